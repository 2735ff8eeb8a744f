#include "trace/direct.hpp"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdlib>
#include <iostream>
#include <limits>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "random.hpp"
#include "ray_oracle.hpp"
#include "task/ranges.hpp"
#include "trace/calibrated.hpp"
#include "trace/scene.hpp"
#include "trace/user_geometry.hpp"

namespace swiftlet::trace {
namespace {

using oracle::Vec3d;
using testing::cone;
using testing::Directions;
using testing::everywhere;
using testing::fan;
using testing::make_world;
using testing::primitive;
using testing::Random;
using testing::same_bits;

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// All kinds in turn, half of them aligned with the axes, sizes over two decades.
std::vector<Primitive> random_primitives(Random& random, int count, bool with_room) {
  using enum PrimitiveKind;
  std::vector<Primitive> primitives;
  if (with_room) primitives.push_back(primitive(room, random.point(0.5F), {7.0F, 6.5F, 4.0F}));
  for (int i = 0; i < count; ++i) {
    const auto size = [&] { return random.within(0.0F, 1.0F) < 0.2F ? random.within(0.02F, 0.1F) : random.within(0.1F, 1.5F); };
    const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere, plane, disc}[static_cast<std::size_t>(i) % 6];
    Vec3 half(size(), size(), size());
    if (kind != box && kind != plane) half.y() = half.x();
    if (kind == sphere) half.z() = half.x();
    if (kind == capsule) half.z() += half.x();
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const bool aligned = kind == sphere || random.within(0.0F, 1.0F) < 0.5F;
    primitives.push_back(primitive(kind, random.point(5.0F), half, aligned ? Quat::Identity() : random.rotation()));
  }
  return primitives;
}

// One bundle and one block, and where the answers of each come from.
struct Tracer {
  RayBundle bundle;
  RayBlock block;
  Reach reach;

