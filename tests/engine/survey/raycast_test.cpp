#include "flockstep/raycast.hpp"

#include <random>

#include "base/platform.hpp"
#include "meshes.hpp"
#include "prepared/prepared_world.hpp"
#include "ray_oracle.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep {
namespace {

using oracle::Vec3d;
using namespace testing;

// -- Random worlds and rays.

struct Rays {
  std::vector<float> origins, directions;
  std::size_t size() const { return origins.size() / 3; }
  void add(const Vec3& origin, const Vec3& direction) {
    origins.insert(origins.end(), origin.data(), origin.data() + 3);
    directions.insert(directions.end(), direction.data(), direction.data() + 3);
  }
  Vec3 origin(std::size_t i) const { return {origins[3 * i], origins[3 * i + 1], origins[3 * i + 2]}; }
  Vec3 direction(std::size_t i) const { return {directions[3 * i], directions[3 * i + 1], directions[3 * i + 2]}; }
  // The direction as World::raycast normalises it.
  Vec3 unit(std::size_t i) const { return direction(i).cast<double>().normalized().cast<float>(); }
  Rays pick(const std::vector<std::size_t>& order) const {
    Rays picked;
    for (const std::size_t i : order) picked.add(origin(i), direction(i));
    return picked;
  }
};

Rays random_rays(Random& random, int count, float reach) {
  Rays rays;
  for (int i = 0; i < count; ++i) rays.add(random.point(reach), random.direction());
  return rays;
}

std::vector<Primitive> random_primitives(Random& random, bool with_room) {
  std::vector<Primitive> primitives;
  if (with_room) primitives.push_back(primitive(PrimitiveKind::room, random.point(0.5F), {7.0F, 7.0F, 6.0F}));
  for (int i = 0; i < 10; ++i) {
    const float radius = random.within(0.1F, 1.0F);
    const Vec3 half(random.within(0.1F, 1.0F), random.within(0.1F, 1.0F), random.within(0.1F, 1.0F));
    const Quat turned = i % 2 == 0 ? random.rotation() : Quat::Identity();
    primitives.push_back(primitive(PrimitiveKind::box, random.point(5.0F), half, turned));
    primitives.push_back(primitive(PrimitiveKind::cylinder, random.point(5.0F), {radius, radius, half.z()}, turned));
    if (i % 2 == 0) primitives.push_back(primitive(PrimitiveKind::sphere, random.point(5.0F), Vec3::Constant(radius)));
    if (i % 3 != 0) continue;
    primitives.push_back(primitive(PrimitiveKind::capsule, random.point(5.0F), {radius, radius, radius + half.z()}, turned));
    primitives.push_back(primitive(PrimitiveKind::plane, random.point(5.0F), {half.x(), half.y(), 0}, turned));
    primitives.push_back(primitive(PrimitiveKind::disc, random.point(5.0F), {radius, radius, 0}, turned));
  }
  return primitives;
}

TriangleMesh random_triangles(Random& random, int count) {
  TriangleMesh mesh;
  for (int i = 0; i < count; ++i) {
    const Vec3 center = random.point(5.0F);
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(center + random.point(1.0F));
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  return mesh;
}

// Makes a hilly surface over [-6, 6]^2 with n x n squares of two triangles.
TriangleMesh hills(int n) {
  TriangleMesh mesh;
  for (int i = 0; i <= n; ++i) {
    for (int j = 0; j <= n; ++j) {
      const float x = 12.0F * static_cast<float>(i) / static_cast<float>(n) - 6.0F;
      const float y = 12.0F * static_cast<float>(j) / static_cast<float>(n) - 6.0F;
      mesh.vertices.emplace_back(x, y, 0.7F * std::sin(2.1F * x) * std::cos(1.7F * y));
    }
  }
  add_squares(mesh, 0, n, n);
  return mesh;
}

void expect_like_oracle(const World& world, const Rays& rays, float max_range) {
  const RayHits hits = raycast(world, rays.origins, rays.directions, max_range);
  std::size_t compared = 0;
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Vec3d origin = rays.origin(i).cast<double>();
    const Vec3d direction = rays.unit(i).cast<double>();
    const oracle::Hit expected = oracle::nearest(world, origin, direction, max_range);
    if (!oracle::is_clear_cut(world, expected, origin, direction, max_range)) continue;
    ++compared;
    ASSERT_EQ(hits.primitive[i], expected.element) << "ray " << i << ": " << hits.t_hit[i] << " m, expected " << expected.t;
    if (expected.element < 0) {
      EXPECT_EQ(hits.t_hit[i], kInfinity);
      EXPECT_EQ(hits.normal[i], Vec3(0, 0, 0));
    } else {
      EXPECT_NEAR(static_cast<double>(hits.t_hit[i]), expected.t, 1e-5 * std::max(1.0, expected.t)) << "ray " << i;
      EXPECT_LT((hits.normal[i].cast<double>() - expected.normal).norm(), 1e-3) << "ray " << i;
    }
  }
  EXPECT_GT(compared, rays.size() * 9 / 10);
}

TEST(Raycast, FindsPrimitivesWhereClosedFormsDo) {
  for (unsigned seed = 0; seed < 6; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto world = make_world(random_primitives(random, seed % 2 == 0));
    expect_like_oracle(*world, random_rays(random, 2000, 5.5F), seed < 3 ? 30.0F : 3.0F);
  }
}

// Each kind is tested separately, so that failures of one kind cannot hide among the rays that are not compared.
TEST(Raycast, FindsEachKindInAnyOrientation) {
  using enum PrimitiveKind;
  for (const PrimitiveKind kind : {box, cylinder, sphere, capsule, plane, disc}) {
    for (unsigned seed = 0; seed < 8; ++seed) {
      SCOPED_TRACE(::testing::Message() << "kind " << static_cast<int>(kind) << ", seed " << seed);
      Random random(50 + seed);
      Vec3 half(random.within(0.2F, 3), random.within(0.2F, 3), random.within(0.2F, 3));
      if (kind != box && kind != plane) half.y() = half.x();
      if (kind == sphere) half.z() = half.x();
      if (kind == capsule) half.z() += seed == 0 ? half.x() - half.z() : half.x();
      if (kind == plane || kind == disc) half.z() = 0.0F;
      const Quat rotation = kind == sphere || seed % 4 == 0 ? Quat::Identity() : random.rotation();
      const Vec3 center = random.point(2.0F);
      const auto world = make_world({primitive(kind, center, half, rotation)});
      Rays rays;
      for (int i = 0; i < 1000; ++i) {  // from inside and outside, mainly towards the primitive
        const Vec3 origin = center + random.point(i % 2 == 0 ? 8.0F : 2.0F);
        rays.add(origin, i % 5 == 0 ? random.direction() : Vec3(center + random.point(1.5F) - origin));
      }
      expect_like_oracle(*world, rays, 30.0F);
    }
  }
}

TEST(Raycast, FindsTrianglesWhereBruteForceDoesAlsoAmongPrimitives) {
  for (unsigned seed = 10; seed < 16; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const bool is_mixed = seed >= 13;
    auto primitives = is_mixed ? random_primitives(random, seed != 14) : std::vector<Primitive>();
    const auto world = make_world(std::move(primitives), {}, random_triangles(random, is_mixed ? 80 : 150));
    expect_like_oracle(*world, random_rays(random, 1500, is_mixed ? 5.5F : 6.0F), 20.0F);
  }
}

TEST(Raycast, RangeReachesThePlaygroundsWallsAndPillars) {
  const auto world = playground("train-1");
  Random random(30);
  Rays rays;
  for (int i = 0; i < 3000; ++i) {
    rays.add({random.within(0.1F, 13.9F), random.within(0.1F, 13.9F), random.within(0.1F, 5.1F)}, random.direction());
  }
  expect_like_oracle(*world, rays, 3.0F);
  expect_like_oracle(*world, rays, kInfinity);
}

// -- Position on a triangle.

// Checks the barycentric coordinates of the hit in double precision: o + t d = a + u (b - a) + v (c - a).
TEST(RaycastBarycentric, AreThoseOfTheClosedForm) {
  std::size_t compared = 0;
  for (unsigned seed = 60; seed < 66; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto world = make_world(random_primitives(random, seed % 2 == 0), {}, random_triangles(random, 200));
    const TriangleMesh& mesh = world->triangles();
    const Rays rays = random_rays(random, 3000, 6.0F);
    const RayHits hits = raycast(*world, rays.origins, rays.directions, 30.0F);
    ASSERT_EQ(hits.u.size(), rays.size());
    ASSERT_EQ(hits.v.size(), rays.size());
    for (std::size_t i = 0; i < rays.size(); ++i) {
      const std::int64_t triangle = hits.primitive[i] - static_cast<std::int64_t>(world->primitives().size());
      if (triangle < 0) {  // a primitive, or a miss
        EXPECT_EQ(hits.u[i], 0.0F);
        EXPECT_EQ(hits.v[i], 0.0F);
        continue;
      }
      const auto corner = [&](std::size_t k) {
        const std::int32_t index = mesh.triangles[static_cast<std::size_t>(triangle)][k];
        return Eigen::Vector3d(mesh.vertices[static_cast<std::size_t>(index)].cast<double>());
      };
      const Eigen::Vector3d direction = rays.unit(i).cast<double>();
      const Eigen::Vector3d ab = corner(1) - corner(0), ac = corner(2) - corner(0);
      const double cosine = std::abs(ab.cross(ac).normalized().dot(direction));
      if (cosine < 0.02) continue;  // ray almost parallel to the plane
      Eigen::Matrix3d columns;
      columns << ab, ac, -direction;
      const Eigen::Vector3d uvt = columns.inverse() * (rays.origin(i).cast<double>() - corner(0));
      const Eigen::Vector2d error(static_cast<double>(hits.u[i]) - uvt.x(), static_cast<double>(hits.v[i]) - uvt.y());
      EXPECT_LT((error.x() * ab + error.y() * ac).norm(), 1e-5 * std::max(1.0, uvt.z()) / cosine) << "ray " << i;
      EXPECT_GE(hits.u[i], -1e-4F);
      EXPECT_GE(hits.v[i], -1e-4F);
      EXPECT_LE(hits.u[i] + hits.v[i], 1.0F + 1e-4F);
      ++compared;
    }
  }
  EXPECT_GT(compared, 2000U);
}

TEST(RaycastBarycentric, CountTheSecondAndTheThirdVertex) {
  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {4, 0, 0}, {0, 2, 0}};
  mesh.triangles = {{0, 1, 2}};
  const auto world = make_world({}, {}, mesh);
  for (const float side : {1.0F, -1.0F}) {  // both sides
    const std::vector<float> origins{1.0F, 0.5F, 3.0F * side, 9.0F, 9.0F, 3.0F * side};
    const std::vector<float> directions{0, 0, -side, 0, 0, -side};
    const RayHits hits = raycast(*world, origins, directions, 10.0F);
    EXPECT_NEAR(hits.u[0], 0.25F, 1e-6F);
    EXPECT_NEAR(hits.v[0], 0.25F, 1e-6F);
    EXPECT_EQ(hits.u[1], 0.0F);
    EXPECT_EQ(hits.v[1], 0.0F);
  }
}

