// Tracer: asks a Scene what the nearest thing along rays is, in the one place where every sensor does. It owns what that takes:
// what may be met from where the sensor is, the rays on their way, and those that wait to go through Embree together.
//
// Each way of asking ends with the static world and leaves the distances found: things that move are met after that, where the
// comments say "the static world ends here", by rays whose range that has already shortened.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "trace/frustum.hpp"
#include "trace/mesh_tiles.hpp"
#include "trace/ray_block.hpp"
#include "trace/scene.hpp"

namespace flockstep::trace {

// How rays of a sensor go.
struct TracePolicy {
  std::size_t tile_triangle_limit = 0;  // triangles of a world up to which they are met in tiles, where they can be
  bool embree = false;                  // all that Embree can trace it does, primitives too

  friend bool operator==(const TracePolicy&, const TracePolicy&) = default;
};
TracePolicy trace_policy_of(TracerKind kind, std::size_t rays);  // of a sensor

// Where a sensor is, how far it sees, and what.
struct Viewpoint {
  Vec3 origin;                // m, world frame
  Mat3 rotation;              // sensor to world
  float near = 0.0F;          // a hit is in [near, range], in lengths of the directions
  float range;                // likewise
  float longest = 1.0F;       // length of the longest direction
  bool sees_markers = false;  // numbered on after the triangles
  AskedDetails asked{};       // of what trace() hits
  TracePolicy policy{};       // a scene to be traced in tiles is prepared for them
};

// Rays of a tile as a picture: each is a multiple of (1, u, v) in the tile's frame.
struct TileView {
  Mat3 to_sensor;                              // rotation, tile's frame to the sensor's
  TileAxis u, v;                               // rows of kTileWidth, whatever the tile's width
  alignas(64) float ahead[kMaxRays] = {};      // length of the direction along the tile's axis; 0 beside the tile
  alignas(64) float per_ahead[kMaxRays] = {};  // 1 / ahead; likewise
};

// Rays of a sensor that are traced together, since they point much the same way.
struct RayTile {
  const float *x, *y, *z;                     // (rows * width + kRayPadding,) directions, sensor frame, row by row
  std::size_t rows, width;                    // rows * width is at most kMaxRays
  const Frustum* frustum;                     // that holds them, sensor frame
  const TileView* view = nullptr;             // if they lie close enough; for enqueue() only
  const TileAxis *u = nullptr, *v = nullptr;  // of y and z, where x is 1; for trace() in tiles only
};

// What has gone through Embree's trees of triangles, shadow rays included.
struct EmbreeUse {
  std::int64_t rays = 0;
  std::int64_t packets = 0;

  EmbreeUse& operator+=(const EmbreeUse& other) {
    rays += other.rays;
    packets += other.packets;
    return *this;
  }
};

// A thread's own; some 60 KB, so make it once. Nothing is allocated while it traces. A ray's result has the same bits beside any
// other rays, except those of trace(), whose tile is always the same for a pixel. Call under FlushDenormals.
class Tracer {
 public:
  // Settles where a sensor is: from now on trace() and enqueue() are about its rays. Rays that wait are traced first unless
  // these may join them. The scene outlives what is traced in it.
  void set_viewpoint(const Scene& scene, const Viewpoint& viewpoint);

  // Nearest hits of a camera's tile, through masks. Its rows are kTileWidth wide and, up to a multiple of 4 of them, have
  // directions to be read.
  const RayBundle& trace(const RayTile& tile);

  // Distances of a tile, row by row to ranges, ranges + stride and so on: at once, or by finish() at the latest, where rays go
  // through Embree and wait until they fill a block with those of other sensors.
  void enqueue(const RayTile& tile, float* ranges, std::size_t stride);
  void finish();

  // Rays of any origins, to be filled in by the caller: all but t_hit and element of the first `count`, and near.
  RayBlock& block() { return block_; }
  // Nearest hits of the block.
  void trace_block(const Scene& scene);
  // Whether anything but rooms and markers lies on the rays of the block, through masks: t_hit is finite then.
  void trace_shadows(const Scene& scene);

  // What is known of the hits of the last trace() or trace_block() on triangles.
  const HitDetails& details() const { return details_; }

  // Since the tracer was made. Packets are shared by what waits, so their number depends on the order in which sensors come.
  const EmbreeUse& embree_use() const { return embree_use_; }

 private:
  // Rays of several sensors, with what they have hit so far.
  struct Waiting {
    struct Segment {  // consecutive rays, and where their distances go
      float* ranges;
      std::size_t count;
    };
    RayBlock rays;
    std::array<Segment, kMaxRays> segments;
    std::size_t num_segments = 0;
  };

  void aim(const RayTile& tile);                                                           // the bundle is of its rays
  bool is_nothing_near() const { return candidates_.count == 0 && !candidates_.crowded; }  // but triangles
  bool trace_candidates(const RayTile& tile, bool numbered);                               // false if they are too many
  void trace_by_embree();                                                                  // what trace_candidates() has not
  void trace_view(const TileView& view, std::size_t rows, std::size_t width, bool no_hits_yet);
  void meet_primitives(RayBlock& rays) const;
  void meet_triangles(const Scene& scene, RayBlock& rays, HitDetails* details, Through through = Through::nothing);
  void note(std::size_t rays, std::size_t packets);  // that they went through Embree; no packets: they did not
  void wait(const RayTile& tile, float* ranges, std::size_t stride, Waiting& waiting);
  void deliver(Waiting& waiting);

  const Scene* scene_ = nullptr;    // that the sensor is in
  const MeshTree* tree_ = nullptr;  // of its triangles, where they are traced in tiles
  bool sees_markers_ = false;
  AskedDetails asked_;
  TracePolicy policy_;
  CandidateSet candidates_;  // of the sensor
  RayBundle bundle_;         // of the tile
  RayBundle view_bundle_;    // the same in the frame of its view
  HitDetails details_;
  EmbreeUse embree_use_;
  RayBlock block_;
  Waiting for_everything_, for_triangles_;
};

}  // namespace flockstep::trace
