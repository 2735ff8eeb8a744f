// Fans traced as slices, against closed forms, all triangles in double precision, and Embree.
#include "trace/mesh_slices.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "meshes.hpp"
#include "numbers.hpp"
#include "on_target.hpp"
#include "random.hpp"
#include "ray_oracle.hpp"
#include "trace/embree.hpp"
#include "trace/mesh_tree.hpp"
#include "tried.hpp"

namespace flockstep::trace {
namespace {

using oracle::Vec3d;
using testing::ball;
using testing::cube;
using testing::kInfinity;
using testing::Random;

constexpr double kPi = std::numbers::pi;
constexpr std::array kWalks{SliceWalk::automatic, SliceWalk::listed, SliceWalk::ordered};
constexpr std::int32_t kEarlier = 1 << 20;  // element of hits before the trace

struct EmbreeDevice {
  std::unique_ptr<RTCDeviceTy, decltype(&rtcReleaseDevice)> device{rtcNewDevice(nullptr), &rtcReleaseDevice};
  MeshTree tree(const TriangleMesh& mesh) const { return {device.get(), mesh}; }
};

// Embree by itself: robust, one ray at a time.
class RobustEmbree {
 public:
  struct Hit {
    float t = kInfinity;
    int element = -1;
  };

  RobustEmbree(const EmbreeDevice& device, const TriangleMesh& mesh)
      : scene_(rtcNewScene(device.device.get()), &rtcReleaseScene) {
    const RTCGeometry geometry = rtcNewGeometry(device.device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
    auto* vertices = static_cast<float*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 12, mesh.vertices.size()));
    auto* corners = static_cast<std::int32_t*>(
        rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3, 12, mesh.triangles.size()));
    for (const Vec3& vertex : mesh.vertices) vertices = std::copy_n(vertex.data(), 3, vertices);
    for (const auto& triangle : mesh.triangles) corners = std::copy(triangle.begin(), triangle.end(), corners);
    rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
    rtcCommitGeometry(geometry);
    rtcAttachGeometry(scene_.get(), geometry);
    rtcReleaseGeometry(geometry);
    rtcSetSceneFlags(scene_.get(), RTC_SCENE_FLAG_ROBUST);
    rtcCommitScene(scene_.get());
  }

  Hit nearest(const Vec3& origin, const Vec3& direction, float near, float range) const {
    const FlushDenormals flush;
    RTCRayHit ray{};
    ray.ray.org_x = origin.x();
    ray.ray.org_y = origin.y();
    ray.ray.org_z = origin.z();
    ray.ray.dir_x = direction.x();
    ray.ray.dir_y = direction.y();
    ray.ray.dir_z = direction.z();
    ray.ray.tnear = near;
    ray.ray.tfar = range;
    ray.ray.mask = 0xFFFFFFFFU;
    ray.hit.geomID = RTC_INVALID_GEOMETRY_ID;
#if FLOCKSTEP_EMBREE_MAJOR >= 4
    rtcIntersect1(scene_.get(), &ray);
#else
    RTCIntersectContext context;
    rtcInitIntersectContext(&context);
    rtcIntersect1(scene_.get(), &context, &ray);
#endif
    if (ray.hit.geomID == RTC_INVALID_GEOMETRY_ID) return {};
    return {ray.ray.tfar, static_cast<int>(ray.hit.primID)};
  }

 private:
  std::unique_ptr<RTCSceneTy, decltype(&rtcReleaseScene)> scene_;
};

Vec3d level(double angle) { return {std::cos(angle), std::sin(angle), 0.0}; }

// Rays in a plane, their pose and their hits.
struct Slice {
  std::vector<Vec3d> directions;  // before the mounting
  Eigen::Matrix3d mounting;
  std::unique_ptr<Fan> fan;
  std::unique_ptr<RayBundle> rays = std::make_unique<RayBundle>();

  explicit Slice(std::vector<Vec3d> of, const Eigen::Matrix3d& mounting_of = Eigen::Matrix3d::Identity())
      : directions(std::move(of)), mounting(mounting_of), fan(std::make_unique<Fan>(make_fan(directions, mounting))) {
    rays->count = directions.size();
    rays->range = 100.0F;
  }

  void trace(const MeshTree& tree, const Vec3& origin, const Mat3& rotation, SliceWalk walk = SliceWalk::automatic) {
    std::fill_n(rays->t_hit, rays->count, kInfinity);
    std::fill_n(rays->element, rays->count, -1);
    rays->origin = origin;
    rays->rotation = rotation;
    trace_on(tree, 0, walk);
  }

  // Traces with the current setup, keeping earlier hits.
  void trace_on(const MeshTree& tree, std::int32_t first_element, SliceWalk walk = SliceWalk::automatic) {
    const FlushDenormals flush;
    trace_mesh_slice(tree, first_element, *fan, *rays, walk);
  }

  Vec3d origin() const { return rays->origin.cast<double>(); }
  Vec3d direction(std::size_t ray) const { return rays->rotation.cast<double>() * (mounting * directions[ray]); }
  // A unit normal of the plane, world frame.
  Vec3d normal() const { return rays->rotation.cast<double>() * fan->to_sensor.col(2).cast<double>(); }
};

// Equal distances, bit for bit, and elements.
::testing::AssertionResult same_hit(const RayBundle& a, std::size_t i, const RayBundle& b, std::size_t j) {
  if (a.element[i] == b.element[j] && testing::same_bits(std::span(a.t_hit + i, 1), std::span(b.t_hit + j, 1))) {
    return ::testing::AssertionSuccess();
  }
  return ::testing::AssertionFailure() << "ray " << i << " meets " << a.element[i] << " at " << a.t_hit[i] << ", ray " << j
                                       << " meets " << b.element[j] << " at " << b.t_hit[j];
}

Vec3d corner_of(const TriangleMesh& mesh, std::int32_t triangle, std::size_t k) {
  const std::int32_t vertex = mesh.triangles[static_cast<std::size_t>(triangle)][k];
  return mesh.vertices[static_cast<std::size_t>(vertex)].cast<double>();
}

