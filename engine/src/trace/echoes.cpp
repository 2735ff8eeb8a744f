#include "trace/echoes.hpp"

#include <algorithm>
#include <cstddef>

#include "trace/ray_block.hpp"
#include "world/triangle_normal.hpp"

namespace flockstep::trace {

Echoes::Echoes(const World& world) {
  const TriangleMesh& mesh = world.triangles();
  const std::size_t triangles = mesh.triangles.size();
  first_triangle = static_cast<std::int32_t>(world.primitives().size());
  num_elements = first_triangle + static_cast<std::int32_t>(triangles);
  const auto add = [&](std::size_t material, std::size_t object) {
    const Echo echo = echo_of(world.materials()[material].base_color, world.semantic(material),
                              static_cast<std::uint16_t>(1 + object));  // numbers start at 1
    ids.push_back(echo.ids);
    reflectance.push_back(echo.reflectance);
  };
  const std::size_t entries = std::max(static_cast<std::size_t>(num_elements) + 1, 2 * kRayPadding);
  ids.reserve(entries);
  reflectance.reserve(entries);
  ids.push_back(0);
  reflectance.push_back(0.0F);
  for (const Primitive& primitive : world.primitives()) add(primitive.material, ids.size() - 1);
  for (std::vector<float>* const axis : {&normal_x, &normal_y, &normal_z}) axis->reserve(triangles);
  for (std::size_t i = 0; i < triangles; ++i) {
    add(mesh.materials[i], world.primitives().size() + mesh.objects[i]);
    const Vec3 normal = triangle_normal(mesh, i).cast<float>();
    normal_x.push_back(normal.x());
    normal_y.push_back(normal.y());
    normal_z.push_back(normal.z());
  }
  ids.resize(entries);
  reflectance.resize(entries);
}

}  // namespace flockstep::trace
