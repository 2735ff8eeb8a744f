#include "render/raycast/raycast_renderer.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstring>
#include <limits>
#include <numeric>
#include <span>
#include <vector>

#include "trace/packets.hpp"

namespace flockstep::render {
namespace {

static_assert(PixelTile::kSide == trace::kTileWidth && TilePixels::kCount == trace::kMaxRays);

// Distance of a shadow ray's origin from the surface, relative to its coordinates. It exceeds the rounding error of a hit.
constexpr float kLift = 1e-4F;

// An adaptive camera takes all samples of a pixel if a channel differs by more than this among the 3 x 3 pixels around it.
constexpr int kMaxEven = 8;

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

// Fills the tracer's block with rays of this range from the hits of a tile, and moves their origins away from the surface: back
// along the ray and by `away`, directions of length 1. Returns the box around the origins, whose min exceeds its max without
// hits.
Aabb start_at_hits(const trace::RayBundle& rays, const RayArray (&away)[3], float range, trace::RayBlock& block) {
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
  const RayArray lift = kLift * (1.0F + farthest);
  const RayArray missed = hit.select(RayArray::Zero(count), kFar);  // moves other rays out of the box around all hits
  Aabb hits;
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    RayView origin(origins[axis], count);
    origin += lift * (away[axis] - directions[axis] / length);
    hits.min[axis] = (origin + missed).minCoeff();
    hits.max[axis] = (origin - missed).maxCoeff();
  }
  RayView(block.range, count) = hit.select(RayArray::Constant(count, range), 0.0F);
  return hits;
}

// Finds the hits that lie in shadow: traces a ray from each hit towards the sun.
void find_shadows(const RenderRequest& request, const trace::RayBundle& rays, RaycastScratch& scratch) {
  trace::RayBlock& block = scratch.tracer.block();
  const Vec3 sun = to_sun(request);
  const auto count = static_cast<Eigen::Index>(rays.count);
  RayArray towards[3];
  float* const directions[3] = {block.dir_x, block.dir_y, block.dir_z};
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    towards[axis] = RayArray::Constant(count, sun[axis]);
    RayView(directions[axis], count) = towards[axis];
  }
  const Aabb hits = start_at_hits(rays, towards, std::numeric_limits<float>::max(), block);
  if (hits.min.x() > hits.max.x()) {
    std::fill_n(scratch.shaded, rays.count, std::uint8_t{0});
    return;
  }
  const float radius = std::tan(request.camera->sun_size_deg * (std::numbers::pi_v<float> / 360.0F));
  if (radius > 0.0F) scratch.soft.aim_at_disc(radius, block);
  const Casters::Beam beam{sun, radius};
  scratch.tracer.trace_shadows(*request.scene, !scratch.casters.lists_primitives(), scratch.casters.above(hits, beam),
                               scratch.casters.meshes_above(hits, beam));
  for (std::size_t i = 0; i < rays.count; ++i) scratch.shaded[i] = std::isfinite(block.t_hit[i]);
  const std::optional<Aabb>& room = request.shading->room();
  const bool outside = room && !((room->min.array() <= hits.min.array()).all() && (hits.max.array() <= room->max.array()).all());
  for (std::size_t i = 0; outside && i < rays.count; ++i) {
    const Vec3 point(block.org_x[i], block.org_y[i], block.org_z[i]);
    const Vec3 towards_sun(block.dir_x[i], block.dir_y[i], block.dir_z[i]);
    if (rays.element[i] >= 0 && is_behind(*room, point, towards_sun)) scratch.shaded[i] = 1;
  }
}

