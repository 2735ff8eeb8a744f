// Refusing bad input: one sentence that names the field, what was expected and what came.
#pragma once

#include <sstream>
#include <stdexcept>
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

}  // namespace flockstep
