// Checks worlds whose triangles are the mesh of a body or a drone.
#pragma once

#include <string>

#include "flockstep/world.hpp"

namespace flockstep {

// Throws std::invalid_argument that names the field unless the world has triangles, and neither primitives nor bodies.
void require_mesh(const World& world, const std::string& field);

}  // namespace flockstep