// Finds the share of the ambient light that reaches each hit: traces short rays into the half space in front of the surface.
void find_ambient(const RenderRequest& request, const trace::RayBundle& rays, RaycastScratch& scratch) {
  trace::RayBlock& block = scratch.tracer.block();
  const CameraOutputs normals{.rgb = false, .normal = true};
  request.shading->shade(rays, scratch.tracer.details(), {}, nullptr, 1.0F, normals, DepthKind::planar, scratch.bodies,
                         scratch.facing);
  const float* const facing[3] = {scratch.facing.nx, scratch.facing.ny, scratch.facing.nz};
  RayArray away[3];
  for (std::size_t axis = 0; axis < 3; ++axis) {
    away[axis] = Eigen::Map<const Eigen::ArrayXf>(facing[axis], static_cast<Eigen::Index>(rays.count));
  }
  Aabb hits = start_at_hits(rays, away, SoftLight::kReach, block);
  std::fill_n(scratch.soft.ambient, rays.count, 1.0F);
  if (hits.min.x() > hits.max.x()) return;
  hits.min.array() -= SoftLight::kReach;
  hits.max.array() += SoftLight::kReach;
  const auto shapes = scratch.casters.above(hits, {});
  const auto meshes = scratch.casters.meshes_above(hits, {});
  const int number = request.camera->ambient_occlusion_rays;
  for (int k = 0; k < number; ++k) {
    scratch.soft.aim_at_sky(facing[0], facing[1], facing[2], k, block);
    scratch.tracer.trace_shadows(*request.scene, !scratch.casters.lists_primitives(), shapes, meshes);
    for (std::size_t i = 0; i < rays.count; ++i) {
      if (std::isfinite(block.t_hit[i])) scratch.soft.ambient[i] -= 1.0F / static_cast<float>(number);
    }
  }
}

// Finds the shares of the light that the hits of a tile receive. shadows: find_shadows() has been called.
void find_soft_light(const RenderRequest& request, const trace::RayBundle& rays, bool shadows, RaycastScratch& scratch) {
  for (std::size_t i = 0; i < rays.count; ++i) scratch.soft.sun[i] = shadows && scratch.shaded[i] != 0 ? 0.0F : 1.0F;
  if (request.camera->ambient_occlusion_rays > 0) {
    find_ambient(request, rays, scratch);
  } else {
    std::fill_n(scratch.soft.ambient, rays.count, 1.0F);
  }
}

bool has_soft_light(const RenderRequest& request, const CameraOutputs& wanted) {
  return request.camera->has_soft_light() && wanted.any_color();
}

// Traces and shades rays of a tile. With soft light, they have their random numbers.
void shoot(const RenderRequest& request, const PixelTile& tile, const trace::RayTile& shot, const CameraOutputs& wanted,
           RaycastScratch& scratch) {
  const trace::RayBundle& rays = scratch.tracer.trace(shot);
  const bool shadows = request.camera->shadows && wanted.any_color();
  const bool soft = has_soft_light(request, wanted);
  if (shadows) find_shadows(request, rays, scratch);
  if (soft) find_soft_light(request, rays, shadows, scratch);
  const auto shaded = shadows && !soft ? std::span<const std::uint8_t>(scratch.shaded) : std::span<const std::uint8_t>();
  const auto samples = static_cast<float>(std::max(request.optics->grids.size() - 1, std::size_t{1}));
  request.shading->shade(rays, scratch.tracer.details(), shaded, soft ? &scratch.soft : nullptr, 1.0F / (tile.density * samples),
                         wanted, request.camera->depth_kind, scratch.bodies, scratch.pixels);
}

// Sets the random numbers of the ray through a pixel of a tile.
void seed(const RenderRequest& request, const CameraOptics::Grid& grid, const PixelTile& tile, std::size_t pixel, std::size_t ray,
          RaycastScratch& scratch) {
  scratch.soft.seed(ray, tile.column + pixel % PixelTile::kSide, tile.row + pixel / PixelTile::kSide,
                    static_cast<std::size_t>(&grid - request.optics->grids.data()), request.camera->ambient_occlusion_rays);
}