  // Directly, by way of gathering; false if too much is in view.
  bool directly(const Scene& scene) {
    const FlushDenormals flush;
    scene.gather(bundle.origin, bundle.range, reach);
    return scene.intersect(reach, bundle) == Traced::fully;
  }
  // The same rays as a block.
  void as_block(const Scene& scene) {
    testing::copy(bundle, block);
    const FlushDenormals flush;
    scene.intersect(block);
  }
};

// -- The three ways agree: bundles traced directly, blocks (through Embree where the world has more than kMaxDirectAnyOrigin
// primitives, else without origin or view in common), and closed forms in double precision.
//
// How many rays: SWIFTLET_RAYS, if set, as in
//   SWIFTLET_RAYS=10000000 ./dev test engine --gtest_filter='Agreement*'

std::size_t rays_wanted() {
  const char* const text = std::getenv("SWIFTLET_RAYS");
  return text == nullptr ? 150'000 : std::stoul(text);
}

struct Deviation {
  std::size_t compared = 0;
  double worst = 0.0;          // m, over max(1 m, range), of clear-cut hits
  double worst_grazing = 0.0;  // the same of grazing ones, over how many times steeper than a clear-cut one they may be
};

struct Tally {
  std::size_t rays = 0, hits = 0;
  std::size_t unclear = 0;  // an edge, a silhouette or the end of the range is near
  std::size_t grazing = 0;  // clear of those, but at a grazing angle
  Deviation direct, by_embree, by_list;
};

constexpr double kTolerance = 1e-5;  // relative, or m
constexpr double kSteep = 5.0;       // as oracle::is_clear_cut has it

// One way's answer for a ray that is clear of edges. False if it is wrong.
::testing::AssertionResult agrees(float t, std::int32_t element, const oracle::Hit& expected, double steepness, Deviation& seen) {
  ++seen.compared;
  if (element != expected.element) {
    return ::testing::AssertionFailure() << "element " << element << " at " << t << " m, expected " << expected.element << " at "
                                         << expected.t << " m";
  }
  if (element < 0) {
    if (t == kInfinity) return ::testing::AssertionSuccess();
    return ::testing::AssertionFailure() << t << " m of a miss";
  }
  const double error =
      std::abs(static_cast<double>(t) - expected.t) / std::max(1.0, expected.t) / std::max(1.0, steepness / kSteep);
  double& worst = steepness <= kSteep ? seen.worst : seen.worst_grazing;
  worst = std::max(worst, error);
  if (error <= kTolerance) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << t << " m, expected " << expected.t << " m, steepness " << steepness;
}

// Directions of one bundle: a LiDAR's fan, a tile of a camera, or all around.
Directions random_directions(Random& random) {
  switch (random.generator()() % 4) {
    case 0:
      return Directions(fan(35, 270.0F));
    case 1:
      return Directions(cone(random, 64, 20.0F));
    case 2:
      return Directions(cone(random, 37, 79.0F));
    default:
      return Directions(cone(random, 50, 180.0F));
  }
}

void compare(const World& world, Random& random, Tracer& tracer, Tally& tally) {
  const Directions directions = random_directions(random);
  RayBundle& bundle = tracer.bundle;
  directions.aim(bundle);
  const unsigned kind = random.generator()() % 4;
  bundle.rotation = kind == 0 ? Mat3::Identity() : random.rotation().toRotationMatrix();
  bundle.origin = random.point(random.generator()() % 4 == 0 ? 9.0F : 4.0F);
  bundle.range = std::array{2.0F, 8.0F, 30.0F, kInfinity}[random.generator()() % 4];
  const bool is_direct = tracer.directly(world.scene());
  tracer.as_block(world.scene());
  const bool is_embree = world.primitives().size() > kMaxDirectAnyOrigin;
  for (std::size_t i = 0; i < bundle.count; ++i) {
    const Vec3d origin = bundle.origin.cast<double>();
    const Vec3d direction = bundle.direction(i).cast<double>();
    const auto range = static_cast<double>(bundle.range);
    const oracle::Hit expected = oracle::nearest(world, origin, direction, range);
    const double steepness = oracle::steepness(world, expected, origin, direction, range);
    ++tally.rays;
    tally.hits += expected.element >= 0;
    if (steepness == oracle::kNever) {
      ++tally.unclear;
      continue;
    }
    tally.grazing += steepness > kSteep;
    const auto ray = [&](const char* way) {
      return ::testing::Message() << way << " from " << origin.transpose() << " along " << direction.transpose() << " within "
                                  << range << " m: ";
    };
    if (is_direct) {
      EXPECT_TRUE(agrees(bundle.t_hit[i], bundle.element[i], expected, steepness, tally.direct)) << ray("directly");
    }
    Deviation& of_block = is_embree ? tally.by_embree : tally.by_list;
    EXPECT_TRUE(agrees(tracer.block.t_hit[i], tracer.block.element[i], expected, steepness, of_block)) << ray("as a block");
  }
}

TEST(Agreement, DirectlyThroughEmbreeAndByClosedForms) {
  const std::size_t wanted = rays_wanted();
  Tally tally;
  const auto tracer = std::make_unique<Tracer>();
  for (unsigned seed = 0; tally.rays < wanted; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto world = make_world(random_primitives(random, std::array{6, 12, 18, 23, 60}[seed % 5], seed % 3 != 0));
    for (int i = 0; i < 12; ++i) compare(*world, random, *tracer, tally);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_LT(static_cast<double>(tally.unclear), 0.01 * static_cast<double>(tally.rays));
  EXPECT_GT(tally.hits, tally.rays / 3);
  EXPECT_GT(tally.direct.compared, tally.rays / 2);
  EXPECT_GT(tally.by_embree.compared, tally.rays / 2);
  EXPECT_GT(tally.by_list.compared, tally.rays / 10);
  std::ostringstream text;
  const auto write = [&text](const char* way, const Deviation& deviation) {
    text << "; " << way << ' ' << deviation.compared << " compared, worst error " << deviation.worst << " (grazing "
         << deviation.worst_grazing << ')';
  };
  text << tally.rays << " rays, " << tally.hits << " hits, " << tally.unclear << " near an edge, " << tally.grazing << " grazing";
  write("directly", tally.direct);
  write("through Embree", tally.by_embree);
  write("from a list", tally.by_list);
  RecordProperty("counts", text.str());
  if (std::getenv("SWIFTLET_RAYS") != nullptr) std::cout << text.str() << '\n';
}

}  // namespace
}  // namespace swiftlet::trace
