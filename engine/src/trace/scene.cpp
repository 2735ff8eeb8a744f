#include "trace/scene.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <exception>
#include <iterator>
#include <limits>
#include <memory>
#include <mutex>
#include <new>
#include <stdexcept>
#include <string>

#include "base/interrupt.hpp"
#include "base/platform.hpp"
#include "base/thread_sanitizer.hpp"
#include "trace/packets.hpp"
#include "trace/user_geometry.hpp"
#include "world/scene_description.hpp"

namespace flockstep::trace {
namespace {

static_assert(kMaxDirectAnyOrigin <= kMaxDirect && kMaxDirect <= kMaxCandidates);

constexpr float kRounding = 1e-5F;  // fraction of coordinates; bounds are widened by this so that rounding does not hide a hit

float squared_distance(const Vec3& center, const Vec3& half) { return (center.cwiseAbs() - half).cwiseMax(0.0F).squaredNorm(); }

void throw_embree_error(RTCDevice device) {
  const RTCError error = rtcGetDeviceError(device);
  if (error == RTC_ERROR_NONE) return;
  if (error == RTC_ERROR_OUT_OF_MEMORY) throw std::bad_alloc();
  throw std::runtime_error("Embree failed with error " + std::to_string(static_cast<int>(error)));
}

// Returns what Embree made, or throws the reason why it failed.
template <class T>
T* required(T* made, RTCDevice device) {
  if (made != nullptr) return made;
  throw_embree_error(device);
  throw std::bad_alloc();
}

struct ReleaseGeometry {
  void operator()(RTCGeometry geometry) const { rtcReleaseGeometry(geometry); }
};
using Geometry = std::unique_ptr<RTCGeometryTy, ReleaseGeometry>;

// Returns Embree's device. All scenes of the process share it: a device is expensive, and Embree cannot create thousands of
// them. It is released with the last scene. A forked child cannot use its parent's device and creates its own.
std::shared_ptr<RTCDeviceTy> shared_device() {
  static std::mutex mutex;
  static std::weak_ptr<RTCDeviceTy> current;
  static long owner = 0;
  const std::lock_guard lock(mutex);
  std::shared_ptr<RTCDeviceTy> device = owner == process_id() ? current.lock() : nullptr;
  if (!device) {
    device.reset(required(rtcNewDevice(nullptr), nullptr), rtcReleaseDevice);
    current = device;
    owner = process_id();
  }
  return device;
}

// The filter of triangles with masks: rays that pass through masks do not hit the transparent parts. The result of a ray
// depends only on that ray.
void pass_through_masks(const RTCFilterFunctionNArguments* args) {
  if (through_of(*args) == Through::nothing) return;
  const auto& masks = *static_cast<const Masks*>(args->geometryUserPtr);
  for (unsigned int i = 0; i < args->N; ++i) {
    if (args->valid[i] == 0) continue;
    const unsigned int triangle = RTCHitN_primID(args->hit, args->N, i);
    if (masks.lets_through(triangle, RTCHitN_u(args->hit, args->N, i), RTCHitN_v(args->hit, args->N, i))) args->valid[i] = 0;
  }
}

// near: hits nearer than this are ignored. The hint is not valid if the surface is nearer than this.
OriginHint hint_in_room(const Shape& room, const std::array<float, 3>& o, float near) {
  const float* const half = room.half_extents;
  // On a wall, every ray hits that wall at distance 0, as with any other solid.
  const bool within = std::abs(o[0]) + near < half[0] && std::abs(o[1]) + near < half[1] && std::abs(o[2]) + near < half[2];
  return within ? OriginHint::in_room : OriginHint::anywhere;
}

// Calls f(primitive, query) for the triangles within the query's radius, which f may reduce. It returns true if it has.
template <class F>
void query_triangles(RTCScene meshes, const Vec3& center, float radius, F f) {
  if (meshes == nullptr) return;
  RTCPointQuery query;
  query.x = center.x();
  query.y = center.y();
  query.z = center.z();
  query.time = 0.0F;
  query.radius = radius;
  RTCPointQueryContext instances;
  rtcInitPointQueryContext(&instances);
  rtcPointQuery(
      meshes, &query, &instances,
      [](RTCPointQueryFunctionArguments* args) { return (*static_cast<F*>(args->userPtr))(args->primID, *args->query); }, &f);
}

}  // namespace

// shapes is indexed by element. It is declared before the scene, which reads it until its end.
struct Scene::EmbreePrimitives {
  std::vector<Shape> shapes;
  EmbreeScene scene;
};

Scene::Scene(const World& world, std::pmr::memory_resource& memory, std::size_t max_direct)
    : shapes_(&memory), visible_(&memory), markers_(&memory), tree_({}, {}, memory), world_(&world) {
  add_primitives(world.primitives(), max_direct);
  add_triangles(world);
  const Markers& markers = world.markers();
  markers_.reserve(markers.waypoints.size() + 2);
  const auto add_marker = [&](const Vec3& center) {
    const auto element = static_cast<std::int32_t>(shapes_.size() + world.triangles().triangles.size() + markers_.size());
    markers_.push_back(
        {make_shape(Primitive{.kind = PrimitiveKind::sphere, .center = center, .half_extents = Vec3::Constant(markers.radius)}),
         element});
  };
  if (markers.start) add_marker(*markers.start);
  for (const Vec3& waypoint : markers.waypoints) add_marker(waypoint);
  if (markers.goal) add_marker(*markers.goal);
}

Scene::~Scene() = default;

Scene::EmbreeScene Scene::new_scene() const {
  if (!device_) device_ = shared_device();
  EmbreeScene scene(required(rtcNewScene(device_.get()), device_.get()));
  // ROBUST: without it, rays leak through shared triangle edges.
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  rtcSetSceneBuildQuality(scene.get(), RTC_BUILD_QUALITY_MEDIUM);
  return scene;
}

// Builds the scene. The callback stops Embree midway by returning false, since exceptions must not pass through Embree.
void Scene::commit(RTCScene scene) const {
  std::exception_ptr interrupted;  // written only by this thread: on others, poll() does nothing
  rtcSetSceneProgressMonitorFunction(
      scene,
      [](void* result, double) {
        try {
          Interrupt::poll();
          return true;
        } catch (...) {
          *static_cast<std::exception_ptr*>(result) = std::current_exception();
          return false;
        }
      },
      &interrupted);
  rtcCommitScene(scene);
  rtcSetSceneProgressMonitorFunction(scene, nullptr, nullptr);
  if (interrupted) {
    static_cast<void>(rtcGetDeviceError(device_.get()));  // discards the cancellation error
    std::rethrow_exception(interrupted);
  }
  throw_embree_error(device_.get());
}

void Scene::add_primitives(std::span<const Primitive> primitives, std::size_t max_direct) {
  std::vector<Aabb> boxes;
  std::vector<std::uint32_t> numbers;
  shapes_.reserve(primitives.size());
  for (const Primitive& primitive : primitives) {
    const auto element = static_cast<std::uint32_t>(shapes_.size());
    shapes_.push_back({make_shape(primitive), static_cast<std::int32_t>(element)});
    if (primitive.kind == PrimitiveKind::room) {
      ++num_rooms_;
    } else if (is_visible(primitive.visibility)) {
      boxes.push_back(shapes_.back().shape.bounds());
      numbers.push_back(element);
    }
  }
  tree_ = ShapeTree(boxes, numbers, *shapes_.get_allocator().resource());
  const auto is_visual = [&](const NumberedShape& shape) {
    return is_visible(primitives[static_cast<std::size_t>(shape.element)].visibility);
  };
  is_all_visible_ = std::all_of(shapes_.begin(), shapes_.end(), is_visual);
  if (!is_all_visible_) std::copy_if(shapes_.begin(), shapes_.end(), std::back_inserter(visible_), is_visual);
  if (traced().size() > max_direct) embree_primitives_ = make_embree_primitives();  // otherwise, bundles are traced directly
}

std::unique_ptr<const Scene::EmbreePrimitives> Scene::make_embree_primitives() const {
  auto made = std::make_unique<EmbreePrimitives>();
  // An empty box keeps rooms and invisible primitives out of Embree's tree and leaves the other indices unchanged. In the tree,
  // every ray would hit the rooms.
  for (const NumberedShape& shape : shapes_) {
    made->shapes.push_back(shape.shape);
    made->shapes.back().box_half = Vec3::Constant(-1.0F);
  }
  for (const NumberedShape& shape : casters()) {
    made->shapes[static_cast<std::size_t>(shape.element)].box_half = shape.shape.box_half;
  }
  made->scene = new_scene();
  const Geometry owned(required(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_USER), device_.get()));
  RTCGeometry geometry = owned.get();
  rtcSetGeometryUserPrimitiveCount(geometry, static_cast<unsigned int>(made->shapes.size()));
  rtcSetGeometryUserData(geometry, made->shapes.data());
  rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
  rtcSetGeometryBoundsFunction(
      geometry,
      [](const RTCBoundsFunctionArguments* args) {
        thread_sanitizer::acquire(args->geometryUserPtr);
        const Aabb box = static_cast<const Shape*>(args->geometryUserPtr)[args->primID].bounds();
        *args->bounds_o = {box.min.x(), box.min.y(), box.min.z(), 0, box.max.x(), box.max.y(), box.max.z(), 0};
        thread_sanitizer::release(args->geometryUserPtr);
      },
      nullptr);
  rtcSetGeometryIntersectFunction(geometry, primitive_intersect_function());
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(made->scene.get(), geometry);
  thread_sanitizer::release(made->shapes.data());  // synchronises with Embree's builder threads
  commit(made->scene.get());
  thread_sanitizer::acquire(made->shapes.data());
  return made;
}

