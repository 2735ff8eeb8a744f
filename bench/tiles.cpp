// Compares tiles of rays and slices of fans with Embree on triangles. Only tracing is timed, from the same poses, on one thread.
//
// Bare Embree: single rays, or packets of 8 or 16 neighbouring rays of one sensor, coherent or incoherent, in rectangles of 4 x 2
// or 4 x 4 if the pattern has rows. The best of all counts. It stores the same results as the engine: distance, triangle and
// normal for cameras, distance for LiDARs. Engine: a Tracer. All variants run in turns. Prints a JSON list of figures.
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <cstring>
#include <limits>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <tuple>
#include <utility>
#include <vector>

#include "bare_embree.hpp"
#include "base/platform.hpp"
#include "bench.hpp"
#include "flockstep/generators.hpp"
#include "mesh_world.hpp"
#include "render/pinhole_camera.hpp"
#include "sensors/beams.hpp"
#include "trace/packets.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace {

using flockstep::Mat3;
using flockstep::Quat;
using flockstep::Vec3;

constexpr int kRuns = 7;
constexpr float kInfinity = std::numeric_limits<float>::infinity();

// Fans: beams, field of view (degrees), range (m).
constexpr std::array<std::tuple<int, float, float>, 6> kFans{
    {{8, 180.0F, 4.0F}, {12, 180.0F, 5.0F}, {20, 180.0F, 5.0F}, {35, 270.0F, 3.0F}, {35, 270.0F, 30.0F}, {72, 360.0F, 10.0F}}};

// A sensor's rays, row by row, in its frame. For cameras x is 1.
struct Pattern {
  std::string name;
  std::size_t rows, columns;
  int sensors;
  bool is_camera;
  float near, range;
  std::vector<float> x, y, z;
};

struct Poses {
  std::vector<Vec3> position;
  std::vector<Mat3> rotation;

  Poses() = default;
  Poses(const flockstep::World& world, int count) : position(bench::free_positions(world, count, 1)) {
    std::mt19937 random(2);
    while (rotation.size() < position.size()) {
      const float yaw = std::uniform_real_distribution<float>(0.0F, 2.0F * std::numbers::pi_v<float>)(random);
      const float pitch = std::uniform_real_distribution<float>(-0.2F, 0.2F)(random);
      rotation.emplace_back((Eigen::AngleAxisf(yaw, Vec3::UnitZ()) * Eigen::AngleAxisf(pitch, Vec3::UnitY())).toRotationMatrix());
    }
  }

  Poses only(std::size_t sensor) const {
    Poses one;
    one.position = {position[sensor]};
    one.rotation = {rotation[sensor]};
    return one;
  }
};

// The hits of one sensor's rays. All sensors use the same buffer, so it stays in cache.
struct Hits {
  std::vector<float> distance;
  std::vector<unsigned int> triangle;
  std::array<std::vector<float>, 3> normal;

  explicit Hits(const Pattern& pattern) : distance(pattern.rows * pattern.columns) {
    if (!pattern.is_camera) return;
    triangle.resize(distance.size());
    for (std::vector<float>& axis : normal) axis.resize(distance.size());
  }
};

