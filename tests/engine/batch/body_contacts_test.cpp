// Drones of a batch among bodies that move, against fine stepping with an independent convex distance: first contacts, pushes
// among walls and other bodies, and thin plates that nothing passes.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <sstream>
#include <utility>
#include <vector>

#include "batch_helpers.hpp"
#include "collision/sweep.hpp"
#include "convex_oracle.hpp"
#include "flockstep/batch.hpp"
#include "random.hpp"
#include "tried.hpp"

namespace flockstep {
namespace {

using oracle::Vec3d;
using testing::Random;

constexpr float kStepS = 0.1F;  // of a kinematic batch, one tick

const DroneModel& tried_drone() {
  static const DroneModel model = DroneModel::quadrotor650();
  return model;
}

// A motion in double precision: the position along the segment and the rotation along the shortest arc.
struct Way {
  Pose from, to;

  Vec3d position(double time) const { return (1.0 - time) * from.position.cast<double>() + time * to.position.cast<double>(); }
  Eigen::Quaterniond rotation(double time) const {
    return from.rotation.cast<double>().normalized().slerp(time, to.rotation.cast<double>().normalized());
  }
  Vec3d shift() const { return (to.position - from.position).cast<double>(); }
  double turn() const {
    return from.rotation.cast<double>().normalized().angularDistance(to.rotation.cast<double>().normalized());
  }
};

// A convex solid and its motion. A room is hollow, and a mesh is its convex hull.
struct Mover {
  PrimitiveKind kind = PrimitiveKind::box;
  Vec3 half = Vec3::Ones();
  Way way;
  int number = -1;  // of the body; -1: static
  const TriangleMesh* mesh = nullptr;

  double radius() const { return half.cast<double>().norm(); }

  // The solid at a time. Spheres and capsules are the points within rounding() of it.
  oracle::Support core(double time) const {
    const Vec3d position = way.position(time);
    if (kind == PrimitiveKind::sphere) return oracle::polytope({position});
    const Eigen::Matrix3d rotation = way.rotation(time).toRotationMatrix();
    if (mesh != nullptr) {
      std::vector<Vec3d> corners;
      for (const Vec3& vertex : mesh->vertices) corners.emplace_back(position + rotation * vertex.cast<double>());
      return oracle::polytope(std::move(corners));
    }
    if (kind == PrimitiveKind::capsule) {
      const Vec3d up = static_cast<double>(half.z() - half.x()) * rotation.col(2);
      return oracle::polytope({position + up, position - up});
    }
    const oracle::Support local = oracle::solid({.kind = kind, .half_extents = half});
    return [=](const Vec3d& d) -> Vec3d { return position + rotation * local(rotation.transpose() * d); };
  }
  double rounding() const {
    return kind == PrimitiveKind::sphere || kind == PrimitiveKind::capsule ? static_cast<double>(half.x()) : 0.0;
  }

