// Tracer: finds the nearest hits of rays in a Scene, for every sensor. It owns the working data: the candidates near the
// sensor, the rays in progress, and the rays that wait to go through Embree together.
//
// Bodies, which move, are traced apart from static geometry, against rays that end at the hits found so far.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <span>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "trace/bodies.hpp"
#include "trace/echoes.hpp"
#include "trace/frustum.hpp"
#include "trace/mesh_slices.hpp"
#include "trace/mesh_tiles.hpp"
#include "trace/ray_block.hpp"
#include "trace/scene.hpp"

namespace flockstep::trace {

// The method of tracing a sensor's rays.
struct TracePolicy {
  static constexpr std::size_t kNever = static_cast<std::size_t>(-1);
  std::size_t tile_triangle_limit = 0;  // triangles; tiles are used in worlds of up to this many
  // A fan is traced as a slice if it has at least this many rays, and their mean distance (m) at its range is at most this.
  std::size_t min_rays_in_slice = kNever;
  float widest_in_slice = std::numeric_limits<float>::infinity();
  bool embree = false;  // use Embree for everything it can trace, primitives included

  friend bool operator==(const TracePolicy&, const TracePolicy&) = default;
};
TracePolicy trace_policy_of(TracerKind kind, std::size_t rays);  // rays: of the sensor

// Pose and range of a sensor, and the data that it needs.
struct Viewpoint {
  Vec3 origin;                        // m, world frame
  Mat3 rotation;                      // sensor to world
  float range;                        // in lengths of the directions; hits are in [near, range]
  float longest = 1.0F;               // length of the longest direction
  float near = 0.0F;                  // not beside range: reading both at once, just written, would take longer
  bool sees_markers = false;          // markers are visible, numbered after the triangles
  const Bodies* bodies = &kNoBodies;  // the env's; needed by set_viewpoint() only, but their arrays as long as rays are traced
  const Bodies* drones = &kNoBodies;  // the same for the drones that the sensor sees
  AskedDetails asked{};               // details of the hits of trace()
  TracePolicy policy{};               // tiles require Scene::prepare_tiles()
};

// The rays of a tile as a picture: each is a multiple of (1, u, v) in the tile's frame.
struct TileView {
  Mat3 to_sensor;                              // rotation, tile's to sensor's frame
  TileAxis u, v;                               // rows of kTileWidth, also for narrower tiles
  alignas(64) float ahead[kMaxRays] = {};      // length of the direction along the tile's axis; 0 outside the tile
  alignas(64) float per_ahead[kMaxRays] = {};  // 1 / ahead; 0 outside the tile
};

// Rays of a sensor that are traced together, because they point in similar directions.
struct RayTile {
  const float *x, *y, *z;                     // (rows * width + kRayPadding,) directions, sensor frame, row by row
  std::size_t rows, width;                    // rows * width is at most kMaxRays
  const Frustum* frustum;                     // contains the directions, sensor frame
  const TileView* view = nullptr;             // null if the rays spread too far; for enqueue() only
  const Fan* fan = nullptr;                   // these rays, to be traced as a slice, or null; for enqueue() only
  const TileAxis *u = nullptr, *v = nullptr;  // axes of y and z if x is 1; for trace() in tiles only
  bool is_rectangle = false;                  // see RayBundle
};

// Counts of rays and packets that Embree traced against triangles, shadow rays included.
struct EmbreeUse {
  std::int64_t rays = 0;
  std::int64_t packets = 0;

  EmbreeUse& operator+=(const EmbreeUse& other) {
    rays += other.rays;
    packets += other.packets;
    return *this;
  }
};

// Each thread needs its own. It takes about 110 KB, so create it once. Tracing allocates nothing. A ray's result has the same
// bits beside any other rays. Only in trace() it depends on the ray's tile, which is always the same for a pixel. Call under
// FlushDenormals.
class Tracer {
 public:
  // Sets the sensor for the next calls of trace() and enqueue(). Waiting rays are traced first, unless the new ones can join
  // them. The scene must outlive the tracing of these rays.
  void set_viewpoint(const Scene& scene, const Viewpoint& viewpoint);

