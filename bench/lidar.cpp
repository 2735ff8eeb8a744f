// How near the engine's LiDAR stage comes to bare Embree.
//
// Bare: a plain loop over the very same rays and scene with no engine: packets filled from precomputed arrays, traced, and the
// distances stored. It takes the best of: pillars tessellated to 16-gons or analytic user geometry; packets of 1, 8 or 16;
// coherent or incoherent. Engine: Batch::sense on one thread, from the poses. All variants take turns within one run.
// Prints a JSON list of figures.
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
#include <vector>

#include "bench.hpp"
#include "collision/sweep.hpp"
#include "swiftlet/batch.hpp"
#include "trace/scene.hpp"
#include "trace/user_geometry.hpp"

namespace {

using swiftlet::Vec3;
using swiftlet::trace::Shape;

constexpr int kRuns = 9;
constexpr int kPillarSides = 16;

// The rays of all drones in one world, as plain arrays.
struct Rays {
  std::vector<float> ox, oy, oz, dx, dy, dz, range;
  std::vector<float> t;  // result
};

struct BareScene {
  RTCDevice device = rtcNewDevice(nullptr);
  RTCScene scene = rtcNewScene(device);
  std::vector<Shape> shapes;
  BareScene() = default;
  BareScene(const BareScene&) = delete;
  BareScene& operator=(const BareScene&) = delete;
  ~BareScene() {
    rtcReleaseScene(scene);
    rtcReleaseDevice(device);
  }
  void finish(RTCGeometry geometry) {
    rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene, geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene, RTC_SCENE_FLAG_ROBUST);
    rtcCommitScene(scene);
  }
};

std::unique_ptr<BareScene> analytic_scene(const swiftlet::World& world) {
  auto bare = std::make_unique<BareScene>();
  for (const auto& primitive : world.primitives()) bare->shapes.push_back(swiftlet::trace::make_shape(primitive));
  RTCGeometry geometry = rtcNewGeometry(bare->device, RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned int>(bare->shapes.size()));
  rtcSetGeometryUserData(geometry, bare->shapes.data());
  rtcSetGeometryBoundsFunction(
      geometry,
      [](const RTCBoundsFunctionArguments* args) {
        const swiftlet::Aabb box = static_cast<const Shape*>(args->geometryUserPtr)[args->primID].bounds();
        *args->bounds_o = {box.min.x(), box.min.y(), box.min.z(), 0, box.max.x(), box.max.y(), box.max.z(), 0};
      },
      nullptr);
  rtcSetGeometryIntersectFunction(geometry, swiftlet::trace::primitive_intersect_function());
  bare->finish(geometry);
  return bare;
}

std::unique_ptr<BareScene> triangle_scene(const swiftlet::World& world) {
  float radius = 0.0F;
  for (const auto& primitive : world.primitives()) {
    if (primitive.kind == swiftlet::PrimitiveKind::cylinder) radius = primitive.half_extents.x();
  }
  // The chord error of a polygon of k sides is r (1 - cos(pi / k)).
  const float chord_error = radius * (1.0F - std::cos(std::numbers::pi_v<float> / kPillarSides));
  const swiftlet::TriangleMesh mesh = world.mesh(1.0001F * chord_error);
  auto bare = std::make_unique<BareScene>();
  RTCGeometry geometry = rtcNewGeometry(bare->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.vertices.size()));
  auto* indices =
      static_cast<int*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles.size()));
  for (const Vec3& vertex : mesh.vertices) vertices = std::copy_n(vertex.data(), 3, vertices);
  for (const auto& triangle : mesh.triangles) indices = std::copy(triangle.begin(), triangle.end(), indices);
  bare->finish(geometry);
  return bare;
}

#if SWIFTLET_EMBREE_MAJOR >= 4
using Query = RTCIntersectArguments;
Query make_query(bool coherent) {
  Query query;
  rtcInitIntersectArguments(&query);
  query.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
  return query;
}
void trace_packet(RTCScene scene, const int* valid, RTCRayHit8& packet, Query& query) {
  rtcIntersect8(valid, scene, &packet, &query);
}
void trace_packet(RTCScene scene, const int* valid, RTCRayHit16& packet, Query& query) {
  rtcIntersect16(valid, scene, &packet, &query);
}
#else
using Query = RTCIntersectContext;
Query make_query(bool coherent) {
  Query query;
  rtcInitIntersectContext(&query);
  query.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  return query;
}
void trace_packet(RTCScene scene, const int* valid, RTCRayHit8& packet, Query& query) {
  rtcIntersect8(valid, scene, &query, &packet);
}
void trace_packet(RTCScene scene, const int* valid, RTCRayHit16& packet, Query& query) {
  rtcIntersect16(valid, scene, &query, &packet);
}
#endif

// The bare loop.
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
    if (lanes == kLanes) {
      fill(first, kLanes);
    } else {  // the unused lanes keep the rays of the packet before
      fill(first, lanes);
    }
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
#if SWIFTLET_EMBREE_MAJOR >= 4
    rtcIntersect1(scene, &ray, nullptr);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene, &context, &ray);