// Traces and shades one sample of each pixel of the tile.
void sample(const RenderRequest& request, const CameraOptics::Grid& grid, const PixelTile& tile, const CameraOutputs& wanted,
            RaycastScratch& scratch) {
  const std::size_t pixels = has_soft_light(request, wanted) ? tile.height * PixelTile::kSide : 0;
  for (std::size_t i = 0; i < pixels; ++i) seed(request, grid, tile, i, i, scratch);
  shoot(request, tile,
        {.x = grid.ahead.empty() ? scratch.ones : grid.ahead.data() + tile.across * TilePixels::kCount + tile.first,
         .y = grid.left.data() + tile.across * TilePixels::kCount + tile.first,
         .z = grid.up.data() + tile.down * TilePixels::kCount + tile.first,
         .rows = tile.height,
         .width = PixelTile::kSide,
         .frustum = &tile.frustum,
         .u = grid.columns.empty() ? nullptr : &grid.columns[tile.across],
         .v = grid.rows.empty() ? nullptr : &grid.rows[tile.down],
         .is_rectangle = !request.optics->lens},
        wanted, scratch);
}

CameraOutputs colors_of(CameraOutputs outputs) {
  outputs.depth = outputs.semantic = outputs.instance = outputs.normal = false;
  return outputs;
}

// Returns the bodies and the drones of a request, numbered after the elements of its world.
std::array<VisibleBodies, 2> numbered_bodies(const RenderRequest& request) {
  std::array all{request.bodies, request.drones};
  all[0].shapes.first_element = request.shading->first_body();
  all[1].shapes.first_element = all[0].shapes.first_element + static_cast<std::int32_t>(all[0].shapes.count);
  return all;
}

// Points the tracer from a pose of the camera.
void aim(const RenderRequest& request, const CameraPose& pose, RaycastScratch& scratch) {
  const CameraConfig& camera = *request.camera;
  const auto [bodies, drones] = numbered_bodies(request);
  scratch.tracer.set_viewpoint(*request.scene,
                               {.origin = pose.position,
                                .rotation = pose.rotation,
                                .range = camera.far_m,
                                .longest = request.optics->corner,
                                .near = camera.near_m,
                                .sees_markers = true,
                                .bodies = &bodies.shapes,
                                .drones = &drones.shapes,
                                .asked = {.normals = camera.outputs.normal || has_soft_light(request, camera.outputs),
                                          .weights = camera.outputs.any_color()},
                                .policy = request.policy});
}

// Averages the colours of all samples, at all poses of the exposure, the last of which remains the tracer's.
void average(const RenderRequest& request, const PixelTile& tile, RaycastScratch& scratch) {
  TilePixels& pixels = scratch.pixels;
  std::uint8_t* const channels[3] = {pixels.r, pixels.g, pixels.b};
  const CameraOutputs colors = colors_of(request.camera->outputs);
  const std::size_t pixels_of_tile = tile.height * PixelTile::kSide;
  for (auto& sums : scratch.sums) std::fill_n(sums, pixels_of_tile, std::uint16_t{0});
  const auto all = std::span(request.optics->grids);
  const auto grids = all.size() > 1 ? all.subspan(1) : all;
  const int poses = request.camera->num_poses();
  for (int pose = 0; pose < poses; ++pose) {
    if (poses > 1) aim(request, request.exposure->at(tile.row, pose), scratch);
    for (const CameraOptics::Grid& grid : grids) {
      sample(request, grid, tile, colors, scratch);
      for (std::size_t c = 0; c < 3; ++c) {
        for (std::size_t i = 0; i < pixels_of_tile; ++i) {
          scratch.sums[c][i] = static_cast<std::uint16_t>(scratch.sums[c][i] + channels[c][i]);
        }
      }
    }
  }
  const auto count = static_cast<unsigned int>(grids.size()) * static_cast<unsigned int>(poses);
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < pixels_of_tile; ++i) {
      channels[c][i] = static_cast<std::uint8_t>((scratch.sums[c][i] + count / 2) / count);
    }
  }
}

// Row `row` of a channel of request.centres, which is padded to whole tiles.
std::uint8_t* centres_of(const RenderRequest& request, std::size_t channel, std::size_t row) {
  const std::vector<PixelTile>& tiles = request.optics->tiles;
  const std::size_t width = tiles.back().column + PixelTile::kSide;
  return request.centres + channel * tiles.size() * TilePixels::kCount + row * width;
}