  // Returns the distance from a hull at a time, or a lower bound of it that exceeds `enough`.
  double distance(double time, const Way& drone, double drone_time, double enough) const {
    const Vec3d at = drone.position(drone_time);
    if (kind == PrimitiveKind::room) {
      const oracle::Support hull = oracle::hull_at(tried_drone(), at, drone.rotation(drone_time));
      double least = std::numeric_limits<double>::infinity();
      for (int axis = 0; axis < 3; ++axis) {
        const Vec3d d = Vec3d::Unit(axis);
        const auto size = static_cast<double>(half[axis]);
        least = std::min({least, size - hull(d)[axis], size + hull(-d)[axis]});
      }
      return least;
    }
    const double reach = radius() + static_cast<double>(tried_drone().radius());
    const double apart = (at - way.position(time)).norm() - reach;
    if (apart > enough) return apart;
    const oracle::Support hull = oracle::hull_at(tried_drone(), at, drone.rotation(drone_time));
    return oracle::distance(hull, core(time)).lower - rounding();
  }
};

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

// Returns the first time at which the hull is within the standoff of a solid, or a value above 1. Steps by 20 um or by the
// current distance, whichever is larger.
double first_time_by_steps(const std::vector<Mover>& movers, const Way& drone) {
  double first = 2.0;
  for (const Mover& mover : movers) {
    const double speed = relative_speed(mover, drone);
    for (double time = 0.0; time <= 1.0 && time < first;) {
      const double beyond = mover.distance(time, drone, time, 0.5) - standoff_of(drone);
      if (beyond <= 0.0) {
        first = time;
        break;
      }
      time = time < 1.0 ? std::min(1.0, time + std::max(beyond, 2e-5) / speed) : 2.0;
    }
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

float any_size(Random& random, float least, float most) {
  return least * std::exp(random.within(0.0F, 1.0F) * std::log(most / least));
}

BodyConfig any_body(Random& random, float least, float most) {
  BodyConfig body;
  body.shape = static_cast<BodyShape>(random.generator()() % 5);
  body.size_m = {any_size(random, least, most), any_size(random, least, most), any_size(random, least, most)};
  if (body.shape == BodyShape::mesh) {
    TriangleMesh mesh;
    for (std::int32_t i = 0; i < 12; ++i) {
      mesh.vertices.push_back(0.5F * Vec3(Vec3::Map(body.size_m.data())).cwiseProduct(random.point(1.0F)));
      if (i % 3 == 0) mesh.triangles.push_back({i, i + 1, i + 2});
    }
    body.mesh = testing::make_world({}, {}, std::move(mesh));
    body.size_m = BodyConfig().size_m;
    return body;
  }
  if (body.shape != BodyShape::box) body.size_m[1] = body.size_m[0];
  if (body.shape == BodyShape::sphere) body.size_m[2] = body.size_m[0];
  if (body.shape == BodyShape::capsule) body.size_m[2] += body.size_m[0];
  return body;
}

PrimitiveKind primitive_kind(BodyShape shape) {
  constexpr std::array kKinds{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule};
  return kKinds[static_cast<std::size_t>(shape)];
}

Quat turned_by(Random& random, float most_degrees, const Quat& from) {
  const float angle = random.within(0.0F, most_degrees) * std::numbers::pi_v<float> / 180.0F;
  return (Quat(Eigen::AngleAxisf(angle, random.direction().normalized())) * from).normalized();
}

// Rows of an array of positions, rotations or velocities.
void put(std::vector<float>& array, std::size_t row, const Vec3& value) {
  std::copy_n(value.data(), 3, array.begin() + static_cast<std::ptrdiff_t>(3 * row));
}
void put(std::vector<float>& array, std::size_t row, const Quat& q) {
  const std::array<float, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
  std::copy_n(wxyz.data(), 4, array.begin() + static_cast<std::ptrdiff_t>(4 * row));
}
Vec3 vector_at(const std::vector<float>& array, std::size_t row) { return Vec3::Map(array.data() + 3 * row); }
Pose pose_at(const std::vector<float>& position, const std::vector<float>& quat, std::size_t row) {
  const float* const q = quat.data() + 4 * row;
  return {vector_at(position, row), Quat(q[0], q[1], q[2], q[3])};
}

// Envs of one drone each, among bodies of their own, in one static world.
class BodyEnvs {
 public:
  std::vector<Primitive> statics;
  std::size_t envs, slots;
  Batch batch;
  std::vector<float> position, quat, velocity, turning;  // of bodies, for the next call

  BodyEnvs(const BatchConfig& config, std::vector<Primitive> static_solids)
      : statics(std::move(static_solids)),
        envs(static_cast<std::size_t>(config.num_envs)),
        slots(static_cast<std::size_t>(config.max_bodies)),
        batch(config, {testing::make_world(statics)}),
        position(3 * envs * slots),
        quat(4 * envs * slots),
        velocity(3 * envs * slots),
        turning(3 * envs * slots) {}

  static BatchConfig config(int envs, int slots) {
    BatchConfig config;
    config.num_envs = envs;
    config.num_threads = 1;
    config.max_bodies = slots;
    config.clock.policy_hz = 1.0F / kStepS;
    return config;
  }

  // Fills every slot of every env.
  template <class F>
  void spawn(const F& make) {
    for (std::size_t slot = 0; slot < slots; ++slot) {
      for (std::size_t env = 0; env < envs; ++env) {
        std::vector<std::uint8_t> only(envs, 0);
        only[env] = 1;
        batch.spawn_bodies(make(), {}, {}, {}, {}, only);
      }
    }
  }

  Pose drone(std::size_t env) const { return pose_at(batch.state().position, batch.state().quat_wxyz, env); }
  Pose body(std::size_t row) const { return pose_at(batch.state().bodies.position, batch.state().bodies.quat_wxyz, row); }
  const BodyConfig& config_of(std::size_t row) const {
    return *batch.body_config(static_cast<std::int64_t>(row / slots), static_cast<std::int64_t>(row % slots));
  }

  // The solids that a drone may meet, with bodies that stand at their current poses.
  std::vector<Mover> solids(std::size_t env) const {
    std::vector<Mover> solids;
    for (std::size_t slot = 0; slot < slots; ++slot) {
      const BodyConfig& config = config_of(env * slots + slot);
      const Pose pose = body(env * slots + slot);
      Mover solid{PrimitiveKind::box, 0.5F * Vec3::Map(config.size_m.data()), {pose, pose}, static_cast<int>(slot)};
      if (config.mesh != nullptr) {
        solid.mesh = &config.mesh->triangles();
        solid.half = config.mesh->bounds().min.cwiseAbs().cwiseMax(config.mesh->bounds().max.cwiseAbs());
      } else {
        solid.kind = primitive_kind(config.shape);
      }
      solids.push_back(solid);
    }
    for (const Primitive& solid : statics) {
      const Pose pose{solid.center, solid.rotation};
      solids.push_back({solid.kind, solid.half_extents, {pose, pose}, -1});
    }
    return solids;
  }
};

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
  Random random(seed + 100U * testing::part_tried());
  motions = testing::times_tried(motions);
  ContactTally tally;
  while (tally.motions < motions) {
    std::vector<Primitive> statics{testing::primitive(PrimitiveKind::sphere, {500, 0, 0}, Vec3::Ones())};
    const auto boxes = random.generator()() % 3;
    const Vec3 away = random.generator()() % 8 == 0 ? random.point(1000.0F) : Vec3(Vec3::Zero());
    for (std::size_t i = 0; i < boxes; ++i) {
      statics.push_back(testing::primitive(PrimitiveKind::box, away + random.point(2.5F),
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
      envs.batch.set_body_pose(envs.position, envs.quat);
      envs.batch.set_body_velocity(envs.velocity, envs.turning);
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

// -- Pushes among walls and other bodies.

// Returns true if the drone is proved to be apart from the solid.
bool is_apart(const Mover& solid, const Pose& drone) { return solid.distance(1.0, {drone, drone}, 0.0, 0.0) > 0.0; }

// Bodies that fly to and fro in a room with two obstacles. At most `length` (m) per motion.
class Shoving {
 public:
  Shoving(const BatchConfig& config, Random& random, float length, float motion_s)
      : random_(random), speed_(length / motion_s), envs(config, statics_of(random)) {
    envs.spawn([this] { return any_body(random_, 5e-3F, 1.2F); });
    for (std::size_t env = 0; env < envs.envs; ++env) begin(env);
  }

  // Puts the drone of an env and its bodies elsewhere; the drone is free.
  void begin(std::size_t env) {
    std::vector<Mover> solids = envs.solids(env);
    Pose pose;
    do {
      pose = {random_.point(1.2F), random_.rotation()};
    } while (!std::all_of(solids.begin(), solids.end(),
                          [&pose](const Mover& solid) { return solid.number >= 0 || is_apart(solid, pose); }));
    std::vector<float> position(batch().state().position), quat(batch().state().quat_wxyz);
    put(position, env, pose.position);
    put(quat, env, pose.rotation);
    std::vector<std::uint8_t> drone_mask(envs.envs, 0), body_mask(envs.envs * envs.slots, 0);
    drone_mask[env] = 1;
    batch().set_pose(position, quat, drone_mask);
    for (Mover& solid : solids) {
      if (solid.number < 0) continue;
      const std::size_t row = env * envs.slots + static_cast<std::size_t>(solid.number);
      do {
        solid.way.from = solid.way.to = {random_.point(1.7F), random_.rotation()};
      } while (!is_apart(solid, pose));
      put(envs.position, row, solid.way.to.position);
      put(envs.quat, row, solid.way.to.rotation);
      body_mask[row] = 1;
    }
    batch().set_body_pose(envs.position, envs.quat, body_mask);
    for (std::size_t slot = 0; slot < envs.slots; ++slot) turn_back(env * envs.slots + slot);
    batch().set_body_velocity(envs.velocity, envs.turning, body_mask);
    was_inside_[env] = false;
    age_[env] = 0;
  }

  // Call it before each motion: bodies that leave the room turn back.
  void steer() {
    for (std::size_t row = 0; row < envs.envs * envs.slots; ++row) {
      const Vec3 at = envs.body(row).position;
      if (at.cwiseAbs().maxCoeff() > 1.8F || random_.generator()() % 64 == 0) turn_back(row);
    }
    batch().set_body_velocity(envs.velocity, envs.turning);
  }

  // Call it after each motion.
  void check(long motion) {
    const ContactState& contact = batch().state().contact;
    for (std::size_t env = 0; env < envs.envs; ++env, ++motions) {
      const Pose pose = envs.drone(env);
      for (const Mover& solid : envs.solids(env)) {
        if (is_apart(solid, pose)) continue;
        ASSERT_GE(solid.number, 0) << "in a wall or an obstacle: motion " << motion << ", env " << env;
        ASSERT_TRUE(contact.inside[env]) << "in body " << solid.number << ": motion " << motion << ", env " << env;
      }
      pushes += contact.body[env] >= 0;
      squeezes += !was_inside_[env] && contact.inside[env];
      was_inside_[env] = contact.inside[env];
      if (++age_[env] > 400 || (was_inside_[env] && random_.generator()() % 8 == 0)) begin(env);
    }
  }

  Batch& batch() { return envs.batch; }

 private:
  static std::vector<Primitive> statics_of(Random& random) {
    std::vector<Primitive> statics{testing::primitive(PrimitiveKind::room, Vec3::Zero(), {2, 2, 2})};
    for (int i = 0; i < 2; ++i) {
      BodyConfig shape;
      do {
        shape = any_body(random, 0.02F, 1.0F);
      } while (shape.mesh != nullptr);
      const Quat turn = shape.shape == BodyShape::sphere ? Quat::Identity() : random.rotation();
      statics.push_back(testing::primitive(primitive_kind(shape.shape), random.point(1.8F),
                                           0.5F * Vec3(shape.size_m[0], shape.size_m[1], shape.size_m[2]), turn));
    }
    return statics;
  }

  void turn_back(std::size_t row) {
    const Vec3 target = random_.within(0, 1) < 0.7F ? envs.drone(row / envs.slots).position : random_.point(1.0F);
    const Vec3 way = target - envs.body(row).position;
    put(envs.velocity, row, Vec3(random_.within(0.1F, 1.0F) * speed_ * (way.normalized() + 0.2F * random_.direction())));
    const float turn = random_.within(0, 1) < 0.5F ? 0.0F : random_.within(0.0F, 2.0F) * speed_;
    put(envs.turning, row, Vec3(std::min(turn, 30.0F) * random_.direction().normalized()));
  }

  Random& random_;
  float speed_;

 public:
  BodyEnvs envs;
  long motions = 0, pushes = 0, squeezes = 0;

 private:
  std::vector<bool> was_inside_ = std::vector<bool>(envs.envs, false);
  std::vector<int> age_ = std::vector<int>(envs.envs, 0);
};

constexpr int kShovedEnvs = 16, kShovingBodies = 4;

void report_shoves(long motions, long pushes, long squeezes) {
  EXPECT_GT(pushes, motions / 50);
  EXPECT_GT(squeezes, 0);
  EXPECT_LT(squeezes, pushes / 2);
  std::ostringstream text;
  text << motions << " motions, " << pushes << " pushes, " << squeezes << " squeezes";
  ::testing::Test::RecordProperty("counts", text.str());
  testing::tried("shoves", pushes);
}

void shove_kinematic(unsigned seed, long wanted, float length) {
  Random random(seed + 100U * testing::part_tried());
  wanted = testing::times_tried(wanted);
  long motions = 0, pushes = 0, squeezes = 0;
  while (pushes < wanted) {
    Shoving shoving(BodyEnvs::config(kShovedEnvs, kShovingBodies), random, length, kStepS);
    for (long motion = 0; motion < 100; ++motion) {
      std::vector<float> target(3 * kShovedEnvs), quat(4 * kShovedEnvs);
      for (std::size_t env = 0; env < kShovedEnvs; ++env) {
        const Pose pose = shoving.envs.drone(env);
        const bool stands = random.within(0, 1) < 0.4F;
        put(target, env, stands ? pose.position : Vec3(pose.position + random.point(std::min(length, 0.5F))));
        put(quat, env, stands ? pose.rotation : turned_by(random, 20.0F, pose.rotation));
      }
      shoving.steer();
      shoving.batch().move(target, quat);
      shoving.check(motion);
      if (::testing::Test::HasFatalFailure()) return;
    }
    motions += shoving.motions;
    pushes += shoving.pushes;
    squeezes += shoving.squeezes;
  }
  report_shoves(motions, pushes, squeezes);
}

TEST(Shoves, OfKinematicDronesBySlowBodies) { shove_kinematic(21, 1000, 0.1F); }
TEST(Shoves, OfKinematicDronesByFastBodies) { shove_kinematic(22, 1000, 1.0F); }
TEST(Shoves, OfKinematicDronesAt50MetresPerSecond) { shove_kinematic(23, 1000, 5.0F); }

BatchConfig rotor_config(OnContact on_contact, int envs, int slots) {
  BatchConfig config = BodyEnvs::config(envs, slots);
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::velocity;
  config.dynamics.on_contact = on_contact;
  config.clock.policy_hz = 50.0F;
  config.clock.physics_hz = 500.0F;
  return config;
}

// Bodies at up to `speed` (m/s), observed after every tick.
void shove_rotors(unsigned seed, long wanted, float speed) {
  Random random(seed + 100U * testing::part_tried());
  wanted = testing::times_tried(wanted);
  long motions = 0, pushes = 0, squeezes = 0;
  for (int scene = 0; pushes < wanted; ++scene) {
    constexpr std::array kAll{OnContact::terminate, OnContact::stop, OnContact::bounce};
    constexpr float kTickS = 0.002F;
    const auto on_contact = kAll[static_cast<std::size_t>(scene) % kAll.size()];
    Shoving shoving(rotor_config(on_contact, kShovedEnvs, kShovingBodies), random, speed * kTickS, kTickS);
    std::vector<float> command(4 * kShovedEnvs);
    for (long tick = 0; tick < 500; ++tick) {
      if (tick % 20 == 0) {
        for (float& value : command) value = random.within(-3.0F, 3.0F);
      }
      if (tick % 10 == 0) shoving.steer();
      shoving.batch().fly(command, 1);
      shoving.check(tick);
      if (::testing::Test::HasFatalFailure()) return;
    }
    motions += shoving.motions;
    pushes += shoving.pushes;
    squeezes += shoving.squeezes;
  }
  report_shoves(motions, pushes, squeezes);
}

TEST(Shoves, OfDronesWithRotors) { shove_rotors(24, 1000, 10.0F); }
TEST(Shoves, OfDronesWithRotorsAt50MetresPerSecond) { shove_rotors(25, 1000, 50.0F); }

// -- Thin plates. A plate of 5 mm is so large that there is no way around it, and nothing else is there that could squeeze a
// drone: it is never inside, and stays on its side of the plate.

// Drones and plates that approach each other at 50 m/s or more, each pair in an env.
class Plates {
 public:
  static constexpr int kEnvs = 16;
  static constexpr float kHalfSide = 500.0F, kApproach = 50.0F;  // m, m/s

  Plates(const BatchConfig& config, Random& random)
      : envs(config, {testing::primitive(PrimitiveKind::sphere, {5000, 0, 0}, Vec3::Ones())}) {
    envs.spawn([] {
      BodyConfig plate;
      plate.size_m = {0.005F, 2.0F * kHalfSide, 2.0F * kHalfSide};
      return plate;
    });
    std::vector<float> position(3 * envs.envs), quat(4 * envs.envs);
    for (std::size_t env = 0; env < envs.envs; ++env) {
      sides_.push_back(random.generator()() % 2 == 0 ? 1.0F : -1.0F);
      parts_.push_back(random.generator()() % 3 == 0 ? 1.0F : random.within(0, 1));
      const Pose drone{random.point(2.0F), random.rotation()};
      put(position, env, drone.position);
      put(quat, env, drone.rotation);
      const Quat turn = random.rotation();
      const Vec3 normal = sides_[env] * (turn * Vec3::UnitX());
      const Vec3 along = turn * Vec3(0, random.within(-1, 1), random.within(-1, 1));
      put(envs.position, env,
          Vec3(drone.position - (tried_drone().radius() + 0.003F + random.within(0.0F, 1.0F)) * normal + 50.0F * along));
      put(envs.quat, env, turn);
      put(envs.velocity, env, Vec3(parts_[env] * kApproach * normal + random.within(0, 20) * along));
      const float rate = random.generator()() % 2 == 0 ? 0.0F : random.within(0.0F, 0.5F);  // rad/s
      put(envs.turning, env, Vec3(rate * random.direction().normalized()));
    }
    envs.batch.set_pose(position, quat);
    envs.batch.set_body_pose(envs.position, envs.quat);
    envs.batch.set_body_velocity(envs.velocity, envs.turning);
  }

  // Normal of the face that is towards the drone.
  Vec3 normal(std::size_t env) const { return sides_[env] * (envs.body(env).rotation * Vec3::UnitX()); }
  // Velocity of the drone, which makes up for the approach that its plate lacks.
  Vec3 speed(std::size_t env) const { return -(1.0F - parts_[env]) * kApproach * normal(env); }

  // Call it after each motion.
  void check(long motion) {
    const ContactState& contact = envs.batch.state().contact;
    for (std::size_t env = 0; env < envs.envs; ++env, ++motions) {
      const Pose drone = envs.drone(env), plate = envs.body(env);
      const Vec3d face = normal(env).cast<double>().normalized();
      const oracle::Support hull = oracle::hull_at(tried_drone(), drone.position.cast<double>(), drone.rotation.cast<double>());
      const Vec3d apart = hull(-face) - plate.position.cast<double>();
      ASSERT_GT(face.dot(apart), 0.0025) << "motion " << motion << ", env " << env;
      ASSERT_LT((apart - face.dot(apart) * face).cwiseAbs().maxCoeff(), static_cast<double>(kHalfSide) - 2.0);
      ASSERT_FALSE(contact.inside[env]) << "motion " << motion << ", env " << env;
      pushes += contact.body[env] >= 0;
    }
  }

  BodyEnvs envs;
  long motions = 0, pushes = 0;

 private:
  std::vector<float> sides_, parts_;  // parts: of the approach that is the plate's
};

void report_plates(long motions, long pushes) {
  EXPECT_GT(pushes, motions / 4);
  ::testing::Test::RecordProperty("counts", std::to_string(motions) + " motions, " + std::to_string(pushes) + " pushes");
  testing::tried("shoves", pushes);
}

TEST(Shoves, NoKinematicDronePassesAThinPlate) {
  Random random(31U + 100U * testing::part_tried());
  const long wanted = testing::times_tried(1000);
  long motions = 0, pushes = 0;
  while (pushes < wanted) {
    Plates plates(BodyEnvs::config(Plates::kEnvs, 1), random);
    for (long motion = 0; motion < 20; ++motion) {
      std::vector<float> target(3 * plates.envs.envs), quat(4 * plates.envs.envs);
      for (std::size_t env = 0; env < plates.envs.envs; ++env) {
        const Pose pose = plates.envs.drone(env);
        put(target, env, Vec3(pose.position + kStepS * plates.speed(env)));
        put(quat, env, random.within(0, 1) < 0.5F ? pose.rotation : turned_by(random, 90.0F, pose.rotation));
      }
      plates.envs.batch.move(target, quat);
      ASSERT_NO_FATAL_FAILURE(plates.check(motion));
    }
    motions += plates.motions;
    pushes += plates.pushes;
  }
  report_plates(motions, pushes);
}

TEST(Shoves, NoDroneWithRotorsPassesAThinPlate) {
  Random random(32U + 100U * testing::part_tried());
  const long wanted = testing::times_tried(1000);
  long motions = 0, pushes = 0;
  for (int scene = 0; pushes < wanted; ++scene) {
    constexpr std::array kAll{OnContact::terminate, OnContact::stop, OnContact::bounce};
    Plates plates(rotor_config(kAll[static_cast<std::size_t>(scene) % kAll.size()], Plates::kEnvs, 1), random);
    std::vector<float> command(4 * plates.envs.envs), velocity(3 * plates.envs.envs), turning(3 * plates.envs.envs);
    for (long tick = 0; tick < 200; ++tick) {
      if (tick % 10 == 0) {  // again towards the plate
        for (std::size_t env = 0; env < plates.envs.envs; ++env) {
          put(velocity, env, plates.speed(env));
          put(turning, env, random.point(20.0F));
          put(command, env, Quat(-1, -1, -1, 1));
        }
        plates.envs.batch.set_velocity(velocity, turning, {});
      }
      plates.envs.batch.fly(command, 1);
      ASSERT_NO_FATAL_FAILURE(plates.check(tick));
    }
    motions += plates.motions;
    pushes += plates.pushes;
  }
  report_plates(motions, pushes);
}

}  // namespace
}  // namespace flockstep
