// trace::Scene: one world, prepared for ray tracing, with queries for each kind of geometry. A Tracer combines them.
//
// Elements that are not visual keep their number and are never hit.
//
// Primitives are traced directly if few are within range (see CandidateSet), otherwise by Embree. Triangles are traced by
// Embree, or by a separate tree for tiles of rays.
#pragma once

#include <algorithm>
#include <array>
#include <cstdint>
#include <memory>
#include <memory_resource>
#include <mutex>
#include <span>
#include <vector>

#include "flockstep/world.hpp"
#include "trace/calibrated.hpp"
#include "trace/direct.hpp"
#include "trace/echoes.hpp"
#include "trace/embree.hpp"
#include "trace/masks.hpp"
#include "trace/mesh_tree.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"
#include "trace/shape_tree.hpp"

namespace flockstep::trace {

// Called for every element near a point; returns the remaining search radius (m), which shrinks in a search for the nearest one.
// An element is an index into World::primitives(), or primitives().size() + triangle index.
using NearCallback = float (*)(void* context, std::uint32_t element);

// The shapes that the rays of one sensor may hit: those whose bounding boxes are within its range. Filled by Scene::gather.
struct CandidateSet {
  std::array<Candidate, kMaxCandidates> list;
  std::size_t count = 0;
  bool crowded = false;    // more shapes are in range than fit
  bool triangles = false;  // some triangles are in range
};

class Scene {
 public:
  // The world must outlive the scene. Up to max_direct primitives, rays of arbitrary origins are tested against each of them.
  explicit Scene(const World& world, std::pmr::memory_resource& memory = *std::pmr::get_default_resource(),
                 std::size_t max_direct = kMaxDirectAnyOrigin);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  const World& world() const { return *world_; }

  // Gathers the shapes that rays from the origin may hit between near_m and range_m. Markers are included if `markers` is set;
  // they are numbered after the triangles.
  void gather(const Vec3& origin, float near_m, float range_m, bool markers, CandidateSet& candidates) const;

  // Each keeps its hits that are nearer than the block's t_hit. A ray's result has the same bits in any block and beside any
  // other rays. Call under FlushDenormals.
  void intersect_primitives(RayBlock& rays, bool embree = false) const;  // embree: use Embree if prepare_embree() was called
  void intersect_casters(RayBlock& rays) const;                          // casters()
  void intersect_markers(RayBlock& rays) const;
  // Returns the number of packets traced by Embree. details: null if only distances are needed.
  std::size_t intersect_triangles(RayBlock& rays, HitDetails* details, Through through = Through::nothing) const;
  // The same for a camera's tile, through masks. Its rows of kTileWidth rays go through Embree together, so a ray's bits can
  // depend on the rest of the tile.
  std::size_t intersect_triangles(RayBundle& tile, HitDetails& details) const;

  // Builds the tree for tiles of rays, unless it exists. Call this before tiles(). mesh: the world's mesh.
  void prepare_tiles(const TriangleMesh& mesh) const;
  const MeshTree* tiles() const { return tiles_.get(); }                     // null before prepare_tiles() or without triangles
  const Masks* masks() const { return masks_.empty() ? nullptr : &masks_; }  // masks of the triangles, or null
  // Builds what LiDARs with more than ranges read, unless it exists. Call this before echoes().
  void prepare_echoes() const;
  const Echoes* echoes() const { return echoes_.get(); }  // null before prepare_echoes()
  // Builds the Embree scene for intersect_primitives(), unless it exists. Rooms are never in it, since every ray hits them.
  void prepare_embree() const;
  // Returns true if a LiDAR may need Embree: for triangles, or for more primitives than are traced directly.
  bool may_need_embree() const { return meshes_ || traced().size() > kMaxDirect; }
  std::size_t num_triangles() const { return num_triangles_; }
  std::int32_t first_triangle() const { return static_cast<std::int32_t>(shapes_.size()); }

  const Shape& shape(std::size_t primitive) const { return shapes_[primitive].shape; }
  std::span<const NumberedShape> markers() const { return markers_; }
  std::span<const NumberedShape> casters() const { return traced().subspan(num_rooms_); }  // all primitives except the rooms

  // The broad phase of collision: calls back for each element except rooms whose bounding box is within radius (m) of center,
  // and possibly for some others. Allocates nothing; safe from many threads.
  void for_each_near(const Vec3& center, float radius, NearCallback callback, void* context) const;

  // Prefetches the data that every sensor and every motion reads first. The scene itself must already be in the cache.
  void prefetch_parts() const {
    tree_.prefetch_parts();
    prefetch(shapes_.data(), std::min(shapes_.size(), std::size_t{2}) * sizeof(NumberedShape));
  }

 private:
  struct Release {
    void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  };
  using EmbreeScene = std::unique_ptr<RTCSceneTy, Release>;

  struct EmbreePrimitives;  // all visible primitives except the rooms, for Embree
  EmbreeScene new_scene() const;
  std::unique_ptr<const EmbreePrimitives> make_embree_primitives() const;
  void add_candidate(const Shape& shape, std::int32_t element, const Vec3& origin, CandidateSet& candidates) const;
  void add_primitives(std::span<const Primitive> primitives, std::size_t max_direct);
  void add_triangles(const World& world);
  void attach_triangles(const TriangleMesh& mesh, bool masked);
  void commit(RTCScene scene) const;

  std::span<const NumberedShape> traced() const { return is_all_visible_ ? shapes_ : visible_; }

  std::pmr::vector<NumberedShape> shapes_;   // all primitives, in the order of their elements: rooms first
  std::pmr::vector<NumberedShape> visible_;  // the visual ones among them; empty if all are
  bool is_all_visible_ = true;
  std::pmr::vector<NumberedShape> markers_;  // start, waypoints, goal
  std::size_t num_rooms_ = 0;
  ShapeTree tree_;  // visible primitives except the rooms
  Masks masks_;
  Vec3 mesh_center_, mesh_half_;                               // m, bounding box, slightly wider than the triangles
  mutable std::shared_ptr<RTCDeviceTy> device_;                // null until Embree is needed
  std::unique_ptr<const EmbreePrimitives> embree_primitives_;  // null if there are few
  std::size_t num_triangles_ = 0;
  EmbreeScene meshes_;         // visible triangles; null without any
  bool wide_packets_ = false;  // the processor supports packets of 16
  mutable std::mutex prepared_mutex_;
  mutable std::unique_ptr<const EmbreePrimitives> prepared_embree_primitives_;  // null until prepared
  mutable std::unique_ptr<const MeshTree> tiles_;                               // null until prepared
  mutable std::unique_ptr<const Echoes> echoes_;                                // null until prepared
  const World* world_;
};

}  // namespace flockstep::trace
