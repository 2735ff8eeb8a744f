// Sweeps in random scenes, compared with fine stepping and an independent distance.
#include "collision/places.hpp"

namespace flockstep::collision {
namespace {

using namespace places;

// -- SceneRandom scenes, compared with fine stepping and an independent distance.

class SceneRandom {
 public:
  explicit SceneRandom(unsigned seed) : bits_(seed) {}
  float uniform(float low, float high) { return std::uniform_real_distribution<float>(low, high)(bits_); }
  bool chance(float p) { return uniform(0, 1) < p; }
  Vec3 normal() {
    const float x = gauss_(bits_);
    const float y = gauss_(bits_);
    return {x, y, gauss_(bits_)};
  }
  Quat rotation() {
    const Vec3 axis = normal();
    return Quat(Eigen::AngleAxisf(uniform(0, std::numbers::pi_v<float>), axis.normalized()));
  }

 private:
  std::mt19937 bits_;
  std::normal_distribution<float> gauss_;
};

std::unique_ptr<Place> random_place(SceneRandom& random, int elements) {
  std::vector<Primitive> primitives;
  TriangleMesh mesh;
  if (random.chance(0.5F)) primitives.push_back(make(PrimitiveKind::room, 0.3F * random.normal(), Vec3(3, 2.5F, 2)));
  for (int i = 0; i < elements; ++i) {
    const Vec3 center = 0.9F * std::cbrt(static_cast<float>(elements)) * random.normal();
    // Sizes over three decades, from a wire to a wall.
    const auto size = [&] {
      return random.chance(0.2F) ? random.uniform(0.001F, 0.01F) : random.uniform(0.01F, random.chance(0.1F) ? 4.0F : 0.7F);
    };
    const float a = size();
    const float b = size();
    const Vec3 half(a, b, size());
    const Quat rotation = random.chance(0.4F) ? Quat::Identity() : random.rotation();
    switch (static_cast<int>(random.uniform(0, 7))) {
      case 0:
        primitives.push_back(make(PrimitiveKind::box, center, half, rotation));
        break;
      case 1:
        primitives.push_back(make(PrimitiveKind::cylinder, center, {a, a, half.z()}, rotation));
        break;
      case 2:
        primitives.push_back(make(PrimitiveKind::sphere, center, Vec3::Constant(a)));
        break;
      case 3:
        primitives.push_back(make(PrimitiveKind::capsule, center, {a, a, a + half.z()}, rotation));
        break;
      case 4:
        primitives.push_back(make(PrimitiveKind::plane, center, {a, b, 0}, rotation));
        break;
      case 5:
        primitives.push_back(make(PrimitiveKind::disc, center, {a, a, 0}, rotation));
        break;
      default: {
        const auto first = static_cast<std::int32_t>(mesh.vertices.size());
        for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(center + 0.7F * random.normal());
        mesh.triangles.push_back({first, first + 1, first + 2});
        mesh.materials.push_back(0);
      }
    }
  }
  return std::make_unique<Place>(std::move(primitives), std::move(mesh));
}

// Brute-force distances from a hull to everything in a world.
class Reference {
 public:
  explicit Reference(const World& world) {
    for (const Primitive& primitive : world.primitives()) {
      if (primitive.kind == PrimitiveKind::room) {
        rooms_.push_back(primitive);
      } else {
        solids_.push_back(
            {oracle::solid(primitive), primitive.center.cast<double>(), primitive.half_extents.cast<double>().norm()});
      }
    }
    const TriangleMesh& mesh = world.triangles();
    for (const auto& triangle : mesh.triangles) {
      std::vector<Eigen::Vector3d> corners;
      for (const std::int32_t vertex : triangle) {
        corners.push_back(mesh.vertices[static_cast<std::size_t>(vertex)].cast<double>());
      }
      const double reach = std::max((corners[1] - corners[0]).norm(), (corners[2] - corners[0]).norm());
      solids_.push_back({oracle::polytope(corners), corners[0], reach});
    }
  }

  // Returns the distance, or a lower bound of it that exceeds `enough`. Not positive if they overlap.
  double distance(const Eigen::Vector3d& position, const Eigen::Quaterniond& rotation, double enough) const {
    double least = std::numeric_limits<double>::infinity();
    const oracle::Support body = oracle::hull_at(quadrotor(), position, rotation);
    for (const Primitive& room : rooms_) least = std::min(least, oracle::distance_from(body, room));
    for (const Solid& solid : solids_) {
      const double bound = (position - solid.center).norm() - solid.reach - static_cast<double>(quadrotor().radius());
      least = std::min(least, bound > enough ? bound : oracle::distance(body, solid.support).lower);
    }
    return least;
  }

