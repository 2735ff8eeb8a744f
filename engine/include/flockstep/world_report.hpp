// WorldReport: what to look at before flying in a world from elsewhere.
#pragma once

#include <cstddef>
#include <string>

#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

struct WorldReport {
  std::size_t triangles = 0, objects = 0;  // of meshes; an object is what cameras number
  // Edges of triangles, vertices at the same place being one. Open: of one triangle alone; a closed body has none, ground has
  // them around it. Crowded: of more than two.
  std::size_t open_edges = 0, crowded_edges = 0;
  std::size_t texture_bytes = 0;  // of all textures, as they lie in memory: 4 for a pixel
  // Why the navigation tasks cannot fly this drone here, as they would say; empty where they can.
  std::string not_navigable;
};

FLOCKSTEP_API WorldReport check(const World& world, const DroneModel& drone);

}  // namespace flockstep