// Traces packets of kWide x kHigh rays.
template <class Packet, std::size_t kWide, std::size_t kHigh>
void trace_bare(const bench::BareScene& scene, const Pattern& pattern, const Poses& poses, bool coherent, Hits& hits) {
  constexpr std::size_t kLanes = kWide * kHigh;
  alignas(64) Packet packet{};
  alignas(64) std::array<int, kLanes> valid;
  bench::Query query = bench::make_query(coherent);
  std::fill_n(packet.ray.mask, kLanes, 0xFFFFFFFFU);
  std::fill_n(packet.ray.tnear, kLanes, pattern.near);
  std::array<std::size_t, kLanes> index;
  for (std::size_t sensor = 0; sensor < poses.position.size(); ++sensor) {
    const Vec3& origin = poses.position[sensor];
    const Mat3& r = poses.rotation[sensor];
    std::fill_n(packet.ray.org_x, kLanes, origin.x());
    std::fill_n(packet.ray.org_y, kLanes, origin.y());
    std::fill_n(packet.ray.org_z, kLanes, origin.z());
    for (std::size_t row = 0; row < pattern.rows; row += kHigh) {
      for (std::size_t column = 0; column < pattern.columns; column += kWide) {
        for (std::size_t i = 0; i < kLanes; ++i) {
          const std::size_t its_row = row + i / kWide, its_column = column + i % kWide;
          valid[i] = its_row < pattern.rows && its_column < pattern.columns ? -1 : 0;
          index[i] = std::min(its_row, pattern.rows - 1) * pattern.columns + std::min(its_column, pattern.columns - 1);
          const float x = pattern.x[index[i]], y = pattern.y[index[i]], z = pattern.z[index[i]];
          packet.ray.dir_x[i] = r(0, 0) * x + r(0, 1) * y + r(0, 2) * z;
          packet.ray.dir_y[i] = r(1, 0) * x + r(1, 1) * y + r(1, 2) * z;
          packet.ray.dir_z[i] = r(2, 0) * x + r(2, 1) * y + r(2, 2) * z;
          packet.ray.tfar[i] = pattern.range;
          packet.hit.geomID[i] = RTC_INVALID_GEOMETRY_ID;
        }
        bench::trace_packet(scene.scene, valid.data(), packet, query);
        for (std::size_t i = 0; i < kLanes; ++i) {
          if (valid[i] == 0) continue;
          const std::size_t to = index[i];
          const bool is_hit = packet.hit.geomID[i] != RTC_INVALID_GEOMETRY_ID;
          hits.distance[to] = is_hit ? packet.ray.tfar[i] : kInfinity;
          if (!pattern.is_camera) continue;
          hits.triangle[to] = packet.hit.primID[i];
          hits.normal[0][to] = packet.hit.Ng_x[i];
          hits.normal[1][to] = packet.hit.Ng_y[i];
          hits.normal[2][to] = packet.hit.Ng_z[i];
        }
      }
    }
  }
}

// Traces a LiDAR's rays one by one.
void trace_singly(const bench::BareScene& scene, const Pattern& pattern, const Poses& poses, bool coherent, Hits& hits) {
  bench::Query query = bench::make_query(coherent);
  for (std::size_t sensor = 0; sensor < poses.position.size(); ++sensor) {
    const Mat3& r = poses.rotation[sensor];
    alignas(16) RTCRayHit ray{};
    ray.ray.mask = 0xFFFFFFFFU;
    ray.ray.tnear = pattern.near;
    ray.ray.org_x = poses.position[sensor].x();
    ray.ray.org_y = poses.position[sensor].y();
    ray.ray.org_z = poses.position[sensor].z();
    for (std::size_t i = 0; i < hits.distance.size(); ++i) {
      const float x = pattern.x[i], y = pattern.y[i], z = pattern.z[i];
      ray.ray.dir_x = r(0, 0) * x + r(0, 1) * y + r(0, 2) * z;
      ray.ray.dir_y = r(1, 0) * x + r(1, 1) * y + r(1, 2) * z;
      ray.ray.dir_z = r(2, 0) * x + r(2, 1) * y + r(2, 2) * z;
      ray.ray.tfar = pattern.range;
      ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
      bench::trace_ray(scene.scene, ray, query);
      hits.distance[i] = ray.hit.geomID == RTC_INVALID_GEOMETRY_ID ? kInfinity : ray.ray.tfar;
    }
  }
}

class Engine {
 public:
  Engine(const flockstep::World& world, const flockstep::CameraConfig* camera, const flockstep::LidarConfig* lidar)
      : scene_(flockstep::prepared(world).scene()), ones_(flockstep::trace::kMaxRays + flockstep::trace::kRayPadding, 1.0F) {
    scene_.prepare_tiles(world.triangles());
    if (camera != nullptr) pinhole_ = flockstep::render::make_pinhole_camera(*camera);
    if (lidar != nullptr) beams_ = flockstep::sensors::make_pattern(*lidar, policy_);
  }

