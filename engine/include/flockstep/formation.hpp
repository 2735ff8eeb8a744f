// Formations: places of drones relative to a leader.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

// Shape of a formation. The leader flies in direction +x.
enum class FormationShape : std::uint8_t {
  line,    // abreast of the leader, alternately left and right
  column,  // one behind the other
  v,       // behind the leader, alternately left and right, on two lines at 45 degrees
  circle,  // around the leader, the first in front of it
};
template <>
struct EnumNames<FormationShape> {
  static constexpr std::array kNames{"line", "column", "v", "circle"};
};

// Returns the places of `count` drones, m, relative to the leader, which has no place among them. Neighbours in the formation are
// spacing_m (m) apart, and none is nearer than that to the leader; on a circle of fewer than six drones they are farther apart.
FLOCKSTEP_API std::vector<Vec3> formation_places(FormationShape shape, std::size_t count, float spacing_m);

}  // namespace flockstep