double distance_to_segment(const Vec3d& point, const Vec3d& a, const Vec3d& b) {
  const Vec3d along = b - a;
  const double share = along.isZero() ? 0.0 : std::clamp((point - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (point - a - share * along).norm();
}

double distance_to_triangle(const Vec3d& point, const TriangleMesh& mesh, std::int32_t triangle) {
  const Vec3d a = corner_of(mesh, triangle, 0), b = corner_of(mesh, triangle, 1), c = corner_of(mesh, triangle, 2);
  const Vec3d normal = (b - a).cross(c - a);
  const auto is_inside = [&](const Vec3d& from, const Vec3d& to) { return normal.cross(to - from).dot(point - from) >= 0.0; };
  if (!normal.isZero() && is_inside(a, b) && is_inside(b, c) && is_inside(c, a)) {
    return std::abs(normal.normalized().dot(point - a));
  }
  return std::min({distance_to_segment(point, a, b), distance_to_segment(point, b, c), distance_to_segment(point, c, a)});
}

// Returns the largest distance (m) from the origin to a corner of a triangle, or of any triangle.
double reach_of(const Vec3d& origin, const TriangleMesh& mesh, std::int32_t triangle) {
  double reach = 0.0;
  for (std::size_t k = 0; k < 3; ++k) reach = std::max(reach, (corner_of(mesh, triangle, k) - origin).norm());
  return reach;
}

double reach_of(const Vec3d& origin, const TriangleMesh& mesh) {
  double reach = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    reach = std::max(reach, reach_of(origin, mesh, static_cast<std::int32_t>(i)));
  }
  return reach;
}

// Bounds the distance (m) of a hit from its place on its ray and from its triangle, whose corners are up to `reach` m from the
// origin. Every operation has a relative error of at most u, half the distance of 1 to the next float. In units of u reach:
// - 20 for a corner in the fan's frame. An axis of the frame has unit length; its rounded components and a rotation of three
//   products and two sums make 4 for each component, which is less than 7 for the axis. Subtracting the origin makes 1, three
//   products and two sums make 3, and sqrt(3) times these 11 is less than 20.
// - 24 for a rotation from a float quaternion, which is orthonormal only up to rounding, and 1 for the ray's rounded components.
// - 8 for a cut. It lies between two corners: 2 for the products and their difference, 3 for the reciprocal of the difference of
//   heights and its product; sqrt(2) times these 5 is less than 8.
// - 6 for the place on the segment: 2 for a side, and 2 for the quotient of sides times a length of up to 2 reach.
// - 7 for the distance: 2 for those of the ends, 4 for their difference of up to 2 reach and its product, 1 for the sum.
// Neither a grazing angle nor a needle makes this larger, but they magnify the error along the ray.
double rounding_of(double reach) {
  constexpr double kU = 0.5 * static_cast<double>(std::numeric_limits<float>::epsilon());
  return (20.0 + 24.0 + 1.0 + 8.0 + 6.0 + 7.0) * kU * reach;
}

::testing::AssertionResult is_on_its_triangle(const Slice& slice, std::size_t ray, const TriangleMesh& mesh) {
  const double t = static_cast<double>(slice.rays->t_hit[ray]);
  const std::int32_t triangle = slice.rays->element[ray];
  const double distance = distance_to_triangle(slice.origin() + t * slice.direction(ray), mesh, triangle);
  if (distance <= rounding_of(reach_of(slice.origin(), mesh, triangle))) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "ray " << ray << " at " << t << " is " << distance << " m from triangle " << triangle;
}

// Returns three axes. The first two span the plane of x and y, of x and z, or of y and z; the third is its normal.
Eigen::Matrix3d plane_of_axes(std::size_t number) {
  Eigen::Matrix3d plane = Eigen::Matrix3d::Identity();
  if (number == 1) plane << 1, 0, 0, 0, 0, 1, 0, 1, 0;
  if (number == 2) plane << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  return plane;
}

// 1 to kMaxRays directions in a plane, before the mounting: in a plane of two axes or in any, evenly spaced or not, in a sector
// or all around.
std::vector<Vec3d> random_fan(Random& random) {
  const auto any = [&](std::size_t count) { return random.generator()() % count; };
  const std::size_t few = std::array<std::size_t, 8>{1, 2, 3, 12, 35, 72, 255, kMaxRays}[any(8)];
  const std::size_t count = any(2) == 0 ? few : 1 + any(kMaxRays);
  const double width = any(3) == 0 ? 2.0 * kPi : std::array{0.05, 1.0, 3.0, 3.3, 4.7, 6.0}[any(6)];
  const double first = any(2) == 0 ? -0.5 * width : static_cast<double>(random.within(-4, 4));
  const bool is_even = any(2) == 0;
  const std::size_t kind = any(count < 3 ? 3 : 4);  // one ray, or two opposite ones, lie in many planes
  const Eigen::Matrix3d plane =
      kind < 3 ? plane_of_axes(kind) : Eigen::Matrix3d(random.rotation().cast<double>().normalized().toRotationMatrix());
  std::vector<Vec3d> directions;
  for (std::size_t i = 0; i < count; ++i) {
    const double part = is_even ? static_cast<double>(i) / static_cast<double>(count) : static_cast<double>(random.within(0, 1));
    directions.push_back(plane * level(first + width * part));
  }
  return directions;
}

Mat3 random_pose(Random& random) {
  const auto kind = random.generator()() % 3;
  return kind == 0   ? Mat3(Mat3::Identity())
         : kind == 1 ? Mat3(Eigen::AngleAxisf(random.within(-3, 3), Vec3::UnitZ()).toRotationMatrix())
                     : random.rotation().toRotationMatrix();
}

Eigen::Matrix3d random_mounting(Random& random) {
  return random.generator()() % 2 == 0 ? Eigen::Matrix3d::Identity()
                                       : Eigen::Matrix3d(random.rotation().cast<double>().normalized().toRotationMatrix());
}

// A world of some hundred triangles.
TriangleMesh random_mesh(Random& random) {
  switch (random.generator()() % 4) {
    case 0: {
      const int rings = std::array{3, 5, 8}[random.generator()() % 3];
      return ball(rings, 2 * rings, 0.5F, random);
    }
    case 1:
      return testing::furnished_room(10, random);
    case 2:
      return testing::hills(8);
    default:
      return testing::loose_triangles(120, random);
  }
}

// Adds triangles between corners that are the same.
TriangleMesh with_triangles_of_no_area(TriangleMesh mesh, Random& random) {
  const auto vertices = static_cast<std::int32_t>(mesh.vertices.size());
  for (std::int32_t i = 0; i < 5; ++i) {
    const auto any = static_cast<std::int32_t>(random.generator()() % static_cast<unsigned>(vertices));
    mesh.triangles.push_back({any, i, any});
    mesh.triangles.push_back({any, any, any});
  }
  if (!mesh.materials.empty()) mesh.materials.resize(mesh.triangles.size());
  if (!mesh.objects.empty()) mesh.objects.resize(mesh.triangles.size());
  return mesh;
}

// -- Against oracles.

// Compares the rays of slices with the oracle.
struct SliceTally {
  long rays = 0, compared = 0, hits = 0;

  void compare(const Slice& slice, const World& world, const TriangleMesh& mesh, const RobustEmbree& embree,
               const std::vector<float>& earlier) {
    const RayBundle& bundle = *slice.rays;
    const double near = static_cast<double>(bundle.near), range = static_cast<double>(bundle.range);
    const double aside = rounding_of(reach_of(slice.origin(), mesh));
    for (std::size_t ray = 0; ray < bundle.count; ++ray) {
      ++rays;
      const Vec3d direction = slice.direction(ray), from = slice.origin() + near * direction;
      const float t = bundle.t_hit[ray];
      const std::int32_t element = bundle.element[ray];
      if (element >= 0 && element < kEarlier) {
        ASSERT_GE(t, bundle.near);
        ASSERT_LE(t, std::min(bundle.range, earlier[ray]));
        ASSERT_TRUE(is_on_its_triangle(slice, ray, mesh));
      } else {
        ASSERT_EQ(t, earlier[ray]);
      }
      oracle::Hit expected = oracle::nearest(world, from, direction, range - near);
      const double steep = oracle::steepness(world, expected, from, direction, range - near, aside);
      if (steep > 5.0) continue;
      if (near > 0.0) {  // a surface at the near range
        const Vec3d along = 1e-4 * direction;
        if (oracle::nearest(world, from + along, direction, range - near).element != expected.element) continue;
        if (oracle::nearest(world, from - along, direction, range - near).element != expected.element) continue;
      }
      expected.t += near;
      const double reach = expected.element < 0 ? 0.0 : reach_of(slice.origin(), mesh, expected.element);
      const double tolerance = rounding_of(reach) * std::max(steep, 1.0);
      const double before = static_cast<double>(earlier[ray]);
      if (std::abs(expected.t - before) <= tolerance) continue;
      ++compared;
      const bool is_nearer = expected.t < before;
      ASSERT_EQ(element, is_nearer ? expected.element : earlier[ray] < kInfinity ? kEarlier : -1) << "ray " << ray;
      const RobustEmbree::Hit by_embree =
          embree.nearest(bundle.origin, direction.cast<float>(), bundle.near, std::min(bundle.range, earlier[ray]));
      ASSERT_EQ(by_embree.element, is_nearer ? expected.element : -1) << "ray " << ray;
      if (!is_nearer) continue;
      ++hits;
      ASSERT_NEAR(static_cast<double>(t), expected.t, tolerance) << "ray " << ray;
      ASSERT_NEAR(static_cast<double>(t), static_cast<double>(by_embree.t), 2.0 * tolerance) << "ray " << ray;
    }
  }
};

TEST(SlicesAgreement, WithAllTrianglesInDoublePrecision) {
  const EmbreeDevice device;
  const long wanted = testing::times_tried(10'000);
  SliceTally tally;
  for (unsigned seed = testing::part_tried() << 24U; tally.rays < wanted; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto world = testing::make_world({}, {}, random_mesh(random));
    const TriangleMesh mesh = with_triangles_of_no_area(world->triangles(), random);
    const MeshTree tree = device.tree(mesh);
    const RobustEmbree embree(device, mesh);
    for (int i = 0; i < 10; ++i) {
      Slice slice(random_fan(random), random_mounting(random));
      slice.rays->near = i % 3 == 2 ? random.within(0, 3) : 0.0F;
      slice.rays->range = i % 2 == 0 ? 30.0F : slice.rays->near + random.within(0.5F, 6);
      std::vector<float> earlier(slice.rays->count, kInfinity);
      for (float& t : earlier) {
        if (i % 4 == 1 && random.within(0, 1) < 0.5F) t = random.within(0.1F, 9);
      }
      std::ranges::copy(earlier, slice.rays->t_hit);
      std::ranges::transform(earlier, slice.rays->element, [](float t) { return t < kInfinity ? kEarlier : -1; });
      slice.rays->origin = random.point(i % 2 == 0 ? 2.0F : 6.0F);
      slice.rays->rotation = random_pose(random);
      slice.trace_on(tree, 0, kWalks[random.generator()() % 3]);
      tally.compare(slice, *world, mesh, embree, earlier);
      ASSERT_FALSE(HasFailure()) << "fan " << i << " of " << slice.rays->count << " rays";
    }
  }
  EXPECT_GT(tally.compared, 3 * tally.rays / 4);
  EXPECT_GT(tally.hits, tally.compared / 4);
  testing::tried("slices", tally.compared);
}

// In large worlds, the oracle decides where a slice and Embree differ.
TEST(SlicesAgreement, WithEmbreeInLargeWorlds) {
  const EmbreeDevice device;
  const long wanted = testing::times_tried(10'000);
  Random random(9 + (testing::part_tried() << 24U));
  long rays = 0, hits = 0, differ = 0, undecided = 0;
  for (int kind = 0; kind < 3; ++kind) {
    const auto world = testing::make_world({}, {},
                                           kind == 0   ? ball(50, 100, 0.1F, random)
                                           : kind == 1 ? testing::hills(64)
                                                       : testing::furnished_room(400, random));
    const TriangleMesh& mesh = world->triangles();
    const MeshTree tree = device.tree(mesh);
    const RobustEmbree embree(device, mesh);
    while (rays < (kind + 1) * wanted / 3) {
      Slice slice(random_fan(random), random_mounting(random));
      slice.rays->range = std::array{3.0F, 10.0F, 50.0F}[random.generator()() % 3];
      const Vec3 origin = random.point(kind == 1 ? 25.0F : 2.5F).cwiseProduct(Vec3(1, 1, kind == 1 ? 0.1F : 1.0F));
      slice.trace(tree, origin, random_pose(random), kWalks[random.generator()() % 3]);
      for (std::size_t ray = 0; ray < slice.rays->count; ++ray) {
        ++rays;
        const Vec3d direction = slice.direction(ray);
        const float t = slice.rays->t_hit[ray];
        const std::int32_t element = slice.rays->element[ray];
        if (element >= 0) {
          ++hits;
          ASSERT_TRUE(is_on_its_triangle(slice, ray, mesh));
        }
        const RobustEmbree::Hit other = embree.nearest(origin, direction.cast<float>(), 0.0F, slice.rays->range);
        if (element < 0 && other.element < 0) continue;
        if (element >= 0 && other.element >= 0) {
          const Vec3d normal = (corner_of(mesh, element, 1) - corner_of(mesh, element, 0))
                                   .cross(corner_of(mesh, element, 2) - corner_of(mesh, element, 0))
                                   .normalized();
          const double against = std::max(std::abs(normal.dot(direction)), 1e-3);
          const double reach = std::max(reach_of(slice.origin(), mesh, element), reach_of(slice.origin(), mesh, other.element));
          const double tolerance = 2.0 * rounding_of(reach) / against;
          if (std::abs(static_cast<double>(t - other.t)) <= tolerance) continue;
        }
        ++differ;
        const oracle::Hit expected = oracle::nearest(*world, slice.origin(), direction, slice.rays->range);
        if (!oracle::is_clear_cut(*world, expected, slice.origin(), direction, slice.rays->range)) {
          ++undecided;
          continue;
        }
        ASSERT_EQ(element, expected.element) << "ray " << ray << " of " << slice.rays->count;
      }
    }
  }
  EXPECT_GT(hits, rays / 3);
  EXPECT_LT(differ, rays / 500 + 5);
  testing::tried("slices", rays - undecided);  // compared with Embree, and with the oracle if they differ
}

// The cross-section of a cube, as seen from its middle.
TEST(MeshSlices, MeetACubeWhereTheClosedFormDoes) {
  const EmbreeDevice device;
  const MeshTree tree = device.tree(cube(4.0F));
  std::vector<Vec3d> directions;
  for (int i = 0; i < 200; ++i) directions.push_back(level(2.0 * kPi * i / 200.0 - kPi));
  Slice slice(directions);
  for (const SliceWalk walk : kWalks) {
    slice.trace(tree, Vec3(0, 0, 0.3F), Mat3::Identity(), walk);
    for (std::size_t ray = 0; ray < directions.size(); ++ray) {
      ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), 4.0 / directions[ray].cwiseAbs().maxCoeff(), 2e-6) << ray;
    }
  }
}

TEST(MeshSlices, KeepAnEarlierHitThatIsNearer) {
  const EmbreeDevice device;
  TriangleMesh mesh = cube(4.0F);
  testing::add_box(mesh, Vec3::Zero(), Vec3::Constant(2.0F));
  const MeshTree tree = device.tree(mesh);
  std::vector<Vec3d> directions;
  for (int i = 0; i < 64; ++i) directions.push_back(level(0.02 * (i - 31.5)));
  Slice slice(directions);
  const auto expect = [&](double x) {
    for (std::size_t ray = 0; ray < directions.size(); ++ray) {
      ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]) * directions[ray].x(), x, 1e-6);
    }
  };
  slice.trace(tree, Vec3(0, 0, 0.5F), Mat3::Identity());
  expect(2.0);
  for (std::size_t ray = 0; ray < slice.rays->count; ++ray) {
    slice.rays->t_hit[ray] = ray % 2 == 0 ? 1.0F : 50.0F;
    slice.rays->element[ray] = kEarlier;
  }
  slice.trace_on(tree, 7);
  for (std::size_t ray = 0; ray < slice.rays->count; ++ray) {
    ASSERT_EQ(slice.rays->t_hit[ray] == 1.0F, ray % 2 == 0);
    ASSERT_EQ(slice.rays->element[ray] == kEarlier, ray % 2 == 0);
    if (ray % 2 == 0) continue;
    ASSERT_GE(slice.rays->element[ray], 7 + 12 + 10);  // the last face of the inner box
  }
  slice.rays->near = 2.5F;
  slice.trace(tree, Vec3(0, 0, 0.5F), Mat3::Identity());
  expect(4.0);
  slice.rays->near = 0.0F;
  slice.rays->range = 1.5F;
  slice.trace(tree, Vec3(0, 0, 0.5F), Mat3::Identity());
  for (std::size_t ray = 0; ray < slice.rays->count; ++ray) {
    ASSERT_EQ(slice.rays->t_hit[ray], kInfinity);
    ASSERT_EQ(slice.rays->element[ray], -1);
  }
}