  void trace(const Pattern& pattern, const Poses& poses, Hits& hits) {
    for (std::size_t sensor = 0; sensor < poses.position.size(); ++sensor) {
      tracer_.set_viewpoint(scene_, {.origin = poses.position[sensor],
                                     .rotation = poses.rotation[sensor],
                                     .near = pattern.near,
                                     .range = pattern.range,
                                     .longest = pattern.is_camera ? pinhole_.corner : 1.0F,
                                     .policy = policy_});
      pattern.is_camera ? trace_camera(pattern, hits) : trace_lidar(pattern, hits);
    }
    tracer_.finish();
  }

 private:
  void trace_camera(const Pattern& pattern, Hits& hits) {
    constexpr std::size_t kSide = flockstep::render::PixelTile::kSide;
    const auto& grid = pinhole_.grids[0];
    for (const auto& tile : pinhole_.tiles) {
      const flockstep::trace::RayBundle& rays = tracer_.trace({.x = ones_.data(),
                                                               .y = grid.left.data() + tile.column * kSide,
                                                               .z = grid.up.data() + tile.row * kSide,
                                                               .rows = tile.height,
                                                               .width = kSide,
                                                               .frustum = &tile.frustum,
                                                               .u = &grid.columns[tile.column / kSide],
                                                               .v = &grid.rows[tile.row / kSide]});
      const flockstep::trace::HitDetails& details = tracer_.details();
      for (std::size_t row = 0; row < tile.height; ++row) {
        const std::size_t to = (tile.row + row) * pattern.columns + tile.column, from = row * kSide;
        const auto copy = [&](const auto* values, auto* out) {
          // Almost every row of a tile has full width, and its copy compiles to a few instructions.
          if (tile.width == kSide) {
            std::memcpy(out + to, values + from, kSide * sizeof *out);
          } else {
            std::memcpy(out + to, values + from, tile.width * sizeof *out);
          }
        };
        copy(rays.t_hit, hits.distance.data());
        copy(rays.element, hits.triangle.data());
        copy(details.normal_x, hits.normal[0].data());
        copy(details.normal_y, hits.normal[1].data());
        copy(details.normal_z, hits.normal[2].data());
      }
    }
  }

  void trace_lidar(const Pattern& pattern, Hits& hits) {
    for (const auto& tile : beams_.tiles) {
      tracer_.enqueue({.x = beams_.x.data() + tile.first,
                       .y = beams_.y.data() + tile.first,
                       .z = beams_.z.data() + tile.first,
                       .rows = tile.rows,
                       .width = tile.width,
                       .frustum = &tile.frustum,
                       .view = tile.view < 0 ? nullptr : &beams_.views[static_cast<std::size_t>(tile.view)],
                       .fan = tile.fan < 0 ? nullptr : &beams_.fans[static_cast<std::size_t>(tile.fan)]},
                      hits.distance.data() + tile.channel * pattern.columns + tile.beam, pattern.columns);
    }
  }

  // Tiles wherever possible, and every fan as a slice.
  const flockstep::trace::TracePolicy policy_{.tile_triangle_limit = flockstep::trace::TracePolicy::kNever,
                                              .min_rays_in_slice = 1};
  const flockstep::trace::Scene& scene_;
  std::vector<float> ones_;
  flockstep::render::PinholeCamera pinhole_{};
  flockstep::sensors::BeamPattern beams_{};
  flockstep::trace::Tracer tracer_;
};