// -- Results known in advance.

struct One {
  float t;
  Vec3 normal;
  std::int32_t element;
};

One cast(const World& world, const Vec3& origin, const Vec3& direction, float max_range = 100.0F) {
  Rays ray;
  ray.add(origin, direction);
  const RayHits hits = raycast(world, ray.origins, ray.directions, max_range);
  return {hits.t_hit[0], hits.normal[0], hits.primitive[0]};
}

void expect_hit(const One& hit, float t, const Vec3& normal) {
  EXPECT_NEAR(hit.t, t, 1e-5F);
  EXPECT_LT((hit.normal - normal).norm(), 1e-5F) << hit.normal.transpose();
  EXPECT_GE(hit.element, 0);
}

void expect_miss(const One& hit) {
  EXPECT_EQ(hit.t, kInfinity);
  EXPECT_EQ(hit.normal, Vec3(0, 0, 0));
  EXPECT_EQ(hit.element, -1);
}

TEST(Raycast, RaysParallelToFacesAndAxes) {
  const auto box = make_world({primitive(PrimitiveKind::box, {0, 0, 0}, {1, 2, 3})});
  expect_hit(cast(*box, {-5, 0.5F, 0.5F}, {1, 0, 0}), 4.0F, {-1, 0, 0});
  expect_hit(cast(*box, {-5, 0.5F, 0.5F}, {2, -0.0F, -0.0F}), 4.0F, {-1, 0, 0});
  expect_hit(cast(*box, {0, 0, 9}, {0, 0, -1}), 6.0F, {0, 0, 1});
  expect_miss(cast(*box, {-5, 2.5F, 0}, {1, 0, 0}));
  expect_miss(cast(*box, {-5, -2.5F, 0}, {1, -0.0F, 0}));
  expect_miss(cast(*box, {-5, 0, 0}, {-1, 0, 0}));

  const auto cylinder = make_world({primitive(PrimitiveKind::cylinder, {1, 1, 0}, {0.5F, 0.5F, 2})});
  expect_hit(cast(*cylinder, {1.2F, 0.9F, 5}, {0, 0, -1}), 3.0F, {0, 0, 1});
  expect_hit(cast(*cylinder, {1, 1, -5}, {0, 0, 1}), 3.0F, {0, 0, -1});
  expect_miss(cast(*cylinder, {1.6F, 1, 5}, {0, 0, -1}));
  expect_hit(cast(*cylinder, {-4, 1, 1.9F}, {1, 0, 0}), 4.5F, {-1, 0, 0});
  expect_miss(cast(*cylinder, {-4, 1, 2.1F}, {1, 0, 0}));
  expect_miss(cast(*cylinder, {-4, 1.6F, 0}, {1, 0, 0}));

  const auto capsule = make_world({primitive(PrimitiveKind::capsule, {1, 1, 0}, {0.5F, 0.5F, 2})});
  expect_hit(cast(*capsule, {1, 1, 5}, {0, 0, -1}), 3.0F, {0, 0, 1});
  expect_hit(cast(*capsule, {1.3F, 1, 5}, {0, 0, -1}), 5.0F - 1.9F, {0.6F, 0, 0.8F});
  expect_hit(cast(*capsule, {-4, 1, 1.5F}, {1, 0, 0}), 4.5F, {-1, 0, 0});
  expect_hit(cast(*capsule, {-4, 1, -1.8F}, {1, 0, 0}), 4.6F, {-0.8F, 0, -0.6F});
  expect_miss(cast(*capsule, {1.6F, 1, 5}, {0, 0, -1}));
  expect_miss(cast(*capsule, {-4, 1, 2.1F}, {1, 0, 0}));

  const auto plane = make_world({primitive(PrimitiveKind::plane, {0, 0, 1}, {1, 2, 0})});
  expect_hit(cast(*plane, {0.9F, 1.9F, 5}, {0, 0, -1}), 4.0F, {0, 0, 1});
  expect_hit(cast(*plane, {-0.9F, -1.9F, -5}, {0, 0, 1}), 6.0F, {0, 0, -1});
  expect_miss(cast(*plane, {1.1F, 0, 5}, {0, 0, -1}));
  expect_miss(cast(*plane, {0, 2.1F, 5}, {0, 0, -1}));
  expect_miss(cast(*plane, {-5, 0, 1.1F}, {1, 0, 0}));

  const auto disc = make_world({primitive(PrimitiveKind::disc, {0, 0, 1}, {1, 1, 0})});
  expect_hit(cast(*disc, {0.7F, 0.7F, 5}, {0, 0, -1}), 4.0F, {0, 0, 1});
  expect_hit(cast(*disc, {0.7F, 0.7F, -5}, {0, 0, 1}), 6.0F, {0, 0, -1});
  expect_miss(cast(*disc, {0.8F, 0.8F, 5}, {0, 0, -1}));
  expect_miss(cast(*disc, {-5, 0, 0.9F}, {1, 0, 0}));

  TriangleMesh mesh;
  mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  mesh.triangles = {{0, 1, 2}};
  const auto triangle = make_world({}, {}, mesh);
  expect_hit(cast(*triangle, {0.2F, 0.2F, 3}, {0, 0, -1}), 3.0F, {0, 0, 1});
  expect_hit(cast(*triangle, {0.2F, 0.2F, -3}, {0, 0, 1}), 3.0F, {0, 0, -1});
  expect_miss(cast(*triangle, {-1, 0.2F, 0.1F}, {1, 0, 0}));
}

