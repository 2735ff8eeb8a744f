#include "bodies/mesh_world.hpp"

#include "base/require.hpp"

namespace flockstep {

void require_mesh(const World& world, const std::string& field) {
  require(!world.triangles().triangles.empty(), field, "a world with triangles", "a world without any");
  require(world.primitives().empty(), field, "a world of triangles only",
          std::to_string(world.primitives().size()) + " primitives");
  require(world.bodies().empty(), field, "a world without bodies", std::to_string(world.bodies().size()) + " bodies");
}

}  // namespace flockstep