#endif
    rays.t[k] = ray.hit.geomID == RTC_INVALID_GEOMETRY_ID ? std::numeric_limits<float>::infinity() : ray.ray.tfar;
  }
}

// Poses that a drone can be in: not touching anything.
std::vector<Vec3> free_positions(const swiftlet::World& world, int count, std::uint32_t seed) {
  std::mt19937 random(seed);
  const swiftlet::DroneModel drone = swiftlet::DroneModel::quadrotor650();
  std::vector<Vec3> positions;
  while (static_cast<int>(positions.size()) < count) {
    Vec3 position;
    for (int axis = 0; axis < 3; ++axis) {
      position[axis] = std::uniform_real_distribution<float>(world.bounds().min[axis], world.bounds().max[axis])(random);
    }
    if (!swiftlet::collision::overlaps(world, drone, {position, swiftlet::Quat::Identity()})) positions.push_back(position);
  }
  return positions;
}

void bench_case(const std::string& name, const swiftlet::LidarConfig& lidar, int num_drones,
                const swiftlet::Batch::Worlds& worlds, int runs, bench::Figures& figures) {
  swiftlet::BatchConfig config;
  config.num_drones = num_drones;
  config.num_threads = 1;
  config.has_lidar = true;
  config.lidar = lidar;
  swiftlet::Batch batch(config, worlds);
  const auto n = static_cast<std::size_t>(num_drones);
  std::vector<float> position(3 * n);
  for (std::size_t w = 0; w < worlds.size(); ++w) {
    const auto free = free_positions(*worlds[w], num_drones, static_cast<std::uint32_t>(w));
    for (std::size_t i = w; i < n; i += worlds.size())
      std::copy_n(free[i].data(), 3, position.begin() + static_cast<std::ptrdiff_t>(3 * i));
  }
  batch.set_pose(position, {});
  batch.sense();

  const std::size_t per_drone = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
  std::vector<float> directions(3 * n * per_drone);
  batch.lidar_directions(directions);  // drones are level: body frame and world frame agree
  std::vector<Rays> rays(worlds.size());
  std::vector<std::unique_ptr<BareScene>> analytic, triangles;
  for (const auto& world : worlds) {
    analytic.push_back(analytic_scene(*world));
    triangles.push_back(triangle_scene(*world));
  }
  for (std::size_t i = 0; i < n; ++i) {
    Rays& r = rays[i % worlds.size()];
    for (std::size_t k = 0; k < per_drone; ++k) {
      r.ox.push_back(position[3 * i]);
      r.oy.push_back(position[3 * i + 1]);
      r.oz.push_back(position[3 * i + 2]);
      r.dx.push_back(directions[3 * (i * per_drone + k)]);
      r.dy.push_back(directions[3 * (i * per_drone + k) + 1]);
      r.dz.push_back(directions[3 * (i * per_drone + k) + 2]);
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
  for (const bool tessellated : {false, true}) {
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
  const swiftlet::trace::FlushDenormals flush;
  bench::Times times = bench::interleave(variants, runs);

  std::size_t best = 1;
  for (std::size_t v = 1; v < variants.size(); ++v) {
    std::fprintf(stderr, "  %-36s %8.3f M rays/s\n", variants[v].label.c_str(),
                 static_cast<double>(n * per_drone) / bench::median(times[v]) / 1e6);
    if (bench::median(times[v]) < bench::median(times[best])) best = v;
  }
  std::fprintf(stderr, "  %-36s %8.3f M rays/s (best bare: %s)\n", "engine",
               static_cast<double>(n * per_drone) / bench::median(times[0]) / 1e6, variants[best].label.c_str());
  figures.add("lidar/" + name + "/ratio_to_bare_embree", bench::median_ratio(times[best], times[0]), "1", runs);
  figures.add("lidar/" + name + "/scans_per_second", static_cast<double>(n) / bench::median(times[0]), "1/s", runs);
  figures.add("lidar/" + name + "/bare_embree_scans_per_second", static_cast<double>(n) / bench::median(times[best]), "1/s",
              runs);
}

}  // namespace

int main(int argc, char** argv) {
  swiftlet::Batch::Worlds worlds;
  for (int i = 1; i <= 5; ++i) {
    worlds.push_back(swiftlet::World::load(SWIFTLET_SCENES "/playground/train-" + std::to_string(i) + ".json"));
  }
  // With "fan" only the first case, quickly: what bench/run.py divides by while it times the steps of an environment.
  const bool quick = argc > 1 && std::string(argv[1]) == "fan";
  bench::Figures figures;
  bench_case("fan35x1024", {}, 1024, worlds, quick ? 1 : kRuns, figures);
  if (!quick) {
    swiftlet::LidarConfig grid;
    grid.channels = 16;
    grid.beams = 360;
    grid.hfov_deg = 360.0F;
    grid.vfov_deg = 30.0F;
    grid.max_range_m = 30.0F;
    bench_case("grid16x360x256", grid, 256, worlds, kRuns, figures);
  }
  figures.print();
}