TEST(Raycast, FromInsideASolidTheFarSideIsSeen) {
  const auto world = make_world(
      {primitive(PrimitiveKind::box, {0, 0, 0}, {1, 2, 3}), primitive(PrimitiveKind::sphere, {10, 0, 0}, {1, 1, 1}),
       primitive(PrimitiveKind::cylinder, {20, 0, 0}, {1, 1, 2}), primitive(PrimitiveKind::capsule, {30, 0, 0}, {1, 1, 3})});
  expect_hit(cast(*world, {0, 0, 0}, {0, 1, 0}), 2.0F, {0, -1, 0});
  expect_hit(cast(*world, {10.5F, 0, 0}, {1, 0, 0}), 0.5F, {-1, 0, 0});
  expect_hit(cast(*world, {10.5F, 0, 0}, {-1, 0, 0}), 1.5F, {1, 0, 0});
  expect_hit(cast(*world, {20, 0, 0}, {0, 0, 1}), 2.0F, {0, 0, -1});
  expect_hit(cast(*world, {20, 0, 0}, {0, 1, 0}), 1.0F, {0, -1, 0});
  expect_hit(cast(*world, {30, 0, 0}, {0, 0, 1}), 3.0F, {0, 0, -1});
  expect_hit(cast(*world, {30, 0, 2.5F}, {0, 0, -1}), 5.5F, {0, 0, 1});
  expect_hit(cast(*world, {30, 0, 2}, {0, 1, 0}), 1.0F, {0, -1, 0});
}

