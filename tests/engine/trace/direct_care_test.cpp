// Rays that are hard to trace directly: grazing, thin and far, within surfaces, and at the ends of their range.
#include "trace/direct_scenes.hpp"

namespace flockstep::trace {
namespace {

using namespace direct;

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
    const Quat rotation = i < 3 || kind == sphere ? Quat::Identity() : facing(Vec3::UnitZ(), axis);
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

}  // namespace
}  // namespace flockstep::trace