void bench_case(const std::string& scene, const flockstep::World& world, const bench::BareScene& bare, const Pattern& pattern,
                const flockstep::CameraConfig* camera, const flockstep::LidarConfig* lidar, bench::Figures& figures) {
  const Poses poses(world, pattern.sensors);
  Engine engine(world, camera, lidar);
  Hits ours(pattern), theirs = ours;
  const std::size_t rays = poses.position.size() * ours.distance.size();
  std::vector<bench::Variant> variants{{"engine", [&] { engine.trace(pattern, poses, ours); }}};
  for (const bool coherent : {false, true}) {
    const std::string flag = coherent ? " coherent" : " incoherent";
    const auto add = [&](const char* shape, auto trace) {
      variants.push_back(
          {"bare Embree " + std::string(shape) + flag, [&, trace, coherent] { trace(bare, pattern, poses, coherent, theirs); }});
    };
    if (!pattern.is_camera) add("singly", trace_singly);
    add("8 x 1", trace_bare<RTCRayHit8, 8, 1>);
    add("16 x 1", trace_bare<RTCRayHit16, 16, 1>);
    if (pattern.rows == 1) continue;
    add("4 x 2", trace_bare<RTCRayHit8, 4, 2>);
    add("4 x 4", trace_bare<RTCRayHit16, 4, 4>);
  }
  const flockstep::FlushDenormals flush;
  const bench::Times times = bench::interleave(variants, kRuns);
  std::size_t best = 1;
  for (std::size_t v = 1; v < variants.size(); ++v) {
    if (bench::median(times[v]) < bench::median(times[best])) best = v;
  }
  const std::string name = scene + '/' + pattern.name;
  for (std::size_t v = 0; v < variants.size(); ++v) {
    std::fprintf(stderr, "  %-26s %-28s %8.2f M rays/s\n", name.c_str(), variants[v].label.c_str(),
                 static_cast<double>(rays) / bench::median(times[v]) / 1e6);
  }
  std::size_t differ = 0;
  for (std::size_t sensor = 0; sensor < poses.position.size(); ++sensor) {
    const Poses one = poses.only(sensor);
    engine.trace(pattern, one, ours);
    trace_bare<RTCRayHit8, 8, 1>(bare, pattern, one, false, theirs);
    for (std::size_t i = 0; i < ours.distance.size(); ++i) {
      const float a = ours.distance[i], b = theirs.distance[i];
      differ += !(a == b || std::abs(a - b) < 1e-3F * (1.0F + a));
    }
  }
  if (differ > rays / 1000) {  // different results are not comparable
    std::fprintf(stderr, "%s: %zu of %zu rays have another hit\n", name.c_str(), differ, rays);
    std::exit(1);
  }
  const auto rate = [&](std::size_t v) { return static_cast<double>(rays) / bench::median(times[v]); };
  figures.add(name + "/ratio_to_bare_embree", bench::median_ratio(times[best], times[0]), "1", kRuns);
  figures.add(name + "/rays_per_second", rate(0), "1/s", kRuns);
  figures.add(name + "/bare_embree_rays_per_second", rate(best), "1/s", kRuns);
}

flockstep::CameraConfig camera_of(int width, int height) {
  flockstep::CameraConfig camera;
  camera.width_px = width;
  camera.height_px = height;
  camera.far_m = 100.0F;
  return camera;
}

Pattern pattern_of(const flockstep::CameraConfig& camera, int sensors) {
  const float fx = camera.fx(), fy = camera.fy();
  Pattern pattern{std::to_string(camera.width_px) + 'x' + std::to_string(camera.height_px),
                  static_cast<std::size_t>(camera.height_px),
                  static_cast<std::size_t>(camera.width_px),
                  sensors,
                  true,
                  camera.near_m,
                  camera.far_m,
                  {},
                  {},
                  {}};
  for (int row = 0; row < camera.height_px; ++row) {
    for (int column = 0; column < camera.width_px; ++column) {
      pattern.x.push_back(1.0F);
      pattern.y.push_back((0.5F * static_cast<float>(camera.width_px - 1) - static_cast<float>(column)) / fx);
      pattern.z.push_back((0.5F * static_cast<float>(camera.height_px - 1) - static_cast<float>(row)) / fy);
    }
  }
  return pattern;
}

flockstep::LidarConfig lidar_of(int channels, int beams, float vfov_deg) {
  flockstep::LidarConfig lidar;
  lidar.channels = channels;
  lidar.beams = beams;
  lidar.hfov_deg = 360.0F;
  lidar.vfov_deg = vfov_deg;
  lidar.max_range_m = 30.0F;
  return lidar;
}

flockstep::LidarConfig fan_of(int beams, float hfov_deg, float range_m) {
  flockstep::LidarConfig lidar;
  lidar.beams = beams;
  lidar.hfov_deg = hfov_deg;
  lidar.max_range_m = range_m;
  return lidar;
}

