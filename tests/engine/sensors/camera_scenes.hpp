// Worlds and cameras for tests of images.
#pragma once

#include "batch_helpers.hpp"
#include "picture_oracle.hpp"
#include "sensors/camera.hpp"

namespace flockstep::scenes {

using enum PrimitiveKind;
using namespace testing;

inline Quat turned(float degrees, const Vec3& axis) {
  return Quat(Eigen::AngleAxisf(degrees * std::numbers::pi_v<float> / 180.0F, axis.normalized()));
}

inline std::array<float, 4> wxyz(const Quat& q) { return {q.w(), q.x(), q.y(), q.z()}; }

inline CameraConfig camera_of(int width, int height, float hfov_deg = 90.0F) {
  return {.width_px = width, .height_px = height, .hfov_deg = hfov_deg, .outputs = kAllOutputs};
}

// Adds a square of two triangles around the x axis at a fixed x, visible from both sides.
inline void add_square(TriangleMesh& mesh, float x, float half, std::uint16_t material = 0, std::uint16_t object = 0) {
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (const auto& [y, z] : {std::pair{-half, -half}, {half, -half}, {half, half}, {-half, half}})
    mesh.vertices.emplace_back(x, y, z);
  for (const auto& [a, b, c] : {std::array{0, 1, 2}, {0, 2, 3}}) {
    mesh.triangles.push_back({first + a, first + b, first + c});
    mesh.materials.push_back(material);
    mesh.objects.push_back(object);
  }
}

// Returns the number of pixels with an instance id.
inline std::size_t count_of(const Batch& batch, int instance) {
  const auto& all = batch.camera(0).images().instance;
  return static_cast<std::size_t>(std::count(all.begin(), all.end(), instance));
}

// -- Semantic and instance ids.

// One primitive of each kind, two meshes of two materials each, and markers, every 30 degrees around the origin at 4 m, all in
// a room.
struct Ring {
  std::shared_ptr<const World> world;
  struct Thing {
    const char* what;
    int semantic, instance;
  };
  std::vector<Thing> things;  // by angle
  static Quat towards(std::size_t i) { return turned(30.0F * static_cast<float>(i), Vec3::UnitZ()); }
};

inline Ring ring() {
  SceneDescription description;
  description.materials.clear();
  for (int i = 0; i < 10; ++i) {
    const float part = 0.1F * static_cast<float>(i);
    // Some materials set their class, the others get a number.
    description.materials.push_back({std::string(1, static_cast<char>('a' + i)),
                                     {1.0F - part, part, 0.5F},
                                     static_cast<std::uint16_t>(i % 3 == 0 ? 1000 + i : 0)});
  }
  Ring ring;
  const auto at = [](std::size_t i) { return Vec3(Ring::towards(i) * Vec3(4, 0, 0)); };
  const std::vector<std::pair<PrimitiveKind, Vec3>> kinds{{box, {0.5F, 0.5F, 0.5F}},    {cylinder, {0.5F, 0.5F, 1}},
                                                          {sphere, {0.5F, 0.5F, 0.5F}}, {capsule, {0.5F, 0.5F, 1}},
                                                          {plane, {0.5F, 0.5F, 0}},     {disc, {0.5F, 0.5F, 0}}};
  description.primitives.push_back(primitive(room, {0, 0, 0}, {9, 9, 9}));
  const std::array names{"a box", "a cylinder", "a sphere", "a capsule", "a plane", "a disc"};
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const bool flat = kinds[i].first == plane || kinds[i].first == disc;
    const Quat facing = flat ? Ring::towards(i) * turned(90, Vec3::UnitY()) : Quat::Identity();
    description.primitives.push_back(primitive(kinds[i].first, at(i), kinds[i].second, facing));
    description.primitives.back().material = static_cast<std::uint16_t>(i + 1);
    // The room has instance 1, the others follow in this order. Material i has class i + 1, or 1000 + i.
    ring.things.push_back(
        {names[i], (i + 1) % 3 == 0 ? 1001 + static_cast<int>(i) : static_cast<int>(i) + 2, static_cast<int>(i) + 2});
  }
  // Two meshes. One half of each has material 7, the other material 8.
  for (std::size_t object = 0; object < 2; ++object) {
    TriangleMesh flat;
    add_square(flat, 4.0F, 0.5F, 0, static_cast<std::uint16_t>(object));
    const auto first = static_cast<std::int32_t>(description.mesh.vertices.size());
    for (const Vec3& vertex : flat.vertices) description.mesh.vertices.push_back(Ring::towards(6 + object) * vertex);
    for (std::size_t i = 0; i < 2; ++i) {
      auto triangle = flat.triangles[i];
      for (std::int32_t& vertex : triangle) vertex += first;
      description.mesh.triangles.push_back(triangle);
      description.mesh.materials.push_back(static_cast<std::uint16_t>(7 + i));
      description.mesh.objects.push_back(static_cast<std::uint16_t>(object));
    }
  }
  ring.things.push_back({"a mesh", 8, 8});  // 7 primitives precede it; material 7 has class 8, 8 has 9
  ring.things.push_back({"another mesh", 8, 9});
  description.markers = {.radius = 0.4F, .start = at(8), .waypoints = {at(9), at(10)}, .goal = at(11)};
  ring.things.push_back({"the start", kSemanticStart, 10});
  ring.things.push_back({"a waypoint", kSemanticWaypoint, 11});
  ring.things.push_back({"another waypoint", kSemanticWaypoint, 12});
  ring.things.push_back({"the goal", kSemanticGoal, 13});
  ring.world = std::make_shared<const World>(description);
  return ring;
}

// -- Shadows.

// Objects above a floor in the sun, a room around them, and a marker.
inline std::shared_ptr<const World> yard(bool with_mesh) {
  SceneDescription description;
  description.light.sun_direction = {0.5F, 0.3F, 0.8F};
  description.primitives = {primitive(room, {0, 0, 3}, {6, 6, 3}),
                            primitive(box, {1.5F, 1, 0.6F}, {0.4F, 0.3F, 0.6F}, turned(20, Vec3::UnitZ())),
                            primitive(cylinder, {-1, 1.5F, 1}, {0.3F, 0.3F, 1}),
                            primitive(sphere, {0.5F, -1.5F, 1.2F}, {0.5F, 0.5F, 0.5F}),
                            primitive(capsule, {-1.8F, -1, 1}, {0.25F, 0.25F, 0.8F}, turned(40, {1, 1, 0})),
                            primitive(plane, {2.5F, -2, 1.5F}, {0.6F, 0.4F, 0}),
                            primitive(disc, {-3, 0.5F, 1.5F}, {0.5F, 0.5F, 0}, turned(30, {1, 0, 0}))};
  description.markers.goal = Vec3(3, 3, 1);
  if (with_mesh) {
    description.mesh.vertices = {{0, 3, 1}, {1.5F, 3, 1}, {0.5F, 4, 2}, {-0.5F, 2.5F, 0.5F}};
    description.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  }
  return std::make_shared<const World>(description);
}

}  // namespace flockstep::scenes
