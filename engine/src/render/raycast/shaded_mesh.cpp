#include "render/raycast/shaded_mesh.hpp"

namespace flockstep::render {

ShadedMesh::ShadedMesh(const BodySurface& surface, const Shading& world)
    : world_(*surface.mesh), shading_(surface.shading), light_(world.light()), tables_(shading_->tables_of_body(world)) {
  for (auto& lit_in : lit_in_) lit_in.resize(tables_.triangles.size());
}

bool ShadedMesh::fits(const BodySurface& surface, const Light& light) const {
  return surface.shading == shading_ && light == light_;
}

void ShadedMesh::turn(const Mat3& to_local) {
  if (!is_turned(to_local)) return;
  to_local_ = to_local;
  const auto turned = [&](const std::array<float, 3>& direction) -> std::array<float, 3> {
    const Vec3 local = trace::rotated(to_local, {direction[0], direction[1], direction[2]});
    return {local.x(), local.y(), local.z()};
  };
  tables_.light.sun_direction = turned(light_.sun_direction);
  tables_.up = turned({0.0F, 0.0F, 1.0F});
  ++generation_;
}

void ShadedMesh::light(std::span<const std::int32_t> triangles, bool shadows) {
  for (const bool shaded : {false, true}) {
    if (shaded && !shadows) break;
    auto& lit_in = lit_in_[shaded ? 1 : 0];
    missing_.clear();
    for (const std::int32_t triangle : triangles) {
      std::uint32_t& generation = lit_in[static_cast<std::size_t>(triangle)];
      if (generation == generation_) continue;
      generation = generation_;
      missing_.push_back(triangle);
    }
    if (!missing_.empty()) shading_->light_triangles(tables_, missing_, shaded);
  }
}

}  // namespace flockstep::render