TEST(Raycast, ARoomIsSeenFromWithinAndWithout) {
  const auto world = make_world({primitive(PrimitiveKind::room, {0, 0, 2}, {5, 6, 2})});
  expect_hit(cast(*world, {1, 0, 1}, {1, 0, 0}), 4.0F, {-1, 0, 0});
  expect_hit(cast(*world, {1, 0, 1}, {0, 0, -1}), 1.0F, {0, 0, 1});
  expect_hit(cast(*world, {1, 0, 1}, {0, -3, 0}), 6.0F, {0, 1, 0});
}

TEST(Raycast, AHitAtTheRangeItselfIsAHit) {
  TriangleMesh mesh;
  mesh.vertices = {{-1, -1, -4}, {1, -1, -4}, {0, 1, -4}};
  mesh.triangles = {{0, 1, 2}};
  const auto world = make_world(
      {primitive(PrimitiveKind::room, {0, 0, 0}, {8, 8, 8}), primitive(PrimitiveKind::box, {2, 0, 0}, {0.5F, 1, 1})}, {}, mesh);
  const float below = std::nextafter(1.5F, 0.0F);
  EXPECT_EQ(cast(*world, {0, 0, 0}, {1, 0, 0}, 1.5F).t, 1.5F);
  EXPECT_EQ(cast(*world, {0, 0, 0}, {1, 0, 0}, below).t, kInfinity);
  EXPECT_EQ(cast(*world, {0, 0, 0}, {0, 1, 0}, 8.0F).t, 8.0F);
  EXPECT_EQ(cast(*world, {0, 0, 0}, {0, 1, 0}, std::nextafter(8.0F, 0.0F)).t, kInfinity);
  EXPECT_NEAR(cast(*world, {0, 0, 0}, {0, 0, -1}, 4.001F).t, 4.0F, 1e-5F);
  EXPECT_EQ(cast(*world, {0, 0, 0}, {0, 0, -1}, 3.999F).t, kInfinity);
}