void Scene::add_triangles(const World& world) {
  const TriangleMesh& mesh = world.triangles();
  num_triangles_ = mesh.triangles.size();
  Eigen::AlignedBox3f box;
  bool any = false;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.visibility_of(i))) continue;
    for (const std::int32_t index : mesh.triangles[i]) box.extend(mesh.vertices[static_cast<std::size_t>(index)]);
    any = true;
  }
  if (!any) return;
  masks_ = Masks(world);
  meshes_ = new_scene();
  attach_triangles(mesh, false);
  if (!masks_.empty()) attach_triangles(mesh, true);
  mesh_center_ = box.center();
  mesh_half_ = 0.5F * box.sizes() + kRounding * (Vec3::Ones() + box.min().cwiseAbs().cwiseMax(box.max().cwiseAbs()));
  commit(meshes_.get());
  wide_packets_ = rtcGetDeviceProperty(device_.get(), RTC_DEVICE_PROPERTY_NATIVE_RAY16_SUPPORTED) != 0;
}

// Attaches the visible triangles with masks, or those without. Embree reads the mesh in place. Triangles keep their numbers in
// both geometries: Embree skips a triangle with invalid vertex indices.
void Scene::attach_triangles(const TriangleMesh& mesh, bool masked) {
  const Geometry owned(required(rtcNewGeometry(device_.get(), RTC_GEOMETRY_TYPE_TRIANGLE), device_.get()));
  RTCGeometry geometry = owned.get();
  rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, mesh.vertices.data(), 0, sizeof(Vec3),
                             mesh.vertices.size());
  if (masks_.empty() && mesh.visibility.empty()) {  // this geometry has all triangles
    rtcSetSharedGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, mesh.triangles.data(), 0,
                               sizeof(mesh.triangles[0]), mesh.triangles.size());
  } else {
    auto* indices =
        static_cast<unsigned int*>(required(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                    3 * sizeof(unsigned int), mesh.triangles.size()),
                                            device_.get()));
    constexpr unsigned int kNowhere = std::numeric_limits<unsigned int>::max();
    for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
      const bool is_here = is_visible(mesh.visibility_of(i)) && (masks_.find(i) != nullptr) == masked;
      for (const std::int32_t index : mesh.triangles[i]) *indices++ = is_here ? static_cast<unsigned int>(index) : kNowhere;
    }
  }
  rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
  if (masked) {
    rtcSetGeometryUserData(geometry, &masks_);
    rtcSetGeometryIntersectFilterFunction(geometry, pass_through_masks);
  }
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(meshes_.get(), geometry);
}

