// PosedHull: a body that is a convex polyhedron, such as a drone, at its pose. A ray's test costs two multiplications by a
// vector for each face, so only rays that come close to the hull are tested.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/pose.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// The half spaces of the faces: points p inside the hull have n . p <= offset for each unit normal n.
struct HullPlanes {
  static constexpr std::size_t kMax = 64;

  explicit HullPlanes(std::span<const Vec3> points);  // vertices of a valid DroneModel; their convex hull

  Vec3 normal_at(const Vec3& point) const;  // of the face on which a point of the surface lies; body frame

  std::size_t count = 0;
  // m, body frame; the entries from `count` on are half spaces that contain everything
  alignas(64) std::array<float, kMax> x{}, y{}, z{}, offset{};
  Vec3 half_extents = Vec3::Zero();  // m, of a box around the origin that contains the hull
};

// The normals of a hull's planes in the world frame. All drones near a hull share them, so they are kept until it turns.
struct TurnedPlanes {
  const HullPlanes* planes = nullptr;
  std::array<float, 4> quat_wxyz{};                         // body to world
  Mat3 half_box = Mat3::Zero();                             // m, columns: from the position to three faces of the box
  alignas(64) std::array<float, HullPlanes::kMax> x, y, z;  // as in HullPlanes

  void turn(const HullPlanes& to_turn, const float* quat) {
    if (planes != &to_turn || !std::equal(quat_wxyz.begin(), quat_wxyz.end(), quat)) compute(to_turn, quat);
  }

 private:
  void compute(const HullPlanes& to_turn, const float* quat);
};

struct PosedHull {
  const HullPlanes* planes;
  TurnedPlanes* turned;    // turned when a ray may hit the hull, which is rare
  const float* quat_wxyz;  // body to world
  Vec3 position;           // m, world frame
  float radius;            // m, of the ball around the position that contains it
  std::int32_t element;    // number of the body in hits
};

// Keeps hits on hulls that are nearer than t_hit. Like other solids, a hull is visible from inside, too. The distances do not
// depend on the order of the hulls; if several are hit at the same distance, the element is that of the first one.
void trace_hulls(std::span<const PosedHull> hulls, RayBundle& rays);

}  // namespace flockstep::trace
