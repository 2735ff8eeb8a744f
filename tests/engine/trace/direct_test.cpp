#include "trace/direct.hpp"

#include "trace/direct_scenes.hpp"

namespace flockstep::trace {
namespace {

using namespace direct;

// -- Three results agree: bundles traced directly, blocks, and closed forms in double precision. Blocks go through Embree if
// the world has more than kMaxDirectAnyOrigin primitives. Otherwise they are traced without a common origin or frustum.

std::size_t rays_wanted() {
#if defined(NDEBUG)
  constexpr long kDefault = 150'000;
#else  // sanitizers and debug builds are slow
  constexpr long kDefault = 20'000;
#endif
  return static_cast<std::size_t>(times_tried(kDefault));
}

struct Deviation {
  std::size_t compared = 0;
  double worst = 0.0;          // m, relative to max(1 m, range), for clear-cut hits
  double worst_grazing = 0.0;  // same for grazing hits, divided by steepness over kSteep
};

struct Tally {
  std::size_t rays = 0, hits = 0;
  std::size_t unclear = 0;  // near an edge, a silhouette or the end of the range
  std::size_t grazing = 0;  // clear of those, but at a grazing angle
  Deviation direct, by_embree, by_list;
};

constexpr double kTolerance = 1e-5;  // relative, or m
constexpr double kSteep = 5.0;       // as in oracle::is_clear_cut

// Checks one path's result for a ray that is clear of edges.
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

// Returns the directions of a bundle: a LiDAR's fan, a camera's tile, or all around.
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

void compare(const World& world, Random& random, Probe& probe, Tally& tally) {
  const Directions directions = random_directions(random);
  RayBundle& bundle = probe.bundle;
  directions.aim(bundle);
  const unsigned kind = random.generator()() % 4;
  bundle.rotation = kind == 0 ? Mat3::Identity() : random.rotation().toRotationMatrix();
  bundle.origin = random.point(random.generator()() % 4 == 0 ? 9.0F : 4.0F);
  bundle.range = std::array{2.0F, 8.0F, 30.0F, kInfinity}[random.generator()() % 4];
  const bool is_direct = probe.directly(prepared(world).scene());
  probe.as_block(prepared(world).scene());
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
    EXPECT_TRUE(agrees(probe.block().t_hit[i], probe.block().element[i], expected, steepness, of_block)) << ray("as a block");
  }
}

TEST(Agreement, DirectlyThroughEmbreeAndByClosedForms) {
  const std::size_t wanted = rays_wanted();
  Tally tally;
  const auto probe = std::make_unique<Probe>();
  for (unsigned seed = part_tried() << 24U; tally.rays < wanted; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    constexpr int kLimit = static_cast<int>(kMaxDirectAnyOrigin);
    const int count = std::array{4, kLimit - 1, kLimit + 1, kLimit + 10, kLimit + 40}[seed % 5];
    const auto world = make_world(random_primitives(random, count, seed % 3 != 0));
    for (int i = 0; i < 12; ++i) compare(*world, random, *probe, tally);
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
  testing::tried("rays", static_cast<long>(tally.rays));
}

// -- The same bits with any neighbours.

struct Bits {
  std::vector<float> t;
  std::vector<std::int32_t> element;
  friend bool operator==(const Bits& a, const Bits& b) { return same_bits(a.t, b.t) && a.element == b.element; }
};

template <class Rays>
void keep(const Rays& rays, Bits& bits) {
  bits.t.insert(bits.t.end(), rays.t_hit, rays.t_hit + rays.count);
  bits.element.insert(bits.element.end(), rays.element, rays.element + rays.count);
}

TEST(DirectBits, InAnyBundleAtAnyPlaceSeenOrNot) {
  const auto probe = std::make_unique<Probe>();
  RayBundle& bundle = probe->bundle;
  std::size_t hits = 0;
  std::size_t culled = 0;
  for (unsigned seed = 0; seed < 40; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    const auto world = make_world(random_primitives(random, static_cast<int>(seed % 20) + 4, seed % 3 != 0));
    const Scene& scene = prepared(*world).scene();
    std::vector<Vec3> of_set = seed % 2 == 0 ? fan(100, 270.0F) : cone(random, 100, 30.0F);
    const Directions set(of_set);
    bundle.origin = random.point(4.0F);
    bundle.rotation = random.rotation().toRotationMatrix();
    bundle.range = seed % 4 == 0 ? 3.0F : 30.0F;
    set.aim(bundle);
    ASSERT_TRUE(probe->directly(scene));
    Bits whole;
    keep(bundle, whole);
    hits += static_cast<std::size_t>(std::count_if(whole.element.begin(), whole.element.end(), [](int e) { return e >= 0; }));

    bundle.frustum = &everywhere();
    ASSERT_TRUE(probe->directly(scene));
    Bits seen;
    keep(bundle, seen);
    ASSERT_EQ(seen, whole) << "without a frustum";
    culled += probe->candidates.count > 4;

    // Split the set into parts, so rays have other lanes and other counts.
    for (const std::size_t size : {1U, 2U, 7U, 16U, 33U}) {
      Bits parts;
      for (std::size_t first = 0; first < set.size(); first += size) {
        set.aim(bundle, first);
        bundle.count = std::min(size, bundle.count);
        ASSERT_TRUE(probe->directly(scene));
        keep(bundle, parts);
      }
      ASSERT_EQ(parts, whole) << size << " at a time";
    }

    // Mixed with other rays of the set, with the frustum of that mix.
    for (int round = 0; round < 4; ++round) {
      std::vector<std::size_t> order(of_set.size());
      for (std::size_t i = 0; i < order.size(); ++i) order[i] = i;
      std::shuffle(order.begin(), order.end(), random.generator());
      order.resize(round == 0 ? order.size() : 1 + random.generator()() % order.size());
      std::vector<Vec3> picked;
      for (const std::size_t i : order) picked.push_back(of_set[i]);
      const Directions others(picked);
      others.aim(bundle);
      ASSERT_TRUE(probe->directly(scene));
      for (std::size_t i = 0; i < order.size(); ++i) {
        ASSERT_TRUE(same_bits(std::span(&bundle.t_hit[i], 1), std::span(&whole.t[order[i]], 1))) << order[i];
        ASSERT_EQ(bundle.element[i], whole.element[order[i]]);
      }
    }
  }
  EXPECT_GT(hits, 1500U);
  EXPECT_GT(culled, 10U) << "frusta had something to hide";
}

// All results of tracing and normalising: bundles, blocks from lists and through Embree, observations.
struct Everything {
  Bits rays;
  std::vector<float> normalised;
  std::vector<double> clearance;
};

Everything trace_everything() {
  Everything all;
  const auto probe = std::make_unique<Probe>();
  for (unsigned seed = 0; seed < 60; ++seed) {
    Random random(seed);
    // Scenes are rebuilt, because Embree's callback is chosen when a scene is made.
    const auto world = make_world(random_primitives(random, std::array{5, 12, 22, 90}[seed % 4], seed % 3 != 0));
    for (int i = 0; i < 20; ++i) {
      const Directions directions = random_directions(random);
      RayBundle& bundle = probe->bundle;
      directions.aim(bundle);
      bundle.origin = random.point(5.0F);
      bundle.rotation = i % 3 == 0 ? Mat3::Identity() : Mat3(random.rotation().toRotationMatrix());
      bundle.range = std::array{2.0F, 8.0F, kInfinity}[random.generator()() % 3];
      if (probe->directly(prepared(*world).scene())) keep(bundle, all.rays);
      probe->as_block(prepared(*world).scene());
      keep(probe->block(), all.rays);
      const std::size_t count = random.generator()() % bundle.count + 1;
      const std::span<const float> ranges(probe->block().t_hit, count);
      std::vector<float> normalised(count);
      const float max_range_m = random.within(1.0F, 9.0F);
      task::normalise(ranges, max_range_m, normalised.data());
      const task::ScanClearance clearance = task::clearance_of(ranges, max_range_m);
      all.normalised.insert(all.normalised.end(), normalised.begin(), normalised.end());
      all.clearance.push_back(clearance.nearest);
      all.clearance.push_back(clearance.sum);
    }
  }
  return all;
}

// Every compiled target that this processor supports: AVX3 (AVX-512), AVX2 and SSE4 on x86-64.
TEST(DirectBits, AreTheSameOnEverySimdTarget) {
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  std::string names;
  for (const std::int64_t target : targets) names += std::string(names.empty() ? "" : " ") + hwy::TargetName(target);
  RecordProperty("targets", names);
  ASSERT_FALSE(targets.empty());
  const auto run = [](std::int64_t target) {
    const OnTarget on(target);
    EXPECT_STREQ(simd_target(), hwy::TargetName(target));
    return trace_everything();
  };
  const Everything best = run(targets.front());
  EXPECT_GT(best.rays.t.size(), 50'000U);
  for (const std::int64_t target : targets) {
    SCOPED_TRACE(hwy::TargetName(target));
    const Everything same = run(target);
    ASSERT_EQ(same.rays.t.size(), best.rays.t.size());
    std::size_t different = 0;
    for (std::size_t i = 0; i < best.rays.t.size(); ++i) {
      different += !same_bits(std::span(&same.rays.t[i], 1), std::span(&best.rays.t[i], 1)) ||
                   same.rays.element[i] != best.rays.element[i];
    }
    EXPECT_EQ(different, 0U) << "rays";
    EXPECT_TRUE(same_bits(same.normalised, best.normalised));
    EXPECT_TRUE(same_bits(same.clearance, best.clearance));
  }
}

}  // namespace
}  // namespace flockstep::trace
