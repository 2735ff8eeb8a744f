// Limits: the range of values of a number, defined once. Checks, schemas, docstrings and tables are made from it.
#pragma once

#include <array>
#include <cstddef>
#include <limits>
#include <string>
#include <type_traits>

#include "flockstep/export.hpp"

namespace flockstep {

// Limit of the world: positions, ray origins and geometry lie within +-kMaxCoordinate along each axis. float32 resolves 6 cm
// there, and its squares are far from overflow.
inline constexpr double kMaxCoordinate = 1e6;  // m

struct Limits {
  double least = -std::numeric_limits<double>::infinity();    // lower limit
  double greatest = std::numeric_limits<double>::infinity();  // upper limit
  bool excludes_least = false;                                // the lower limit itself is not allowed
  bool excludes_greatest = false;                             // the upper limit itself is not allowed
  bool or_zero = false;                                       // 0 is allowed in addition

  std::array<int, 4> choices{};  // allowed values, instead of a range
  std::size_t num_choices = 0;   // number of choices; 0: a range

  // Returns false for NaN and infinities. A float is compared with the float32 nearest to a limit, so 0.1F is at least 0.1.
  template <class Number>
  constexpr bool contain(Number number) const {
    using Real = std::conditional_t<std::is_same_v<Number, float>, float, double>;
    constexpr Real kInfinity = std::numeric_limits<Real>::infinity();
    const auto value = static_cast<Real>(number);
    for (std::size_t i = 0; i < num_choices; ++i) {
      if (value == static_cast<Real>(choices[i])) return true;
    }
    if (num_choices > 0) return false;
    if (or_zero && value == Real{}) return true;
    const auto low = static_cast<Real>(least), high = static_cast<Real>(greatest);
    return (excludes_least ? value > low : value >= low) && (excludes_greatest ? value < high : value <= high) &&
           value > -kInfinity && value < kInfinity;
  }

  // Returns true if both limits are finite.
  constexpr bool are_bounded() const {
    return least > -std::numeric_limits<double>::infinity() && greatest < std::numeric_limits<double>::infinity();
  }

  // Returns text for messages: "in (0, 360]", "within +-100", ">= 0", "< 1", "1, 4 or 9"; empty if every finite number is
  // allowed. It leaves out `or_zero`, which stands before the noun: "0 or a number in [0.1, 45]".
  FLOCKSTEP_API std::string text() const;
};

constexpr Limits at_least(double least) { return {.least = least}; }                                        // >= least
constexpr Limits above(double least) { return {.least = least, .excludes_least = true}; }                   // > least
constexpr Limits between(double least, double greatest) { return {.least = least, .greatest = greatest}; }  // [least, greatest]
// (least, greatest]
constexpr Limits above_up_to(double least, double greatest) {
  return {.least = least, .greatest = greatest, .excludes_least = true};
}
// (least, greatest)
constexpr Limits between_excluding(double least, double greatest) {
  return {.least = least, .greatest = greatest, .excludes_least = true, .excludes_greatest = true};
}
// 0 or [least, greatest]
constexpr Limits zero_or_between(double least, double greatest) {
  return {.least = least, .greatest = greatest, .or_zero = true};
}
// One of four numbers.
constexpr Limits one_of(int a, int b, int c, int d) { return {.choices = {a, b, c, d}, .num_choices = 4}; }
constexpr Limits within(double magnitude) { return between(-magnitude, magnitude); }  // [-magnitude, magnitude]

}  // namespace flockstep
