// trace::Scene: one world as rays meet it, and the question asked of it: what is the nearest thing along these rays.
//
// Primitives are traced directly where few are within reach (see CandidateSet), and by Embree where many are; triangles always by
// Embree.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/world.hpp"
#include "trace/calibrated.hpp"
#include "trace/direct.hpp"
#include "trace/embree.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"
#include "trace/shape_tree.hpp"

namespace flockstep::trace {

// Called for every element (index into World::primitives(), then primitives().size() + triangle index) near a point.
using NearbyCallback = void (*)(void* context, std::uint32_t element);

// What the rays of one sensor may meet: the shapes whose bounding boxes come within its range. Filled by Scene::gather.
struct CandidateSet {
  std::array<Candidate, kMaxCandidates> list;
  std::size_t count = 0;
  bool crowded = false;  // there are more
  bool meshes = false;   // triangles are within range
};

// How far Scene::intersect(CandidateSet) came with a bundle.
enum class Traced : std::uint8_t {
  fully,
  primitives_only,  // meshes are left to do, by Scene::intersect_meshes with what was found so far
  nothing,          // too many shapes: all is left to do, by Scene::intersect
};

class Scene {
 public:
  // Keeps no reference to the world. Up to max_direct primitives, rays of any origins are tested against every one.
  explicit Scene(const World& world, std::size_t max_direct = kMaxDirectAnyOrigin);
  ~Scene();
  Scene(const Scene&) = delete;
  Scene& operator=(const Scene&) = delete;

  // Nearest hits of a block of rays: fills t_hit and element. A ray's result has the same bits in any block, beside any
  // other rays. Call under FlushDenormals.
  void intersect(RayBlock& rays) const;
  // The same for what only the triangles can add to t_hit and element.
  void intersect_meshes(RayBlock& rays) const;

  // For many rays of one origin and range: gather once, then trace bundle after bundle.
  void gather(const Vec3& origin, float range_m, CandidateSet& candidates) const;
  Traced intersect(const CandidateSet& candidates, RayBundle& rays) const;

  // The same for a camera, whose bundles are tiles: kTileWidth rays a row. It sees the markers too, numbered on after the
  // triangles, and nothing nearer than near_m, the distance of its near plane's corners.
  void gather_visible(const Vec3& origin, float near_m, float range_m, CandidateSet& candidates) const;
  // Nearest hits, and the normals of those on triangles; the block is scratch. Call under FlushDenormals.
  void intersect_tile(const CandidateSet& candidates, RayBundle& rays, GeometricNormals& normals, RayBlock& block) const;
  // Whether anything that casts a shadow, rooms and markers do not, lies on the rays of the block: t_hit is finite then.
  void intersect_casters(RayBlock& rays) const;

  const Shape& shape(std::size_t primitive) const { return shapes_[primitive].shape; }
  std::span<const NumberedShape> markers() const { return markers_; }

  // The broad phase of collision: calls back for each element but rooms whose bounding box comes within radius (m) of center;
  // may call back for some that do not. Allocates nothing; safe from many threads.
  void for_each_nearby(const Vec3& center, float radius, NearbyCallback callback, void* context) const;

 private:
  struct Release {
    void operator()(RTCScene scene) const { rtcReleaseScene(scene); }
  };
  using EmbreeScene = std::unique_ptr<RTCSceneTy, Release>;

  EmbreeScene new_scene();
  void gather(const Vec3& origin, float near_m, float range_m, CandidateSet& candidates) const;
  void intersect_primitives(RayBlock& rays) const;  // takes what is nearer than t_hit
  void add_candidate(const Shape& shape, std::int32_t element, const Vec3& origin, CandidateSet& candidates) const;
  void add_primitives(std::span<const Primitive> primitives, std::size_t max_direct);
  void add_triangles(const TriangleMesh& mesh);
  void commit(RTCScene scene) const;

  std::vector<NumberedShape> shapes_;   // all primitives, in the order of their elements: rooms first
  std::vector<NumberedShape> markers_;  // start, waypoints, goal
  std::size_t num_rooms_ = 0;
  ShapeTree tree_;  // of all but the rooms
  std::vector<Shape> crowd_shapes_;
  Vec3 mesh_center_, mesh_half_;         // m, of the bounding box, a little wider than the triangles
  std::shared_ptr<RTCDeviceTy> device_;  // null where nothing needs Embree
  EmbreeScene crowd_;                    // all primitives but the rooms; null where there are few
  EmbreeScene meshes_;                   // all triangles; null without any
  bool wide_packets_ = false;            // the processor has vectors for packets of 16
};

}  // namespace flockstep::trace
