#include "trace/tracer.hpp"

#include <algorithm>
#include <cstring>
#include <limits>
#include <span>

#include "trace/calibrated.hpp"
#include "trace/direct.hpp"
#include "trace/mesh_tiles.hpp"
#include "trace/packets.hpp"

namespace flockstep::trace {
namespace {

template <class Rays>
void forget_hits(Rays& rays) {
  std::fill_n(rays.t_hit, rays.count, std::numeric_limits<float>::infinity());
  std::fill_n(rays.element, rays.count, -1);
  if constexpr (requires { rays.cosine; }) {
    if (rays.has_cosines) std::fill_n(rays.cosine, rays.count, BeamHits::kNoCosine);
  }
}

// Copies values that SIMD code has just stored. Each copied piece lies within one of these stores, so the processor can forward
// it. Otherwise the load would wait until the stores reach the cache.
void copy_values(const float* from, std::size_t count, float* to) {
  constexpr std::size_t kPiece = 4;
  std::size_t i = 0;
  for (; i + kPiece <= count; i += kPiece) std::memcpy(to + i, from + i, kPiece * sizeof(float));
  switch (count - i) {
    case 3:
      to[i + 2] = from[i + 2];
      [[fallthrough]];
    case 2:
      to[i + 1] = from[i + 1];
      [[fallthrough]];
    case 1:
      to[i] = from[i];
      break;
    default:
      break;
  }
}

}  // namespace

TracePolicy trace_policy_of(TracerKind kind, std::size_t rays) {
  switch (kind) {
    case TracerKind::automatic:
      return {.tile_triangle_limit = rays < kMinRaysInTiles ? 0 : kTrianglesPerRay * rays,
              .min_rays_in_slice = kMinRaysInSlice,
              .widest_in_slice = kWidestInSlice};
    case TracerKind::slices:
      return {.tile_triangle_limit = rays < kMinRaysInTiles ? 0 : kTrianglesPerRay * rays, .min_rays_in_slice = 1};
    case TracerKind::tiles:
      return {.tile_triangle_limit = std::numeric_limits<std::size_t>::max()};
    default:
      return {.embree = true};
  }
}

void Tracer::set_viewpoint(const Scene& scene, const Viewpoint& viewpoint) {
  const bool may_join =
      scene_ == &scene && for_everything_.rays.near == viewpoint.near && sees_markers_ == viewpoint.sees_markers;
  if (!may_join) {
    finish();
    scene_ = &scene;
    sees_markers_ = viewpoint.sees_markers;
    for_everything_.rays.near = for_triangles_.rays.near = viewpoint.near;
  }
  bundle_.origin = viewpoint.origin;
  bundle_.rotation = viewpoint.rotation;
  tree_ = scene.num_triangles() <= viewpoint.policy.tile_triangle_limit ? scene.tiles() : nullptr;
  sliced_ = viewpoint.policy.min_rays_in_slice == TracePolicy::kNever ? nullptr : scene.tiles();
  asked_ = viewpoint.asked;
  bundle_.near = viewpoint.near;
  bundle_.range = viewpoint.range;
  scene.gather(viewpoint.origin, viewpoint.near * viewpoint.longest, viewpoint.range * viewpoint.longest, viewpoint.sees_markers,
               candidates_);
  near_bodies_.clear();
  if (viewpoint.bodies->count + viewpoint.drones->count > 0) {
    near_bodies_.gather(*viewpoint.bodies, *viewpoint.drones, viewpoint.origin, viewpoint.near * viewpoint.longest,
                        viewpoint.range * viewpoint.longest);
  }
  candidates_.crowded |= viewpoint.policy.embree;
  policy_ = viewpoint.policy;
}

const RayBundle& Tracer::trace(const RayTile& tile) {
  bundle_.numbered = true;
  bundle_.has_cosines = false;
  bundle_.no_hits_yet = tree_ != nullptr && candidates_.triangles && is_nothing_near();
  if (bundle_.no_hits_yet) {
    aim(tile);
  } else if (!trace_candidates(tile)) {
    trace_by_embree();
  }
  if (candidates_.triangles && tree_ != nullptr) {
    trace_mesh_tile(*tree_, scene_->first_triangle(), *tile.u, *tile.v, bundle_, &details_, asked_, scene_->masks());
  } else if (candidates_.triangles) {
    note(bundle_.count, scene_->intersect_triangles(bundle_, details_));
  }
  meet_bodies(&tile);
  return bundle_;
}

void Tracer::enqueue(const RayTile& tile, float* ranges, std::size_t stride, const EchoTarget& echoes) {
  bundle_.numbered = echoes.reader != nullptr;
  bundle_.has_cosines = echoes.needs_cosines;
  const bool in_slice = sliced_ != nullptr && tile.fan != nullptr && candidates_.triangles;
  const bool in_view = !in_slice && tree_ != nullptr && tile.view != nullptr && candidates_.triangles;
  if (!trace_candidates(tile)) {
    if (!in_slice && !in_view) {
      forget_hits(bundle_);
      bundle_.has_cosines = false;  // a primitive may yet take the place of a body
      meet_bodies();                // before the rays leave the bundle
      return wait(tile, ranges, stride, echoes, for_everything_);
    }
    trace_by_embree();
  } else if (candidates_.triangles && !in_slice && !in_view) {
    meet_bodies();
    return wait(tile, ranges, stride, echoes, for_triangles_);
  }
  if (in_slice) {
    const SliceWalk walk = was_ordered_faster_ ? SliceWalk::ordered : SliceWalk::automatic;
    was_ordered_faster_ = trace_mesh_slice(*sliced_, scene_->first_triangle(), *tile.fan, bundle_, walk);
  }
  if (in_view) trace_view(*tile.view, tile.rows, tile.width, is_nothing_near());
  meet_bodies();
  if (echoes.reader != nullptr) {
    return echoes.write(*scene_->echoes(),
                        {bundle_.origin, bundle_.rotation, bundle_.x, bundle_.y, bundle_.z, bundle_.t_hit, bundle_.element,
                         details_.triangle, bundle_.cosine, bundle_.count},
                        ranges, tile.width, stride);
  }
  for (std::size_t row = 0; row < tile.rows; ++row) {
    copy_values(bundle_.t_hit + row * tile.width, tile.width, ranges + row * stride);
  }
}

void Tracer::finish() {
  deliver(for_everything_);
  deliver(for_triangles_);
}

void Tracer::trace_block(const Scene& scene, std::span<const NumberedShape> bodies) {
  forget_hits(block_);
  scene.intersect_primitives(block_);
  meet_triangles(scene, block_, &details_);
  if (!bodies.empty()) trace_direct(bodies, block_);
}

void Tracer::trace_shadows(const Scene& scene, bool casters, std::span<const NumberedShape> shapes,
                           std::span<const PosedMesh> meshes) {
  forget_hits(block_);
  if (casters) scene.intersect_casters(block_);
  meet_triangles(scene, block_, nullptr, Through::masks);
  if (!shapes.empty()) trace_direct(shapes, block_);
  for (const PosedMesh& mesh : meshes) {
    select_rays(mesh, block_, mesh_rays_);
    meet_triangles(*mesh.scene, mesh_rays_.rays, nullptr, Through::masks);
    for (std::size_t i = 0; i < mesh_rays_.rays.count; ++i) block_.t_hit[mesh_rays_.of[i]] = mesh_rays_.rays.t_hit[i];
  }
}

void Tracer::aim(const RayTile& tile) {
  bundle_.x = tile.x;
  bundle_.y = tile.y;
  bundle_.z = tile.z;
  bundle_.count = tile.rows * tile.width;
  bundle_.frustum = tile.frustum;
  bundle_.is_rectangle = tile.is_rectangle;
}

bool Tracer::trace_candidates(const RayTile& tile) {
  aim(tile);
  if (is_nothing_near()) {
    forget_hits(bundle_);
    return true;
  }
  return !candidates_.crowded && trace_direct(std::span(candidates_.list).first(candidates_.count), kMaxDirect, bundle_);
}

void Tracer::trace_by_embree() {
  forget_hits(bundle_);
  block_.count = 0;
  block_.near = bundle_.near;
  append(bundle_, 0, bundle_.count, block_);
  meet_primitives(block_);
  std::copy_n(block_.t_hit, bundle_.count, bundle_.t_hit);
  std::copy_n(block_.element, bundle_.count, bundle_.element);
}

// Shortens the bundle's t_hit to nearer hits on triangles. no_hits_yet: the bundle has no hits.
void Tracer::trace_view(const TileView& view, std::size_t rows, std::size_t width, bool no_hits_yet) {
  RayBundle& seen = view_bundle_;
  seen.origin = bundle_.origin;
  for (int axis = 0; axis < 3; ++axis) seen.rotation.col(axis) = rotated(bundle_.rotation, view.to_sensor.col(axis));
  seen.near = bundle_.near;
  seen.range = bundle_.range;
  seen.count = rows * kTileWidth;
  seen.no_hits_yet = no_hits_yet && width == kTileWidth;
  if (!seen.no_hits_yet) {
    std::fill_n(seen.element, seen.count, -1);
    for (std::size_t row = 0; row < rows; ++row) {
      float* const depth = seen.t_hit + row * kTileWidth;
      const float *const ahead = view.ahead + row * kTileWidth, *const found = bundle_.t_hit + row * width;
      std::fill_n(depth, kTileWidth, -1.0F);  // outside the tile: nothing is nearer
      for (std::size_t i = 0; i < width; ++i) depth[i] = std::min(found[i], bundle_.range) * ahead[i];
    }
  }
  trace_mesh_tile(*tree_, scene_->first_triangle(), view.u, view.v, seen, nullptr, {});
  for (std::size_t row = 0; row < rows; ++row) {
    const float *const depth = seen.t_hit + row * kTileWidth, *const per_ahead = view.per_ahead + row * kTileWidth;
    const std::int32_t* const element = seen.element + row * kTileWidth;
    float* const found = bundle_.t_hit + row * width;
    std::int32_t* const number = bundle_.element + row * width;
    for (std::size_t i = 0; i < width; ++i) {
      const float distance = depth[i] * per_ahead[i];
      const bool is_met = (element[i] >= 0) & (distance <= bundle_.range) & (distance < found[i]);
      found[i] = is_met ? distance : found[i];
      number[i] = is_met ? element[i] : number[i];
    }
  }
}

void Tracer::meet_primitives(RayBlock& rays) const {
  scene_->intersect_primitives(rays, policy_.embree);
  if (sees_markers_) scene_->intersect_markers(rays);
}

void Tracer::meet_triangles(const Scene& scene, RayBlock& rays, HitDetails* details, Through through) {
  note(rays.count, scene.intersect_triangles(rays, details, through));
}

void Tracer::meet_bodies(const RayTile* picture) {
  if (near_bodies_.empty()) return;
  if (!near_bodies_.candidates().empty()) trace_nearer(near_bodies_.candidates(), bundle_);
  for (const PosedMesh& mesh : near_bodies_.meshes()) {
    if (is_beside(mesh, bundle_)) continue;
    picture == nullptr ? meet_mesh(mesh) : meet_mesh(mesh, *picture);
  }
  if (!near_bodies_.hulls().empty()) trace_hulls(near_bodies_.hulls(), bundle_);
}

void Tracer::meet_mesh(const PosedMesh& mesh) {
  select_rays(mesh, bundle_, mesh_rays_);
  const RayBlock& rays = mesh_rays_.rays;
  meet_triangles(*mesh.scene, mesh_rays_.rays, nullptr);
  for (std::size_t i = 0; i < rays.count; ++i) {
    if (rays.element[i] < 0) continue;
    bundle_.t_hit[mesh_rays_.of[i]] = rays.t_hit[i];
    bundle_.element[mesh_rays_.of[i]] = mesh.element;
    details_.triangle[mesh_rays_.of[i]] = rays.element[i];
  }
}

void Tracer::meet_mesh(const PosedMesh& mesh, const RayTile& picture) {
  const auto take = [&](std::size_t ray, float t_hit, std::int32_t triangle, std::size_t i) {
    bundle_.t_hit[ray] = t_hit;
    bundle_.element[ray] = mesh.element;
    details_.triangle[ray] = triangle;
    for (const auto values :
         {&HitDetails::u, &HitDetails::v, &HitDetails::normal_x, &HitDetails::normal_y, &HitDetails::normal_z}) {
      (details_.*values)[ray] = (mesh_details_.*values)[i];
    }
    details_.back[ray] = mesh_details_.back[i];
  };
  const MeshTree* const tree =
      mesh.scene->num_triangles() <= policy_.tile_triangle_limit && picture.u != nullptr ? mesh.scene->tiles() : nullptr;
  if (tree != nullptr) {
    RayBundle& seen = view_bundle_;
    seen.origin = mesh.local_point(bundle_.origin);
    seen.rotation = mesh.local_rotation(bundle_.rotation);
    seen.near = bundle_.near;
    seen.range = bundle_.range;
    seen.count = bundle_.count;
    seen.no_hits_yet = false;
    std::copy_n(bundle_.t_hit, bundle_.count, seen.t_hit);
    std::fill_n(seen.element, seen.count, -1);
    trace_mesh_tile(*tree, 0, *picture.u, *picture.v, seen, &mesh_details_, asked_, mesh.scene->masks());
    for (std::size_t i = 0; i < seen.count; ++i) {
      if (seen.element[i] >= 0) take(i, seen.t_hit[i], seen.element[i], i);
    }
    return;
  }
  select_rays(mesh, bundle_, mesh_rays_);
  const RayBlock& rays = mesh_rays_.rays;
  meet_triangles(*mesh.scene, mesh_rays_.rays, &mesh_details_, Through::masks);
  for (std::size_t i = 0; i < rays.count; ++i) {
    if (rays.element[i] >= 0) take(mesh_rays_.of[i], rays.t_hit[i], rays.element[i], i);
  }
}

void Tracer::note(std::size_t rays, std::size_t packets) {
  if (packets > 0) embree_use_ += {static_cast<std::int64_t>(rays), static_cast<std::int64_t>(packets)};
}

// Adds the bundle's rays, with their hits so far, to the waiting ones.
void Tracer::wait(const RayTile& tile, float* ranges, std::size_t stride, const EchoTarget& echoes, Waiting& waiting) {
  for (std::size_t row = 0; row < tile.rows; ++row) {
    for (std::size_t ray = 0; ray < tile.width;) {
      const std::size_t count = std::min(kMaxRays - waiting.rays.count, tile.width - ray);
      const std::size_t first = row * tile.width + ray, to = row * stride + ray;
      waiting.segments[waiting.num_segments++] = {ranges + to, echoes.from(to), count};
      if (echoes.reader != nullptr) std::copy_n(details_.triangle + first, count, waiting.triangle + waiting.rays.count);
      if (echoes.needs_cosines) std::copy_n(bundle_.cosine + first, count, waiting.cosine + waiting.rays.count);
      append(bundle_, first, count, waiting.rays);
      if (waiting.rays.count == kMaxRays) deliver(waiting);
      ray += count;
    }
  }
}

// Traces the waiting rays and writes their distances and echoes.
void Tracer::deliver(Waiting& waiting) {
  if (waiting.rays.count == 0) return;
  if (&waiting == &for_everything_) meet_primitives(waiting.rays);
  const RayBlock& rays = waiting.rays;
  meet_triangles(*scene_, waiting.rays, nullptr);
  std::size_t first = 0;
  for (const auto& [ranges, echoes, count] : std::span(waiting.segments).first(waiting.num_segments)) {
    if (echoes.reader == nullptr) {
      std::copy_n(rays.t_hit + first, count, ranges);
    } else {
      echoes.write(*scene_->echoes(),
                   {{rays.org_x[first], rays.org_y[first], rays.org_z[first]},
                    Mat3::Identity(),
                    rays.dir_x + first,
                    rays.dir_y + first,
                    rays.dir_z + first,
                    rays.t_hit + first,
                    rays.element + first,
                    waiting.triangle + first,
                    waiting.cosine + first,
                    count},
                   ranges, count, count);
    }
    first += count;
  }
  waiting.rays.count = waiting.num_segments = 0;
}

}  // namespace flockstep::trace
