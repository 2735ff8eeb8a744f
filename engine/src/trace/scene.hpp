// trace::Scene: one world as rays meet it, and what can be asked of each kind of thing in it. A Tracer puts the questions
// together.
//
// What is not visual is not in it: it keeps its number, and nothing meets it.
//
// Primitives are traced directly where few are within reach (see CandidateSet), and by Embree where many are; triangles by
// Embree, or in tiles of rays by a tree of their own.
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
#include "trace/embree.hpp"
#include "trace/masks.hpp"
#include "trace/mesh_tree.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"
#include "trace/shape_tree.hpp"

namespace flockstep::trace {

// Called for every element (index into World::primitives(), then primitives().size() + triangle index) near a point.
using NearbyCallback = void (*)(void* context, std::uint32_t element);
// The same in a search for what is nearest: returns how far (m) the search still has to look.
using NearerCallback = float (*)(void* context, std::uint32_t element);

// What the rays of one sensor may meet: the shapes whose bounding boxes come within its range. Filled by Scene::gather.
struct CandidateSet {
  std::array<Candidate, kMaxCandidates> list;
  std::size_t count = 0;
  bool crowded = false;    // there are more
  bool triangles = false;  // some are within range
};

class Scene {
 public:
  // Of a world that outlives it. Up to max_direct primitives, rays of any origins are tested against every one.
  explicit Scene(const World& world, std::pmr::memory_resource& memory = *std::pmr::get_default_resource(),
                 std::size_t max_direct = kMaxDirectAnyOrigin);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // Gathers what rays from the origin may meet that see nothing nearer than near_m and nothing beyond range_m. Markers, where
  // they are seen, are numbered on after the triangles.
  void gather(const Vec3& origin, float near_m, float range_m, bool markers, CandidateSet& candidates) const;

  // Each takes what it has that is nearer than the block's t_hit. A ray's result has the same bits in any block, beside any other
  // rays. Call under FlushDenormals.
  void intersect_primitives(RayBlock& rays, bool embree = false) const;  // embree: by Embree wherever prepare_embree() was called
  void intersect_casters(RayBlock& rays) const;                          // all primitives but the rooms
  void intersect_markers(RayBlock& rays) const;
  // Returns how many packets went through Embree. details: null where only distances are of interest.
  std::size_t intersect_triangles(RayBlock& rays, HitDetails* details, Through through = Through::nothing) const;
  // The same for a camera's tile, through masks. Its bits are those of the tile as a whole: its rows of kTileWidth rays go
  // through Embree together.
  std::size_t intersect_triangles(RayBundle& tile, HitDetails& details) const;

  // Builds the tree for tiles of rays, unless it is there: whoever is to call tiles() calls this first. mesh: of the world.
  void prepare_tiles(const TriangleMesh& mesh) const;
  const MeshTree* tiles() const { return tiles_.get(); }                     // null where there are no triangles
  const Masks* masks() const { return masks_.empty() ? nullptr : &masks_; }  // of them, which cameras see through; null: none
  // Builds what intersect_primitives() needs to go through Embree where it would not. Rooms are never in it: each ray meets them.
  void prepare_embree() const;
  // Whether a LiDAR may meet what is left to Embree: triangles, or more primitives than are traced directly.
  bool may_need_embree() const { return meshes_ || traced().size() > kMaxDirect; }
  std::size_t num_triangles() const { return num_triangles_; }
  std::int32_t first_triangle() const { return static_cast<std::int32_t>(shapes_.size()); }

  const Shape& shape(std::size_t primitive) const { return shapes_[primitive].shape; }
  std::span<const NumberedShape> markers() const { return markers_; }

  // The broad phase of collision: calls back for each element but rooms whose bounding box comes within radius (m) of center;
  // may call back for some that do not. Allocates nothing; safe from many threads.
  void for_each_nearby(const Vec3& center, float radius, NearbyCallback callback, void* context) const;
  // The same, but the radius shrinks to what the callback returns.
  void for_each_nearer(const Vec3& center, float radius, NearerCallback callback, void* context) const;

  // What every sensor and every motion asks for first. The scene itself has to be in the cache.
  void prefetch_parts() const {
    tree_.prefetch_parts();
    prefetch(shapes_.data(), std::min(shapes_.size(), std::size_t{2}) * sizeof(NumberedShape));
  }

 private:
  struct Release {
    void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  };
  using EmbreeScene = std::unique_ptr<RTCSceneTy, Release>;

  struct EmbreePrimitives;  // all visible primitives but the rooms, for Embree
  EmbreeScene new_scene() const;
  std::unique_ptr<const EmbreePrimitives> make_embree_primitives() const;
  void add_candidate(const Shape& shape, std::int32_t element, const Vec3& origin, CandidateSet& candidates) const;
  void add_primitives(std::span<const Primitive> primitives, std::size_t max_direct);
  void add_triangles(const World& world);
  void attach_triangles(const TriangleMesh& mesh, bool masked);
  void commit(RTCScene scene) const;

  std::span<const NumberedShape> traced() const { return is_all_visible_ ? shapes_ : visible_; }

  std::pmr::vector<NumberedShape> shapes_;   // all primitives, in the order of their elements: rooms first
  std::pmr::vector<NumberedShape> visible_;  // those of them that are visual, where some are not
  bool is_all_visible_ = true;
  std::pmr::vector<NumberedShape> markers_;  // start, waypoints, goal
  std::size_t num_rooms_ = 0;
  ShapeTree tree_;  // of all but the rooms
  Masks masks_;
  Vec3 mesh_center_, mesh_half_;                               // m, of the bounding box, a little wider than the triangles
  mutable std::shared_ptr<RTCDeviceTy> device_;                // null where nothing needs Embree
  std::unique_ptr<const EmbreePrimitives> embree_primitives_;  // null where there are few
  std::size_t num_triangles_ = 0;
  EmbreeScene meshes_;         // all triangles; null without any
  bool wide_packets_ = false;  // the processor has vectors for packets of 16
  mutable std::mutex prepared_mutex_;
  mutable std::unique_ptr<const EmbreePrimitives> prepared_embree_primitives_;  // likewise until it is prepared
  mutable std::unique_ptr<const MeshTree> tiles_;                               // null until they are prepared
};

}  // namespace flockstep::trace
