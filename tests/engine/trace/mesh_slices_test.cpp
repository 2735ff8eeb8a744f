// Fans traced as slices, against closed forms, all triangles in double precision, and Embree.
#include "trace/mesh_slices.hpp"

#include "trace/slices.hpp"

namespace flockstep::trace {
namespace {

using namespace slices;

// Embree by itself: robust, one ray at a time.
class RobustEmbree {
 public:
  struct Hit {
    float t = kInfinity;
    int element = -1;
  };

  RobustEmbree(const EmbreeDevice& device, const TriangleMesh& mesh) : scene_(device.scene(mesh)) {}

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
  EmbreeScene scene_;
};

// Equal distances, bit for bit, and elements.
::testing::AssertionResult same_hit(const RayBundle& a, std::size_t i, const RayBundle& b, std::size_t j) {
  if (a.element[i] == b.element[j] && same_bits(std::span(a.t_hit + i, 1), std::span(b.t_hit + j, 1))) {
    return ::testing::AssertionSuccess();
  }
  return ::testing::AssertionFailure() << "ray " << i << " meets " << a.element[i] << " at " << a.t_hit[i] << ", ray " << j
                                       << " meets " << b.element[j] << " at " << b.t_hit[j];
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
      return furnished_room(10, random);
    case 2:
      return testing::hills(8);
    default:
      return loose_triangles(120, random);
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
  const long wanted = times_tried(10'000);
  SliceTally tally;
  for (unsigned seed = part_tried() << 24U; tally.rays < wanted; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto world = make_world({}, {}, random_mesh(random));
    const TriangleMesh mesh = with_triangles_of_no_area(world->triangles(), random);
    const MeshTree tree = tree_of(device, mesh);
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
  const long wanted = times_tried(10'000);
  Random random(9 + (part_tried() << 24U));
  long rays = 0, hits = 0, differ = 0, undecided = 0;
  for (int kind = 0; kind < 3; ++kind) {
    const auto world = make_world({}, {},
                                  kind == 0   ? ball(50, 100, 0.1F, random)
                                  : kind == 1 ? testing::hills(64)
                                              : furnished_room(400, random));
    const TriangleMesh& mesh = world->triangles();
    const MeshTree tree = tree_of(device, mesh);
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

TEST(MeshSlices, KeepAnEarlierHitThatIsNearer) {
  const EmbreeDevice device;
  TriangleMesh mesh = cube(4.0F);
  add_box(mesh, Vec3::Zero(), Vec3::Constant(2.0F));
  const MeshTree tree = tree_of(device, mesh);
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
  const MeshTree tree = tree_of(device, cube(4.0F));
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
  complete(mesh);
  return mesh;
}

// The other rays, their order and the way through the tree must not change any bit. In a plane of two axes, the fan's frame does
// not depend on its rays.
TEST(MeshSlices, ARaysResultDoesNotDependOnTheRaysBesideIt) {
  const EmbreeDevice device;
  Random random(3 + (part_tried() << 24U));
  constexpr long kFansOfAMesh = 10;
  const long fans = times_tried(50);
  const long of_a_mesh = std::max(kFansOfAMesh, fans / 50);
  long rays = 0, hits = 0;
  std::unique_ptr<const MeshTree> tree;
  Vec3 eye;
  for (long i = 0; i < fans; ++i) {
    if (i % of_a_mesh == 0) {
      const long kind = i / of_a_mesh % 5;
      const int rings = kind % 2 == 0 ? 5 : 40;
      TriangleMesh mesh = kind < 2    ? ball(rings, 2 * rings, 0.7F, random)
                          : kind == 2 ? furnished_room(40, random)
                          : kind == 3 ? lattice(4, 1.0F, true)
                                      : shells(random);
      eye = kind == 3 ? Vec3(0, 1, 0) : Vec3(random.point(2.5F));
      add_slivers(mesh, 20 * rings, eye, random);
      tree = std::make_unique<const MeshTree>(tree_of(device, mesh));
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
  ASSERT_GT(hwy::SupportedAndGeneratedTargets().size(), 1U);
  Random random(8);
  for (int i = 0; i < 60; ++i) {
    TriangleMesh mesh = i % 3 == 0 ? lattice(4, 1.0F, true) : with_triangles_of_no_area(random_mesh(random), random);
    const Vec3 origin = i % 3 == 0 ? Vec3(0, 1, 0) : Vec3(random.point(3.0F));
    add_slivers(mesh, 60, origin, random);
    const MeshTree tree = tree_of(device, mesh);
    const Mat3 rotation = random_pose(random);
    Slice first(random_fan(random), random_mounting(random));
    first.trace(tree, origin, rotation);
    on_every_target([&] {
      for (const SliceWalk walk : kWalks) {
        Slice same(first.directions, first.mounting);
        same.trace(tree, origin, rotation, walk);
        for (std::size_t ray = 0; ray < same.rays->count; ++ray) {
          ASSERT_TRUE(same_hit(*same.rays, ray, *first.rays, ray)) << "fan " << i;
        }
      }
    });
  }
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
    const auto world = make_world({}, {}, mesh);
    const MeshTree tree = tree_of(device, mesh);
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
  const MeshTree tree = tree_of(device, mesh);
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
