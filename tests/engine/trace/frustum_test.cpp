#include "trace/frustum.hpp"

#include "bundles.hpp"
#include "random.hpp"
#include "trace/calibrated.hpp"
#include "trace/direct.hpp"

namespace flockstep::trace {
namespace {

using namespace testing;

// Returns sets from a single ray to all around: narrow, wide, thin, tilted, and sets whose mean is undefined because they have
// too few or opposite directions.
Directions random_set(Random& random, unsigned kind) {
  const Quat turn = random.rotation();
  const auto turned = [&turn](std::vector<Vec3> directions) {
    for (Vec3& direction : directions) direction = turn * direction;
    return directions;
  };
  switch (kind % 9) {
    case 0:
      return Directions(cone(random, 1, 0.0F));
    case 1:
      return Directions(cone(random, 2, random.within(1, 180)));
    case 2:
      return Directions(cone(random, 40, random.within(0.01F, 60)));
    case 3:
      return Directions(cone(random, 60, random.within(70, 95)));  // around the limit between narrow and wide frusta
    case 4:
      return Directions(cone(random, 60, 180.0F));
    case 5:
      return Directions(fan(35, random.within(5, 360)));
    case 6:
      return Directions(turned(fan(35, random.within(5, 360))));
    case 7: {  // opposite pairs: their mean vanishes
      std::vector<Vec3> pairs = cone(random, 5, 180.0F);
      for (std::size_t i = 0; i < 5; ++i) pairs.push_back(-pairs[i]);
      return Directions(pairs);
    }
    default:  // along axes
      return Directions(std::vector<Vec3>{Vec3::Unit(static_cast<Eigen::Index>(random.generator()() % 3)), Vec3(0, 0, 1)});
  }
}

TEST(Frustum, ContainsEverythingThatItsDirectionsReach) {
  for (unsigned seed = 0; seed < 900; ++seed) {
    Random random(seed);
    const Directions set = random_set(random, seed);
    const Frustum& frustum = set.frustum();
    for (std::size_t plane = 0; plane < Frustum::kPlanes; ++plane) {
      const Vec3 normal(frustum.x[plane], frustum.y[plane], frustum.z[plane]);
      const float length = normal.norm();
      ASSERT_TRUE(length == 0.0F || std::abs(length - 1.0F) < 1e-6F);
      ASSERT_GE(frustum.reach[plane], 0.0F);
      for (std::size_t i = 0; i < set.size(); ++i) {
        for (const float t : {0.0F, 0.3F, 1.0F}) ASSERT_LE(normal.dot(t * set[i]), frustum.reach[plane]) << "seed " << seed;
      }
    }
  }
}

// A frustum is tight. The four sides of a pyramid touch directions, as do the upper and lower planes of a wide set.
TEST(Frustum, IsAsNarrowAsItsDirections) {
  for (unsigned seed = 0; seed < 300; ++seed) {
    Random random(seed);
    const bool is_narrow = seed % 2 == 0;
    const Directions set = is_narrow ? Directions(cone(random, 40, random.within(1, 60))) : Directions(fan(35, 270));
    const Frustum& frustum = set.frustum();
    for (std::size_t plane = 0; plane < (is_narrow ? Frustum::kPlanes : 2U); ++plane) {
      const Vec3 normal(frustum.x[plane], frustum.y[plane], frustum.z[plane]);
      float most = -1.0F;
      for (std::size_t i = 0; i < set.size(); ++i) most = std::max(most, normal.dot(set[i]));
      ASSERT_NEAR(most, 0.0F, 1e-5F) << "seed " << seed;
      ASSERT_NEAR(frustum.reach[plane], 0.0F, 2e-5F);
    }
  }
}

// -- Culling, as in trace_direct.

Primitive box_about(const Vec3& center, const Vec3& half) {
  return {.kind = PrimitiveKind::box, .center = center, .half_extents = half};
}

// Shapes, and their candidates for a bundle with a given origin.
struct Crowd {
  std::vector<Shape> shapes;
  std::vector<Candidate> candidates;

