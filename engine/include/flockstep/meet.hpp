// Meet: how the drones of an env interact.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/fields.hpp"

namespace flockstep {

enum class Meet : std::uint8_t { never, seen, touched, both };
template <>
struct EnumNames<Meet> {
  static constexpr std::array kNames{"never", "seen", "touched", "both"};
};
// True if sensors detect the other drones.
inline bool is_seen(Meet meet) { return meet == Meet::seen || meet == Meet::both; }
// True if drones hit each other.
inline bool is_touched(Meet meet) { return meet == Meet::touched || meet == Meet::both; }

}  // namespace flockstep