// Both ends of the range count: a wall at the near range and one at the far range are met.
TEST(MeshSlices, MeetWallsAtTheEndsOfTheRange) {
  const EmbreeDevice device;
  const MeshTree tree = device.tree(cube(4.0F));
  Slice slice({Vec3d::UnitX()});
  for (const auto& [near, range, expected] : {std::array{0.0F, 4.0F, 4.0F},
                                              {4.0F, 9.0F, 4.0F},
                                              {0.0F, std::nextafter(4.0F, 0.0F), kInfinity},
                                              {std::nextafter(4.0F, 9.0F), 9.0F, kInfinity}}) {
    slice.rays->near = near;
    slice.rays->range = range;
    for (const SliceWalk walk : kWalks) {
      slice.trace(tree, Vec3(0, 0.125F, 0.25F), Mat3::Identity(), walk);
      EXPECT_EQ(slice.rays->t_hit[0], expected) << near << " to " << range;
    }
  }
}

// -- No ray slips between triangles.

// A closed box of squares whose corners lie at multiples of `step`, from -half to half steps along each axis, around closed boxes
// with faces on the same planes.
TriangleMesh lattice(int half, float step, bool with_boxes) {
  TriangleMesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int side : {-half, half}) {
      const auto first = static_cast<std::int32_t>(mesh.vertices.size());
      for (int row = -half; row <= half; ++row) {
        for (int column = -half; column <= half; ++column) {
          Vec3 corner;
          corner[axis] = step * static_cast<float>(side);
          corner[(axis + 1) % 3] = step * static_cast<float>(column);
          corner[(axis + 2) % 3] = step * static_cast<float>(row);
          mesh.vertices.push_back(corner);
        }
      }
      const int across = 2 * half + 1;
      for (int row = 0; row < 2 * half; ++row) {
        for (int column = 0; column < 2 * half; ++column) {
          const std::int32_t at = first + row * across + column;
          mesh.triangles.push_back({at, at + 1, at + across + 1});
          mesh.triangles.push_back({at, at + across + 1, at + across});
        }
      }
    }
  }
  testing::complete(mesh);
  if (!with_boxes) return mesh;
  for (const Vec3& center : {Vec3(2, 2, -1), Vec3(-2, 1, 1), Vec3(0, -2, 1), Vec3(2, -2, -1)}) {
    testing::add_box(mesh, step * center, Vec3::Constant(step));
  }
  return mesh;
}

