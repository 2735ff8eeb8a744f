#include "trace/tracer.hpp"

#include "allocation_counter.hpp"
#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "prepared/prepared_world.hpp"
#include "ray_oracle.hpp"
#include "trace/bodies.hpp"

namespace flockstep::trace {
namespace {

using namespace testing;

// One world per tracing path: direct, direct and then triangles, and all through Embree.
std::vector<std::shared_ptr<const World>> worlds(Random& random) {
  const auto spheres = [&random](int count) {
    std::vector<Primitive> primitives;
    for (int i = 0; i < count; ++i) {
      primitives.push_back(primitive(PrimitiveKind::sphere, random.point(4.0F), Vec3::Constant(0.2F)));
    }
    return primitives;
  };
  return {make_world(spheres(6)), make_world(spheres(6), {}, soup(random, 100)), make_world(spheres(600), {}, soup(random, 100))};
}

// Returns the set as a tile with one or more rows.
RayTile tile_of(const Directions& set, std::size_t rows, RayBundle& aimed) {
  set.aim(aimed);
  return {aimed.x, aimed.y, aimed.z, rows, set.size() / rows, aimed.frustum};
}

TEST(Tracer, DeferredRaysGetTheSameBitsBesideAnyOthers) {
  Random random(70);
  const auto all = worlds(random);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  RayBundle aimed;
  const std::array<Directions, 3> sets{Directions(fan(35, 270.0F)), Directions(cone(random, 48, 30.0F)),
                                       Directions(fan(256, 360.0F))};
  struct Scan {
    const Scene* scene;
    const Directions* set;
    Viewpoint viewpoint;
    std::vector<float> ranges;
  };
  std::vector<Scan> scans;
  for (int i = 0; i < 120; ++i) {
    const Directions& set = sets[random.generator()() % sets.size()];
    scans.push_back({&prepared(*all[static_cast<std::size_t>(i / 7) % all.size()]).scene(),
                     &set,
                     {.origin = random.point(3.0F), .rotation = random.rotation().toRotationMatrix(), .range = 6.0F},
                     std::vector<float>(set.size(), -1.0F)});
  }
  for (Scan& scan : scans) {  // consecutive scans of one world may share packets; seven of them do not fill a block
    tracer->set_viewpoint(*scan.scene, scan.viewpoint);
    tracer->enqueue(tile_of(*scan.set, 1, aimed), scan.ranges.data(), scan.set->size());
  }
  tracer->finish();
  std::size_t hits = 0;
  for (const Scan& scan : scans) {
    std::vector<float> alone(scan.set->size(), -1.0F);
    tracer->set_viewpoint(*scan.scene, scan.viewpoint);
    tracer->enqueue(tile_of(*scan.set, 1, aimed), alone.data(), alone.size());
    tracer->finish();
    EXPECT_TRUE(same_bits(alone, scan.ranges));
    for (const float range : alone) hits += range < kInfinity ? 1 : 0;

    aimed.origin = scan.viewpoint.origin;
    aimed.rotation = scan.viewpoint.rotation;
    aimed.range = scan.viewpoint.range;
    testing::copy(aimed, tracer->block());
    tracer->trace_block(*scan.scene);
    for (std::size_t i = 0; i < alone.size(); ++i) {
      if (alone[i] == kInfinity || tracer->block().t_hit[i] == kInfinity) continue;  // near the end of the range or an edge
      EXPECT_NEAR(tracer->block().t_hit[i], alone[i], 1e-3F);
    }
  }
  EXPECT_GT(hits, 500U);
}

TEST(Tracer, WritesEachRowToItsPlace) {
  Random random(71);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  RayBundle aimed;
  const Directions set(cone(random, 48, 30.0F));
  for (const auto& world : worlds(random)) {
    const Scene& scene = prepared(*world).scene();
    const Viewpoint viewpoint{.origin = random.point(3.0F), .rotation = Mat3::Identity(), .range = 9.0F};
    std::vector<float> row(48), rows(4 * 20, -1.0F);
    tracer->set_viewpoint(scene, viewpoint);
    tracer->enqueue(tile_of(set, 1, aimed), row.data(), 0);
    tracer->enqueue(tile_of(set, 4, aimed), rows.data(), 20);
    tracer->finish();
    for (std::size_t i = 0; i < 80; ++i) {
      const std::size_t column = i % 20;
      EXPECT_EQ(rows[i], column < 12 ? row[i / 20 * 12 + column] : -1.0F) << i;
    }
  }
}

TEST(Tracer, ShadowsAreOfAllButRoomsAndMarkers) {
  const auto world =
      make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {5, 5, 5}), primitive(PrimitiveKind::box, {3, 0, 0}, {1, 1, 1})},
                 {.start = Vec3(0, 3, 0)});
  const Scene& scene = prepared(*world).scene();
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  RayBlock& rays = tracer->block();
  const std::vector<Vec3> directions{Vec3::UnitX(), Vec3::UnitY(), Vec3::UnitZ()};
  const auto fill = [&] {
    rays.count = directions.size();
    rays.near = 0.0F;
    for (std::size_t i = 0; i < directions.size(); ++i) {
      rays.org_x[i] = rays.org_y[i] = rays.org_z[i] = 0.0F;
      rays.dir_x[i] = directions[i].x();
      rays.dir_y[i] = directions[i].y();
      rays.dir_z[i] = directions[i].z();
      rays.range[i] = 100.0F;
    }
  };
  fill();
  tracer->trace_shadows(scene);
  EXPECT_TRUE(std::isfinite(rays.t_hit[0])) << "a box";
  EXPECT_FALSE(std::isfinite(rays.t_hit[1])) << "a marker, and a room";
  EXPECT_FALSE(std::isfinite(rays.t_hit[2])) << "a room";
  fill();
  tracer->trace_block(scene);
  for (std::size_t i = 0; i < directions.size(); ++i) EXPECT_EQ(rays.t_hit[i], i == 0 ? 2.0F : 5.0F) << i;
}

