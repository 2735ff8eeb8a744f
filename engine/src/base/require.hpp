// Refusing bad input: one sentence that names the field, what was expected and what came.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <sstream>
#include <stdexcept>
#include <string>
#include <string_view>

namespace flockstep {

template <class Got>
[[noreturn]] void refuse(std::string_view field, std::string_view expected, const Got& got) {
  std::ostringstream message;
  message << field << ": expected " << expected << ", got " << got;
  throw std::invalid_argument(message.str());
}

template <class Got>
void require(bool holds, std::string_view field, std::string_view expected, const Got& got) {
  if (!holds) refuse(field, expected, got);
}

inline void require_finite(float value, std::string_view field) {
  require(std::isfinite(value), field, "a finite number", value);
}

inline void require_positive(float value, std::string_view field) {
  require(std::isfinite(value) && value > 0.0F, field, "a finite number > 0", value);
}

inline void require_not_negative(float value, std::string_view field) {
  require(std::isfinite(value) && value >= 0.0F, field, "a finite number >= 0", value);
}

// A sensor's mount in the body frame, m: at most as far out as the points of a hull may be.
inline void require_mount(const std::array<float, 3>& offset_m, std::string_view field) {
  for (const float value : offset_m) require(std::abs(value) <= 100.0F, field, "numbers within +-100", value);
}

inline void require_unit_quaternion(const std::array<float, 4>& quat_wxyz, std::string_view field) {
  float norm = 0.0F;
  for (const float value : quat_wxyz) norm += value * value;
  norm = std::sqrt(norm);
  require(std::abs(norm - 1.0F) < 1e-2F, field, "a unit quaternion (w, x, y, z)", "one of norm " + std::to_string(norm));
}

// A name that can be part of a file's.
inline void require_plain_name(const std::string& name, std::string_view field) {
  const auto is_plain = [](char c) {
    return (c >= '0' && c <= '9') || (c >= 'A' && c <= 'Z') || (c >= 'a' && c <= 'z') || c == '_' || c == '-';
  };
  require(!name.empty() && std::all_of(name.begin(), name.end(), is_plain), field, "letters, digits, _ and -", '"' + name + '"');
}

}  // namespace flockstep
