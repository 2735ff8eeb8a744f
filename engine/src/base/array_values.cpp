#include <cmath>
#include <cstdint>
#include <span>
#include <string>
#include <type_traits>
#include <utility>

#include "base/require.hpp"
#include "flockstep/arrays.hpp"

namespace flockstep {
namespace {

constexpr std::int64_t kMaxCounted = std::int64_t{1} << 62;  // leaves headroom for increments

const char* text_of(Values allowed) {
  switch (allowed) {
    case Values::any:
      return "a number";
    case Values::finite:
      return "finite numbers";
    case Values::flag:
      return "0 or 1";
    case Values::count:
      return "a number in [0, 2^62]";
    case Values::last_count:
      return "a number in [-1, 2^62]";
    case Values::fraction:
      return "a number in [0, 1]";
    case Values::range:
      return "ranges >= 0";
  }
  return "";
}

template <class T>
bool is_allowed(T value, Values allowed) {
  const auto is_counted_from = [value](std::int64_t least) {
    if constexpr (std::is_floating_point_v<T>) {
      return value >= static_cast<T>(least) && value <= static_cast<T>(kMaxCounted);
    } else {
      return std::cmp_greater_equal(value, least) && std::cmp_less_equal(value, kMaxCounted);
    }
  };
  switch (allowed) {
    case Values::any:
      return true;
    case Values::finite:
      return std::isfinite(static_cast<double>(value));
    case Values::flag:
      return value == T{0} || value == T{1};
    case Values::count:
      return is_counted_from(0);
    case Values::last_count:
      return is_counted_from(-1);
    case Values::fraction:
      return value >= T{0} && value <= T{1};
    case Values::range:
      return value >= T{0};
  }
  return false;
}

template <class T>
void check(std::span<const T> values, const char* name, Values allowed) {
  for (const T value : values) {
    if (!is_allowed(value, allowed)) refuse(std::string("snapshot: ") + name, text_of(allowed), +value);
  }
}

}  // namespace

void check_values(std::span<const std::uint8_t> values, const char* name, Values allowed) { check(values, name, allowed); }
void check_values(std::span<const std::uint16_t> values, const char* name, Values allowed) { check(values, name, allowed); }
void check_values(std::span<const std::int32_t> values, const char* name, Values allowed) { check(values, name, allowed); }
void check_values(std::span<const std::int64_t> values, const char* name, Values allowed) { check(values, name, allowed); }
void check_values(std::span<const std::uint64_t> values, const char* name, Values allowed) { check(values, name, allowed); }
void check_values(std::span<const float> values, const char* name, Values allowed) { check(values, name, allowed); }
void check_values(std::span<const double> values, const char* name, Values allowed) { check(values, name, allowed); }

}  // namespace flockstep
