// Visibility: the role of an object or a body.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/fields.hpp"

namespace flockstep {

// Role of an object. Visual objects are detected by cameras, LiDARs and rays. Solid objects are hit by drones, avoided by
// planners and measured by distances. A room is always both (full).
enum class Visibility : std::uint8_t { full, visual, solid };
template <>
struct EnumNames<Visibility> {
  static constexpr std::array kNames{"full", "visual", "solid"};
};
// Returns true if cameras, LiDARs and rays detect it.
inline bool is_visible(Visibility visibility) { return visibility != Visibility::solid; }
// Returns true if drones hit it.
inline bool is_solid(Visibility visibility) { return visibility != Visibility::visual; }

}  // namespace flockstep