 private:
  struct Solid {
    oracle::Support support;
    Eigen::Vector3d center;
    double reach;
  };
  std::vector<Primitive> rooms_;
  std::vector<Solid> solids_;
};

using Motion = oracle::Way;

// An upper bound for any point of the hull.
double speed_of(const Motion& motion) {
  return motion.shift().norm() + static_cast<double>(quadrotor().radius()) * motion.turn();
}

// Returns the first time at which the hull is within the standoff, or a value above 1 if there is none.
double first_time(const Reference& reference, const Motion& motion) {
  return oracle::first_time_within(kStandoff, std::max(speed_of(motion), 1e-9), [&](double time) {
    return reference.distance(motion.position(time), motion.rotation(time), 0.5);
  });
}

struct Tally {
  int hits = 0;
  int insides = 0;
  int frees = 0;
};

void compare_with_fine_stepping(SceneRandom& random, const Place& place, const Motion& motion, Tally& tally) {
  const Reference reference(place.world);
  const Contact contact = place.sweep(motion.from, motion.to);
  const double first = reference.distance(motion.position(0), motion.rotation(0), 0.5);
  if (std::abs(first) < 2.0 * kStandoff) {
    return;  // different rules apply at the standoff
  }
  ASSERT_EQ(contact.inside, first <= 0.0);
  ASSERT_EQ(place.overlaps(motion.from), contact.inside);
  if (contact.inside) {
    ++tally.insides;
    ASSERT_TRUE(contact.hit);
    ASSERT_NEAR(contact.normal.norm(), 1.0F, 1e-5F);
    return;
  }
  const double expected = first_time(reference, motion);
  const double travel = speed_of(motion);
  const double ended = static_cast<double>(contact.fraction);
  const double left = reference.distance(motion.position(ended), motion.rotation(ended), 0.5);
  if (!contact.hit) {
    ++tally.frees;
    ASSERT_EQ(contact.fraction, 1.0F);
    if (expected <= 1.0) {  // dips of a few micrometres below the standoff are ignored
      ASSERT_GT(reference.distance(motion.position(expected), motion.rotation(expected), 0.5), kStandoff - 3e-5);
    }
    return;
  }
  ++tally.hits;
  ASSERT_GT(left, kStandoff - 1e-6);
  ASSERT_LT(left, kStandoff + 2e-5);
  ASSERT_LT(ended * travel, expected * travel + 5e-5) << "flew through";
  // If the hull closes the last micrometres very slowly, it may stop earlier. The gap check above allows that.
  const double before = std::max(0.0, ended - 1e-3 / travel);
  const double approach = (reference.distance(motion.position(before), motion.rotation(before), 0.5) - left) / 1e-3;
  if (approach > 0.05) {
    ASSERT_GT(ended * travel, expected * travel - 1e-3) << "stopped early";
  }
  const Pose stop = interpolate(motion.from, motion.to, contact.fraction);
  ASSERT_FALSE(place.overlaps(stop));
  ASSERT_GT(reference.distance(stop.position.cast<double>(), stop.rotation.cast<double>(), 0.5), 0.5 * kStandoff);
  ASSERT_NEAR(contact.normal.norm(), 1.0F, 1e-5F);
  // The contact point is at the standoff distance from the hull, on the side that the normal points away from.
  const oracle::Support body = oracle::hull_at(quadrotor(), stop);
  const oracle::Support point = oracle::polytope({contact.point.cast<double>()});
  ASSERT_LT(oracle::distance(body, point).upper, kStandoff + 2e-4);
  ASSERT_GT(contact.normal.cast<double>().dot(body(-contact.normal.cast<double>()) - contact.point.cast<double>()), -1e-5);
  // Moving away and then anywhere never enters an obstacle.
  Pose pose = stop;
  for (int step = 0; step < 4; ++step) {
    const Pose next{pose.position + 0.1F * random.normal(), random.chance(0.5F) ? pose.rotation : random.rotation()};
    const Contact again = place.sweep(pose, next);
    ASSERT_FALSE(again.inside);
    pose = again.hit ? interpolate(pose, next, again.fraction) : next;
    ASSERT_GT(reference.distance(pose.position.cast<double>(), pose.rotation.cast<double>(), 0.5), 0.0) << step;
  }
}

void random_cases(unsigned seed, int places, int motions, int elements, float length, float most_degrees) {
  SceneRandom random(seed + 10U * part_tried());
  Tally tally;
  places = static_cast<int>(times_tried(places));
  for (int i = 0; i < places; ++i) {
    const std::unique_ptr<Place> place = random_place(random, elements);
    for (int j = 0; j < motions; ++j) {
      SCOPED_TRACE(::testing::Message() << "place " << i << ", motion " << j);
      Motion motion;
      motion.from.position = 1.2F * random.normal();
      motion.from.rotation = random.rotation();
      motion.to.position = motion.from.position + length * random.uniform(0, 1) * random.normal();
      const Vec3 axis = random.normal().normalized();
      motion.to.rotation = turn(random.uniform(0, most_degrees), axis) * motion.from.rotation;
      if (random.chance(0.2F)) motion.to.position = motion.from.position;
      compare_with_fine_stepping(random, *place, motion, tally);
      if (::testing::Test::HasFatalFailure()) return;
    }
  }
  const int total = places * motions;
  EXPECT_GT(tally.hits, total / 100);
  EXPECT_GT(tally.frees, total / 50);
  EXPECT_GT(tally.insides, total / 50);
  testing::tried("motions", total);
}

TEST(SweepAgainstFineStepping, ShortMotions) { random_cases(1, 300, 20, 5, 0.3F, 0.0F); }
TEST(SweepAgainstFineStepping, ShortTurningMotions) { random_cases(2, 300, 20, 5, 0.2F, 20.0F); }
TEST(SweepAgainstFineStepping, LongMotions) { random_cases(3, 200, 10, 4, 3.0F, 0.0F); }
TEST(SweepAgainstFineStepping, LongTurningMotions) { random_cases(4, 150, 10, 4, 2.0F, 180.0F); }
TEST(SweepAgainstFineStepping, ManyElements) { random_cases(5, 20, 20, 100, 0.3F, 20.0F); }

TEST(Sweep, ResultsDependOnNothingButTheInputs) {
  // The same elements checked one by one, through the acceleration structure, and in another order.
  SceneRandom random(6);
  for (int i = 0; i < 20; ++i) {
    std::vector<Primitive> few;
    for (int k = 0; k < 12; ++k) {
      few.push_back(make(PrimitiveKind::box, 1.5F * random.normal(), Vec3(0.3F, 0.2F, 0.4F), random.rotation()));
    }
    std::vector<Primitive> reversed(few.rbegin(), few.rend());
    std::vector<Primitive> many = few;
    for (int k = 0; k < 60; ++k) {  // far away
      many.push_back(make(PrimitiveKind::sphere, {100.0F + 2.0F * static_cast<float>(k), 0, 0}, Vec3::Constant(0.5F)));
    }
    const Place a(few);
    const Place b(reversed);
    const Place c(many);
    for (int j = 0; j < 100; ++j) {
      const Pose from{1.5F * random.normal(), random.rotation()};
      const Pose to{from.position + 0.5F * random.normal(), turn(10, Vec3::UnitZ()) * from.rotation};
      const Contact first = a.sweep(from, to);
      for (const Contact& other : {a.sweep(from, to), b.sweep(from, to), c.sweep(from, to)}) {
        ASSERT_EQ(first.hit, other.hit);
        ASSERT_EQ(first.inside, other.inside);
        ASSERT_EQ(first.fraction, other.fraction);
        if (!first.inside) {  // with several overlaps, the element with the lowest index sets the normal
          ASSERT_EQ(first.normal, other.normal);
          ASSERT_EQ(first.point, other.point);
        }
      }
    }
  }
}

TEST(Sweep, AllocatesNothing) {
  SceneRandom random(7);
  for (const int elements : {10, 100}) {
    const std::unique_ptr<Place> place = random_place(random, elements);
    (void)place->overlaps(at(0, 0, 0));  // builds the acceleration structure, which is lazy
    int hits = 0;
    const std::uint64_t before = allocations_of_this_thread();
    for (int i = 0; i < 2000; ++i) {
      const Pose from{random.normal(), random.rotation()};
      const Pose to{from.position + 0.3F * random.normal(), random.rotation()};
      hits += place->sweep(from, to).hit;
    }
    EXPECT_EQ(allocations_of_this_thread(), before);
    EXPECT_GT(hits, 100);
  }
}

}  // namespace
}  // namespace flockstep::collision
