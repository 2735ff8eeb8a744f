// Compares the engine's LiDAR stage with bare loops over exactly the same rays, on one thread.
//
// Bare Embree: a plain loop without the engine. It fills packets from precomputed rays, traces them and stores the distances.
// The best of packets of 1, 8 or 16, coherent or incoherent, counts. It runs on the room and its pillars tessellated to
// 16-gons, as any program that passes triangles to Embree would do. It also runs on analytic user geometry, whose callback is
// the engine's SIMD kernel.
// Bare direct: bare_direct-inl.hpp, the minimal code that traces primitives without a tree.
// Engine: Batch::sense, starting from the poses, and the same with errors of ranges or with outputs. All variants run in turns.
// Prints a JSON list of figures.
#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "lidar.cpp"
#include <hwy/foreach_target.h>
// Highway's headers must come after foreach_target.
#include <hwy/highway.h>

#include "bare_direct-inl.hpp"

#if HWY_ONCE
#include <algorithm>
#include <array>
#include <chrono>
#include <cmath>
#include <cstdio>
#include <functional>
#include <limits>
#include <map>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>
#include <vector>

#include "bare_embree.hpp"
#include "base/platform.hpp"
#include "bench.hpp"
#include "collision/sweep.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/generators.hpp"
#include "mesh_world.hpp"
#include "trace/scene.hpp"
#include "trace/user_geometry.hpp"

namespace bench {
HWY_EXPORT(scan);

void scan_direct(const Sensors& sensors, const std::vector<Shape>& shapes, float* ranges) {
  HWY_DYNAMIC_DISPATCH(scan)(sensors, shapes, ranges);
}
}  // namespace bench

namespace {

using bench::BareScene, bench::free_positions, bench::make_query, bench::Query, bench::trace_packet, bench::triangle_scene;
using flockstep::Vec3;
using flockstep::trace::Shape;

constexpr int kRuns = 9;

// The rays of all drones in one world, as plain arrays.
struct Rays {
  std::vector<float> ox, oy, oz, dx, dy, dz, range;
  std::vector<float> t;  // results
};

std::unique_ptr<BareScene> analytic_scene(const flockstep::World& world) {
  auto bare = std::make_unique<BareScene>();
  for (const auto& primitive : world.primitives()) bare->shapes.push_back(flockstep::trace::make_shape(primitive));
  RTCGeometry geometry = rtcNewGeometry(bare->device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned int>(bare->shapes.size()));
  rtcSetGeometryUserData(geometry, bare->shapes.data());
  rtcSetGeometryBoundsFunction(
      geometry,
      [](const RTCBoundsFunctionArguments* args) {
        const flockstep::Aabb box = static_cast<const Shape*>(args->geometryUserPtr)[args->primID].bounds();
        *args->bounds_o = {box.min.x(), box.min.y(), box.min.z(), 0, box.max.x(), box.max.y(), box.max.z(), 0};
      },
      nullptr);
  rtcSetGeometryIntersectFunction(geometry, flockstep::trace::primitive_intersect_function());
  bare->finish(geometry);
  return bare;
}

// The bare Embree loop.
template <class Packet, std::size_t kLanes>
void trace_bare(RTCScene scene, Rays& rays, bool coherent) {
  alignas(64) Packet packet{};
  alignas(64) std::array<int, kLanes> valid;
  valid.fill(-1);
  Query query = make_query(coherent);
  std::fill_n(packet.ray.mask, kLanes, 0xFFFFFFFFU);
  const std::size_t count = rays.t.size();
  const auto fill = [&](std::size_t first, std::size_t lanes) {
    for (std::size_t i = 0; i < lanes; ++i) {
      packet.ray.org_x[i] = rays.ox[first + i];
      packet.ray.org_y[i] = rays.oy[first + i];
      packet.ray.org_z[i] = rays.oz[first + i];
      packet.ray.dir_x[i] = rays.dx[first + i];
      packet.ray.dir_y[i] = rays.dy[first + i];
      packet.ray.dir_z[i] = rays.dz[first + i];
      packet.ray.tfar[i] = rays.range[first + i];
    }
  };
  for (std::size_t first = 0; first < count; first += kLanes) {
    const std::size_t lanes = std::min(kLanes, count - first);
    std::fill_n(packet.hit.geomID, kLanes, RTC_INVALID_GEOMETRY_ID);
    lanes == kLanes ? fill(first, kLanes) : fill(first, lanes);  // unused lanes keep the previous packet's rays
    trace_packet(scene, valid.data(), packet, query);
    for (std::size_t i = 0; i < lanes; ++i) {
      rays.t[first + i] =
          packet.hit.geomID[i] == RTC_INVALID_GEOMETRY_ID ? std::numeric_limits<float>::infinity() : packet.ray.tfar[i];
    }
  }
}

void trace_bare_single(RTCScene scene, Rays& rays) {
  for (std::size_t k = 0; k < rays.t.size(); ++k) {
    RTCRayHit ray{};
    ray.ray.org_x = rays.ox[k];
    ray.ray.org_y = rays.oy[k];
    ray.ray.org_z = rays.oz[k];
    ray.ray.dir_x = rays.dx[k];
    ray.ray.dir_y = rays.dy[k];
    ray.ray.dir_z = rays.dz[k];
    ray.ray.tfar = rays.range[k];
    ray.ray.mask = 0xFFFFFFFFU;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
#if FLOCKSTEP_EMBREE_MAJOR >= 4
    rtcIntersect1(scene, &ray, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &ray);
#endif
    rays.t[k] = ray.hit.geomID == RTC_INVALID_GEOMETRY_ID ? std::numeric_limits<float>::infinity() : ray.ray.tfar;
  }
}

// The poses, beams and shapes of one world, traced by the bare direct loop.
struct BareDirect {
  std::vector<bench::Shape> shapes;
  std::vector<float> position, rotation, ranges;

