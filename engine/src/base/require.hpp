// Rejects bad input with one sentence that names the field, the expected value and the actual one.
#pragma once

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

// For literals: one type, whatever their length.
[[noreturn]] inline void refuse(std::string_view field, std::string_view expected, const char* got) {
  refuse<const char*>(field, expected, got);
}
inline void require(bool holds, std::string_view field, std::string_view expected, const char* got) {
  if (!holds) refuse(field, expected, got);
}

inline void require_positive(float value, std::string_view field) {
  require(std::isfinite(value) && value > 0.0F, field, "a finite number > 0", value);
}

inline void require_not_negative(float value, std::string_view field) {
  require(std::isfinite(value) && value >= 0.0F, field, "a finite number >= 0", value);
}

// A file that does not exist. Python raises it as flockstep.errors.MissingFileError.
class MissingFile : public std::invalid_argument {
 public:
  using std::invalid_argument::invalid_argument;
};

}  // namespace flockstep