// Returns the angle at which a cell of a fan that is not even begins.
double begin_of_cell(std::size_t cell) {
  return 2.0 * kPi * static_cast<double>(cell) / static_cast<double>(Fan::kMaxCells) - kPi;
}

std::size_t random_cell(Random& random) { return random.generator()() % Fan::kMaxCells; }

// Returns the angles of everything that may let a ray slip: where edges pass through the plane, as seen from the origin, and the
// ends of the cells of angles; each of them some roundings off, too. frame: of the plane, in its columns.
std::vector<double> critical_angles(const TriangleMesh& mesh, const Vec3d& origin, const Eigen::Matrix3d& frame, Random& random) {
  std::vector<double> angles;
  const auto add = [&](double angle) {
    angles.push_back(angle);
    const double off = std::pow(10.0, static_cast<double>(random.within(-9, -4.5F)));
    for (const double aside : {-off, off}) angles.push_back(angle + aside);
  };
  for (std::size_t triangle = 0; triangle < mesh.triangles.size(); ++triangle) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto i = static_cast<std::int32_t>(triangle);
      const Vec3d a = frame.transpose() * (corner_of(mesh, i, k) - origin);
      const Vec3d b = frame.transpose() * (corner_of(mesh, i, (k + 1) % 3) - origin);
      if (a.z() * b.z() > 0.0 || (a.z() == 0.0 && b.z() == 0.0)) continue;
      const Vec3d point = (a * b.z() - b * a.z()) / (b.z() - a.z());
      add(std::atan2(point.y(), point.x()));
    }
  }
  std::ranges::shuffle(angles, random.generator());
  if (angles.size() > kMaxRays - 48) angles.resize(kMaxRays - 48);
  while (angles.size() < kMaxRays) add(begin_of_cell(random_cell(random)));
  angles.resize(kMaxRays);
  return angles;
}

// From inside closed meshes, in planes through their corners and in level planes through their faces, towards edges and corners.
TEST(SlicesWatertight, NoRaySlipsBetweenTriangles) {
  const EmbreeDevice device;
  Random random(2 + (testing::part_tried() << 24U));
  constexpr long kFansOfAMesh = 25;
  const long fans = testing::times_tried(200);
  const long of_a_mesh = std::max(kFansOfAMesh, fans / 80);
  long rays = 0;
  TriangleMesh mesh;
  std::unique_ptr<const MeshTree> tree;
  Vec3 place = Vec3::Zero();
  for (long i = 0; i < fans; ++i) {
    const long kind = i / of_a_mesh % 8;
    if (i % of_a_mesh == 0) {
      const int rings = std::array{3, 4, 12, 40}[static_cast<std::size_t>(kind % 4)];
      mesh = kind < 4    ? ball(rings, 2 * rings, rings == 12 ? 1.0F : 0.0F, random)
             : kind == 4 ? cube(3.0F)
             : kind == 5 ? lattice(1, 3.0F, false)
             : kind == 6 ? lattice(4, 0.75F, false)
                         : lattice(4, 1.0F, true);
      place = kind == 1 || kind == 2 ? Vec3(10000, -9000, 500) : Vec3(0, 0, 0);
      for (Vec3& vertex : mesh.vertices) vertex += place;
      tree = std::make_unique<const MeshTree>(device.tree(mesh));
    }
    const auto any_vertex = [&] { return mesh.vertices[random.generator()() % mesh.vertices.size()]; };
    Vec3 origin = random.point(0.8F);  // not in a box of the lattice
    if (i % 2 == 0) origin = Vec3::Zero();
    if (kind > 4 && i % 4 == 2) origin = Vec3(0.5F, 0, 0);
    if (i % 5 == 1) origin[static_cast<Eigen::Index>(i % 3)] = 0.0F;
    if (kind > 5 && i % 8 == 4) {  // in the plane of other faces, or just beside it
      const auto level_of = static_cast<float>(static_cast<int>(random.generator()() % 5) - 2);
      origin.z() = (kind == 6 ? 0.75F : 1.0F) * level_of + (i % 16 == 4 ? 0.0F : random.within(-1e-6F, 1e-6F));
    }
    origin += place;
    // The plane: of two axes, or through two corners. Some corner may lie at the end of a cell of the angles.
    const Vec3d a = (any_vertex() - origin).cast<double>(), b = (any_vertex() - origin).cast<double>();
    Eigen::Matrix3d frame = plane_of_axes(i % 4 == 1 ? 2 : 0);
    if (i % 4 > 1 && a.cross(b).norm() > 0.1) {
      frame.col(2) = a.cross(b).normalized();
      frame.col(0) = a.normalized();
      frame.col(1) = frame.col(2).cross(frame.col(0));
      const double off = std::pow(10.0, static_cast<double>(random.within(-9, -4.5F))) * (i % 3 == 0 ? -1.0 : 1.0);
      const double turn = begin_of_cell(random_cell(random)) + off;
      frame = frame * Eigen::AngleAxisd(turn, Vec3d::UnitZ()).toRotationMatrix();
    }
    // As a level fan of a tilted drone, or as a tilted fan of a level drone.
    const bool is_drone_tilted = i % 3 != 0;
    std::vector<double> angles = critical_angles(mesh, origin.cast<double>(), frame, random);
    if (i % 5 == 4) {  // even, so that rays themselves begin cells; one of them points to an edge
      const double step = i % 2 == 0 ? 2.0 * kPi / static_cast<double>(angles.size()) : 0.02;
      const double first = angles.front() - std::floor((angles.front() + kPi) / step) * step;
      for (std::size_t ray = 0; ray < angles.size(); ++ray) angles[ray] = first + step * static_cast<double>(ray);
    }
    std::vector<Vec3d> directions;
    for (const double angle : angles) {
      directions.push_back(is_drone_tilted ? level(angle) : Vec3d(frame * level(angle)));
    }
    const std::size_t at_once = i % 4 == 3 ? 2 : kMaxRays;
    for (std::size_t begin = 0; begin < kMaxRays; begin += at_once) {
      const auto from = directions.begin() + static_cast<std::ptrdiff_t>(begin);
      // Two rays in a plane of their own may be too close to each other to define it.
      if (at_once == 2 && from[0].cross(from[1]).norm() < 1e-3) continue;
      Slice slice({from, from + static_cast<std::ptrdiff_t>(at_once)});
      slice.trace(*tree, origin, is_drone_tilted ? Mat3(frame.cast<float>()) : Mat3(Mat3::Identity()),
                  kWalks[random.generator()() % 3]);
      for (std::size_t ray = 0; ray < at_once; ++ray) {
        ++rays;
        ASSERT_GE(slice.rays->element[ray], 0) << "ray " << ray << " of fan " << i << " at " << slice.direction(ray).transpose();
        ASSERT_TRUE(is_on_its_triangle(slice, ray, mesh)) << "fan " << i;
      }
    }
  }
  testing::tried("slices_watertight", rays);
}

