// Appearance: the colours and ids of all surfaces of a world, shared by both rendering backends.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>
#include <vector>

#include "flockstep/body.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "trace/bodies.hpp"

namespace flockstep::render {

struct Surface {
  std::array<float, 3> color{};  // linear RGB
  std::uint16_t semantic = 0;
  std::uint16_t instance = 0;
  std::int32_t texture = -1;  // index into World::textures(), for triangles only; -1 means none
  std::array<float, 3> emissive{};

  bool emits() const { return emissive != std::array<float, 3>{}; }
};

// Marker colours, linear RGB. The blob task finds the goal by its green; see tasks/color_blob.cpp.
inline constexpr std::array<float, 3> kStartColor{0.8F, 0.03F, 0.02F};
inline constexpr std::array<float, 3> kWaypointColor{0.85F, 0.6F, 0.02F};
inline constexpr std::array<float, 3> kGoalColor{0.02F, 0.6F, 0.05F};

// Colour of the hull of a drone without a mesh, linear RGB.
inline constexpr std::array<float, 3> kHullColor{0.4F, 0.4F, 0.4F};

// A marker as cameras render it: a sphere of radius Markers::radius.
struct MarkerSphere {
  Vec3 center;  // m, world frame
  Surface surface;
};

// The sun in the sky. Light defines the formula and the symbols s, r and q.
struct SunDisc {
  explicit SunDisc(const Light& light);

  bool shows = false;
  std::array<float, 3> color{};  // s
  float edge = 0.0F;             // r^2
  float steepness = 0.0F;        // 1 / (0.19 r^2)
  float glow = 0.0F;
  static constexpr float kFocus = 100.0F;  // factor of q in the glow: larger values make the glow fade faster
};

struct Appearance {
  explicit Appearance(const World& world);

  std::vector<Surface> primitives;    // one per element of World::primitives()
  std::vector<Surface> materials;     // one per material, for triangles; instance is 0
  std::uint16_t first_object = 0;     // instance id of the triangles of mesh 0
  std::vector<MarkerSphere> markers;  // start, waypoints, goal
};

// Returns the room of a world if something lies outside it that its shadow can reach. A room hides the sun only from points
// outside it, because rays hit a room only from inside.
std::optional<Aabb> shading_room(const World& world);

// BodySurface: the appearance of a body in camera images.
class Shading;

struct BodySurface {
  std::array<float, 3> color{};  // base colour, linear RGB; not for meshes
  std::uint16_t semantic = 0;
  // Only for meshes. A backend that keeps data of the world shares its ownership.
  const std::shared_ptr<const World>* mesh = nullptr;
  const Shading* shading = nullptr;  // shading of that world, for raycast
};

// The bodies or drones of one env as its cameras see them. Number i has the instance id first_instance + i.
struct VisibleBodies {
  trace::Bodies shapes;                   // first_element is set by the renderer
  const BodySurface* surfaces = nullptr;  // (shapes.count,), or one for all if they have a common mesh
  std::uint16_t first_instance = kFirstBodyInstance;

  const BodySurface& surface(std::size_t number) const { return surfaces[shapes.common_mesh == nullptr ? number : 0]; }
  std::uint16_t instance(std::size_t number) const { return static_cast<std::uint16_t>(first_instance + number); }

  // Returns the bodies of one env, if these are the bodies of all envs.
  VisibleBodies of_env(std::size_t env, std::size_t per_env) const {
    return {shapes.of_env(env, per_env), surfaces + env * per_env, first_instance};
  }
  // Returns the drones of one env as one of them sees them, if these are the drones of all envs.
  VisibleBodies seen_by(std::size_t drone, std::size_t per_env) const {
    return {shapes.seen_by(drone, per_env), surfaces, first_instance};
  }
};

}  // namespace flockstep::render