TEST(Raycast, DirectionsNeedNotBeUnit) {
  const auto world = make_world({primitive(PrimitiveKind::sphere, {5, 0, 0}, {1, 1, 1})});
  for (const float length : {1e-30F, 1e-3F, 1.0F, 1e30F}) expect_hit(cast(*world, {0, 0, 0}, {length, 0, 0}), 4.0F, {-1, 0, 0});
}

TEST(Raycast, RefusesBadInput) {
  const auto world = make_world({primitive(PrimitiveKind::sphere, {5, 0, 0}, {1, 1, 1})});
  const std::vector<float> origin{0, 0, 0};
  const std::vector<float> ahead{1, 0, 0};
  EXPECT_REFUSED(raycast(*world, std::vector<float>{0, kNan, 0}, ahead, 1.0F), "origins");
  EXPECT_REFUSED(raycast(*world, std::vector<float>{0, kInfinity, 0}, ahead, 1.0F), "origins");
  EXPECT_REFUSED(raycast(*world, origin, std::vector<float>{kNan, 0, 0}, 1.0F), "directions");
  EXPECT_REFUSED(raycast(*world, origin, std::vector<float>{kInfinity, 0, 0}, 1.0F), "directions");
  EXPECT_REFUSED(raycast(*world, origin, std::vector<float>{0, 0, 0}, 1.0F), "directions");
  EXPECT_REFUSED(raycast(*world, origin, std::vector<float>{1, 0, 0, 1, 0, 0}, 1.0F), "directions");
  EXPECT_REFUSED(raycast(*world, std::vector<float>{0, 0}, std::vector<float>{1, 0}, 1.0F), "directions");
  for (const float range : {0.0F, -1.0F, kNan}) EXPECT_REFUSED(raycast(*world, origin, ahead, range), "max_range_m");
  EXPECT_TRUE(raycast(*world, {}, {}, 1.0F).t_hit.empty());
}

