// PosedMesh: a body that is a mesh, at its pose. Rays are traced in its own frame, so nothing is built when it moves.
#pragma once

#include <cstddef>
#include <cstdint>

#include "flockstep/pose.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

class Scene;

struct PosedMesh {
  const Scene* scene;    // of the mesh, in the body's frame
  Vec3 position;         // m, world frame
  Mat3 to_local;         // rotation, world to body
  float radius;          // m, of the ball around the position that contains it
  std::int32_t element;  // number of the body in hits

  Vec3 local_point(const Vec3& point) const { return rotated(to_local, point - position); }
  // Returns the rotation from a sensor's frame to the body's; to_world: from the sensor's to the world's.
  Mat3 local_rotation(const Mat3& to_world) const {
    Mat3 rotation;
    for (int axis = 0; axis < 3; ++axis) rotation.col(axis) = rotated(to_local, to_world.col(axis));
    return rotation;
  }
};

// Rays of one block or bundle that may hit a mesh, in its frame.
struct MeshRays {
  RayBlock rays;
  std::size_t of[kMaxRays];  // their numbers in the block or bundle
};

// Copies the rays that come within the mesh's ball before their hits.
void select_rays(const PosedMesh& mesh, const RayBundle& bundle, MeshRays& selected);
void select_rays(const PosedMesh& mesh, const RayBlock& block, MeshRays& selected);

// Returns true if no ray of the bundle can reach the mesh; may return false in that case, too.
bool is_beside(const PosedMesh& mesh, const RayBundle& bundle);

}  // namespace flockstep::trace
