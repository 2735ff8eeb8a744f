// Limits: the values that a number may take, written once. Checks, schemas, docstrings and tables are made from them.
#pragma once

#include <limits>
#include <string>

namespace flockstep {

struct Limits {
  double least = -std::numeric_limits<double>::infinity();
  double greatest = std::numeric_limits<double>::infinity();
  bool excludes_least = false;
  bool excludes_greatest = false;

  // False for NaN and for infinities.
  constexpr bool contain(double value) const {
    constexpr double kInfinity = std::numeric_limits<double>::infinity();
    const bool is_above = excludes_least ? value > least : value >= least;
    const bool is_below = excludes_greatest ? value < greatest : value <= greatest;
    return is_above && is_below && value > -kInfinity && value < kInfinity;
  }

  // As a message says it: "in (0, 360]", ">= 0", "> 0", "< 1"; empty if every finite number is allowed.
  std::string text() const;
};

constexpr Limits at_least(double least) { return {.least = least}; }
constexpr Limits above(double least) { return {.least = least, .excludes_least = true}; }
constexpr Limits between(double least, double greatest) { return {.least = least, .greatest = greatest}; }
constexpr Limits above_up_to(double least, double greatest) {
  return {.least = least, .greatest = greatest, .excludes_least = true};
}
constexpr Limits within(double magnitude) { return between(-magnitude, magnitude); }

}  // namespace flockstep
