// Finds the limits up to which direct tracing, tiles and slices are faster than Embree, and prints
// engine/src/trace/calibrated.hpp. It times direct tracing in clouds of primitives of growing density, tiles on meshes of growing
// size with few rays, and slices with fewer beams and with larger gaps between them. `./dev calibrate` writes the file. Run it on
// a quiet machine. The constants are committed, because the choice of tracer affects the last bits of a distance.
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <initializer_list>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <utility>
#include <vector>

#include "bare_embree.hpp"
#include "base/platform.hpp"
#include "bench.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/world.hpp"
#include "mesh_world.hpp"
#include "prepared/prepared_world.hpp"
#include "sensors/beams.hpp"
#include "trace/scene.hpp"
#include "trace/shape.hpp"
#include "trace/tracer.hpp"
#include "trace/user_geometry.hpp"

namespace {

using namespace flockstep;

constexpr int kRuns = 7;
constexpr std::size_t kOrigins = 64;
constexpr float kRange = 5.0F;    // m
constexpr float kExtent = 60.0F;  // m, side of the cube

// Makes a cloud: boxes, cylinders and spheres in equal parts, scattered over a cube.
std::shared_ptr<const World> cloud(int count, float side, std::mt19937& random) {
  std::uniform_real_distribution<float> place(-side / 2, side / 2);
  std::normal_distribution<float> normal;
  SceneDescription description;
  for (int i = 0; i < count; ++i) {
    Primitive primitive;
    primitive.kind =
        std::array{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere}[static_cast<std::size_t>(i % 3)];
    primitive.center = Vec3(place(random), place(random), place(random));
    primitive.half_extents = Vec3::Constant(0.4F);
    if (primitive.kind != PrimitiveKind::sphere) {
      primitive.rotation = Quat(normal(random), normal(random), normal(random), normal(random)).normalized();
    }
    description.primitives.push_back(primitive);
  }
  return std::make_shared<const World>(std::move(description));
}

// Returns the size of a cloud that has about `within` shapes within range of a point.
int count_for(int within) {
  const double ball = 4.0 / 3.0 * std::numbers::pi * std::pow(static_cast<double>(kRange) + 0.4, 3.0);
  return static_cast<int>(within * std::pow(static_cast<double>(kExtent), 3.0) / ball);
}

// Returns Embree's time over that of direct tracing. The rays are a horizontal 360-degree fan in clouds with `within` shapes in
// range.
double bundle_advantage(int within) {
  LidarConfig lidar;
  lidar.hfov_deg = 360.0F;
  std::mt19937 random(1);
  const auto world = cloud(count_for(within), kExtent, random);
  const trace::Scene& scene = prepared(*world).scene();
  const sensors::BeamPattern pattern = sensors::make_pattern(lidar, {});
  std::uniform_real_distribution<float> place(-kExtent / 3, kExtent / 3);
  std::vector<Vec3> origins(kOrigins);
  for (Vec3& origin : origins) origin = Vec3(place(random), place(random), place(random));

  auto bundle = std::make_unique<trace::RayBundle>();
  auto candidates = std::make_unique<trace::CandidateSet>();
  auto tracer = std::make_unique<trace::Tracer>();
  trace::RayBlock* const block = &tracer->block();
  bundle->rotation = Mat3::Identity();
  bundle->range = kRange;
  const auto for_each_bundle = [&](const auto& trace) {
    for (const Vec3& origin : origins) {
      bundle->origin = origin;
      scene.gather(origin, 0.0F, kRange, false, *candidates);
      for (const sensors::BeamTile& tile : pattern.tiles) {
        bundle->x = pattern.x.data() + tile.first;
        bundle->y = pattern.y.data() + tile.first;
        bundle->z = pattern.z.data() + tile.first;
        bundle->count = tile.rows * tile.width;
        bundle->frustum = &tile.frustum;
        trace();
      }
    }
  };
  const auto direct = [&] {
    for_each_bundle(
        [&] { trace::trace_direct(std::span(candidates->list).first(candidates->count), trace::kMaxCandidates, *bundle); });
  };
  const auto embree = [&] {
    block->count = 0;
    for_each_bundle([&] {
      std::fill_n(bundle->t_hit, bundle->count, std::numeric_limits<float>::infinity());
      std::fill_n(bundle->element, bundle->count, -1);
      for (std::size_t first = 0; first < bundle->count;) {
        const std::size_t count = std::min(trace::kMaxRays - block->count, bundle->count - first);
        append(*bundle, first, count, *block);
        first += count;
        if (block->count < trace::kMaxRays) continue;
        tracer->trace_block(scene);
        block->count = 0;
      }
    });
  };
  const bench::Times times = bench::interleave({{"direct", direct}, {"embree", embree}}, kRuns, 0.01);
  return bench::median_ratio(times[1], times[0]);
}

// Same ratio for rays with arbitrary origins and directions, in a world of `count` shapes.
double block_advantage(int count) {
  std::mt19937 random(1);
  const auto world = cloud(count, 2.0F * kRange, random);
  const trace::Scene scene(*world, *std::pmr::get_default_resource(), 0);  // no direct tracing, everything goes through Embree
  std::vector<trace::NumberedShape> shapes;
  for (const Primitive& primitive : world->primitives()) {
    shapes.push_back({trace::make_shape(primitive), static_cast<std::int32_t>(shapes.size())});
  }
  std::uniform_real_distribution<float> place(-kRange, kRange);
  auto tracer = std::make_unique<trace::Tracer>();
  trace::RayBlock* const rays = &tracer->block();
  rays->count = trace::kMaxRays;
  for (std::size_t i = 0; i < rays->count; ++i) {
    const Vec3 direction = Vec3(place(random), place(random), place(random)).normalized();
    rays->org_x[i] = place(random);
    rays->org_y[i] = place(random);
    rays->org_z[i] = place(random);
    rays->dir_x[i] = direction.x();
    rays->dir_y[i] = direction.y();
    rays->dir_z[i] = direction.z();
    rays->range[i] = 4.0F * kRange;
  }
  const bench::Times times = bench::interleave(
      {{"direct", [&] { trace::trace_direct(shapes, *rays); }}, {"embree", [&] { tracer->trace_block(scene); }}}, kRuns, 0.01);
  return bench::median_ratio(times[1], times[0]);
}

// Returns the last of some values before the first that is not good, or `otherwise` if the first one is not.
template <class T>
T last_good(std::initializer_list<T> values, T otherwise, const std::function<bool(T)>& is_good) {
  for (const T value : values) {
    if (!is_good(value)) break;
    otherwise = value;
  }
  return otherwise;
}

// Returns the largest count up to which direct tracing is as fast as Embree, within a 5 % measurement tolerance.
int crossover(const char* name, double (*advantage)(int)) {
  return last_good<int>({2, 4, 6, 8, 12, 16, 24, 32, 48, 64, 96, 128, 192, 256, 384}, 0, [&](int count) {
    const double gain = advantage(count);
    std::fprintf(stderr, "  %-10s %4d shapes: Embree takes %6.2f times as long\n", name, count, gain);
    return gain >= 0.95;
  });
}

// Returns Embree's time over that of a tracer, for batches that differ in nothing else. They are at places in free space, with
// rotations (num_envs, 4). embree: the tracer that sends these rays through Embree.
double advantage_over_embree(TracerKind tracer, TracerKind embree, BatchConfig config, const std::shared_ptr<const World>& world,
                             const std::vector<float>& rotation) {
  std::vector<float> position;
  for (const Vec3& place : bench::free_positions(*world, config.num_envs, 1)) {
    position.insert(position.end(), place.begin(), place.end());
  }
  config.num_threads = 1;
  const auto sensing = [&](TracerKind by) {
    config.tracer = by;
    const auto batch = std::make_shared<Batch>(config, Batch::Worlds{world});
    batch->set_pose(position, rotation);
    return bench::Variant{"", [batch] { batch->sense(); }};
  };
  const bench::Times times = bench::interleave({sensing(tracer), sensing(embree)}, kRuns, 0.01);
  return bench::median_ratio(times[1], times[0]);
}

// Returns that of tiles, for cameras of side x side pixels over hills with about `triangles` triangles.
double tiles_advantage(int side, int triangles) {
  const int cells = static_cast<int>(std::sqrt(triangles / 2.48));  // hill and tree triangles
  BatchConfig config;
  config.num_envs = 64;
  config.cameras.emplace_back();
  config.cameras[0].width_px = config.cameras[0].height_px = side;
  config.cameras[0].far_m = 100.0F;
  config.cameras[0].outputs = {.rgb = false, .depth = true};
  std::vector<float> rotation;
  for (int i = 0; i < config.num_envs; ++i) {
    const float half_yaw = 0.3F * static_cast<float>(i);
    rotation.insert(rotation.end(), {std::cos(half_yaw), 0.0F, 0.0F, std::sin(half_yaw)});
  }
  const auto world = bench::mesh_world(cells, 0.3F * static_cast<float>(cells));
  return advantage_over_embree(TracerKind::tiles, TracerKind::embree, config, world, rotation);
}

// Returns the smallest ray count that is faster in tiles at 1000 triangles. Only counts that fill whole tiles are tried.
int min_rays_in_tiles() {
  for (const int side : {16, 24, 32}) {
    const double gain = tiles_advantage(side, 1000);
    std::fprintf(stderr, "  tiles      %4d rays: Embree takes %6.2f times as long\n", side * side, gain);
    if (gain >= 1.05) return side * side;
  }
  return 48 * 48;
}

// Returns the most triangles per ray up to which tiles are faster by a factor of 1.3, which justifies their memory. The result
// is a power of two.
int triangles_per_ray(int rays) {
  return last_good<int>({16, 32, 64, 128, 256, 512, 1024, 2048, 4096, 8192}, 1, [&](int each) {
    const double gain = tiles_advantage(static_cast<int>(std::sqrt(rays)), each * rays);
    std::fprintf(stderr, "  tiles      %4d triangles for each of %d rays: Embree takes %6.2f times as long\n", each, rays, gain);
    return gain >= 1.3;
  });
}

constexpr float kFov = 1.5F * std::numbers::pi_v<float>;  // rad, of fans

// Returns the advantage of slices, for fans of 270 degrees with the given length between beams at their range.
double slices_advantage(const std::shared_ptr<const World>& world, int beams, float between_m) {
  BatchConfig config;
  config.num_envs = 1024;
  config.lidars.emplace_back();
  config.lidars[0].beams = beams;
  config.lidars[0].hfov_deg = 270.0F;
  config.lidars[0].max_range_m = between_m * static_cast<float>(beams - 1) / kFov;
  std::mt19937 random(1);
  std::uniform_real_distribution<float> tilt(-0.2F, 0.2F), turn(-3.14F, 3.14F);
  std::vector<float> rotation;
  for (int i = 0; i < config.num_envs; ++i) {
    const Quat q(Eigen::AngleAxisf(turn(random), Vec3::UnitZ()) * Eigen::AngleAxisf(tilt(random), Vec3::UnitY()) *
                 Eigen::AngleAxisf(tilt(random), Vec3::UnitX()));
    rotation.insert(rotation.end(), {q.w(), q.x(), q.y(), q.z()});
  }
  return advantage_over_embree(TracerKind::slices, TracerKind::tiles, config, world, rotation);  // a fan forms no tile
}

std::shared_ptr<const World> office_of_triangles() {
  const auto world = office(OfficeConfig{});
  return bench::triangles_of(*world, bench::chord_error(*world));
}

// Returns the least advantage of slices in several meshes, with the processor's best instructions and with AVX2, because the
// thresholds are the same for all processors. Embree has its best instructions in both cases.
double least_slices_advantage(int beams, float between_m) {
  static const std::array<std::pair<const char*, std::shared_ptr<const World>>, 4> meshes{
      {{"hills1k", bench::mesh_world(20, 20.0F)},
       {"hills100k", bench::mesh_world(200, 60.0F)},
       {"hills1M", bench::mesh_world(640, 180.0F)},
       {"office", office_of_triangles()}}};
  const std::int64_t all = hwy::SupportedTargets(), older = all & ~(HWY_AVX2 - 1);
  double least = std::numeric_limits<double>::infinity();
  for (const auto& [name, world] : meshes) {
    for (const std::int64_t targets : {all, (all & HWY_AVX2) != 0 ? older : all}) {
      hwy::GetChosenTarget().Update(targets);
      const double gain = slices_advantage(world, beams, between_m);
      std::fprintf(stderr, "  slices     %4d beams, %.1f m between them, in %s with %s: Embree takes %6.2f times as long\n",
                   beams, static_cast<double>(between_m), name, trace::simd_target(), gain);
      least = std::min(least, gain);
    }
  }
  hwy::GetChosenTarget().Update(all);
  return least;
}

// Slices count as fast as Embree down to this advantage: times vary by a few percent, and with AVX2 Embree is favoured.
constexpr double kAsFast = 0.95;

// Returns the number of beams, half a metre apart, from which slices are as fast in every mesh.
int min_rays_in_slice() {
  return last_good<int>({48, 32, 24, 20, 18, 16, 14, 12, 10, 8, 6, 4}, 64,
                        [](int beams) { return least_slices_advantage(beams, 0.5F) >= kAsFast; });
}

// Returns the length between beams up to which slices are as fast in every mesh, for 12 beams and for 35.
float widest_in_slice() {
  return last_good<float>({0.4F, 0.6F, 0.8F, 1.0F, 1.2F, 1.5F, 2.0F, 3.0F}, 0.0F, [](float between_m) {
    return std::min(least_slices_advantage(12, between_m), least_slices_advantage(35, between_m)) >= kAsFast;
  });
}

}  // namespace