  // Returns the nearest hits of a camera's tile, through masks. The tile has rows of kTileWidth rays. Its directions must be
  // readable up to a multiple of 4 rows.
  const RayBundle& trace(const RayTile& tile);

  // Writes the distances of a tile, row by row, to ranges, ranges + stride and so on, and what the target of echoes reads. Its
  // reader must exist until the rays are traced, and it requires Scene::prepare_echoes().
  // Rays for Embree wait until they fill a block with those of other sensors; finish() traces the rest. All others are written
  // at once. Where two surfaces touch, distances with and without echoes may differ by rounding.
  void enqueue(const RayTile& tile, float* ranges, std::size_t stride, const EchoTarget& echoes = {});
  void finish();

  // Rays of arbitrary origins. The caller sets `near` and, for the first `count` rays, everything except t_hit and element.
  RayBlock& block() { return block_; }
  // Finds the nearest hits of the block. bodies: see append_shapes().
  void trace_block(const Scene& scene, std::span<const NumberedShape> bodies = {});
  // Tests if these shapes, these meshes, the scene's triangles, through masks, or its casters() lie on the rays of the block. If
  // so, t_hit is finite. casters: test the scene's casters(), too. meshes: see append_meshes().
  void trace_shadows(const Scene& scene, bool casters = true, std::span<const NumberedShape> shapes = {},
                     std::span<const PosedMesh> meshes = {});

  // Details of the last trace() or trace_block(), for hits on triangles.
  const HitDetails& details() const { return details_; }

  // Counts since the tracer was made. Waiting rays share packets, so the number of packets depends on the order of the sensors.
  const EmbreeUse& embree_use() const { return embree_use_; }

 private:
  // Rays of several sensors, with their hits so far.
  struct Waiting {
    struct Segment {  // consecutive rays, and the destinations of their distances and echoes
      float* ranges;
      EchoTarget echoes;
      std::size_t count;
    };
    RayBlock rays;
    alignas(64) RayFloats cosine;  // as in BeamHits, of the hits so far
    alignas(64) RayInts triangle;
    std::array<Segment, kMaxRays> segments;
    std::size_t num_segments = 0;
  };

  void aim(const RayTile& tile);                                                           // sets the bundle to the tile's rays
  bool is_nothing_near() const { return candidates_.count == 0 && !candidates_.crowded; }  // except triangles
  bool trace_candidates(const RayTile& tile);                                              // false if there are too many
  void trace_by_embree();                                                                  // if trace_candidates() failed
  void trace_view(const TileView& view, std::size_t rows, std::size_t width, bool no_hits_yet);
  void meet_primitives(RayBlock& rays) const;
  void meet_triangles(const Scene& scene, RayBlock& rays, HitDetails* details, Through through = Through::nothing);
  void meet_bodies(const RayTile* picture = nullptr);  // shortens the bundle's rays; picture: for a camera's tile
  void meet_mesh(const PosedMesh& mesh);
  void meet_mesh(const PosedMesh& mesh, const RayTile& picture);
  void note(std::size_t rays, std::size_t packets);  // adds to embree_use_ unless packets is 0
  void wait(const RayTile& tile, float* ranges, std::size_t stride, const EchoTarget& echoes, Waiting& waiting);
  void deliver(Waiting& waiting);

  const Scene* scene_ = nullptr;      // scene of the sensor
  const MeshTree* tree_ = nullptr;    // tree of its triangles; null if not traced in tiles
  const MeshTree* sliced_ = nullptr;  // the same for slices
  bool was_ordered_faster_ = false;   // for the last slice; selects the next walk, and affects no result
  bool sees_markers_ = false;
  AskedDetails asked_;
  TracePolicy policy_;
  CandidateSet candidates_;  // for the current sensor
  NearBodies near_bodies_;   // for the current sensor
  RayBundle bundle_;         // rays of the current tile
  RayBundle view_bundle_;    // the same rays in the frame of the tile's view
  HitDetails details_{};
  EmbreeUse embree_use_;
  RayBlock block_;
  MeshRays mesh_rays_;       // for one mesh of a body
  HitDetails mesh_details_;  // hits of these rays
  Waiting for_everything_, for_triangles_;
};

}  // namespace flockstep::trace
