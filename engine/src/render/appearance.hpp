// Appearance: what each surface of a world looks like, for whichever backend draws it.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep::render {

struct Surface {
  std::array<float, 3> color{};  // linear RGB
  std::uint16_t semantic = 0;
  std::uint16_t instance = 0;
  std::int32_t texture = -1;  // of triangles: index into World::textures(), or none
  std::array<float, 3> emissive{};

  bool emits() const { return emissive != std::array<float, 3>{}; }
};

// The colours of markers, linear RGB. The blob task tells the goal by its green; see task/color_blob.cpp.
inline constexpr std::array<float, 3> kStartColor{0.8F, 0.03F, 0.02F};
inline constexpr std::array<float, 3> kWaypointColor{0.85F, 0.6F, 0.02F};
inline constexpr std::array<float, 3> kGoalColor{0.02F, 0.6F, 0.05F};

// A marker as cameras see it: a sphere of Markers::radius.
struct MarkerSphere {
  Vec3 center;  // m, world frame
  Surface surface;
};

// The sun as it stands in the sky; see Light, whose q this is about.
struct SunDisc {
  explicit SunDisc(const Light& light);

  bool shows = false;
  std::array<float, 3> color{};  // s
  float edge = 0.0F;             // r^2
  float steepness = 0.0F;        // 1 / (0.19 r^2)
  float glow = 0.0F;
  static constexpr float kFocus = 100.0F;  // how soon the glow fades
};

struct Appearance {
  explicit Appearance(const World& world);

  std::vector<Surface> primitives;    // as World::primitives()
  std::vector<Surface> materials;     // of triangles, by their material; with instance 0
  std::uint16_t first_object = 0;     // instance of the triangles of mesh 0
  std::vector<MarkerSphere> markers;  // start, waypoints, goal
  float marker_radius = 0.25F;        // m
  Light light;
};

// The room of a world whose shadow falls on something: that has something outside it. Only from outside does it hide the sun,
// because rays meet it from within alone.
std::optional<Aabb> shading_room(const World& world);

}  // namespace flockstep::render