int main() {
  const FlushDenormals flush;
  const int bundle = crossover("in reach", bundle_advantage);
  const int any_origin = std::min(crossover("in all", block_advantage), bundle);
  const int fewest = min_rays_in_tiles(), per_ray = triangles_per_ray(fewest), in_slice = min_rays_in_slice();
  const float widest = widest_in_slice();
  std::printf(
      R"(// Thresholds that select the method of ray tracing. Written by `./dev calibrate` (here with %s). They are not measured at run
// time, since the method affects the last bits of a distance.
#pragma once

#include <cstddef>

namespace flockstep::trace {

// Up to this many shapes in view, a bundle's rays are tested against each of them.
inline constexpr std::size_t kMaxDirect = %d;
// Up to this many shapes in the world, rays of arbitrary origins are tested against each of them.
inline constexpr std::size_t kMaxDirectAnyOrigin = %d;
// A sensor with at least kMinRaysInTiles rays traces triangles in tiles, if the world has at most kTrianglesPerRay triangles per
// ray.
inline constexpr std::size_t kMinRaysInTiles = %d;
inline constexpr std::size_t kTrianglesPerRay = %d;
// A fan of at least kMinRaysInSlice rays is traced as a slice if their mean distance at its range is at most kWidestInSlice (m).
inline constexpr std::size_t kMinRaysInSlice = %d;
inline constexpr float kWidestInSlice = %.1fF;

}  // namespace flockstep::trace
)",
      trace::simd_target(), bundle, any_origin, fewest, per_ray, in_slice, static_cast<double>(widest));
}