// A beam along the negative first axis is where the angles begin and end.
TEST(SlicesWatertight, NoRaySlipsThroughTheCutOfTheAngles) {
  const EmbreeDevice device;
  for (const bool with_corners_on_axis : {true, false}) {
    const TriangleMesh mesh = with_corners_on_axis ? lattice(2, 2.0F, false) : cube(4.0F);
    const MeshTree tree = device.tree(mesh);
    for (const double aside : {0.0, 1e-300, 1e-40, 1e-16, 1e-12, 6e-8, 1e-6, 1e-5, 1e-4}) {
      std::vector<Vec3d> directions;
      for (int i = 0; i < 36; ++i) directions.push_back(level(2.0 * kPi * i / 36.0 - kPi));
      directions.push_back({-1.0, 0.0, 0.0});
      directions.push_back({-1.0, -0.0, 0.0});
      directions.push_back(Vec3d(-1.0, aside, 0.0).normalized());
      directions.push_back(Vec3d(-1.0, -aside, 0.0).normalized());
      Slice slice(directions);
      // Corners exactly on the axis, beside it, and an edge that crosses it.
      for (const Vec3& origin : {Vec3(0, 0, 0), Vec3(0, 0, 0.5F), Vec3(0, 1e-6F, 0), Vec3(0, -1e-6F, 0.5F), Vec3(0.5F, 1, 1)}) {
        for (const SliceWalk walk : kWalks) {
          slice.trace(tree, origin, Mat3::Identity(), walk);
          for (std::size_t ray = 0; ray < directions.size(); ++ray) {
            ASSERT_GE(slice.rays->element[ray], 0) << "ray " << ray << " from " << origin.transpose();
            const Vec3d end = slice.origin() + static_cast<double>(slice.rays->t_hit[ray]) * directions[ray];
            ASSERT_NEAR(end.cwiseAbs().maxCoeff(), 4.0, 3e-6) << "ray " << ray << " from " << origin.transpose();
          }
        }
      }
    }
  }
}

// Walls around the origin, on the sides of a triangle whose corners are 5 m away: one at an angle, the others 2 rad beside it.
TriangleMesh walls_with_corner_at(double angle) {
  TriangleMesh mesh;
  for (const double side : {0.0, 2.0, -2.0}) {
    const Vec3d corner = 5.0 * level(angle + side);
    for (const float z : {-1.0F, 1.0F}) mesh.vertices.emplace_back(corner.cast<float>().x(), corner.cast<float>().y(), z);
  }
  for (int i = 0; i < 6; i += 2) {
    mesh.triangles.push_back({i, i + 1, (i + 2) % 6});
    mesh.triangles.push_back({i + 1, (i + 3) % 6, (i + 2) % 6});
  }
  return mesh;
}

// Returns the distance from the origin to these walls, by the distances from the origin to the walls' lines.
double distance_to_walls(double corner, double angle) {
  double distance = oracle::kNever;
  for (const auto& [middle, half] : {std::pair{corner + 1.0, 1.0}, {corner - 1.0, 1.0}, {corner + kPi, kPi - 2.0}}) {
    const double along = std::cos(angle - middle);
    if (along > 0.0) distance = std::min(distance, 5.0 * std::cos(half) / along);
  }
  return distance;
}

// Two walls meet in a corner just beside the beginning of a cell: the rays between the two must hit one of them.
TEST(SlicesWatertight, NoRaySlipsAtTheEndOfACell) {
  const EmbreeDevice device;
  for (std::size_t cell = 0; cell <= Fan::kMaxCells; ++cell) {
    const double turn = begin_of_cell(cell);
    for (const double ahead : {-8e-6, -3e-6, 3e-6, 8e-6}) {
      const MeshTree tree = device.tree(walls_with_corner_at(turn + ahead));
      std::vector<Vec3d> directions;
      for (int i = -20; i <= 20; ++i) directions.push_back(level(turn + 5e-7 * i));
      Slice beams(directions);
      ASSERT_FALSE(beams.fan->is_even);
      for (const SliceWalk walk : kWalks) {
        beams.trace(tree, Vec3::Zero(), Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < directions.size(); ++ray) {
          ASSERT_NEAR(static_cast<double>(beams.rays->t_hit[ray]), 5.0, 1e-3) << "ray " << ray << " of cell " << cell;
        }
      }
    }
  }
}

// The rays of an even fan lie at the beginnings of its cells, up to rounding. Two walls meet in a corner just beside one of them.
TEST(SlicesWatertight, NoRaySlipsAtTheBeginningOfAnEvenFansCell) {
  const EmbreeDevice device;
  Random random(11 + (testing::part_tried() << 24U));
  const long fans = testing::times_tried(500);
  for (long i = 0; i < fans; ++i) {
    const std::size_t count = i % 3 == 0 ? kMaxRays : 2 + random.generator()() % (kMaxRays - 1);
    const double most = i % 2 == 0 ? 2.0 * kPi / static_cast<double>(count) : 2.0 / static_cast<double>(kMaxRays);
    const double step = i % 4 < 2 ? most : most * static_cast<double>(random.within(0.5F, 1.0F));
    const double width = step * static_cast<double>(count - 1);
    const double first = static_cast<double>(random.within(0, 1)) * (2.0 * kPi - width) - kPi;
    std::vector<double> angles;
    std::vector<Vec3d> directions;
    for (std::size_t ray = 0; ray < count; ++ray) {
      angles.push_back(first + step * static_cast<double>(ray) + static_cast<double>(random.within(-4e-7F, 4e-7F)));
      directions.push_back(level(angles.back()));
    }
    Slice beams(directions);
    ASSERT_TRUE(beams.fan->is_even) << count << " rays";
    const std::size_t at = random.generator()() % count;
    const double tolerance = rounding_of(5.1) / std::cos(kPi - 2.0);  // at most 5.1 m to a corner, and hit at that angle
    for (const double ahead : {-8e-6, -3e-6, -3e-7, 0.0, 3e-7, 3e-6, 8e-6}) {
      const double corner = angles[at] + ahead;
      const MeshTree tree = device.tree(walls_with_corner_at(corner));
      for (const SliceWalk walk : kWalks) {
        beams.trace(tree, Vec3::Zero(), Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < count; ++ray) {
          ASSERT_NEAR(static_cast<double>(beams.rays->t_hit[ray]), distance_to_walls(corner, angles[ray]), tolerance)
              << "ray " << ray << " of " << count << ", corner beside ray " << at;
        }
      }
    }
  }
}