void Scene::prepare_tiles(const TriangleMesh& mesh) const {
  if (!meshes_) return;
  const std::lock_guard lock(prepared_mutex_);
  if (tiles_) return;
  tiles_ = std::make_unique<const MeshTree>(device_.get(), mesh);
  if (num_triangles_ >= kManyTriangles) give_back_freed_memory();
}

void Scene::prepare_echoes() const {
  const std::lock_guard lock(prepared_mutex_);
  if (!echoes_) echoes_ = std::make_unique<const Echoes>(*world_);
}

void Scene::prepare_embree() const {
  if (embree_primitives_) return;
  const std::lock_guard lock(prepared_mutex_);
  if (!prepared_embree_primitives_) prepared_embree_primitives_ = make_embree_primitives();
}

void Scene::intersect_primitives(RayBlock& rays, bool embree) const {
  const EmbreePrimitives* const primitives =
      embree_primitives_ || !embree ? embree_primitives_.get() : prepared_embree_primitives_.get();
  if (primitives == nullptr) {
    trace_direct(traced(), rays);
  } else {
    trace_direct(traced().first(num_rooms_), rays);
    trace_packets_of_16(primitives->scene.get(), 0, rays);
  }
}

void Scene::intersect_casters(RayBlock& rays) const {
  if (!embree_primitives_) {
    trace_direct(casters(), rays);
  } else {
    trace_packets_of_16(embree_primitives_->scene.get(), 0, rays);
  }
}