TEST(Tracer, AllocatesNothing) {
  Random random(72);
  const auto all = worlds(random);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  RayBundle aimed;
  const Directions set(cone(random, 64, 20.0F));
  std::vector<float> ranges(64);
  for (const auto& world : all) static_cast<void>(prepared(*world).scene());
  const auto before = allocations_of_this_thread();
  for (const auto& world : all) {
    const Scene& scene = prepared(*world).scene();
    tracer->set_viewpoint(scene, {.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .range = 9.0F});
    for (int i = 0; i < 9; ++i) tracer->enqueue(tile_of(set, 4, aimed), ranges.data(), 16);
    tracer->finish();
    tracer->set_viewpoint(
        scene, {.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .range = 9.0F, .near = 0.1F, .sees_markers = true});
    static_cast<void>(tracer->trace(tile_of(set, 4, aimed)));
    tracer->trace_shadows(scene);
    tracer->trace_block(scene);
  }
  EXPECT_EQ(allocations_of_this_thread(), before);
}

// The bodies of one env, in arrays as a batch has them.
struct Moving {
  std::vector<float> position, quat_wxyz, radius;
  std::vector<Primitive> solids;
  mutable std::vector<const Primitive*> pointers;  // to the solids, for the last view()

  void add(const Primitive& solid, float ball) {
    for (const float p : solid.center) position.push_back(p);
    for (const float q : {solid.rotation.w(), solid.rotation.x(), solid.rotation.y(), solid.rotation.z()}) quat_wxyz.push_back(q);
    radius.push_back(ball);
    solids.push_back(solid);
  }
  Bodies view(std::int32_t first_element = 0) const {
    pointers.clear();
    for (const Primitive& solid : solids) pointers.push_back(&solid);
    return {.position = position.data(),
            .quat_wxyz = quat_wxyz.data(),
            .radius = radius.data(),
            .solids = pointers.data(),
            .count = radius.size(),
            .first_element = first_element};
  }
};

Primitive random_solid(Random& random) {
  constexpr std::array kKinds{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule};
  const PrimitiveKind kind = kKinds[random.generator()() % kKinds.size()];
  Vec3 half(random.within(0.05F, 0.6F), random.within(0.05F, 0.6F), random.within(0.05F, 0.6F));
  if (kind != PrimitiveKind::box) half.y() = half.x();
  if (kind == PrimitiveKind::sphere) half.z() = half.x();
  if (kind == PrimitiveKind::capsule) half.z() += half.x();
  Primitive solid = primitive(kind, random.point(3.0F), half);
  if (random.generator()() % 3 != 0) solid.rotation = random.rotation();
  return solid;
}

Moving random_bodies(Random& random, std::size_t count) {
  Moving moving;
  for (std::size_t i = 0; i < count; ++i) {
    const Primitive solid = random_solid(random);
    moving.add(solid, solid.half_extents.norm());
  }
  return moving;
}

std::vector<Primitive> spheres(Random& random, int count) {
  std::vector<Primitive> primitives;
  for (int i = 0; i < count; ++i) {
    primitives.push_back(primitive(PrimitiveKind::sphere, random.point(4.0F), Vec3::Constant(0.2F)));
  }
  return primitives;
}

