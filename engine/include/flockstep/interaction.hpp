// Interaction: how the drones of an env interact.
#pragma once

#include <array>
#include <cstdint>

#include "flockstep/fields.hpp"

namespace flockstep {

enum class Interaction : std::uint8_t { none, sense, collide, both };
template <>
struct EnumNames<Interaction> {
  static constexpr std::array kNames{"none", "sense", "collide", "both"};
};
// True if sensors detect the other drones.
inline bool senses(Interaction interaction) { return interaction == Interaction::sense || interaction == Interaction::both; }
// True if drones hit each other.
inline bool collides(Interaction interaction) { return interaction == Interaction::collide || interaction == Interaction::both; }

}  // namespace flockstep
