// WorldReport: properties to check before flying in a world from another source.
#pragma once

#include <cstddef>
#include <string>

#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

struct WorldReport {
  std::size_t triangles = 0, objects = 0;  // triangles of meshes; objects as cameras number them
  // Edges of triangles, with vertices at the same place merged. An open edge belongs to one triangle: a closed body has none,
  // and open ground has them along its border. A crowded edge belongs to more than two triangles.
  std::size_t open_edges = 0, crowded_edges = 0;
  std::size_t texture_bytes = 0;  // memory of all textures, 4 bytes per pixel
  // Reason why the navigation tasks cannot fly this drone here, in the words of their error; empty if they can.
  std::string not_navigable;
};

// Returns the report on a world, for this drone.
FLOCKSTEP_API WorldReport check(const World& world, const DroneModel& drone);

}  // namespace flockstep
