// Bodies: the solids of one env that move, as its sensors see them: its bodies, or the drones that see each other. The batch
// owns their arrays. For each sensor, the bodies within range become candidates for direct tracing, so nothing has to be updated
// when a body moves.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/near_memory.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "trace/direct.hpp"
#include "trace/hulls.hpp"
#include "trace/near_balls.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace flockstep::trace {

// PosedMesh: a body that is a mesh, at its pose. Rays are traced in its own frame, so nothing is built when it moves.
class Scene;

struct PosedMesh {
  const Scene* scene;    // the mesh's scene, in the body's frame
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

struct Bodies {
  const float* position = nullptr;   // (count, 3) m, world frame
  const float* quat_wxyz = nullptr;  // (count, 4) body to world
  const float* radius = nullptr;     // (count,) m, of the ball around the position that contains it; negative: not visible
  const Primitive* const* solids = nullptr;  // (count,) kind and half_extents; the poses are ignored
  // (count,) scenes of meshes, instead of solids; null for other bodies. Null if there are no meshes.
  const Scene* const* meshes = nullptr;
  // The shape of all of them, if they are drones, instead of solids and meshes: a hull or a mesh.
  const HullPlanes* common_hull = nullptr;
  const Scene* common_mesh = nullptr;
  std::size_t count = 0;
  std::int32_t first_element = 0;  // number of the first body in hits
  std::size_t hidden = kNone;      // number of the drone that carries the sensor, which does not see it

  const BallSlices* slices = nullptr;  // their balls, if many sensors search them

  static constexpr std::size_t kNone = static_cast<std::size_t>(-1);

  // Returns the bodies of one env, if these are the bodies of all envs.
  Bodies of_env(std::size_t env, std::size_t per_env) const {
    if (per_env == 0) return {};
    const std::size_t first = env * per_env;
    return {position + 3 * first,
            quat_wxyz + 4 * first,
            radius + first,
            solids == nullptr ? nullptr : solids + first,
            meshes == nullptr ? nullptr : meshes + first,
            common_hull,
            common_mesh,
            per_env,
            first_element};
  }
  // Returns the drones of one env as one of them sees them, if these are the drones of all envs.
  Bodies seen_by(std::size_t drone, std::size_t per_env) const {
    if (count == 0) return {};
    const std::size_t env = drone / per_env;
    Bodies others = of_env(env, per_env);
    others.hidden = drone - env * per_env;
    return others;
  }
  void prefetch_balls() const {
    prefetch(position, 3 * count * sizeof(float));
    prefetch(radius, count * sizeof(float));
  }
  const Scene* mesh(std::size_t number) const { return meshes == nullptr ? common_mesh : meshes[number]; }
  bool is_visible(std::size_t number) const { return radius[number] >= 0.0F && number != hidden; }
  Balls balls() const { return {position, radius, count}; }
};

inline constexpr Bodies kNoBodies;

// Returns body `number`, which is neither a mesh nor a hull, as a primitive at its current pose.
Primitive posed_solid(const Bodies& bodies, std::size_t number);

// Returns body `number`, which is a mesh.
PosedMesh posed_mesh(const Bodies& bodies, std::size_t number);

// Append shapes and meshes of all visible bodies, for rays of arbitrary origins. Bodies with a common hull have neither.
void append_shapes(const Bodies& bodies, std::vector<NumberedShape>& shapes);
void append_meshes(const Bodies& bodies, std::vector<PosedMesh>& meshes);

// The bodies that the rays of one sensor may hit.
class NearBodies {
 public:
  // Takes those within range_m of the origin. Allocates only if there are more of them than ever before.
  void gather(const Bodies& bodies, const Bodies& drones, const Vec3& origin, float near_m, float range_m);

  void clear() {
    shapes_.clear();
    candidates_.clear();
    meshes_.clear();
    hulls_.clear();
  }
  bool empty() const { return candidates_.empty() && meshes_.empty() && hulls_.empty(); }
  std::span<const Candidate> candidates() const { return candidates_; }  // valid until the next gather()
  std::span<const PosedMesh> meshes() const { return meshes_; }          // valid until the next gather()
  std::span<const PosedHull> hulls() const { return hulls_; }            // valid until the next gather()

 private:
  void add(const Bodies& bodies, const Vec3& origin, float near_m, float range_m);

  std::vector<std::uint32_t> found_;
  std::vector<Shape> shapes_;
  std::vector<Candidate> candidates_;
  std::vector<PosedMesh> meshes_;
  std::vector<PosedHull> hulls_;
  std::vector<TurnedPlanes> turned_;  // by number of the drone; those of the last envs stay until they are needed
};

}  // namespace flockstep::trace