// One world per tracing path: none, direct, direct and then triangles, and all through Embree.
std::vector<std::shared_ptr<const World>> still_worlds(Random& random) {
  return {make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {9, 9, 9})}), make_world(spheres(random, 6)),
          make_world(spheres(random, 6), {}, soup(random, 100)), make_world(spheres(random, 600), {}, soup(random, 100))};
}

std::shared_ptr<const World> nothing_near() { return make_world({primitive(PrimitiveKind::box, {99, 0, 0}, {1, 1, 1})}); }

RayTile tile_of(const Directions& set, RayBundle& aimed) {
  set.aim(aimed);
  return {aimed.x, aimed.y, aimed.z, 1, set.size(), aimed.frustum};
}

std::vector<float> scan(Tracer& tracer, const Scene& scene, const Viewpoint& viewpoint, const Directions& set) {
  RayBundle aimed;
  std::vector<float> ranges(set.size(), -1.0F);
  tracer.set_viewpoint(scene, viewpoint);
  tracer.enqueue(tile_of(set, aimed), ranges.data(), set.size());
  tracer.finish();
  return ranges;
}

// The distance to the nearest body in double precision; infinite beyond the range.
double oracle_distance(const Moving& moving, const Vec3& origin, const Vec3& direction, float range) {
  double nearest = oracle::kNever;
  for (std::size_t i = 0; i < moving.solids.size(); ++i) {
    if (moving.radius[i] < 0.0F) continue;
    nearest = std::min(nearest, oracle::hit_primitive(moving.solids[i], origin.cast<double>(), direction.cast<double>()).t);
  }
  return nearest <= static_cast<double>(range) ? nearest : oracle::kNever;
}

TEST(Bodies, RangesAreThoseOfTheNearerOfWorldAndBodies) {
  Random random(910);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  const std::array sets{Directions(fan(35, 270.0F)), Directions(fan(256, 360.0F)), Directions(fan(3, 20.0F))};
  std::size_t met = 0, unsure = 0, all = 0;
  for (const auto& world : still_worlds(random)) {
    const Scene& scene = prepared(*world).scene();
    for (const std::size_t count : {1U, 3U, 16U, 40U, 700U}) {
      Moving moving = random_bodies(random, count);
      for (std::size_t i = 0; i < count; i += 5) moving.radius[i] = -1.0F;  // not visible
      for (const Directions& set : sets) {
        Viewpoint viewpoint{.origin = random.point(3.0F), .rotation = random.rotation().toRotationMatrix(), .range = 4.0F};
        const std::vector<float> without = scan(*tracer, scene, viewpoint, set);
        const Bodies bodies = moving.view();
        viewpoint.bodies = &bodies;
        const std::vector<float> with = scan(*tracer, scene, viewpoint, set);
        for (std::size_t i = 0; i < set.size(); ++i) {
          const double body = oracle_distance(moving, viewpoint.origin, rotated(viewpoint.rotation, set[i]), viewpoint.range);
          const double expected = std::min(static_cast<double>(without[i]), body);
          ++all;
          if (body < static_cast<double>(without[i])) ++met;
          if (std::isinf(expected) != std::isinf(with[i])) {
            ++unsure;  // at an edge or at the end of the range
          } else if (!std::isinf(expected) && std::abs(static_cast<double>(with[i]) - expected) > 1e-4 * (1.0 + expected)) {
            ++unsure;  // at an edge
          }
          if (with[i] == without[i]) continue;
          EXPECT_LT(with[i], without[i]) << "bodies only shorten";
        }
      }
    }
  }
  EXPECT_GT(met, all / 10);
  EXPECT_LE(unsure, all / 2000);
}

TEST(Bodies, HaveTheBitsOfTheSameSolidsThatStandStill) {
  Random random(911);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  const Directions set(fan(35, 270.0F));
  std::size_t hits = 0;
  for (int i = 0; i < 200; ++i) {
    std::vector<Primitive> solids = random_bodies(random, 1 + static_cast<std::size_t>(i) % 20).solids;
    for (Primitive& solid : solids) {
      if (solid.kind == PrimitiveKind::sphere) solid.rotation = Quat::Identity();  // as worlds require
    }
    const auto standing = make_world(solids);
    Moving moving;  // of the same bits: the world has made rotations unit
    for (const Primitive& solid : standing->primitives()) moving.add(solid, solid.half_extents.norm());
    const auto empty = nothing_near();
    Viewpoint viewpoint{.origin = random.point(3.0F), .rotation = random.rotation().toRotationMatrix(), .range = 5.0F};
    const std::vector<float> expected = scan(*tracer, prepared(*standing).scene(), viewpoint, set);
    const Bodies bodies = moving.view();
    viewpoint.bodies = &bodies;
    const std::vector<float> found = scan(*tracer, prepared(*empty).scene(), viewpoint, set);
    EXPECT_TRUE(same_bits(found, expected)) << i;
    for (const float range : found) hits += range < kInfinity ? 1 : 0;
  }
  EXPECT_GT(hits, 400U);
}

