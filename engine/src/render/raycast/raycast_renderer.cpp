#include "render/raycast/raycast_renderer.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <span>

#include "trace/packets.hpp"

namespace flockstep::render {
namespace {

static_assert(PixelTile::kSide == trace::kTileWidth && TilePixels::kCount == trace::kMaxRays);

// Distance of a shadow ray's origin from the surface, relative to its coordinates. It exceeds the rounding error of a hit.
constexpr float kLift = 1e-4F;

Vec3 to_sun(const RenderRequest& request) {
  const auto& direction = request.world->light().sun_direction;
  return {direction[0], direction[1], direction[2]};
}

// Returns whether the ray from a point to the sun passes through a room that the point is outside of.
bool is_behind(const Aabb& room, const Vec3& point, const Vec3& sun) {
  float enter = -std::numeric_limits<float>::max();
  float leave = std::numeric_limits<float>::max();
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    if (sun[axis] == 0.0F) {
      if (point[axis] < room.min[axis] || point[axis] > room.max[axis]) return false;
      continue;
    }
    const float low = (room.min[axis] - point[axis]) / sun[axis];
    const float high = (room.max[axis] - point[axis]) / sun[axis];
    enter = std::max(enter, std::min(low, high));
    leave = std::min(leave, std::max(low, high));
  }
  return enter > 0.0F && enter <= leave;
}

// Floats of all rays of a tile, in vectors of the processor.
using RayArray = Eigen::Array<float, Eigen::Dynamic, 1, Eigen::ColMajor, static_cast<Eigen::Index>(trace::kMaxRays)>;
using RayView = Eigen::Map<Eigen::ArrayXf>;

// Finds the hits that lie in shadow: traces a ray from each hit towards the sun.
void find_shadows(const RenderRequest& request, const trace::RayBundle& rays, RaycastScratch& scratch) {
  trace::RayBlock& block = scratch.tracer.block();
  const Vec3 sun = to_sun(request);
  constexpr float kFar = std::numeric_limits<float>::max();
  const auto count = static_cast<Eigen::Index>(rays.count);
  const auto view = [count](const float* values) { return Eigen::Map<const Eigen::ArrayXf>(values, count); };
  const auto hit = Eigen::Map<const Eigen::ArrayXi>(rays.element, count) >= 0;
  const RayArray distance = hit.select(view(rays.t_hit), 0.0F);
  block.count = rays.count;
  block.near = 0.0F;
  float* const origins[3] = {block.org_x, block.org_y, block.org_z};
  RayArray directions[3];
  RayArray farthest = RayArray::Zero(count);  // largest coordinate
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    const auto m = rays.rotation.row(axis);
    RayArray& direction = directions[axis];
    direction = m[0] * view(rays.x) + (m[1] * view(rays.y) + m[2] * view(rays.z));
    RayView(origins[axis], count) = rays.origin[axis] + distance * direction;
    farthest = farthest.max(view(origins[axis]).abs());
  }
  RayArray length = directions[0].square() + (directions[1].square() + directions[2].square());
  for (float& value : length) value = std::sqrt(value);  // exactly, unlike Eigen's
  // Moves away from the surface: back along the ray, and towards the sun.
  const RayArray lift = kLift * (1.0F + farthest);
  float* const towards[3] = {block.dir_x, block.dir_y, block.dir_z};
  const RayArray missed = hit.select(RayArray::Zero(count), kFar);  // moves other rays out of the box around all hits
  Aabb hits;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    RayView origin(origins[axis], count);
    origin += lift * (sun[axis] - directions[axis] / length);
    RayView(towards[axis], count) = sun[axis];
    hits.min[axis] = (origin + missed).minCoeff();
    hits.max[axis] = (origin - missed).maxCoeff();
  }
  RayView(block.range, count) = kFar - missed;
  const bool has_casters = !scratch.casters.empty() && hits.min.x() <= hits.max.x();
  if (has_casters) {
    scratch.tracer.trace_shadows(*request.scene, scratch.casters.above(hits), scratch.casters.meshes_above(hits));
  } else {
    scratch.tracer.trace_shadows(*request.scene);
  }
  for (std::size_t i = 0; i < rays.count; ++i) scratch.shaded[i] = std::isfinite(block.t_hit[i]);
  const std::optional<Aabb>& room = request.shading->room();
  const bool outside = room && !((room->min.array() <= hits.min.array()).all() && (hits.max.array() <= room->max.array()).all());
  for (std::size_t i = 0; outside && i < rays.count; ++i) {
    const Vec3 point(block.org_x[i], block.org_y[i], block.org_z[i]);
    if (rays.element[i] >= 0 && is_behind(*room, point, sun)) scratch.shaded[i] = 1;
  }
}

