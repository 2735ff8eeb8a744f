// refusal(): the message with which a call refuses its input.
#pragma once

#include <stdexcept>
#include <string>

namespace flockstep::testing {

// Returns the message of the std::invalid_argument that the call throws, or "accepted".
template <class Call>
std::string refusal(const Call& call) {
  try {
    call();
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

}  // namespace flockstep::testing