// -- The bits.

// Balls that nearly touch each other, of small and large triangles.
TriangleMesh shells(Random& random) {
  TriangleMesh mesh;
  for (const int rings : {4, 7, 12, 20, 33}) {
    const TriangleMesh shell = ball(rings, 2 * rings, 0.0F, random);
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), shell.vertices.begin(), shell.vertices.end());
    for (const auto& [a, b, c] : shell.triangles) mesh.triangles.push_back({first + a, first + b, first + c});
  }
  testing::complete(mesh);
  return mesh;
}

// The other rays, their order and the way through the tree must not change any bit. In a plane of two axes, the fan's frame does
// not depend on its rays.
TEST(MeshSlices, ARaysResultDoesNotDependOnTheRaysBesideIt) {
  const EmbreeDevice device;
  Random random(3 + (testing::part_tried() << 24U));
  constexpr long kFansOfAMesh = 10;
  const long fans = testing::times_tried(50);
  const long of_a_mesh = std::max(kFansOfAMesh, fans / 50);
  long rays = 0, hits = 0;
  std::unique_ptr<const MeshTree> tree;
  Vec3 eye;
  for (long i = 0; i < fans; ++i) {
    if (i % of_a_mesh == 0) {
      const long kind = i / of_a_mesh % 5;
      const int rings = kind % 2 == 0 ? 5 : 40;
      TriangleMesh mesh = kind < 2    ? ball(rings, 2 * rings, 0.7F, random)
                          : kind == 2 ? testing::furnished_room(40, random)
                          : kind == 3 ? lattice(4, 1.0F, true)
                                      : shells(random);
      eye = kind == 3 ? Vec3(0, 1, 0) : Vec3(random.point(2.5F));
      testing::add_slivers(mesh, 20 * rings, eye, random);
      tree = std::make_unique<const MeshTree>(device.tree(mesh));
    }
    const Mat3 rotation = random_pose(random);
    const Vec3 origin = i % 2 == 0 ? eye : Vec3(random.point(2.5F));
    const Eigen::Matrix3d mounting = random_mounting(random);
    const Eigen::Matrix3d plane = plane_of_axes(static_cast<std::size_t>(i) % 3);
    const double width = i % 4 < 2 ? 2.0 * kPi : 0.5;
    std::vector<Vec3d> directions;
    for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
      directions.push_back(plane * level(width * static_cast<double>(random.within(-0.5F, 0.5F)) + 1.0));
    }
    const float near = i % 5 == 0 ? 0.5F : 0.0F, range = i % 7 == 0 ? 2.0F : 100.0F;
    const auto trace = [&](const std::vector<Vec3d>& of, SliceWalk walk) {
      Slice slice(of, mounting);
      slice.rays->near = near;
      slice.rays->range = range;
      slice.trace(*tree, origin, rotation, walk);
      return slice;
    };
    const Slice slice = trace(directions, SliceWalk::automatic);
    for (const SliceWalk walk : {SliceWalk::listed, SliceWalk::ordered}) {
      const Slice same = trace(directions, walk);
      for (std::size_t ray = 0; ray < kMaxRays; ++ray) ASSERT_TRUE(same_hit(*same.rays, ray, *slice.rays, ray)) << "fan " << i;
    }
    std::array<std::size_t, kMaxRays> from;
    for (std::size_t ray = 0; ray < kMaxRays; ++ray) from[ray] = ray;
    std::ranges::shuffle(from, random.generator());
    for (const std::size_t count : {std::size_t{1}, std::size_t{2}, std::size_t{6}, std::size_t{7}, std::size_t{40}, kMaxRays}) {
      std::vector<Vec3d> some;
      for (std::size_t ray = 0; ray < count; ++ray) {
        const bool is_other = ray % 7 == 6;  // replaced by rays in other directions
        some.push_back(is_other ? Vec3d(plane * level(static_cast<double>(random.within(-3, 3)))) : directions[from[ray]]);
      }
      const Slice part = trace(some, kWalks[random.generator()() % 3]);
      for (std::size_t ray = 0; ray < count; ++ray) {
        if (ray % 7 == 6) continue;
        ++rays;
        ASSERT_TRUE(same_hit(*part.rays, ray, *slice.rays, from[ray])) << "fan " << i << ", " << count << " rays";
        hits += part.rays->element[ray] >= 0;
      }
    }
  }
  EXPECT_GT(hits, rays / 3);
  testing::tried("slices_independence", rays);
}

TEST(MeshSlices, HaveTheSameBitsOnEverySimdTarget) {
  const EmbreeDevice device;
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  ASSERT_GT(targets.size(), 1U);
  Random random(8);
  for (int i = 0; i < 60; ++i) {
    TriangleMesh mesh = i % 3 == 0 ? lattice(4, 1.0F, true) : with_triangles_of_no_area(random_mesh(random), random);
    const Vec3 origin = i % 3 == 0 ? Vec3(0, 1, 0) : Vec3(random.point(3.0F));
    testing::add_slivers(mesh, 60, origin, random);
    const MeshTree tree = device.tree(mesh);
    const Mat3 rotation = random_pose(random);
    Slice first(random_fan(random), random_mounting(random));
    first.trace(tree, origin, rotation);
    for (const std::int64_t target : targets) {
      SCOPED_TRACE(hwy::TargetName(target));
      const testing::OnTarget on(target);
      for (const SliceWalk walk : kWalks) {
        Slice same(first.directions, first.mounting);
        same.trace(tree, origin, rotation, walk);
        for (std::size_t ray = 0; ray < same.rays->count; ++ray) {
          ASSERT_TRUE(same_hit(*same.rays, ray, *first.rays, ray)) << "fan " << i;
        }
      }
    }
  }
}

// -- Hard worlds.

// Faces in the fan's plane are not above it: a slice is what a plane just above it, along its normal, sees.
TEST(MeshSlices, FacesInThePlaneAreBelowIt) {
  const EmbreeDevice device;
  const auto world = testing::make_world({}, {}, lattice(4, 1.0F, true));
  const MeshTree tree = device.tree(world->triangles());
  Random random(4);
  std::size_t compared = 0, rays = 0;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Matrix3d plane = plane_of_axes(static_cast<std::size_t>(i) % 3);
    std::vector<Vec3d> directions;
    for (int k = 0; k < 100; ++k) directions.push_back(plane * level(static_cast<double>(random.within(-3.2F, 3.2F))));
    Slice slice(directions);
    const auto step = [&] { return static_cast<float>(static_cast<int>(random.generator()() % 7)) - 3.0F; };
    Vec3 origin(step(), step(), step());
    if (i % 2 == 0) origin += 0.25F * Vec3(plane.col(0).cast<float>()) + 0.125F * Vec3(plane.col(1).cast<float>());
    slice.trace(tree, origin, Mat3::Identity(), kWalks[static_cast<std::size_t>(i) % 3]);
    const Vec3d above = slice.origin() + 1e-7 * slice.normal();
    for (std::size_t ray = 0; ray < directions.size(); ++ray) {
      ++rays;
      const Vec3d& direction = directions[ray];
      const oracle::Hit hit = oracle::nearest(*world, above, direction, 100.0);
      const Vec3d aside = 1e-5 * slice.normal().cross(direction);
      const oracle::Hit left = oracle::nearest(*world, above + aside, direction, 100.0);
      const oracle::Hit right = oracle::nearest(*world, above - aside, direction, 100.0);
      const double moves = std::max(std::abs(left.t - hit.t), std::abs(right.t - hit.t));
      if (moves > 1e-3 || hit.t < 1e-3) continue;
      ++compared;
      ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), hit.t, 1e-5 + moves)
          << "ray " << ray << " from " << origin.transpose();
    }
  }
  EXPECT_GT(compared, 3 * rays / 4);
}