// Copies the colours of a tile to request.centres, or back.
template <bool kBack>
void copy_centres(const RenderRequest& request, const PixelTile& tile, TilePixels& pixels) {
  std::uint8_t* const channels[3] = {pixels.r, pixels.g, pixels.b};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t row = 0; row < tile.height; ++row) {
      std::uint8_t* const centres = centres_of(request, c, tile.row + row) + tile.column;
      std::uint8_t* const own = channels[c] + row * PixelTile::kSide;
      std::memcpy(kBack ? own : centres, kBack ? centres : own, PixelTile::kSide);
    }
  }
}

// Lists the pixels of a tile around which the colours of request.centres differ.
std::span<const std::uint8_t> list_uneven(const RenderRequest& request, const PixelTile& tile,
                                          std::array<std::uint8_t, TilePixels::kCount>& list) {
  constexpr std::size_t kSide = PixelTile::kSide;
  const PixelTile& corner = request.optics->tiles.back();
  const std::size_t left = tile.column == 0 ? 0 : 1, right = tile.column == corner.column ? 0 : 1;
  std::array<bool, TilePixels::kCount> uneven{};
  for (std::size_t c = 0; c < 3; ++c) {
    // With a border of one pixel, and more columns for vectors. Beyond the image it repeats the image's border.
    std::uint8_t around[kSide + 2][2 * kSide] = {};
    for (std::size_t row = 0; row < tile.height + 2; ++row) {
      const std::size_t above = std::clamp(tile.row + row, std::size_t{1}, corner.row + corner.height) - 1;
      const std::uint8_t* const centres = centres_of(request, c, above) + tile.column;
      std::memcpy(&around[row][1], centres, kSide);
      around[row][0] = *(centres - left);
      std::fill(&around[row][tile.width + 1], &around[row][kSide + 2], centres[tile.width - 1 + right]);
    }
    for (std::size_t row = 0; row < tile.height; ++row) {
      std::uint8_t low[2 * kSide], high[2 * kSide];
      for (std::size_t i = 0; i < 2 * kSide; ++i) {
        low[i] = std::min(std::min(around[row][i], around[row + 1][i]), around[row + 2][i]);
        high[i] = std::max(std::max(around[row][i], around[row + 1][i]), around[row + 2][i]);
      }
      for (std::size_t i = 0; i < kSide; ++i) {
        const int lowest = std::min(std::min(low[i], low[i + 1]), low[i + 2]);
        const int highest = std::max(std::max(high[i], high[i + 1]), high[i + 2]);
        uneven[row * kSide + i] |= highest - lowest > kMaxEven;
      }
    }
  }
  std::size_t count = 0;
  for (std::size_t i = 0; i < tile.height * kSide; ++i) {
    if (uneven[i] && i % kSide < tile.width) list[count++] = static_cast<std::uint8_t>(i);
  }
  return std::span(list).first(count);
}

// Takes all samples of some pixels of a tile, kMaxRays in all at most, and writes their means to scratch.refined.
void refine(const RenderRequest& request, const PixelTile& tile, std::span<const std::uint8_t> list, RaycastScratch& scratch) {
  const auto grids = std::span(request.optics->grids).subspan(1);
  std::size_t rays = 0;
  for (const std::size_t pixel : list) {
    for (const CameraOptics::Grid& grid : grids) {
      if (request.camera->has_soft_light()) seed(request, grid, tile, pixel, rays, scratch);
      scratch.ahead[rays] = grid.ahead.empty() ? 1.0F : grid.ahead[tile.across * TilePixels::kCount + pixel];
      scratch.left[rays] = grid.left[tile.across * TilePixels::kCount + pixel];
      scratch.up[rays++] = grid.up[tile.down * TilePixels::kCount + pixel];
    }
  }
  for (float* const of : {scratch.ahead, scratch.left, scratch.up}) std::fill(of + rays, of + trace::kMaxRays, of[rays - 1]);
  const trace::TileAxis u = trace::make_tile_axis(scratch.left), v = trace::make_tile_axis(scratch.up);
  shoot(request, tile,
        {.x = scratch.ahead,
         .y = scratch.left,
         .z = scratch.up,
         .rows = (rays + PixelTile::kSide - 1) / PixelTile::kSide,
         .width = PixelTile::kSide,
         .frustum = &tile.frustum,
         .u = &u,
         .v = &v},
        colors_of(request.camera->outputs), scratch);
  const std::uint8_t* const taken[3] = {scratch.pixels.r, scratch.pixels.g, scratch.pixels.b};
  std::uint8_t* const refined[3] = {scratch.refined.r, scratch.refined.g, scratch.refined.b};
  for (std::size_t c = 0; c < 3; ++c) {
    for (std::size_t i = 0; i < list.size(); ++i) {
      const std::size_t sum = std::accumulate(taken[c] + i * grids.size(), taken[c] + (i + 1) * grids.size(), grids.size() / 2);
      refined[c][list[i]] = static_cast<std::uint8_t>(sum / grids.size());
    }
  }
}