void Scene::intersect_markers(RayBlock& rays) const { trace_markers(markers_, rays); }

std::size_t Scene::intersect_triangles(RayBlock& rays, HitDetails* details, Through through) const {
  return !meshes_ ? 0 : trace_packets_of_8(meshes_.get(), first_triangle(), through, rays, details);
}

std::size_t Scene::intersect_triangles(RayBundle& tile, HitDetails& details) const {
  if (!meshes_) return 0;
  return trace_tile(meshes_.get(), first_triangle(), wide_packets_, Through::masks, tile, details);
}

void Scene::add_candidate(const Shape& shape, std::int32_t element, const Vec3& origin, CandidateSet& candidates) const {
  if (candidates.count == kMaxCandidates) {
    candidates.crowded = true;
    return;
  }
  set_candidate(candidates.list[candidates.count++], shape, element, origin);
}

void Scene::gather(const Vec3& origin, float near_m, float range_m, bool markers, CandidateSet& candidates) const {
  candidates.count = 0;
  candidates.crowded = false;
  for (std::uint32_t room = 0; room < num_rooms_; ++room) {
    const Shape& shape = shapes_[room].shape;
    add_candidate(shape, static_cast<std::int32_t>(room), origin, candidates);
    Candidate& candidate = candidates.list[candidates.count - 1];
    candidate.hint = hint_in_room(shape, candidate.local_origin, near_m);
    if (candidate.hint != OriginHint::in_room) continue;
    bool reachable = false;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      candidate.walls[axis] = shape.half_extents[axis] - std::abs(candidate.local_origin[axis]) <= range_m;
      reachable |= candidate.walls[axis];
    }
    if (!reachable) --candidates.count;
  }
  tree_.for_each_near(origin, range_m, [&](std::uint32_t element) {
    const Shape& shape = shapes_[element].shape;
    add_candidate(shape, static_cast<std::int32_t>(element), origin, candidates);
    if (candidates.crowded) return;
    Candidate& candidate = candidates.list[candidates.count - 1];
    candidate.hint = hint_at_solid(shape, candidate.local_origin, near_m);
  });
  candidates.triangles = meshes_ && squared_distance(mesh_center_ - origin, mesh_half_) <= range_m * range_m;
  if (!markers) return;
  for (const auto& [shape, element] : markers_) {
    add_candidate(shape, element, origin, candidates);
    if (candidates.crowded) return;
    candidates.list[candidates.count - 1].hint = OriginHint::outside_marker;
  }
}

void Scene::for_each_near(const Vec3& center, float radius, NearCallback callback, void* context) const {
  tree_.for_each_near(center, radius, [&](std::uint32_t element) { radius = std::min(radius, callback(context, element)); });
  const auto first_triangle = static_cast<std::uint32_t>(shapes_.size());
  query_triangles(meshes_.get(), center, radius, [=](std::uint32_t triangle, RTCPointQuery& query) {
    const float left = callback(context, first_triangle + triangle);
    if (!(left < query.radius)) return false;
    query.radius = left;
    return true;
  });
}

}  // namespace flockstep::trace
