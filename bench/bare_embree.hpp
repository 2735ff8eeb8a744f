// Plain use of Embree, as in any program. The benchmarks compare the engine against it.
#pragma once

#include <algorithm>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <vector>

#include "collision/sweep.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/world.hpp"
#include "prepared/prepared_world.hpp"
#include "trace/embree.hpp"
#include "trace/shape.hpp"

namespace bench {

inline constexpr int kPillarSides = 16;

struct BareScene {
  RTCDevice device;
  RTCScene scene = rtcNewScene(device);
  std::vector<flockstep::trace::Shape> shapes;  // data of the user geometry
  explicit BareScene(const char* settings = nullptr)
      : device(rtcNewDevice(settings)) {}  // settings: Embree's, such as "isa=avx2"
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

// Returns the chord error that turns pillars into polygons with kPillarSides sides. For k sides it is r (1 - cos(pi / k)).
inline float chord_error(const flockstep::World& world) {
  float radius = 1.0F;
  for (const auto& primitive : world.primitives()) {
    if (primitive.kind == flockstep::PrimitiveKind::cylinder) radius = primitive.half_extents.x();
  }
  return 1.0001F * radius * (1.0F - std::cos(std::numbers::pi_v<float> / kPillarSides));
}

// Builds a scene from a world's triangles, with its primitives tessellated. settings: Embree's.
inline std::unique_ptr<BareScene> triangle_scene(const flockstep::World& world, const char* settings = nullptr) {
  const flockstep::TriangleMesh mesh = world.mesh(chord_error(world));
  auto bare = std::make_unique<BareScene>(settings);
  RTCGeometry geometry = rtcNewGeometry(bare->device, RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.vertices.size()));
  auto* indices =
      static_cast<int*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles.size()));
  for (const flockstep::Vec3& vertex : mesh.vertices) vertices = std::copy_n(vertex.data(), 3, vertices);
  for (const auto& triangle : mesh.triangles) indices = std::copy(triangle.begin(), triangle.end(), indices);
  bare->finish(geometry);
  return bare;
}

#if FLOCKSTEP_EMBREE_MAJOR >= 4
using Query = RTCIntersectArguments;
inline Query make_query(bool coherent) {
  Query query;
  rtcInitIntersectArguments(&query);
  query.flags = coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
  return query;
}
inline void trace_packet(RTCScene scene, const int* valid, RTCRayHit8& packet, Query& query) {
  rtcIntersect8(valid, scene, &packet, &query);
}
inline void trace_packet(RTCScene scene, const int* valid, RTCRayHit16& packet, Query& query) {
  rtcIntersect16(valid, scene, &packet, &query);
}
#else
using Query = RTCIntersectContext;
inline Query make_query(bool coherent) {
  Query query;
  rtcInitIntersectContext(&query);
  query.flags = coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  return query;
}
inline void trace_packet(RTCScene scene, const int* valid, RTCRayHit8& packet, Query& query) {
  rtcIntersect8(valid, scene, &query, &packet);
}
inline void trace_packet(RTCScene scene, const int* valid, RTCRayHit16& packet, Query& query) {
  rtcIntersect16(valid, scene, &query, &packet);
}
#endif

// Draws positions at which a drone touches nothing.
inline std::vector<flockstep::Vec3> free_positions(const flockstep::World& world, int count, std::uint32_t seed) {
  std::mt19937 random(seed);
  const flockstep::collision::Hull hull(flockstep::DroneModel::quadrotor650());
  const flockstep::collision::Obstacles& obstacles = flockstep::prepared(world).obstacles();
  std::vector<flockstep::Vec3> positions;
  while (static_cast<int>(positions.size()) < count) {
    flockstep::Vec3 position;
    for (int axis = 0; axis < 3; ++axis) {
      position[axis] = std::uniform_real_distribution<float>(world.bounds().min[axis], world.bounds().max[axis])(random);
    }
    if (!flockstep::collision::overlaps(obstacles, hull, {position, flockstep::Quat::Identity()})) positions.push_back(position);
  }
  return positions;
}

}  // namespace bench