// Among copies of a triangle, the one with the lowest number is met. There are more copies than a leaf holds.
TEST(MeshSlices, TheFirstOfEqualTrianglesIsMet) {
  const EmbreeDevice device;
  Random random(5);
  for (int round = 0; round < 20; ++round) {
    const TriangleMesh once = round % 2 == 0 ? cube(4.0F) : ball(3, 6, 0.5F, random);
    TriangleMesh often = once;
    for (int copy = 0; copy < 40; ++copy) {
      often.triangles.insert(often.triangles.end(), once.triangles.begin(), once.triangles.end());
    }
    testing::complete(often);
    const MeshTree tree = device.tree(once), copies = device.tree(often);
    const Vec3 origin = random.point(1.0F);
    const Mat3 rotation = random_pose(random);
    for (const std::size_t count : {std::size_t{4}, kMaxRays}) {  // met one by one and in vectors
      std::vector<Vec3d> directions;
      for (std::size_t i = 0; i < count; ++i) directions.push_back(level(static_cast<double>(random.within(-3, 3))));
      Slice slice(directions), same(directions);
      slice.trace(tree, origin, rotation);
      for (const SliceWalk walk : kWalks) {
        same.trace(copies, origin, rotation, walk);
        for (std::size_t ray = 0; ray < count; ++ray) {
          ASSERT_TRUE(same_hit(*same.rays, ray, *slice.rays, ray)) << "round " << round;
        }
      }
    }
  }
}

// Far from the origin, and with all lengths multiplied by a power of two: the same bits, since the differences of coordinates are
// exact.
TEST(MeshSlices, ScaleAndPlaceDoNotMatter) {
  const EmbreeDevice device;
  Random random(6);
  const auto snapped = [](const Vec3& v) { return Vec3((1024.0F * v).array().round() / 1024.0F); };
  std::size_t hits = 0, rays = 0;
  for (int round = 0; round < 30; ++round) {
    TriangleMesh mesh = round % 3 == 0 ? lattice(4, 1.0F, true) : random_mesh(random);
    for (Vec3& vertex : mesh.vertices) vertex = snapped(vertex);
    const Vec3 origin = snapped(random.point(3.0F));
    const Mat3 rotation = random_pose(random);
    Slice slice(random_fan(random), random_mounting(random));
    slice.trace(device.tree(mesh), origin, rotation);
    const auto expect_same = [&](float scale, const Vec3& offset) {
      TriangleMesh other = mesh;
      for (Vec3& vertex : other.vertices) vertex = scale * vertex + offset;
      Slice same(slice.directions, slice.mounting);
      same.rays->range = scale * slice.rays->range;
      same.trace(device.tree(other), scale * origin + offset, rotation, kWalks[static_cast<std::size_t>(round / 3) % 3]);
      for (std::size_t ray = 0; ray < same.rays->count; ++ray) {
        same.rays->t_hit[ray] /= scale;
        ASSERT_TRUE(same_hit(*same.rays, ray, *slice.rays, ray)) << "round " << round << ", scale " << scale;
        hits += slice.rays->element[ray] >= 0;
      }
      rays += same.rays->count;
    };
    expect_same(1.0F, Vec3(10240, -10240, 0));
    expect_same(1.0F, Vec3(-10240, 10240, 10240));
    for (const float scale : {0x1p-12F, 0x1p-8F, 0x1p8F, 0x1p16F}) expect_same(scale, Vec3::Zero());
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_GT(hits, rays / 4);
}

// Triangles from 1 cm to 100 m in one world.
TEST(MeshSlices, MeetSmallTrianglesBesideLargeOnes) {
  const EmbreeDevice device;
  Random random(7);
  std::size_t compared = 0, hits = 0, rays = 0;
  for (int round = 0; round < 10; ++round) {
    TriangleMesh mesh;
    for (std::int32_t i = 0; i < 150; ++i) {
      const float size = std::exp(random.within(-4.6F, 4.6F));
      const Vec3 center = size * random.within(0.5F, 3) * random.direction().normalized();
      for (int k = 0; k < 3; ++k) mesh.vertices.push_back(center + size * random.point(1.0F));
      mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    }
    const auto world = testing::make_world({}, {}, mesh);
    const MeshTree tree = device.tree(mesh);
    for (int i = 0; i < 10; ++i) {
      Slice slice(random_fan(random));
      slice.trace(tree, random.point(0.01F), random_pose(random), kWalks[static_cast<std::size_t>(i) % 3]);
      const double aside = rounding_of(reach_of(slice.origin(), mesh));
      for (std::size_t ray = 0; ray < slice.rays->count; ++ray) {
        ++rays;
        const std::int32_t element = slice.rays->element[ray];
        const Vec3d direction = slice.direction(ray);
        if (element >= 0) {
          ASSERT_TRUE(is_on_its_triangle(slice, ray, mesh));
        }
        const oracle::Hit hit = oracle::nearest(*world, slice.origin(), direction, 100.0);
        const double steep = oracle::steepness(*world, hit, slice.origin(), direction, 100.0, aside);
        if (steep > 5.0) continue;
        ++compared;
        ASSERT_EQ(element, hit.element) << "ray " << ray;
        if (hit.element < 0) continue;
        ++hits;
        const double tolerance = rounding_of(reach_of(slice.origin(), mesh, element)) * std::max(steep, 1.0);
        ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), hit.t, tolerance) << "ray " << ray;
      }
    }
  }
  EXPECT_GT(compared, rays / 3);
  EXPECT_GT(hits, compared / 4);
}

// An edge or a corner at the origin is hit at distance 0 or not at all; surfaces behind it are hit at their distance.
TEST(MeshSlices, AnOriginOnAnEdgeSeesWhatIsBehind) {
  const EmbreeDevice device;
  TriangleMesh mesh = cube(4.0F);
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (const Vec3& corner : {Vec3(1, 1, -1), Vec3(1, 1, 1), Vec3(2, 1.5F, 0), Vec3(1.5F, 2, 0)}) mesh.vertices.push_back(corner);
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 1, first + 3});
  testing::complete(mesh);
  const auto world = testing::make_world({}, {}, mesh);
  const MeshTree tree = device.tree(world->triangles());
  std::vector<Vec3d> directions;
  for (int i = 0; i < 90; ++i) directions.push_back(level(2.0 * kPi * (i + 0.3) / 90.0));
  Slice slice(directions);
  for (const float z : {0.0F, 0.25F, -1.0F, 1.0F, 0.999F}) {
    for (const float near : {0.0F, 0.01F}) {
      slice.rays->near = near;
      for (const SliceWalk walk : kWalks) {
        slice.trace(tree, Vec3(1, 1, z), Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < directions.size(); ++ray) {
          const double t = static_cast<double>(slice.rays->t_hit[ray]);
          if (near == 0.0F && t == 0.0) {
            ASSERT_GE(slice.rays->element[ray], 12);
            continue;
          }
          const Vec3d from = slice.origin() + 0.01 * directions[ray];
          const oracle::Hit hit = oracle::nearest(*world, from, directions[ray], 100.0);
          if (!oracle::is_clear_cut(*world, hit, from, directions[ray], 100.0)) continue;
          ASSERT_NEAR(t, 0.01 + hit.t, 1e-5) << "ray " << ray << " at height " << z;
        }
      }
    }
  }
}