  void add(const Primitive& primitive) { shapes.push_back(make_shape(primitive)); }
  std::span<const Candidate> seen_from(const Vec3& origin) {
    candidates.clear();
    for (std::size_t i = 0; i < shapes.size(); ++i) {
      const Vec3 local = shapes[i].to_local * (origin - Vec3(shapes[i].center[0], shapes[i].center[1], shapes[i].center[2]));
      candidates.push_back(
          {&shapes[i], static_cast<std::int32_t>(i), OriginHint::anywhere, {}, {local.x(), local.y(), local.z()}});
    }
    return candidates;
  }
};

// Boxes around points that rays reach, with the point on any side of the box. Culling by the frustum must not change any hit.
TEST(Frustum, NeverHidesABoxThatARayReaches) {
  const auto rays = std::make_unique<RayBundle>();
  std::size_t hits = 0;
  for (unsigned seed = 0; seed < 6000; ++seed) {
    Random random(seed);
    const Directions set = random_set(random, seed);
    set.aim(*rays);
    rays->origin = random.point(std::array{1.0F, 10.0F, 1000.0F}[seed % 3]);
    rays->rotation = seed % 5 == 0 ? Mat3::Identity() : Mat3(random.rotation().toRotationMatrix());
    rays->range = std::array{0.1F, 3.0F, 30.0F, 1000.0F}[random.generator()() % 4];
    Crowd crowd;
    for (int i = 0; i < 12; ++i) {
      const std::size_t ray = random.generator()() % set.size();
      const float part = i % 3 == 0 ? 0.9999F : random.within(0.0F, 1.0F);  // share of the range
      const Vec3 point = rays->origin + part * rays->range * rays->direction(ray);
      const float size = rays->range * std::pow(10.0F, random.within(-4.0F, 0.0F));
      const Vec3 half = size * Vec3(random.within(0.1F, 1), random.within(0.1F, 1), random.within(0.1F, 1));
      // The point lies just inside the box: at a corner, an edge, a face, or anywhere.
      const Vec3 corner = random.point(1.0F).cwiseMax(-0.5F).cwiseMin(0.5F) * 1.99F;
      Primitive box = box_about(point + half.cwiseProduct(corner), half);
      if (i % 4 == 0) {
        box.rotation = random.rotation();
        box.center = point + box.rotation * half.cwiseProduct(corner);
      }
      crowd.add(box);
    }
    for (int i = 0; i < 12; ++i)
      crowd.add(box_about(rays->origin + random.point(rays->range), Vec3::Constant(0.05F * rays->range)));
    const std::span<const Candidate> candidates = crowd.seen_from(rays->origin);
    ASSERT_LE(candidates.size(), kMaxDirect);

    rays->frustum = &everywhere();
    ASSERT_TRUE(trace_direct(candidates, kMaxDirect, *rays));
    const std::vector<float> t(rays->t_hit, rays->t_hit + rays->count);
    const std::vector<std::int32_t> element(rays->element, rays->element + rays->count);
    rays->frustum = &set.frustum();
    ASSERT_TRUE(trace_direct(candidates, kMaxDirect, *rays));
    for (std::size_t i = 0; i < rays->count; ++i) {
      ASSERT_EQ(rays->element[i], element[i]) << "seed " << seed << ", ray " << i << ", " << t[i] << " m of " << rays->range;
      ASSERT_EQ(rays->t_hit[i], t[i]);
      hits += element[i] >= 0;
    }
  }
  EXPECT_GT(hits, 50'000U);
}

// More boxes than the limit for direct tracing, but most of them out of view.
TEST(Frustum, CullsBoxesBesideAboveAndBelow) {
  const auto rays = std::make_unique<RayBundle>();
  Random random(1);
  const Quat turn = random.rotation();
  rays->origin = random.point(10.0F);
  rays->rotation = turn.toRotationMatrix();
  rays->range = 20.0F;
  struct Case {
    const char* what;
    Directions set;
    std::vector<Vec3> hidden, seen;  // directions in the sensor frame
  };
  std::vector<Vec3> narrow;
  for (int i = 0; i < 32; ++i)
    narrow.push_back(Vec3(1, 0.05F * static_cast<float>(i % 8) - 0.2F, 0.1F * static_cast<float>(i / 8) - 0.2F));
  const std::vector<Case> cases{
      {"a fan", Directions(fan(35, 270)), {{0, 0, 1}, {0, 0, -1}, {1, 0, 1}, {-1, 0, -0.5F}}, {{1, 0, 0}, {0, 1, 0}, {0, -1, 0}}},
      {"a tile",
       Directions(narrow),
       {{-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}, {1, 1, 0}, {1, 0, -1}},
       {{1, 0, 0}, {1, 0.14F, 0.1F}, {1, -0.2F, -0.2F}}},
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    one.set.aim(*rays);
    for (const auto& [directions, expected] : {std::pair{&one.hidden, true}, {&one.seen, false}}) {
      for (const Vec3& direction : *directions) {
        Crowd crowd;
        for (std::size_t i = 0; i <= kMaxDirect; ++i) {
          crowd.add(box_about(rays->origin + turn * (10.0F * direction.normalized()) + random.point(0.1F), Vec3::Constant(0.2F)));
        }
        EXPECT_EQ(trace_direct(crowd.seen_from(rays->origin), kMaxDirect, *rays), expected) << direction.transpose();
        if (!expected) continue;
        EXPECT_TRUE(std::all_of(rays->element, rays->element + rays->count, [](int element) { return element == -1; }));
      }
    }
    rays->frustum = &everywhere();
    Crowd crowd;
    for (std::size_t i = 0; i <= kMaxDirect; ++i) crowd.add(box_about(rays->origin - turn * Vec3(10, 0, 0), Vec3::Ones()));
    EXPECT_FALSE(trace_direct(crowd.seen_from(rays->origin), kMaxDirect, *rays));
    crowd.shapes.pop_back();
    EXPECT_TRUE(trace_direct(crowd.seen_from(rays->origin), kMaxDirect, *rays));
  }
}

}  // namespace
}  // namespace flockstep::trace
