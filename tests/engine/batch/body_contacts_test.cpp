// Drones of a batch among bodies that move, against fine stepping with an independent convex distance: first contacts, pushes
// among walls and other bodies, and thin plates that nothing passes.
#include "batch/body_envs.hpp"

namespace flockstep {
namespace {

using namespace contacts;

double least_distance(const std::vector<Mover>& movers, const Way& drone, double time, double enough) {
  double least = std::numeric_limits<double>::infinity();
  for (const Mover& mover : movers) least = std::min(least, mover.distance(time, drone, time, enough));
  return least;
}

// m per motion, more than any point of the hull moves relative to the solid.
double relative_speed(const Mover& mover, const Way& drone) {
  return std::max(1e-9, (drone.shift() - mover.way.shift()).norm() + static_cast<double>(tried_drone().radius()) * drone.turn() +
                            mover.radius() * mover.way.turn());
}

// The gap that the sweep keeps, with the float32 steps of its coordinates.
double standoff_of(const Way& drone) {
  const auto largest =
      static_cast<double>(std::max(drone.from.position.cwiseAbs().maxCoeff(), drone.to.position.cwiseAbs().maxCoeff()));
  return collision::kStandoff + 4.0 * 0x1p-23 * largest;
}

// Returns the first time at which the hull is within the standoff of a solid, or a value above 1.
double first_time_by_steps(const std::vector<Mover>& movers, const Way& drone) {
  double first = 2.0;
  for (const Mover& mover : movers) {
    const auto distance = [&](double time) { return mover.distance(time, drone, time, 0.5); };
    first = std::min(first, oracle::first_time_within(standoff_of(drone), relative_speed(mover, drone), distance));
  }
  return first;
}

// Returns the least distance from a time on, for `length` (m) of relative motion, by steps of 0.2 um.
double least_by_steps(const std::vector<Mover>& movers, const Way& drone, double time, double length) {
  double least = std::numeric_limits<double>::infinity();
  for (const Mover& mover : movers) {
    const double speed = relative_speed(mover, drone);
    for (double way = 0.0; way <= length; way += 2e-7) {
      const double at = std::min(1.0, time + way / speed);
      least = std::min(least, mover.distance(at, drone, at, 0.5));
    }
  }
  return least;
}

// -- First contacts.

struct ContactTally {
  long motions = 0, hits = 0, of_bodies = 0, frees = 0, insides = 0, skipped = 0;
};

// Checks the contact of one drone, which moved from `drone.from` towards `drone.to`.
void check_contact(const BodyEnvs& envs, std::size_t env, const std::vector<Mover>& movers, const Way& drone,
                   ContactTally& tally) {
  const ContactState& contact = envs.batch.state().contact;
  const Pose end = envs.drone(env);
  const double standoff = standoff_of(drone);
  ++tally.motions;
  const double at_first = least_distance(movers, drone, 0.0, 0.5);
  if (std::abs(at_first) < 2.0 * standoff) {  // different rules apply at the standoff
    ++tally.skipped;
    return;
  }
  if (at_first <= 0.0) {
    EXPECT_TRUE(contact.inside[env] && contact.hit[env]);
    ++tally.insides;
    return;
  }
  if (!contact.inside[env]) {  // not squeezed
    double least = 1.0;
    for (const Mover& mover : movers) least = std::min(least, mover.distance(1.0, {end, end}, 0.0, 1.0));
    EXPECT_GT(least, 0.0);
  }
  const double expected = first_time_by_steps(movers, drone);
  if (!contact.hit[env]) {
    ++tally.frees;
    EXPECT_EQ(contact.body[env], -1);
    EXPECT_EQ(contact.fraction[env], 1.0F);
    if (expected <= 1.0) {  // dips of a few micrometres below the standoff are ignored
      EXPECT_GT(least_distance(movers, drone, expected, 0.5), standoff - 3e-5) << "missed a contact at " << expected;
    }
    return;
  }
  ++tally.hits;
  const auto ended = static_cast<double>(contact.fraction[env]);
  double speed = 0.0, left = std::numeric_limits<double>::infinity();
  const Mover* nearest = nullptr;
  const Mover* met = nullptr;
  for (const Mover& mover : movers) {
    speed = std::max(speed, relative_speed(mover, drone));
    const double distance = mover.distance(ended, drone, ended, 0.5);
    if (distance < left) nearest = &mover;
    left = std::min(left, distance);
    if (mover.number == contact.body[env] && (met == nullptr || distance == left)) met = &mover;
  }
  ASSERT_NE(met, nullptr) << contact.body[env];
  tally.of_bodies += met->number >= 0;
  const double fraction_m = 0x1p-23 * speed;  // the contact's fraction is rounded
  EXPECT_GT(left, standoff - 3e-6 - fraction_m);
  EXPECT_LT(left, standoff + 2e-5 + fraction_m);
  EXPECT_LT(ended * speed, expected * speed + 5e-5) << "flew through";
  const double before = std::max(0.0, ended - 1e-3 / speed);
  if ((least_distance(movers, drone, before, 0.5) - left) / 1e-3 > 0.05) {  // else it may stop earlier
    // The fine steps may pass over a dip that is narrower.
    if (ended * speed <= expected * speed - 1e-3) {
      EXPECT_LT(least_by_steps(movers, drone, ended, 4e-5), standoff + 4e-6 + fraction_m) << "stopped early";
    }
  }
  EXPECT_LT(met->distance(ended, drone, ended, 0.5) - left, 1e-5 + fraction_m) << "the nearest is " << nearest->number;
  // The contact point is on the solid and beside the hull.
  const Vec3d point = vector_at(contact.point, env).cast<double>();
  const Vec3d normal = vector_at(contact.normal, env).cast<double>();
  const double rounded = 1e-5 + 2e-7 * (met->radius() + point.cwiseAbs().maxCoeff());
  EXPECT_LT(oracle::distance(met->core(ended), oracle::polytope({point})).upper - met->rounding(), rounded);
  const oracle::Support hull = oracle::hull_at(tried_drone(), drone.position(ended), drone.rotation(ended));
  EXPECT_LT(oracle::distance(hull, oracle::polytope({point})).upper, standoff + 2e-4 + rounded);
  EXPECT_NEAR(normal.norm(), 1.0, 1e-5);
  EXPECT_GT(normal.dot(hull(-normal) - point), -rounded);
  // The contact's velocity is that of the solid's point there.
  const Eigen::Matrix3d turn = met->way.rotation(ended).toRotationMatrix();
  constexpr double kLater = 1e-4;
  const Vec3d local = turn.transpose() * (point - met->way.position(ended));
  const Vec3d later = met->way.position(ended + kLater) + met->way.rotation(ended + kLater) * local;
  const Vec3d surface = (later - point) / kLater / static_cast<double>(kStepS);
  EXPECT_LT((surface - vector_at(contact.surface_velocity, env).cast<double>()).norm(), 0.05 + 1e-3 * surface.norm());
}

// Bodies of 1 mm to 20 m that pass a drone at most `length` (m) per motion and turn by up to `most_degrees`.
void meet_bodies(unsigned seed, long motions, float length, float most_degrees) {
  Random random(seed + 100U * part_tried());
  motions = times_tried(motions);
  ContactTally tally;
  while (tally.motions < motions) {
    std::vector<Primitive> statics{primitive(PrimitiveKind::sphere, {500, 0, 0}, Vec3::Ones())};
    const auto boxes = random.generator()() % 3;
    const Vec3 away = random.generator()() % 8 == 0 ? random.point(1000.0F) : Vec3(Vec3::Zero());
    for (std::size_t i = 0; i < boxes; ++i) {
      statics.push_back(primitive(PrimitiveKind::box, away + random.point(2.5F),
                                  random.point(0.6F).cwiseAbs() + Vec3::Constant(0.01F), random.rotation()));
    }
    BodyEnvs envs(BodyEnvs::config(16, 3), statics);
    envs.spawn([&random] { return any_body(random, 1e-3F, 20.0F); });
    for (int round = 0; round < 4; ++round) {
      std::vector<Way> drones(envs.envs);
      std::vector<float> start(3 * envs.envs), start_quat(4 * envs.envs), target(start), target_quat(start_quat);
      for (std::size_t env = 0; env < envs.envs; ++env) {
        Way& drone = drones[env];
        drone.from = drone.to = {away + random.point(0.7F), random.rotation()};
        if (random.within(0, 1) < 0.7F) {
          drone.to.position += random.point(length);
          if (random.within(0, 1) < 0.6F) drone.to.rotation = turned_by(random, most_degrees, drone.from.rotation);
        }
        put(start, env, drone.from.position);
        put(start_quat, env, drone.from.rotation);
        put(target, env, drone.to.position);
        put(target_quat, env, drone.to.rotation);
        for (std::size_t row = env * envs.slots; row < (env + 1) * envs.slots; ++row) {
          // At a time, two planes across `towards` enclose a gap between drone and body, which may be negative.
          const Vec3 way = random.within(0, 1) < 0.1F ? Vec3(Vec3::Zero()) : random.point(length);
          const Vec3 towards = random.direction().normalized();
          const float time = random.within(0, 1), gap = std::min(length, 0.6F) * random.within(-0.4F, 0.2F);
          Mover body = envs.solids(env)[row - env * envs.slots];
          body.way.from = body.way.to = {Vec3::Zero(), random.rotation()};
          const Vec3d across = towards.cast<double>();
          const Vec3d hull = oracle::hull_at(tried_drone(), Vec3d::Zero(), drone.rotation(time))(across);
          const auto reach = static_cast<float>(across.dot(hull) + body.rounding() - across.dot(body.core(0.0)(-across)));
          const Vec3 aside = random.within(0, 1) < 0.5F ? Vec3(Vec3::Zero()) : random.point(0.3F * body.half.minCoeff());
          const Vec3 near = drone.position(time).cast<float>();
          put(envs.position, row, Vec3(near + (reach + gap) * towards + aside - aside.dot(towards) * towards - time * way));
          put(envs.quat, row, body.way.from.rotation);
          put(envs.velocity, row, Vec3(way / kStepS));
          const float turn = most_degrees * std::numbers::pi_v<float> / 180.0F / kStepS;
          const float turned = random.within(0, 1) < 0.7F ? random.within(0, turn) : 0.0F;
          put(envs.turning, row, Vec3(turned * random.direction().normalized()));
        }
      }
      envs.batch.set_pose(start, start_quat);
      envs.batch.bodies().set_pose(envs.position, envs.quat);
      envs.batch.bodies().set_velocity(envs.velocity, envs.turning);
      std::vector<std::vector<Mover>> movers;
      for (std::size_t env = 0; env < envs.envs; ++env) movers.push_back(envs.solids(env));
      envs.batch.move(target, target_quat);
      for (std::size_t env = 0; env < envs.envs; ++env) {
        SCOPED_TRACE(::testing::Message() << "motion " << tally.motions);
        for (Mover& mover : movers[env]) {
          if (mover.number >= 0) mover.way.to = envs.body(env * envs.slots + static_cast<std::size_t>(mover.number));
        }
        check_contact(envs, env, movers[env], drones[env], tally);
        ASSERT_FALSE(::testing::Test::HasFailure());
      }
    }
  }
  EXPECT_GT(tally.of_bodies, tally.motions / 10);
  EXPECT_GT(tally.frees, tally.motions / 20);
  EXPECT_LT(tally.insides, tally.motions / 2);
  EXPECT_LT(tally.skipped, tally.motions / 50);
  std::ostringstream text;
  text << tally.motions << " motions, " << tally.hits << " hits, " << tally.of_bodies << " of bodies, " << tally.frees
       << " free, " << tally.insides << " begin inside, " << tally.skipped << " at the standoff";
  ::testing::Test::RecordProperty("counts", text.str());
  testing::tried("encounters", tally.hits + tally.frees);
}

TEST(Encounters, SlowBodies) { meet_bodies(1, 3000, 0.3F, 0.0F); }
TEST(Encounters, SlowTurningBodies) { meet_bodies(2, 2000, 0.2F, 20.0F); }
TEST(Encounters, FastBodies) { meet_bodies(3, 1500, 5.0F, 0.0F); }
TEST(Encounters, FastTurningBodies) { meet_bodies(4, 500, 1.0F, 170.0F); }

}  // namespace
}  // namespace flockstep