// Traces and shades one sample of each pixel of the tile.
void sample(const RenderRequest& request, const PinholeCamera::Grid& grid, const PixelTile& tile, const CameraOutputs& wanted,
            RaycastScratch& scratch) {
  const trace::RayBundle& rays = scratch.tracer.trace({.x = scratch.ones,
                                                       .y = grid.left.data() + tile.column * PixelTile::kSide,
                                                       .z = grid.up.data() + tile.row * PixelTile::kSide,
                                                       .rows = tile.height,
                                                       .width = PixelTile::kSide,
                                                       .frustum = &tile.frustum,
                                                       .u = &grid.columns[tile.column / PixelTile::kSide],
                                                       .v = &grid.rows[tile.row / PixelTile::kSide]});
  const bool shadows = request.camera->shadows && wanted.any_color();
  if (shadows) find_shadows(request, rays, scratch);
  const auto shaded = shadows ? std::span<const std::uint8_t>(scratch.shaded) : std::span<const std::uint8_t>();
  const PinholeCamera& pinhole = *request.pinhole;
  const auto samples = static_cast<float>(std::max(pinhole.grids.size() - 1, std::size_t{1}));
  request.shading->shade(rays, scratch.tracer.details(), shaded, 1.0F / (pinhole.fx * pinhole.fy * samples), wanted,
                         request.camera->depth_kind, scratch.bodies, scratch.pixels);
}

// Averages the colours of all samples.
void average(const RenderRequest& request, const PixelTile& tile, RaycastScratch& scratch) {
  TilePixels& pixels = scratch.pixels;
  std::uint8_t* const channels[3] = {pixels.r, pixels.g, pixels.b};
  CameraOutputs colors = request.camera->outputs;
  colors.depth = colors.semantic = colors.instance = colors.normal = false;
  const std::size_t pixels_of_tile = tile.height * PixelTile::kSide;
  for (auto& sums : scratch.sums) std::fill_n(sums, pixels_of_tile, std::uint16_t{0});
  const auto grids = std::span(request.pinhole->grids).subspan(1);
  for (const PinholeCamera::Grid& grid : grids) {
    sample(request, grid, tile, colors, scratch);
    for (std::size_t c = 0; c < 3; ++c) {
      for (std::size_t i = 0; i < pixels_of_tile; ++i) {
        scratch.sums[c][i] = static_cast<std::uint16_t>(scratch.sums[c][i] + channels[c][i]);
      }
    }
  }
  const auto count = static_cast<unsigned int>(grids.size());
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < pixels_of_tile; ++i) {
      channels[c][i] = static_cast<std::uint8_t>((scratch.sums[c][i] + count / 2) / count);
    }
  }
}

}  // namespace

RaycastScratch::RaycastScratch() { std::fill(std::begin(ones), std::end(ones), 1.0F); }

void render_tiles(const RenderRequest& request, std::size_t first, std::size_t last, RaycastScratch& scratch) {
  const CameraConfig& camera = *request.camera;
  const PinholeCamera& pinhole = *request.pinhole;
  VisibleBodies bodies = request.bodies, drones = request.drones;
  bodies.shapes.first_element = request.shading->first_body();
  drones.shapes.first_element = bodies.shapes.first_element + static_cast<std::int32_t>(bodies.shapes.count);
  scratch.bodies.begin(bodies, drones, *request.shading);
  const bool shadows = camera.shadows && camera.outputs.any_color();
  scratch.casters.begin(shadows ? bodies.shapes : trace::Bodies{}, shadows ? drones.shapes : trace::Bodies{}, to_sun(request));
  scratch.tracer.set_viewpoint(*request.scene,
                               {.origin = request.position,
                                .rotation = request.rotation,
                                .near = camera.near_m,
                                .range = camera.far_m,
                                .longest = pinhole.corner,
                                .sees_markers = true,
                                .bodies = &bodies.shapes,
                                .drones = &drones.shapes,
                                .asked = {.normals = camera.outputs.normal, .weights = camera.outputs.any_color()},
                                .policy = request.policy});
  CameraOutputs wanted = camera.outputs;
  const bool samples = pinhole.grids.size() > 1;
  if (samples) wanted.rgb = wanted.grey = false;
  const bool centre = wanted.any_color() || wanted.depth || wanted.semantic || wanted.instance || wanted.normal;
  for (std::size_t i = first; i < last; ++i) {
    const PixelTile& tile = pinhole.tiles[i];
    if (centre) sample(request, pinhole.grids[0], tile, wanted, scratch);
    if (samples && camera.outputs.any_color()) average(request, tile, scratch);
    write_tile(scratch.pixels, tile, camera, request.frame);
  }
}

}  // namespace flockstep::render
