// PosedHull: a body that is a convex polyhedron, such as a drone, at its pose. A ray's test costs two multiplications by a
// vector for each face, so only rays that come close to the hull are tested.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/pose.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// The half spaces of the faces: points p inside the hull have n . p <= offset for each unit normal n.
struct HullPlanes {
  static constexpr std::size_t kMost = 64;

  explicit HullPlanes(std::span<const Vec3> points);  // of a valid DroneModel; their convex hull

  std::size_t count = 0;
  // m, body frame; the entries from `count` on are half spaces that contain everything
  alignas(64) std::array<float, kMost> x{}, y{}, z{}, offset{};
};

struct PosedHull {
  const HullPlanes* planes;
  Vec3 position;         // m, world frame
  Quat rotation;         // body to world
  float radius;          // m, of the ball around the position that contains it
  std::int32_t element;  // number of the body in hits
};

// Keeps hits on hulls that are nearer than t_hit. Like other solids, a hull is visible from inside, too.
void trace_hulls(std::span<const PosedHull> hulls, RayBundle& rays);

}  // namespace flockstep::trace