  explicit BareDirect(const flockstep::World& world) {
    for (const flockstep::Primitive& primitive : world.primitives()) {
      const Shape from = flockstep::trace::make_shape(primitive);
      bench::Shape& to = shapes.emplace_back();
      to.kind = primitive.kind == flockstep::PrimitiveKind::cylinder ? bench::Kind::cylinder
                : primitive.kind == flockstep::PrimitiveKind::sphere ? bench::Kind::sphere
                                                                     : bench::Kind::box;
      to.turned = !from.aligned;
      for (int i = 0; i < 3; ++i) {
        to.center[i] = from.center[i];
        to.half[i] = from.half_extents[i];
        to.bounds[i] = from.box_half[i];
        for (int k = 0; k < 3; ++k) to.to_local[3 * i + k] = from.to_local(i, k);
      }
    }
  }

  void add(const float* at) {
    position.insert(position.end(), at, at + 3);
    rotation.insert(rotation.end(), {1, 0, 0, 0, 1, 0, 0, 0, 1});
  }

  // beams: (3, beams + padding), by component.
  void scan(const std::array<std::vector<float>, 3>& beams, std::size_t count, float range) {
    const std::size_t sensors = position.size() / 3;
    const std::size_t stride = count + 15;
    ranges.resize(sensors * stride);
    bench::scan_direct(
        {sensors, position.data(), rotation.data(), count, beams[0].data(), beams[1].data(), beams[2].data(), range, stride},
        shapes, ranges.data());
  }
};

// Free positions of the drones of a batch, (N, 3) m.
std::vector<float> places_of(int num_drones, const flockstep::Batch::Worlds& worlds) {
  const auto n = static_cast<std::size_t>(num_drones);
  std::vector<float> position(3 * n);
  for (std::size_t w = 0; w < worlds.size(); ++w) {
    const auto free = free_positions(*worlds[w], num_drones, static_cast<std::uint32_t>(w));
    for (std::size_t i = w; i < n; i += worlds.size()) {
      std::copy_n(free[i].data(), 3, position.begin() + static_cast<std::ptrdiff_t>(3 * i));
    }
  }
  return position;
}

// Compares scans with every error, or with outputs, to the same scans without.
void bench_extras(const std::string& name, const flockstep::LidarConfig& lidar, int num_drones,
                  const flockstep::Batch::Worlds& worlds, bench::Figures& figures) {
  flockstep::BatchConfig config;
  config.num_envs = num_drones;
  config.num_threads = 1;
  const std::vector<float> places = places_of(num_drones, worlds);
  std::vector<std::unique_ptr<flockstep::Batch>> batches;
  std::vector<bench::Variant> variants;
  const auto add = [&](const std::string& label, const flockstep::LidarOutputs& outputs, const flockstep::RangeErrors& errors) {
    config.lidars = {lidar};
    config.lidars[0].outputs = outputs;
    config.lidars[0].errors = errors;
    batches.push_back(std::make_unique<flockstep::Batch>(config, worlds));
    batches.back()->set_pose(places, {});
    variants.push_back({label, [batch = batches.back().get()] { batch->sense(); }});
  };
  add("ranges", {}, {});
  add("errors", {},
      {.noise_std_m = 0.01F,
       .noise_per_m = 0.01F,
       .bias_m = 0.01F,
       .resolution_m = 0.001F,
       .min_range_m = 0.1F,
       .dropout = 0.01F});
  add("ids", {.semantic = true, .instance = true}, {});
  add("intensity", {.intensity = true}, {});
  add("outputs", {.semantic = true, .instance = true, .intensity = true}, {});
  const flockstep::FlushDenormals flush;
  const bench::Times times = bench::interleave(variants, kRuns);
  bench::print_rates(name + " with more than ranges", variants, times, static_cast<double>(num_drones), "scans/s");
  for (std::size_t v = 1; v < variants.size(); ++v) {
    figures.add("lidar/" + name + "/relative_rate_with_" + variants[v].label, bench::ratios(times[0], times[v]), "1");
  }
}

void bench_case(const std::string& name, const flockstep::LidarConfig& lidar, int num_drones,
                const flockstep::Batch::Worlds& worlds, bench::Figures& figures) {
  flockstep::BatchConfig config;
  config.num_envs = num_drones;
  config.num_threads = 1;
  config.lidars = {lidar};
  flockstep::Batch batch(config, worlds);
  config.tracer = flockstep::TracerKind::embree;
  flockstep::Batch by_embree(config, worlds);
  const auto n = static_cast<std::size_t>(num_drones);
  const std::vector<float> position = places_of(num_drones, worlds);
  batch.set_pose(position, {});
  batch.sense();
  by_embree.set_pose(position, {});

  const std::size_t per_drone = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
  std::vector<float> directions(3 * n * per_drone);
  batch.lidar().directions(directions);  // level drones: body and world frame are aligned
  std::vector<Rays> rays(worlds.size());
  std::vector<std::unique_ptr<BareScene>> analytic, triangles;
  std::vector<BareDirect> direct;
  const bool has_primitives = !worlds[0]->primitives().empty();
  for (const auto& world : worlds) {
    triangles.push_back(triangle_scene(*world));
    if (has_primitives) analytic.push_back(analytic_scene(*world));
    direct.emplace_back(*world);
  }
  std::array<std::vector<float>, 3> beams;
  for (std::size_t k = 0; k < per_drone + 15; ++k) {
    for (std::size_t axis = 0; axis < 3; ++axis) beams[axis].push_back(k < per_drone ? directions[3 * k + axis] : 0.0F);
  }
  for (std::size_t i = 0; i < n; ++i) {
    Rays& r = rays[i % worlds.size()];
    direct[i % worlds.size()].add(position.data() + 3 * i);
    for (std::size_t k = 0; k < per_drone; ++k) {
      const float* const along = &directions[3 * (i * per_drone + k)];
      r.ox.push_back(position[3 * i]);
      r.oy.push_back(position[3 * i + 1]);
      r.oz.push_back(position[3 * i + 2]);
      r.dx.push_back(along[0]);
      r.dy.push_back(along[1]);
      r.dz.push_back(along[2]);
      r.range.push_back(lidar.max_range_m);
      r.t.push_back(0.0F);
    }
  }

  std::vector<bench::Variant> variants;
  const auto add = [&](const std::string& label, const std::function<void(std::size_t)>& trace_world) {
    variants.push_back({label, [&worlds, trace_world] {
                          for (std::size_t w = 0; w < worlds.size(); ++w) trace_world(w);
                        }});
  };
  variants.push_back({"engine", [&batch] { batch.sense(); }});
  if (has_primitives) add("bare direct", [&](std::size_t w) { direct[w].scan(beams, per_drone, lidar.max_range_m); });
  const std::size_t first_analytic = variants.size();
  std::size_t first_triangles = first_analytic;
  for (const bool tessellated : {false, true}) {
    if (!tessellated && !has_primitives) continue;
    if (tessellated) first_triangles = variants.size();
    const auto& scenes = tessellated ? triangles : analytic;
    const std::string geometry = tessellated ? "triangles" : "analytic";
    add("bare " + geometry + " 1", [&](std::size_t w) { trace_bare_single(scenes[w]->scene, rays[w]); });
    for (const bool coherent : {false, true}) {
      const std::string flag = coherent ? " coherent" : " incoherent";
      add("bare " + geometry + " 8" + flag,
          [&, coherent](std::size_t w) { trace_bare<RTCRayHit8, 8>(scenes[w]->scene, rays[w], coherent); });
      add("bare " + geometry + " 16" + flag,
          [&, coherent](std::size_t w) { trace_bare<RTCRayHit16, 16>(scenes[w]->scene, rays[w], coherent); });
    }
  }
  const std::size_t end_of_bare = variants.size();
  variants.push_back({"engine by Embree", [&by_embree] { by_embree.sense(); }});
  const flockstep::FlushDenormals flush;
  const bench::Times times = bench::interleave(variants, kRuns);
  bench::print_rates(name, variants, times, static_cast<double>(n), "scans/s");
  const auto per_second = [&](std::size_t v) { return bench::rates(times[v], static_cast<double>(n)); };
  const auto ratio = [&](const std::string& figure, std::size_t v) {
    figures.add("lidar/" + figure, bench::ratios(times[v], times[0]), "1");
  };
  const std::size_t best = bench::fastest(times, first_analytic, end_of_bare);
  ratio(name + "/ratio_to_bare_embree", best);
  figures.add("lidar/" + name + "/scans_per_second", per_second(0), "1/s");
  figures.add("lidar/" + name + "/bare_embree_scans_per_second", per_second(best), "1/s");
  const std::string by_packets = "lidar/embree_" + name;
  figures.add(by_packets + "/ratio_to_bare_embree", bench::ratios(times[best], times[end_of_bare]), "1");
  figures.add(by_packets + "/scans_per_second", per_second(end_of_bare), "1/s");
  if (!has_primitives) return;
  const std::size_t best_triangles = bench::fastest(times, first_triangles, end_of_bare);
  ratio("direct_" + name + "/ratio_to_bare_embree", best_triangles);
  ratio("direct_" + name + "/ratio_to_bare_direct", 1);
  figures.add("lidar/direct_" + name + "/bare_embree_scans_per_second", per_second(best_triangles), "1/s");
}

// A world of thousands of upright cylinders on a floor.
std::shared_ptr<const flockstep::World> forest() {
  constexpr float kHalfSide = 100.0F;  // m
  std::mt19937 random(1);
  std::uniform_real_distribution<float> place(-kHalfSide, kHalfSide);
  flockstep::SceneDescription description;
  description.primitives.push_back({.kind = flockstep::PrimitiveKind::room, .half_extents = {kHalfSide, kHalfSide, 2.5F}});
  for (int i = 0; i < 5000; ++i) {
    description.primitives.push_back({.kind = flockstep::PrimitiveKind::cylinder,
                                      .center = {place(random), place(random), 0.0F},
                                      .half_extents = {0.25F, 0.25F, 2.5F}});
  }
  return std::make_shared<const flockstep::World>(std::move(description));
}

}  // namespace

