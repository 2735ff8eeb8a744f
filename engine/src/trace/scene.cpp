#include "trace/scene.hpp"

#include <array>
#include <memory>
#include <mutex>
#include <stdexcept>
#include <string>

#include "batch/platform.hpp"
#include "trace/handover.hpp"
#include "trace/packets.hpp"
#include "trace/user_geometry.hpp"

#if defined(__SSE__) || defined(_M_X64)
#include <xmmintrin.h>
#endif

namespace swiftlet::trace {
namespace {

constexpr unsigned int kPrimitiveGeometry = 0;
constexpr unsigned int kTriangleGeometry = 1;

constexpr std::size_t kMaxCulled = 64;  // primitives of a world that are worth a look each, for every scan
constexpr std::size_t kMaxDirect = 6;   // primitives within reach that are faster tested than searched for in a tree

float squared_distance(const Aabb& box, const Vec3& point) {
  return (box.min - point).cwiseMax(point - box.max).cwiseMax(0.0F).squaredNorm();
}

[[noreturn]] void throw_embree_error(RTCDevice device) {
  throw std::runtime_error("Embree failed with error " + std::to_string(static_cast<int>(rtcGetDeviceError(device))));
}

// Embree's device, one for all scenes of the process: it is costly, and some thousands of them are more than Embree can make. It
// goes with the last scene. A forked child cannot use its parent's and makes its own.
std::shared_ptr<RTCDeviceTy> shared_device() {
  static std::mutex mutex;
  static std::weak_ptr<RTCDeviceTy> current;
  static long owner = 0;
  const std::lock_guard lock(mutex);
  std::shared_ptr<RTCDeviceTy> device = owner == process_id() ? current.lock() : nullptr;
  if (!device) {
    device.reset(rtcNewDevice(nullptr), [](RTCDevice made) {
      if (made != nullptr) rtcReleaseDevice(made);
    });
    if (!device) throw_embree_error(nullptr);
    current = device;
    owner = process_id();
  }
  return device;
}

}  // namespace

#if defined(__SSE__) || defined(_M_X64)
FlushDenormals::FlushDenormals() : saved_(_mm_getcsr()) {
  constexpr unsigned int kFlushToZero = 0x8000;
  constexpr unsigned int kDenormalsAreZero = 0x0040;
  _mm_setcsr(saved_ | kFlushToZero | kDenormalsAreZero);
}
FlushDenormals::~FlushDenormals() { _mm_setcsr(saved_); }
#else
FlushDenormals::FlushDenormals() : saved_(0) {}
FlushDenormals::~FlushDenormals() = default;
#endif

Scene::Scene(const World& world) : device_(shared_device()) {
  scene_.reset(rtcNewScene(device_.get()));
  // ROBUST: without it rays leak through the edges that triangles share.
  rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(scene_.get(), RTC_BUILD_QUALITY_MEDIUM);
  add_primitives(world.primitives());
  add_triangles(world.triangles());
  handover::release(shapes_.data());  // to Embree's builders, and back
  rtcCommitScene(scene_.get());
  handover::acquire(shapes_.data());
  if (rtcGetDeviceError(device_.get()) != RTC_ERROR_NONE) throw_embree_error(device_.get());
}

Scene::~Scene() = default;

void Scene::add_primitives(std::span<const Primitive> primitives) {
  for (const Primitive& primitive : primitives) {
    shapes_.push_back(make_shape(primitive));
    if (primitive.kind == PrimitiveKind::room) {
      rooms_.push_back({shapes_.back(), static_cast<std::int32_t>(shapes_.size()) - 1});
      // Rooms are traced directly: an empty box keeps them out of the tree, and the indices of the others as they are.
      shapes_.back().bounds = {Vec3::Constant(1.0F), Vec3::Constant(-1.0F)};
    }
  }
  if (shapes_.empty()) return;
  if (shapes_.size() <= kMaxCulled) {
    for (const Primitive& primitive : primitives) {
      numbered_.push_back({make_shape(primitive), static_cast<std::int32_t>(numbered_.size())});
    }
  }
  RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_USER);
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned int>(shapes_.size()));
  rtcSetGeometryUserData(geometry, shapes_.data());
  rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
  rtcSetGeometryBoundsFunction(
      geometry,
      [](const RTCBoundsFunctionArguments* args) {
        handover::acquire(args->geometryUserPtr);
        const Aabb& box = static_cast<const Shape*>(args->geometryUserPtr)[args->primID].bounds;
        *args->bounds_o = {box.min.x(), box.min.y(), box.min.z(), 0, box.max.x(), box.max.y(), box.max.z(), 0};
        handover::release(args->geometryUserPtr);
      },
      nullptr);
  rtcSetGeometryIntersectFunction(geometry, primitive_intersect_function());
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(scene_.get(), geometry, kPrimitiveGeometry);
  rtcReleaseGeometry(geometry);
}

void Scene::add_triangles(const TriangleMesh& mesh) {
  if (mesh.triangles.empty()) return;
  numbered_.clear();
  RTCGeometry geometry = rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
  auto* vertices = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
  auto* indices = static_cast<unsigned int*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                     3 * sizeof(unsigned int), mesh.triangles.size()));
  if (vertices == nullptr || indices == nullptr) throw_embree_error(device_.get());
  for (const Vec3& vertex : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) *vertices++ = vertex[axis];
  }
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t index : triangle) *indices++ = static_cast<unsigned int>(index);
  }
  rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
  rtcCommitGeometry(geometry);
  rtcAttachGeometryByID(scene_.get(), geometry, kTriangleGeometry);
  rtcReleaseGeometry(geometry);
}

void Scene::intersect(RayBlock& rays) const {
  trace_packets({.rooms = rooms_,
                 .scene = scene_.get(),
                 .primitive_geometry = kPrimitiveGeometry,
                 .triangle_geometry = kTriangleGeometry,
                 .first_triangle = static_cast<std::int32_t>(shapes_.size())},
                rays);
}

bool Scene::intersect_nearby(const Vec3& origin, float range_m, RayBlock& rays) const {
  if (numbered_.empty()) return false;
  std::array<const NumberedShape*, kMaxDirect> near;
  std::size_t count = 0;
  for (const NumberedShape& shape : numbered_) {
    if (squared_distance(shape.shape.bounds, origin) > range_m * range_m) continue;
    if (count == kMaxDirect) return false;
    near[count++] = &shape;
  }
  trace_shapes({near.data(), count}, rays);
  return true;
}

void Scene::for_each_nearby(const Vec3& center, float radius, NearbyCallback callback, void* context) const {
  struct Visit {
    NearbyCallback callback;
    void* context;
    std::uint32_t first_triangle;
  } visit{callback, context, static_cast<std::uint32_t>(shapes_.size())};
  RTCPointQuery query;
  query.x = center.x();
  query.y = center.y();
  query.z = center.z();
  query.time = 0.0F;
  query.radius = radius;
  RTCPointQueryContext instances;
  rtcInitPointQueryContext(&instances);
  rtcPointQuery(
      scene_.get(), &query, &instances,
      [](RTCPointQueryFunctionArguments* args) {
        const auto& seen = *static_cast<Visit*>(args->userPtr);
        seen.callback(seen.context, args->geomID == kTriangleGeometry ? seen.first_triangle + args->primID : args->primID);
        return false;  // the radius did not change
      },
      &visit);
}

}  // namespace swiftlet::trace