// Prepares the scratch memory for tiles of a request.
void begin(const RenderRequest& request, RaycastScratch& scratch) {
  const CameraConfig& camera = *request.camera;
  const auto [bodies, drones] = numbered_bodies(request);
  scratch.bodies.begin(bodies, drones, *request.shading);
  if (has_soft_light(request, camera.outputs) || (camera.shadows && camera.outputs.any_color())) {
    const auto& primitives = request.world->primitives();
    const bool has_room = !primitives.empty() && primitives[0].kind == PrimitiveKind::room;
    scratch.casters.begin(has_room ? &request.scene->shape(0) : nullptr, request.scene->casters(), bodies.shapes, drones.shapes);
  }
  aim(request, {request.position, request.rotation}, scratch);
}

}  // namespace

RaycastScratch::RaycastScratch() { std::fill(std::begin(ones), std::end(ones), 1.0F); }

void render_tiles(const RenderRequest& request, std::size_t first, std::size_t last, RaycastScratch& scratch) {
  begin(request, scratch);
  const CameraOptics& optics = *request.optics;
  CameraOutputs wanted = request.camera->outputs;
  const int poses = request.camera->num_poses();
  const bool samples = (optics.grids.size() > 1 || poses > 1) && request.centres == nullptr;
  if (samples) wanted.rgb = wanted.grey = false;
  const bool centre = wanted.any_color() || wanted.depth || wanted.semantic || wanted.instance || wanted.normal;
  for (std::size_t i = first; i < last; ++i) {
    const PixelTile& tile = optics.tiles[i];
    const bool is_new_row = i == first || tile.row != optics.tiles[i - 1].row;
    if (request.exposure && is_new_row) aim(request, request.exposure->at(tile.row, poses - 1), scratch);
    if (centre) sample(request, optics.grids[0], tile, wanted, scratch);
    if (request.centres != nullptr) copy_centres<false>(request, tile, scratch.pixels);
    if (samples && request.camera->outputs.any_color()) average(request, tile, scratch);
    write_tile(scratch.pixels, tile, *request.camera, request.frame);
  }
}

void refine_tiles(const RenderRequest& request, std::size_t first, std::size_t last, RaycastScratch& scratch) {
  begin(request, scratch);
  const std::size_t most = trace::kMaxRays / (request.optics->grids.size() - 1);  // pixels at a time
  const RenderTargets colors{.rgb = request.frame.rgb, .grey = request.frame.grey};
  std::array<std::uint8_t, TilePixels::kCount> list;
  for (std::size_t i = first; i < last; ++i) {
    const PixelTile& tile = request.optics->tiles[i];
    auto left = list_uneven(request, tile, list);
    if (left.empty()) continue;
    copy_centres<true>(request, tile, scratch.refined);
    for (; !left.empty(); left = left.subspan(std::min(most, left.size()))) {
      refine(request, tile, left.first(std::min(most, left.size())), scratch);
    }
    write_tile(scratch.refined, tile, *request.camera, colors);
  }
}

}  // namespace flockstep::render