int main(int argc, char** argv) {
  flockstep::Batch::Worlds worlds;
  for (int i = 1; i <= 5; ++i) {
    worlds.push_back(flockstep::World::load(FLOCKSTEP_SCENES "/playground/train-" + std::to_string(i) + ".json"));
  }
  // "sweep" runs only the first case, with the given numbers of drones.
  const bool is_sweep = argc > 1 && std::string(argv[1]) == "sweep";
  bench::Figures figures;
  const auto fan = [&](const std::string& drones) { bench_case("fan35x" + drones, {}, std::stoi(drones), worlds, figures); };
  for (int i = 2; i < argc; ++i) fan(argv[i]);
  if (!is_sweep) {
    fan("1024");
    flockstep::LidarConfig grid;
    grid.channels = 16;
    grid.beams = 360;
    grid.hfov_deg = 360.0F;
    grid.vfov_deg = 30.0F;
    grid.max_range_m = 30.0F;
    bench_case("grid16x360x256", grid, 256, worlds, figures);
    bench_case("forest_fan35x1024", {}, 1024, {forest()}, figures);
    flockstep::Batch::Worlds meshes;
    for (const auto& world : worlds) meshes.push_back(bench::triangles_of(*world, bench::chord_error(*world)));
    bench_case("mesh_fan35x1024", {}, 1024, meshes, figures);
    bench_case("mesh_grid16x360x256", grid, 256, meshes, figures);
    bench_extras("fan35x1024", {}, 1024, worlds, figures);
    bench_extras("grid16x360x256", grid, 256, worlds, figures);
    bench_extras("office_fan35x1024", {}, 1024, {flockstep::office({})}, figures);
    bench_extras("office_grid16x360x256", grid, 256, {flockstep::office({})}, figures);
  }
  figures.print();
}
#endif  // HWY_ONCE