// -- The same bits with any neighbours.

struct Answers {
  std::vector<float> t;
  std::vector<std::int32_t> element;
};

// Traces the rays in the given order, in blocks of block_size. Each ray's result is stored at its own index.
Answers trace_blocks(const World& world, const Rays& rays, const std::vector<std::size_t>& order, std::size_t block_size) {
  Answers answers{std::vector<float>(rays.size()), std::vector<std::int32_t>(rays.size())};
  const FlushDenormals flush;
  const auto tracer = std::make_unique<trace::Tracer>();
  trace::RayBlock& block = tracer->block();
  for (std::size_t first = 0; first < order.size(); first += block_size) {
    block.count = std::min(block_size, order.size() - first);
    for (std::size_t k = 0; k < block.count; ++k) {
      const Vec3 origin = rays.origin(order[first + k]);
      const Vec3 direction = rays.unit(order[first + k]);
      block.org_x[k] = origin.x();
      block.org_y[k] = origin.y();
      block.org_z[k] = origin.z();
      block.dir_x[k] = direction.x();
      block.dir_y[k] = direction.y();
      block.dir_z[k] = direction.z();
      block.range[k] = 25.0F;
    }
    tracer->trace_block(prepared(world).scene());
    for (std::size_t k = 0; k < block.count; ++k) {
      answers.t[order[first + k]] = block.t_hit[k];
      answers.element[order[first + k]] = block.element[k];
    }
  }
  return answers;
}