// Beside the origin, 10 micrometres away from one end of a segment of 100 m, a hit has a distance, and only for the ray towards
// it.
TEST(MeshSlices, AnEndOfASegmentBesideTheOrigin) {
  const EmbreeDevice device;
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  ASSERT_GT(targets.size(), 1U);
  Random random(13);
  int hits = 0;
  for (int i = 0; i < 200; ++i) {
    // A level cut from a far end to a near one. Both ends are halfway between a corner above the plane and one below.
    const double along = static_cast<double>(random.within(-3, 3)), turn = static_cast<double>(random.within(0.02F, 0.1F));
    const Vec3 far = (100.0 * level(along)).cast<float>();
    const Vec3 near = (std::pow(10.0, static_cast<double>(random.within(-7, -4))) * level(along + kPi - turn)).cast<float>();
    TriangleMesh mesh;
    mesh.vertices = {Vec3(0, 0, 1), Vec3(2.0F * far.x(), 2.0F * far.y(), -1), Vec3(2.0F * near.x(), 2.0F * near.y(), -1)};
    mesh.triangles = {{0, 1, 2}};
    testing::complete(mesh);
    const MeshTree tree = device.tree(mesh);
    // Rays within the segment's angles close to the near end, the opposite ones, and others.
    std::vector<Vec3d> directions;
    for (const double share : {0.001, 0.3, 0.7}) {
      directions.push_back(level(along + kPi - turn - share * (kPi - turn)));
      directions.push_back(-directions.back());
    }
    while (directions.size() < 24) directions.push_back(level(static_cast<double>(random.within(-3.14F, 3.14F))));
    const auto from = far.head<2>().cast<double>(), to = near.head<2>().cast<double>();
    std::vector<float> first;
    for (const std::int64_t target : targets) {
      SCOPED_TRACE(hwy::TargetName(target));
      const testing::OnTarget on(target);
      Slice slice(directions);
      slice.trace(tree, Vec3::Zero(), Mat3::Identity(), kWalks[static_cast<std::size_t>(i) % 3]);
      if (first.empty()) first.assign(slice.rays->t_hit, slice.rays->t_hit + directions.size());
      ASSERT_TRUE(testing::same_bits(std::span(slice.rays->t_hit, directions.size()), std::span<const float>(first)));
      for (std::size_t ray = 0; ray < directions.size(); ++ray) {
        const Eigen::Vector2d d = directions[ray].head<2>();
        // p + share (q - p) = t d, by Cramer's rule.
        const Eigen::Vector2d across(-d.y(), d.x());
        const double share = from.dot(across) / (from - to).dot(across);
        const double t = from.dot(d) + share * (to - from).dot(d);
        if (std::min(std::abs(share), std::abs(share - 1.0)) < 1e-6 && std::abs(t) > 1.0) continue;  // the far end
        if (share < 0.0 || share > 1.0 || t < 0.0) {
          ASSERT_EQ(slice.rays->element[ray], -1) << "ray " << ray << " of mesh " << i;
        } else {
          ++hits;
          ASSERT_EQ(slice.rays->element[ray], 0) << "ray " << ray << " of mesh " << i << " at " << t;
          ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), t, 1e-4 * t) << "ray " << ray << " of mesh " << i;
        }
      }
    }
  }
  EXPECT_GT(hits, 1000);
}

// -- Planes and fans.

TEST(MeshSlices, KnowDirectionsInAPlane) {
  Random random(10);
  int wide = 0;
  for (int i = 0; i < 200; ++i) {
    std::vector<Vec3d> directions = random_fan(random);
    EXPECT_TRUE(are_in_plane(directions)) << directions.size();
    const Vec3d normal = make_fan(directions, Eigen::Matrix3d::Identity()).to_sensor.col(2).cast<double>();
    for (const Vec3d& direction : directions) EXPECT_LT(std::abs(normal.dot(direction)), 2e-6);
    const bool is_wide =
        std::ranges::any_of(directions, [&](const Vec3d& direction) { return direction.cross(directions.front()).norm() > 0.1; });
    if (!is_wide) continue;  // a tilted plane contains one more direction nearly as well
    ++wide;
    directions.push_back((directions.front() + 1e-4 * normal).normalized());
    EXPECT_FALSE(are_in_plane(directions)) << directions.size();
  }
  EXPECT_GT(wide, 100);
  EXPECT_TRUE(are_in_plane(std::vector{Vec3d(Vec3d::UnitX())}));
  EXPECT_TRUE(are_in_plane(std::vector{Vec3d(1, 1, 1).normalized()}));
}

// Unit directions all around in a plane, except that one points `out` (rad) out of it.
std::vector<Vec3d> around_but_one(const Eigen::Matrix3d& plane, double out) {
  std::vector<Vec3d> directions;
  for (int i = 0; i < 200; ++i) directions.push_back(plane * level(2.0 * kPi * (i + 0.3) / 200.0));
  directions[70] = std::cos(out) * directions[70] + std::sin(out) * plane.col(2);
  return directions;
}

// In planes of two axes and in tilted ones. A tilted plane is fitted to all 200 beams, so it turns towards the one that points
// out of it, by 2 / 200 of the angle.
TEST(MeshSlices, BeamsMayPointAMicroradianOutOfThePlane) {
  const EmbreeDevice device;
  const TriangleMesh mesh = cube(4.0F);
  const MeshTree tree = device.tree(mesh);
  Random random(12);
  for (std::size_t i = 0; i < 12; ++i) {
    const Eigen::Matrix3d plane =
        i < 3 ? plane_of_axes(i) : Eigen::Matrix3d(random.rotation().cast<double>().normalized().toRotationMatrix());
    for (const double sign : {-1.0, 1.0}) {
      EXPECT_TRUE(are_in_plane(around_but_one(plane, sign * 0.9e-6))) << "plane " << i;
      EXPECT_FALSE(are_in_plane(around_but_one(plane, sign * 1.1e-6))) << "plane " << i;
      EXPECT_FALSE(are_in_plane(around_but_one(plane, sign * 2e-6))) << "plane " << i;

      // Tracing them in the plane moves a hit by at most 0.9e-6 of its distance across the ray. Faces are 2 m away or more, so a
      // ray that hits one at t does so at an angle whose cosine is at least 2 / t.
      Slice slice(around_but_one(plane, sign * 0.9e-6));
      const Vec3 origin = i % 2 == 0 ? Vec3::Zero() : Vec3(random.point(2.0F));
      for (const SliceWalk walk : kWalks) {
        slice.trace(tree, origin, Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < slice.directions.size(); ++ray) {
          const Vec3d& direction = slice.directions[ray];
          double expected = oracle::kNever;
          for (Eigen::Index axis = 0; axis < 3; ++axis) {
            const double face = 4.0 - std::copysign(1.0, direction[axis]) * slice.origin()[axis];
            expected = std::min(expected, face / std::abs(direction[axis]));
          }
          const double tolerance = (rounding_of(reach_of(slice.origin(), mesh)) + 0.9e-6 * expected) * expected / 2.0;
          ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), expected, tolerance) << "ray " << ray << " of plane " << i;
        }
      }
    }
  }
}

}  // namespace
}  // namespace flockstep::trace
