#include "trace/tracer.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <span>
#include <utility>
#include <vector>

#include "allocation_counter.hpp"
#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "numbers.hpp"
#include "prepared/prepared_world.hpp"
#include "random.hpp"

namespace flockstep::trace {
namespace {

using testing::cone;
using testing::Directions;
using testing::fan;
using testing::kInfinity;
using testing::make_world;
using testing::primitive;
using testing::Random;
using testing::same_bits;
using testing::soup;

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
  const auto before = testing::allocations_of_this_thread();
  for (const auto& world : all) {
    const Scene& scene = prepared(*world).scene();
    tracer->set_viewpoint(scene, {.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .range = 9.0F});
    for (int i = 0; i < 9; ++i) tracer->enqueue(tile_of(set, 4, aimed), ranges.data(), 16);
    tracer->finish();
    tracer->set_viewpoint(
        scene, {.origin = Vec3::Zero(), .rotation = Mat3::Identity(), .near = 0.1F, .range = 9.0F, .sees_markers = true});
    static_cast<void>(tracer->trace(tile_of(set, 4, aimed)));
    tracer->trace_shadows(scene);
    tracer->trace_block(scene);
  }
  EXPECT_EQ(testing::allocations_of_this_thread(), before);
}

}  // namespace
}  // namespace flockstep::trace