void expect_same_in_any_block(const World& world, const Rays& rays, Random& random) {
  std::vector<std::size_t> order(rays.size());
  std::iota(order.begin(), order.end(), std::size_t{0});
  const Answers alone = trace_blocks(world, rays, order, 1);
  EXPECT_GT(std::count_if(alone.element.begin(), alone.element.end(), [](auto e) { return e >= 0; }),
            static_cast<std::ptrdiff_t>(rays.size() / 4));
  const auto expect_same = [&](const Answers& other, const char* how) {
    std::size_t different = 0;
    for (std::size_t i = 0; i < rays.size(); ++i) {
      if (same_bits(std::span(&alone.t[i], 1), std::span(&other.t[i], 1)) && alone.element[i] == other.element[i]) continue;
      if (different++ > 0) continue;
      ADD_FAILURE() << how << ", first ray that differs: origin " << rays.origin(i).transpose() << ", direction "
                    << rays.unit(i).transpose() << ": " << alone.t[i] << " (" << alone.element[i] << ") alone, " << other.t[i]
                    << " (" << other.element[i] << ") in company";
    }
    EXPECT_EQ(different, 0U) << how << ", of " << rays.size();
  };
  for (const std::size_t block_size : {5U, 16U, 19U, 256U}) {
    expect_same(trace_blocks(world, rays, order, block_size), "in order");
  }
  std::vector<std::size_t> shuffled = order;
  for (const std::size_t block_size : {16U, 256U}) {
    std::shuffle(shuffled.begin(), shuffled.end(), random.generator());
    expect_same(trace_blocks(world, rays, shuffled, block_size), "shuffled");
  }
}

// Returns fans of rays from a few places, as of LiDARs, and scattered rays.
Rays fans_and_strays(Random& random, int places, float low, float high) {
  Rays rays;
  for (int place = 0; place < places; ++place) {
    const Vec3 origin(random.within(-4, 4), random.within(-4, 4), random.within(low, high));
    for (int k = 0; k < 64; ++k) {
      const float azimuth = 0.1F * static_cast<float>(k);
      rays.add(origin, {std::cos(azimuth), std::sin(azimuth), -0.3F});
      rays.add(random.point(4.0F), random.direction());
    }
  }
  return rays;
}

TEST(RaycastBits, PrimitivesAndTrianglesBesideAnyRays) {
  Random random(40);
  for (const auto& [world, low, high] : {std::tuple(make_world(random_primitives(random, true)), -2.0F, 2.0F),
                                         {make_world({}, {}, hills(45)), 1.0F, 3.0F},  // 4,050 triangles
                                         {make_world({}, {}, random_triangles(random, 3000)), -2.0F, 2.0F}}) {
    expect_same_in_any_block(*world, fans_and_strays(random, 30, low, high), random);
  }
}

TEST(RaycastBits, RaysThroughSharedEdgesAndVertices) {
  Random random(43);
  const auto world = make_world({}, {}, hills(45));
  Rays rays;
  const auto& mesh = world->triangles();
  for (int i = 0; i < 1000; ++i) {
    const auto& triangle = mesh.triangles[random.generator()() % mesh.triangles.size()];
    const Vec3 a = mesh.vertices[static_cast<std::size_t>(triangle[0])];
    const Vec3 b = mesh.vertices[static_cast<std::size_t>(triangle[1])];
    const Vec3 target = i % 3 == 0 ? a : Vec3(a + 0.5F * (b - a));
    const Vec3 origin(random.within(-4, 4), random.within(-4, 4), random.within(2, 4));
    rays.add(origin, target - origin);
  }
  expect_same_in_any_block(*world, rays, random);
}

TEST(RaycastBits, RaycastOfOneIsRaycastOfMany) {
  Random random(44);
  const auto world = make_world(random_primitives(random, true), {}, hills(20));
  const Rays rays = random_rays(random, 300, 4.0F);
  const RayHits all = raycast(*world, rays.origins, rays.directions, 20.0F);
  for (std::size_t i = 0; i < rays.size(); ++i) {
    const Rays one = rays.pick({i});
    const RayHits alone = raycast(*world, one.origins, one.directions, 20.0F);
    EXPECT_TRUE(same_bits(alone.t_hit, std::span(&all.t_hit[i], 1))) << i;
    EXPECT_EQ(alone.primitive[0], all.primitive[i]) << i;
    EXPECT_TRUE(same_bits(alone.u, std::span(&all.u[i], 1))) << i;
    EXPECT_TRUE(same_bits(alone.v, std::span(&all.v[i], 1))) << i;
    EXPECT_EQ(alone.normal[0], all.normal[i]) << i;
  }
}

}  // namespace
}  // namespace flockstep