Pattern pattern_of(const flockstep::LidarConfig& lidar, int sensors) {
  const auto rows = static_cast<std::size_t>(lidar.channels), columns = static_cast<std::size_t>(lidar.beams);
  const std::string name = rows == 1
                               ? "fan" + std::to_string(columns) + '_' + std::to_string(std::lround(lidar.max_range_m)) + 'm'
                               : std::to_string(rows) + 'x' + std::to_string(columns);
  Pattern pattern{name, rows, columns, sensors, false, 0.0F, lidar.max_range_m, {}, {}, {}};
  std::vector<float> directions(3 * rows * columns);
  write_directions(flockstep::sensors::make_pattern(lidar, {}), directions.data());
  for (std::size_t i = 0; i < rows * columns; ++i) {
    pattern.x.push_back(directions[3 * i]);
    pattern.y.push_back(directions[3 * i + 1]);
    pattern.z.push_back(directions[3 * i + 2]);
  }
  return pattern;
}

std::shared_ptr<const flockstep::World> bundled(const std::shared_ptr<const flockstep::World>& world) {
  return bench::triangles_of(*world, bench::chord_error(*world));
}

}  // namespace

// The arguments select the scene and the beginning of the pattern's name, e.g. "office 64x64" or "all fan", and the instruction
// set "avx2". Without them all are measured with the processor's best.
int main(int argc, char** argv) {
  const std::string only_scene = argc > 1 && argv[1] != std::string("all") ? argv[1] : "", only_pattern = argc > 2 ? argv[2] : "";
  const bool is_avx2 = argc > 3 && argv[3] == std::string("avx2");
  if (is_avx2) hwy::GetChosenTarget().Update(HWY_AVX2);
  const std::string group = is_avx2 ? "tiles_avx2/" : "tiles/";
  const std::vector<std::pair<std::string, std::function<std::shared_ptr<const flockstep::World>()>>> scenes{
      {"pillars", [] { return bundled(flockstep::World::load(FLOCKSTEP_SCENES "/playground/train-1.json")); }},
      {"hills1k", [] { return bench::mesh_world(20, 20.0F); }},
      {"office", [] { return bench::triangles_of(*bench::furnished_rooms(), 0.01F); }},
      {"generated_office", [] { return bundled(flockstep::office(flockstep::OfficeConfig{})); }},
      {"warehouse", [] { return bundled(flockstep::warehouse(flockstep::WarehouseConfig{})); }},
      {"hills100k", [] { return bench::mesh_world(200, 60.0F); }},
      {"forest", [] { return bundled(flockstep::forest(flockstep::ForestConfig{})); }},
      {"city", [] { return bundled(flockstep::city(flockstep::CityConfig{})); }},
      {"hills1M", [] { return bench::mesh_world(640, 180.0F); }}};
  bench::Figures figures;
  for (const auto& [scene, make] : scenes) {
    if (!only_scene.empty() && only_scene != scene) continue;
    const auto world = make();
    const auto bare = bench::triangle_scene(*world, is_avx2 ? "isa=avx2" : nullptr);
    figures.add(group + scene + "/triangles", static_cast<double>(world->triangles().triangles.size()), "1", 1);
    const flockstep::CameraConfig small = camera_of(64, 64), large = camera_of(640, 480);
    const flockstep::LidarConfig coarse = lidar_of(16, 360, 30.0F), dense = lidar_of(64, 1024, 45.0F);
    const auto measure = [&](const Pattern& pattern, const flockstep::CameraConfig* camera, const flockstep::LidarConfig* lidar) {
      if (pattern.name.starts_with(only_pattern)) bench_case(group + scene, *world, *bare, pattern, camera, lidar, figures);
    };
    measure(pattern_of(small, 64), &small, nullptr);
    measure(pattern_of(large, 4), &large, nullptr);
    measure(pattern_of(coarse, 64), nullptr, &coarse);
    measure(pattern_of(dense, 8), nullptr, &dense);
    for (const auto& [beams, hfov_deg, range_m] : kFans) {
      const flockstep::LidarConfig fan = fan_of(beams, hfov_deg, range_m);
      measure(pattern_of(fan, 1024), nullptr, &fan);
    }
  }
  figures.print();
}
