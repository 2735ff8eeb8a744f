// AnyWorld: random worlds that use every feature of a scene except gates and bodies, for tests of formats.
#pragma once

#include <random>

#include "flockstep/world.hpp"
#include "standard.hpp"
#include "world/scene_description.hpp"

namespace flockstep::testing {

class AnyWorld {
 public:
  explicit AnyWorld(unsigned seed) : random_(seed) {}

  World make() {
    SceneDescription scene;
    scene.name = name();
    scene.materials.clear();
    for (int i = below(4); i > 0; --i) add_texture(scene.textures);
    for (int i = 1 + below(4); i > 0; --i) {
      Material material{name(), {share(), share(), share()}, static_cast<std::uint16_t>(below(2) * below(65533))};
      if (!scene.textures.empty() && below(2) == 0) {
        material.texture = static_cast<std::uint16_t>(below(static_cast<int>(scene.textures.size())));
      }
      if (below(2) == 0) material.emissive = {share(), below(2) == 0 ? 100.0F * share() : 0.0F, 0.1F};
      if (below(2) == 0) material.alpha_cutoff = share();
      scene.materials.push_back(material);
    }
    for (int kind = 0; kind < 7; ++kind) {
      for (int i = kind == 0 ? below(2) : below(4); i > 0; --i) add_primitive(scene, static_cast<PrimitiveKind>(kind));
    }
    add_triangles(scene);
    Markers& markers = scene.markers;
    markers.radius = size();
    if (below(2) == 0) markers.start = point();
    if (below(2) == 0) markers.goal = point();
    for (int i = below(13); i > 0; --i) markers.waypoints.push_back(point());
    if (below(2) == 0) {
      const Vec3 a = point(), b = point();
      markers.spawn_box = Aabb{a.cwiseMin(b), a.cwiseMax(b)};
    }
    if (below(2) == 0) {
      const auto color = [&] { return std::array<float, 3>{100 * share(), share(), 0.0F}; };
      scene.light = {{coordinate(), coordinate(), size()},
                     color(),
                     color(),
                     color(),
                     color(),
                     color(),
                     1.0F + 3 * share(),
                     below(2) == 0 ? 0.0F : 0.1F + 44.0F * share(),
                     share(),
                     below(2) == 0 ? 0.0F : 0.1F + 99.0F * share()};
    }
    return World(std::move(scene));
  }

 private:
  int below(int n) { return std::uniform_int_distribution<int>(0, n - 1)(random_); }
  float share() { return std::uniform_real_distribution<float>(0.0F, 1.0F)(random_); }
  float size() { return std::pow(10.0F, 8.0F * share() - 5.0F) * (0.5F + share()); }

  // Returns ordinary values, and values that could lose their last bit or their sign.
  float coordinate() {
    const float ordinary = 200.0F * share() - 100.0F;
    constexpr float kTiny = std::numeric_limits<float>::denorm_min();
    const std::array<float, 8> special{0.0F, -0.0F, kTiny, -1e-30F, 1e6F, -999999.9F, 1.0F / 3.0F, -1.0F};
    return below(4) == 0 ? special[static_cast<std::size_t>(below(8))] : ordinary;
  }
  Vec3 point() { return {coordinate(), coordinate(), coordinate()}; }

  std::string name() {
    const std::array<std::string, 5> stems{"", "wood ", "\"quoted\\", "Stra\xc3\x9f\x65 ", "waypoint."};
    const bool is_empty = names_++ % 50 == 3;  // at most one per kind of object
    return is_empty ? "" : stems[static_cast<std::size_t>(below(5))] + std::to_string(names_);
  }

  Quat rotation() {
    if (below(4) == 0) return Quat::Identity();
    if (below(4) == 0) return Quat(0.0F, -0.0F, below(2) == 0 ? 1.0F : -1.0F, 0.0F);
    return Quat(share() - 0.5F, share() - 0.5F, share() - 0.5F, share() - 0.5F).normalized();
  }

  void add_texture(std::vector<Texture>& textures) {
    Texture texture{.name = name(), .width_px = 1 + below(9), .height_px = 1 + below(9)};
    for (int i = 4 * texture.width_px * texture.height_px; i > 0; --i) {
      texture.rgba.push_back(static_cast<std::uint8_t>(below(256)));
    }
    texture.wrap = {static_cast<TextureWrap>(below(3)), static_cast<TextureWrap>(below(3))};
    textures.push_back(std::move(texture));
  }

  void add_primitive(SceneDescription& scene, PrimitiveKind kind) {
    Primitive primitive{.kind = kind, .center = point(), .rotation = rotation(), .half_extents = {size(), size(), size()}};
    Vec3& half = primitive.half_extents;
    if (kind == PrimitiveKind::room || kind == PrimitiveKind::sphere) primitive.rotation = Quat::Identity();
    if (kind == PrimitiveKind::room) primitive.center = primitive.center.cwiseMin(1e5F).cwiseMax(-1e5F);
    if (kind != PrimitiveKind::room && kind != PrimitiveKind::box && kind != PrimitiveKind::plane) half.y() = half.x();
    if (kind == PrimitiveKind::sphere) half.z() = half.x();
    if (kind == PrimitiveKind::capsule) half.z() = std::max(half.z(), half.x());
    if (kind == PrimitiveKind::plane || kind == PrimitiveKind::disc) half.z() = -0.0F;
    primitive.material = static_cast<std::uint16_t>(below(static_cast<int>(scene.materials.size())));
    scene.primitives.push_back(primitive);
  }

  // Adds at least one triangle. Object numbers have gaps, and materials repeat.
  void add_triangles(SceneDescription& scene) {
    TriangleMesh& mesh = scene.mesh;
    const bool is_colored = below(2) == 0;
    for (int i = 3 + below(30); i > 0; --i) {
      mesh.vertices.push_back(point());
      mesh.uv.push_back({coordinate(), coordinate()});
      if (is_colored) mesh.colors.push_back({share(), share(), 1.0F});
    }
    const auto corner = [&] { return below(static_cast<int>(mesh.vertices.size())); };
    for (int tries = 1 + below(60); tries > 0 || mesh.triangles.empty(); --tries) {
      if (mesh.triangles.empty()) mesh.vertices[0] = {1.0F, 2.0F, static_cast<float>(tries)};
      const std::array<std::int32_t, 3> triangle{corner(), corner(), corner()};
      const auto at = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(triangle[k])]; };
      if (is_degenerate(at(0), at(1), at(2))) continue;
      mesh.triangles.push_back(triangle);
      mesh.materials.push_back(static_cast<std::uint16_t>(below(static_cast<int>(scene.materials.size()))));
      mesh.objects.push_back(static_cast<std::uint16_t>(3 * below(4) + 65526 * (below(20) / 19)));
    }
  }

  std::mt19937 random_;
  int names_ = 0;
};

}  // namespace flockstep::testing
