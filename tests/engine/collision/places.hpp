// Static worlds for tests of sweeps.
#pragma once

#include <random>

#include "allocation_counter.hpp"
#include "collide.hpp"
#include "collision/sweep.hpp"
#include "convex_oracle.hpp"
#include "random.hpp"

namespace flockstep::collision::places {

using namespace testing;

inline constexpr float kDegree = std::numbers::pi_v<float> / 180.0F;

inline const Hull& hull() {
  static const Hull body(quadrotor());
  return body;
}

inline Primitive make(PrimitiveKind kind, const Vec3& center, const Vec3& half_extents, const Quat& rotation = Quat::Identity()) {
  return {.kind = kind, .center = center, .rotation = rotation, .half_extents = half_extents};
}

// A world and its collision data.
struct Place {
  explicit Place(std::vector<Primitive> primitives, TriangleMesh mesh = {})
      : world(describe(std::move(primitives), std::move(mesh))), scene(world), obstacles(world, scene) {}
  Contact sweep(const Pose& from, const Pose& to) const { return collision::sweep(obstacles, hull(), from, to); }
  bool overlaps(const Pose& pose) const { return collision::overlaps(obstacles, hull(), pose); }
  World world;
  trace::Scene scene;
  Obstacles obstacles;

 private:
  static SceneDescription describe(std::vector<Primitive> primitives, TriangleMesh mesh) {
    SceneDescription description;
    description.primitives = std::move(primitives);
    description.mesh = std::move(mesh);
    return description;
  }
};

inline Pose at(float x, float y, float z, const Quat& rotation = Quat::Identity()) { return {{x, y, z}, rotation}; }
inline Quat turn(float degrees, const Vec3& axis) { return Quat(Eigen::AngleAxisf(degrees * kDegree, axis)); }
inline Quat yaw(float degrees) { return turn(degrees, Vec3::UnitZ()); }

}  // namespace flockstep::collision::places