TEST(Bodies, AreNumberedFromTheFirstElement) {
  Random random(912);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  Moving moving;
  moving.add(primitive(PrimitiveKind::sphere, {2, 0, 0}, Vec3::Constant(0.5F)), 0.5F);
  moving.add(primitive(PrimitiveKind::box, {0, 2, 0}, Vec3::Constant(0.5F)), 0.9F);
  const auto world = make_world({primitive(PrimitiveKind::sphere, {-2, 0, 0}, Vec3::Constant(0.5F))});
  const Scene& scene = prepared(*world).scene();
  const std::vector<Vec3> directions{Vec3::UnitX(), Vec3::UnitY(), -Vec3::UnitX(), Vec3::UnitZ()};
  const Directions set(directions);
  RayBundle aimed;
  const Bodies bodies = moving.view(100);
  tracer->set_viewpoint(scene, {.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .range = 9.0F, .bodies = &bodies});
  const RayBundle& rays = tracer->trace(tile_of(set, aimed));
  EXPECT_EQ(rays.element[0], 100);
  EXPECT_EQ(rays.element[1], 101);
  EXPECT_EQ(rays.element[2], 0);
  EXPECT_EQ(rays.element[3], -1);
  EXPECT_FLOAT_EQ(rays.t_hit[0], 1.5F);
  EXPECT_FLOAT_EQ(rays.t_hit[1], 1.5F);

  aimed.origin = Vec3::Zero();
  aimed.rotation = Mat3::Identity();
  aimed.range = 9.0F;
  testing::copy(aimed, tracer->block());
  std::vector<NumberedShape> shapes;
  append_shapes(bodies, shapes);
  tracer->trace_block(scene, shapes);
  for (int i = 0; i < 4; ++i) EXPECT_EQ(tracer->block().element[i], rays.element[i]);
  tracer->trace_shadows(scene, true, shapes);
  EXPECT_LT(tracer->block().t_hit[0], kInfinity);
  EXPECT_LT(tracer->block().t_hit[1], kInfinity);
  EXPECT_EQ(tracer->block().t_hit[3], kInfinity);
}

TEST(Bodies, OfOtherEnvsAreNotSeen) {
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  const auto world = nothing_near();
  const Directions set(fan(35, 360.0F));
  Random random(913);
  const Moving moving = random_bodies(random, 100);
  for (const std::size_t count : {0U, 1U, 7U, 16U, 17U}) {
    Moving own = moving;
    for (auto [list, width] : {std::pair{&own.position, 3U}, {&own.quat_wxyz, 4U}, {&own.radius, 1U}})
      list->resize(width * count);
    Bodies bodies = own.view();
    const Viewpoint viewpoint{.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .range = 9.0F, .bodies = &bodies};
    const std::vector<float> expected = scan(*tracer, prepared(*world).scene(), viewpoint, set);
    bodies = moving.view();
    bodies.count = count;
    EXPECT_TRUE(same_bits(scan(*tracer, prepared(*world).scene(), viewpoint, set), expected)) << count;
  }
}

TEST(Bodies, AllocateNothingAfterTheFirstScan) {
  Random random(914);
  const FlushDenormals flush;
  const auto tracer = std::make_unique<Tracer>();
  const auto world = nothing_near();
  const Directions set(fan(35, 360.0F));
  const Moving moving = random_bodies(random, 64);
  const Bodies bodies = moving.view();
  const Viewpoint viewpoint{.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .range = 9.0F, .bodies = &bodies};
  RayBundle aimed;
  std::array<float, 35> ranges{};
  const auto once = [&] {
    tracer->set_viewpoint(prepared(*world).scene(), viewpoint);
    tracer->enqueue(tile_of(set, aimed), ranges.data(), ranges.size());
    tracer->finish();
  };
  once();
  const std::uint64_t before = allocations();
  once();
  EXPECT_EQ(allocations(), before);
}

}  // namespace
}  // namespace flockstep::trace
