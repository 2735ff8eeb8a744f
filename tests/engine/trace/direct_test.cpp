#include "trace/direct.hpp"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <span>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "bundles.hpp"
#include "numbers.hpp"
#include "on_target.hpp"
#include "prepared/prepared_world.hpp"
#include "random.hpp"
#include "ray_oracle.hpp"
#include "tasks/terms.hpp"
#include "trace/calibrated.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"
#include "trace/user_geometry.hpp"
#include "tried.hpp"

namespace flockstep::trace {
namespace {

using oracle::Vec3d;
using testing::cone;
using testing::Directions;
using testing::everywhere;
using testing::fan;
using testing::kInfinity;
using testing::make_world;
using testing::OnTarget;
using testing::primitive;
using testing::Random;
using testing::same_bits;

// Makes primitives of all kinds in turn, half of them axis-aligned, with sizes over two decades.
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

// A bundle and a block, and the data that the tracing paths need.
struct Probe {
  RayBundle bundle;
  CandidateSet candidates;
  Tracer tracer;

  // Gathers candidates and traces directly. Returns false if too much is in view.
  bool directly(const Scene& scene) {
    const FlushDenormals flush;
    scene.gather(bundle.origin, 0.0F, bundle.range, false, candidates);
    return !candidates.crowded && trace_direct(std::span(candidates.list).first(candidates.count), kMaxDirect, bundle);
  }
  const RayBlock& block() { return tracer.block(); }
  // Traces the same rays as a block.
  void as_block(const Scene& scene) {
    testing::copy(bundle, tracer.block());
    const FlushDenormals flush;
    tracer.trace_block(scene);
  }
};

// -- Three results agree: bundles traced directly, blocks, and closed forms in double precision. Blocks go through Embree if
// the world has more than kMaxDirectAnyOrigin primitives. Otherwise they are traced without a common origin or frustum.

std::size_t rays_wanted() {
#if defined(NDEBUG)
  constexpr long kDefault = 150'000;
#else  // sanitizers and debug builds are slow
  constexpr long kDefault = 20'000;
#endif
  return static_cast<std::size_t>(testing::times_tried(kDefault));
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
  for (unsigned seed = testing::part_tried() << 24U; tally.rays < wanted; ++seed) {
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

// -- Single rays in special positions, through every tracing path.

struct Answer {
  std::string way;
  float t;
  std::int32_t element;
};

// Appends discs that are too far away to be hit. With them the world's rays go through Embree, and bundles are culled by their
// frustum.
std::vector<Primitive> with_company(std::vector<Primitive> primitives) {
  for (std::size_t i = 0; i <= kMaxDirectAnyOrigin; ++i) {
    primitives.push_back(primitive(PrimitiveKind::disc, {-9e5F, -9e5F, static_cast<float>(i) - 9e5F}, {1e-3F, 1e-3F, 0}));
  }
  return primitives;
}

class Ways {
 public:
  explicit Ways(const std::vector<Primitive>& primitives)
      : alone_(make_world(primitives)), crowd_(make_world(with_company(primitives))) {}

  const World& world() const { return *alone_; }

  // The direction is not normalised.
  std::vector<Answer> ask(const Vec3& origin, const Vec3& direction, float range) {
    std::vector<Answer> answers;
    const std::vector<float> x(1 + kRayPadding, direction.x()), y(1 + kRayPadding, direction.y()),
        z(1 + kRayPadding, direction.z());
    const auto first = [](const std::vector<float>& all) { return std::span(all).first(1); };
    frustum_ = make_frustum(first(x), first(y), first(z));
    RayBundle& bundle = probe_->bundle;
    bundle.origin = origin;
    bundle.rotation = Mat3::Identity();
    bundle.range = range;
    bundle.count = 1;
    bundle.x = x.data();
    bundle.y = y.data();
    bundle.z = z.data();
    bundle.frustum = &frustum_;
    for (const auto& [way, world] : {std::pair{"directly", alone_.get()}, {"directly in company", crowd_.get()}}) {
      EXPECT_TRUE(probe_->directly(prepared(*world).scene())) << way;
      answers.push_back({way, bundle.t_hit[0], bundle.element[0]});
    }
    for (const auto& [way, world] : {std::pair{"from a list", alone_.get()}, {"through Embree", crowd_.get()}}) {
      probe_->as_block(prepared(*world).scene());
      answers.push_back({way, probe_->block().t_hit[0], probe_->block().element[0]});
    }
    return answers;
  }

  void expect_hit(const Vec3& origin, const Vec3& direction, float t, float tolerance, int element = 0, float range = kInfinity) {
    for (const Answer& answer : ask(origin, direction, range)) {
      EXPECT_NEAR(answer.t, t, tolerance) << answer.way << describe(origin, direction);
      EXPECT_EQ(answer.element, element) << answer.way << describe(origin, direction);
    }
  }
  void expect_exactly(const Vec3& origin, const Vec3& direction, float t, int element = 0, float range = kInfinity) {
    expect_hit(origin, direction, t, 0.0F, element, range);
  }
  void expect_miss(const Vec3& origin, const Vec3& direction, float range = kInfinity) {
    for (const Answer& answer : ask(origin, direction, range)) {
      EXPECT_EQ(answer.t, kInfinity) << answer.way << describe(origin, direction);
      EXPECT_EQ(answer.element, -1) << answer.way << describe(origin, direction);
    }
  }

 private:
  Frustum frustum_{};  // referenced by the last bundle
  static std::string describe(const Vec3& origin, const Vec3& direction) {
    std::ostringstream text;
    text << " from " << origin.transpose() << " along " << direction.transpose();
    return text.str();
  }

  std::shared_ptr<const World> alone_, crowd_;
  std::unique_ptr<Probe> probe_ = std::make_unique<Probe>();
};

// One primitive of each kind at the origin. The size is 2 along x and y, and along z if the kind has a thickness.
std::vector<Primitive> one_of_each() {
  using enum PrimitiveKind;
  return {primitive(room, {0, 0, 0}, {1, 1, 1}),     primitive(box, {0, 0, 0}, {1, 1, 1}),
          primitive(cylinder, {0, 0, 0}, {1, 1, 1}), primitive(sphere, {0, 0, 0}, {1, 1, 1}),
          primitive(capsule, {0, 0, 0}, {1, 1, 1}),  primitive(plane, {0, 0, 0}, {1, 1, 0}),
          primitive(disc, {0, 0, 0}, {1, 1, 0})};
}

bool is_flat(const Primitive& shape) { return shape.kind == PrimitiveKind::plane || shape.kind == PrimitiveKind::disc; }

TEST(DirectCare, ThinAndFar) {
  constexpr float kRadius = 1e-3F;
  constexpr float kFar = 100.0F;
  Random random(1);
  using enum PrimitiveKind;
  for (int i = 0; i < 60; ++i) {
    const PrimitiveKind kind = std::array{cylinder, capsule, sphere}[static_cast<std::size_t>(i) % 3];
    const Vec3 ahead = i < 3 ? Vec3::UnitX() : random.direction().normalized();
    const Vec3 center = kFar * ahead;
    const Vec3 across = ahead.unitOrthogonal();
    const Vec3 axis = ahead.cross(across);
    const Quat rotation = i < 3 || kind == sphere ? Quat::Identity() : testing::facing(Vec3::UnitZ(), axis);
    Ways ways({primitive(kind, center, {kRadius, kRadius, kind == sphere ? kRadius : 2.0F}, rotation)});
    const Vec3 side = i < 3 ? Vec3::UnitY() : across;
    for (const float part : {-0.9F, -0.5F, 0.0F, 0.3F, 0.9F}) {
      const Vec3 direction = (center + part * kRadius * side).normalized();
      ways.expect_hit(Vec3::Zero(), direction, kFar - kRadius * std::sqrt(1.0F - part * part), 1e-4F);
    }
    for (const float part : {-3.0F, -1.1F, 1.1F, 2.0F})
      ways.expect_miss(Vec3::Zero(), (center + part * kRadius * side).normalized());
  }
}

TEST(DirectCare, GrazingRays) {
  using enum PrimitiveKind;
  Ways sphere_({primitive(sphere, {5, 0, 0}, {1, 1, 1})});
  Ways cylinder_({primitive(cylinder, {5, 0, 0}, {1, 1, 2})});
  Ways capsule_({primitive(capsule, {5, 0, 0}, {1, 1, 3})});
  for (Ways* round : {&sphere_, &cylinder_, &capsule_}) {
    for (const float gap : {1e-3F, 1e-5F, 1e-6F}) {
      const float half_chord = std::sqrt(gap * (2.0F - gap));
      round->expect_hit({0, 1.0F - gap, 0}, {1, 0, 0}, 5.0F - half_chord, 0.5F * half_chord);
      round->expect_miss({0, 1.0F + gap, 0}, {1, 0, 0});
    }
    round->expect_hit({0, -1, 0}, {1, 0, 0}, 5.0F, 1e-6F);  // tangent
  }
  // Nearly along a floor, at angles down to 0.001 degrees. Hit points lie within 1e-5 m of the floor.
  Ways floor({primitive(plane, {0, 0, 0}, {1e5F, 1e5F, 0})});
  for (const double degrees : {10.0, 1.0, 0.1, 0.01, 0.001}) {
    const double angle = degrees * 0.017453292519943295;
    const Vec3 direction = Vec3d(std::cos(angle), 0, -std::sin(angle)).cast<float>();
    for (const Answer& answer : floor.ask({0, 0, 1}, direction, kInfinity)) {
      EXPECT_NEAR(1.0 + static_cast<double>(answer.t) * static_cast<double>(direction.z()), 0.0, 1e-5) << answer.way;
    }
    floor.expect_miss({0, 0, 1}, -direction);
  }
}

TEST(DirectCare, AlongFacesEdgesAndAxes) {
  Ways box({primitive(PrimitiveKind::box, {0, 0, 0}, {1, 2, 3})});
  // In the plane of a face, along an edge, through a corner: the boundary belongs to the box.
  box.expect_exactly({-4, 2, 0}, {1, 0, 0}, 3);
  box.expect_exactly({-4, 2, 3}, {1, 0, 0}, 3);
  box.expect_exactly({-4, -2, -3}, {1, -0.0F, 0}, 3);
  box.expect_exactly({1, 2, 9}, {0, 0, -1}, 6);
  box.expect_exactly({-1, 5, 3}, {-0.0F, -1, 0}, 3);
  box.expect_miss({-4, std::nextafter(2.0F, 3.0F), 0}, {1, 0, 0});
  box.expect_miss({-4, 2, std::nextafter(3.0F, 4.0F)}, {1, 0, 0});
  box.expect_miss({1, std::nextafter(2.0F, 3.0F), 9}, {0, 0, -1});
  box.expect_miss({-4, 2, 0}, {-1, 0, 0});

  Ways cylinder({primitive(PrimitiveKind::cylinder, {0, 0, 0}, {1, 1, 3})});
  cylinder.expect_exactly({1, 0, 9}, {0, 0, -1}, 6);  // along its side
  cylinder.expect_exactly({0, 0, 9}, {0, 0, -1}, 6);  // along its axis
  cylinder.expect_exactly({-4, 0, 3}, {1, 0, 0}, 3);  // across its cap
  cylinder.expect_exactly({0, 0, 0}, {0, -0.0F, 1}, 3);
  cylinder.expect_miss({std::nextafter(1.0F, 2.0F), 0, 9}, {0, 0, -1});
  cylinder.expect_miss({-4, 0, std::nextafter(3.0F, 4.0F)}, {1, 0, 0});

  Ways capsule({primitive(PrimitiveKind::capsule, {0, 0, 0}, {1, 1, 3})});
  capsule.expect_exactly({0, 0, 9}, {0, 0, -1}, 6);
  capsule.expect_exactly({1, 0, 9}, {0, 0, -1}, 7);  // along its side: hits the start of the tube
  capsule.expect_exactly({-4, 0, 2}, {1, 0, 0}, 3);  // across the start of the tube
  capsule.expect_miss({std::nextafter(1.0F, 2.0F), 0, 9}, {0, 0, -1});

  // Rays within a sheet hit its rim, like rays within a box's face.
  Ways plane({primitive(PrimitiveKind::plane, {0, 0, 0}, {1, 2, 0})});
  plane.expect_exactly({-4, 1, 0}, {1, 0, 0}, 3);
  plane.expect_exactly({1, 2, 5}, {0, 0, -1}, 5);
  plane.expect_miss({-4, 1, 1e-6F}, {1, 0, 0});
  Ways disc({primitive(PrimitiveKind::disc, {0, 0, 0}, {1, 1, 0})});
  disc.expect_exactly({-4, 0, 0}, {1, 0, 0}, 3);
  disc.expect_exactly({1, 0, 5}, {0, 0, -1}, 5);
  disc.expect_miss({-4, 0, 1e-6F}, {1, 0, 0});
}

TEST(DirectCare, NearlyZeroComponents) {
  // Cosines of right angles are about 1e-17 instead of 0, and their products reach the smallest floats.
  for (const Primitive& shape : one_of_each()) {
    SCOPED_TRACE(static_cast<int>(shape.kind));
    Ways ways({shape});
    const float top = is_flat(shape) ? 0.0F : 1.0F;
    for (const float tiny : {1e-8F, 6e-17F, 1e-19F, 2e-19F, 1e-20F, 1e-30F, 1e-38F, 1e-40F, 1e-45F}) {
      SCOPED_TRACE(tiny);
      for (const float sign : {1.0F, -1.0F}) {
        ways.expect_hit({0.25F, 0.125F, 5}, {sign * tiny, tiny, -1},
                        shape.kind == PrimitiveKind::sphere || shape.kind == PrimitiveKind::capsule
                            ? 5.0F - std::sqrt(1.0F - 0.078125F)
                            : 5.0F - top,
                        1e-6F);
        ways.expect_miss({1.5F, 0, 5}, {sign * tiny, tiny, -1});
        if (is_flat(shape)) continue;
        ways.expect_hit({0, 0, 0}, {sign * tiny, tiny, 1}, 1.0F, 1e-6F);
        ways.expect_hit({-3, 0, 0}, {1, sign * tiny, tiny}, 2.0F, 1e-6F);
        ways.expect_miss({-3, 1.5F, 0}, {1, sign * tiny, tiny});
        ways.expect_miss({-3, 0, 1.5F}, {1, sign * tiny, tiny});
      }
    }
  }
  // From inside thin tubes, along them.
  for (const float radius : {1e-6F, 1e-3F, 0.1F}) {
    for (const PrimitiveKind kind : {PrimitiveKind::cylinder, PrimitiveKind::capsule}) {
      Ways tube({primitive(kind, {0, 0, 0}, {radius, radius, 2})});
      for (float tiny = 1e-45F; tiny < 1e-12F; tiny *= 3.0F) {
        tube.expect_hit({0.1F * radius, 0, 0}, {tiny, -tiny, 1}, 2.0F, 0.1F * radius);
        tube.expect_hit({0.1F * radius, 0, -5}, {-tiny, tiny, 1}, 3.0F, 0.1F * radius);
        tube.expect_miss({1.5F * radius, 0, -5}, {-tiny, tiny, 1});
      }
    }
  }
}

TEST(DirectCare, OriginsWithinOnASurfaceAndAtCentres) {
  for (const Primitive& shape : one_of_each()) {
    SCOPED_TRACE(static_cast<int>(shape.kind));
    Ways ways({shape});
    if (is_flat(shape)) {
      ways.expect_exactly({0, 0, 0}, {0, 0, 1}, 0);
      ways.expect_exactly({0.5F, 0.5F, 0}, {0.6F, 0, 0.8F}, 0);
      ways.expect_miss({0, 0, std::numeric_limits<float>::min()}, {0, 0, 1});
      continue;
    }
    for (const Vec3& axis : {Vec3(1, 0, 0), Vec3(0, -1, 0), Vec3(0, 0, 1)}) {
      ways.expect_exactly({0, 0, 0}, axis, 1);       // from the centre
      ways.expect_exactly(0.5F * axis, axis, 0.5F);  // from inside
      ways.expect_exactly(0.5F * axis, -axis, 1.5F);
      ways.expect_exactly(axis, axis, 0);   // from the surface, outwards
      ways.expect_exactly(axis, -axis, 0);  // inwards: hit at distance 0
      ways.expect_exactly(2.0F * axis, -axis, 1);
      ways.expect_miss(2.0F * axis, axis);
      ways.expect_miss(std::nextafter(1.0F, 2.0F) * axis, axis);
    }
    ways.expect_hit({0, 0, 0}, Vec3(1, 1, 0).normalized(),
                    shape.kind == PrimitiveKind::room || shape.kind == PrimitiveKind::box ? std::sqrt(2.0F) : 1.0F, 1e-6F);
  }
}

TEST(DirectCare, TheShortestAndTheLongestRanges) {
  constexpr float kShortest = std::numeric_limits<float>::denorm_min();
  for (const Primitive& shape : one_of_each()) {
    SCOPED_TRACE(static_cast<int>(shape.kind));
    Ways ways({shape});
    const Vec3 surface(0, 0, is_flat(shape) ? 0.0F : 1.0F);
    for (const float range : {kShortest, 1e-40F, std::numeric_limits<float>::min(), 1e-30F}) {
      SCOPED_TRACE(range);
      ways.expect_exactly(surface, {0, 0, 1}, 0, 0, range);
      ways.expect_miss(surface + Vec3(0, 0, 1), {0, 0, -1}, range);
      if (!is_flat(shape)) ways.expect_miss({0, 0, 0}, {0, 0, -1}, range);
    }
    for (const float range : {1e18F, 1e20F, 1e30F, std::numeric_limits<float>::max(), kInfinity}) {
      SCOPED_TRACE(range);
      ways.expect_exactly(surface + Vec3(0, 0, 1), {0, 0, -1}, 1, 0, range);
      ways.expect_miss(surface + Vec3(0, 0, 1), {0, 0, 1}, range);
    }
  }
  Ways far({primitive(PrimitiveKind::box, {9e5F, 0, 0}, {1e4F, 1e4F, 1e4F})});
  for (const float range : {1e6F, 1e30F, kInfinity}) far.expect_hit({-1e5F, 0, 0}, {1, 0, 0}, 9.9e5F, 0.1F, 0, range);
}

TEST(DirectCare, ARangeThatEndsAtTheHit) {
  Random random(2);
  std::size_t hits = 0;
  for (int i = 0; i < 300; ++i) {
    std::vector<Primitive> primitives = random_primitives(random, 6, i % 2 == 0);
    Ways ways({primitives[static_cast<std::size_t>(i) % primitives.size()]});
    for (int k = 0; k < 8; ++k) {
      const Vec3 origin = random.point(6.0F);
      const Vec3 target = ways.world().primitives()[0].center + random.point(0.3F);
      const Vec3 direction = (target - origin).normalized();
      const std::vector<Answer> whole = ways.ask(origin, direction, kInfinity);
      for (std::size_t way = 0; way < whole.size(); ++way) {
        if (whole[way].element < 0 || whole[way].t < 1e-3F) continue;
        ++hits;
        const Answer just = ways.ask(origin, direction, whole[way].t)[way];
        EXPECT_EQ(just.t, whole[way].t) << just.way;
        EXPECT_EQ(just.element, 0) << just.way;
        const Answer shy = ways.ask(origin, direction, std::nextafter(whole[way].t, 0.0F))[way];
        EXPECT_EQ(shy.t, kInfinity) << shy.way;
        EXPECT_EQ(shy.element, -1) << shy.way;
      }
    }
  }
  EXPECT_GT(hits, 4000U);
}

TEST(DirectCare, OfCoincidentSurfacesTheLowerElementIsHit) {
  using enum PrimitiveKind;
  // Two equal primitives, or two kinds with coincident surfaces. Element 0 is the first of them.
  const std::vector<std::vector<Primitive>> pairs{
      {primitive(room, {0, 0, 0}, {1, 1, 1}), primitive(box, {0, 0, 0}, {1, 1, 1})},
      {primitive(box, {0, 0, 0}, {1, 1, 1}), primitive(box, {0, 0, 0}, {1, 1, 1})},
      {primitive(box, {0, 0, 0}, {1, 1, 1}), primitive(cylinder, {0, 0, 0}, {0.75F, 0.75F, 1})},
      {primitive(box, {0, 0, -1}, {1, 1, 2}), primitive(plane, {0, 0, 1}, {1, 1, 0})},
      {primitive(cylinder, {0, 0, 0}, {1, 1, 1}), primitive(cylinder, {0, 0, 0}, {1, 1, 1})},
      {primitive(cylinder, {0, 0, 0}, {1, 1, 1}), primitive(disc, {0, 0, 1}, {1, 1, 0})},
      {primitive(sphere, {0, 0, 0}, {1, 1, 1}), primitive(sphere, {0, 0, 0}, {1, 1, 1})},
      {primitive(capsule, {0, 0, 0}, {0.5F, 0.5F, 1}), primitive(capsule, {0, 0, 0}, {0.5F, 0.5F, 1})},
      {primitive(plane, {0, 0, 1}, {1, 1, 0}), primitive(disc, {0, 0, 1}, {1, 1, 0})},
      {primitive(disc, {0, 0, 1}, {1, 1, 0}), primitive(disc, {0, 0, 1}, {0.5F, 0.5F, 0})},
  };
  Random random(3);
  for (std::size_t i = 0; i < pairs.size(); ++i) {
    SCOPED_TRACE(i);
    Ways ways(pairs[i]);
    ways.expect_exactly({0.25F, 0.125F, 4}, {0, 0, -1}, ways.ask({0.25F, 0.125F, 4}, {0, 0, -1}, kInfinity)[0].t);
    for (int k = 0; k < 50; ++k) {
      const Vec3 origin(random.within(-0.3F, 0.3F), random.within(-0.3F, 0.3F), 4);
      const Vec3 target(random.within(-0.3F, 0.3F), random.within(-0.3F, 0.3F), 1);
      for (const Answer& answer : ways.ask(origin, (target - origin).normalized(), kInfinity))
        EXPECT_EQ(answer.element, 0) << answer.way;
    }
  }
  // Same with many elements, for any order of tree traversal: blocks of different depths whose tops overlap at z = 1.
  std::vector<Primitive> blocks;
  for (int i = 0; i < 22; ++i) {
    const auto sixteenths = [&](float low, float high) { return std::round(random.within(low, high) * 16.0F) / 16.0F; };
    const Vec3 half(sixteenths(0.5F, 3), sixteenths(0.5F, 3), sixteenths(0.5F, 40));
    blocks.push_back(primitive(box, {sixteenths(-2, 2), sixteenths(-2, 2), 1.0F - half.z()}, half));
  }
  Ways ways(blocks);
  for (int i = 0; i < 300; ++i) {
    const Vec3 origin(random.within(-3, 3), random.within(-3, 3), 3);
    int lowest = 0;
    const auto is_above = [&](const Primitive& block) {
      return ((origin - block.center).cwiseAbs().head<2>().array() <= block.half_extents.head<2>().array()).all();
    };
    while (lowest < 22 && !is_above(blocks[static_cast<std::size_t>(lowest)])) ++lowest;
    if (lowest == 22) continue;
    ways.expect_exactly(origin, {0, 0, -1}, 2, lowest, 9);
  }
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
      const task::Clearance clearance = task::clearance_of(ranges, max_range_m);
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
