// Contacts of rotor drones with bodies that move: closed forms, and random crowds with an independent distance.
#include "dynamics/contact.hpp"

#include "base/pose_access.hpp"
#include "batch_helpers.hpp"
#include "collide.hpp"
#include "collision/moving_bodies.hpp"
#include "convex_oracle.hpp"
#include "dynamics/rotor_motion.hpp"
#include "flight_state.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

using dynamics::GroupMember;
using dynamics::TickMotion;
using namespace testing;

constexpr float kTick = 0.002F;          // s
constexpr float kNear = 5e-3F;           // m, more than the standoff
const Vec3 kPlate(0.5F, 0.5F, 0.0025F);  // m, half extents
const ClockConfig kClock{.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = 250.0F};

// The arrays of the bodies of some envs.
class Bodies {
 public:
  void add(PrimitiveKind kind, const Vec3& half_extents, const Pose& from, const Pose& to) {
    solids_.push_back(primitive(kind, Vec3::Zero(), half_extents));
    for (auto* const array : {&from_position_, &position_}) array->resize(3 * solids_.size());
    for (auto* const array : {&from_quat_, &quat_}) array->resize(4 * solids_.size());
    reach_.resize(solids_.size());
    move(solids_.size() - 1, from, to);
  }
  void add_plate(const Vec3& from, const Vec3& velocity) {
    add(PrimitiveKind::box, kPlate, {from, Quat::Identity()}, {from + kTick * velocity, Quat::Identity()});
  }
  void move(std::size_t body, const Pose& from, const Pose& to) {
    store_pose(from_position_.data() + 3 * body, from_quat_.data() + 4 * body, from);
    store_pose(position_.data() + 3 * body, quat_.data() + 4 * body, to);
    reach_[body] = 1.001F * (solids_[body].half_extents.norm() + (to.position - from.position).norm());
  }
  // Each body moves on by `way`.
  void go_on(const Vec3& way) {
    for (std::size_t body = 0; body < solids_.size(); ++body)
      move(body, pose(body), {pose(body).position + way, pose(body).rotation});
  }
  Pose pose(std::size_t body) const { return load_pose(position_.data() + 3 * body, quat_.data() + 4 * body); }
  std::size_t count() const { return solids_.size(); }
  Primitive solid(std::size_t body) const {
    Primitive at = solids_[body];
    at.center = pose(body).position;
    at.rotation = pose(body).rotation;
    return at;
  }
  collision::MovingBodies view() const {
    pointers_.clear();
    for (const Primitive& solid : solids_) pointers_.push_back(&solid);
    return {from_position_.data(), from_quat_.data(), position_.data(), quat_.data(),
            reach_.data(),         pointers_.data(),  nullptr,          count()};
  }

 private:
  std::vector<float> from_position_, from_quat_, position_, quat_, reach_;
  std::vector<Primitive> solids_;
  mutable std::vector<const Primitive*> pointers_;
};

double distance(const Pose& drone, const Primitive& solid) {
  const oracle::Support hull = oracle::hull_at(quadrotor(), drone);
  return oracle::distance_from(hull, solid);
}

double distance(const Pose& drone, const Bodies& bodies) {
  double least = 1e9;
  for (std::size_t body = 0; body < bodies.count(); ++body) least = std::min(least, distance(drone, bodies.solid(body)));
  return least;
}

float bottom() {
  float z = 0.0F;
  for (const Vec3& point : quadrotor().hull()) z = std::min(z, point.z());
  return z;
}

DynamicsConfig config_of(OnContact on_contact, float restitution = 0.3F) {
  return {.motion = Motion::rotors, .on_contact = on_contact, .restitution = restitution};
}

class Yard {
 public:
  explicit Yard(const std::vector<Primitive>& statics = {primitive(PrimitiveKind::room, Vec3::Zero(), {50, 50, 50})})
      : world_(make_world(statics)), obstacles_(prepared(*world_).obstacles()), hull_(quadrotor()) {}

  // The drone moves at a constant velocity for one tick.
  GroupMember hit(const Bodies& bodies, const DynamicsConfig& config, const Pose& from, const Vec3& velocity) {
    GroupMember drone;
    drone.airframe = &*quadrotor().airframe();
    drone.motion = {
        from, {from.position + kTick * velocity, from.rotation}, {velocity, Vec3::Zero()}, {velocity, Vec3::Zero()}, kTick};
    contacts_.resolve(drone, obstacles_, bodies.view(), config);
    return drone;
  }
  // The drone stands, with an earlier contact.
  GroupMember push(const Bodies& bodies, const Pose& pose) {
    GroupMember drone;
    drone.motion = dynamics::standing(pose, kTick);
    drone.has_contact = drone.is_fixed = true;
    contacts_.resolve(drone, obstacles_, bodies.view(), {});
    return drone;
  }

 private:
  std::shared_ptr<const World> world_;
  const collision::Obstacles& obstacles_;
  collision::Hull hull_;
  collision::Corners corners_{quadrotor().hull()};
  dynamics::ContactResolver contacts_{hull_, corners_};
};

const Pose kOrigin{Vec3::Zero(), Quat::Identity()};

// A plate of 5 mm comes from below, the drone flies down, or both. v' = u - e (v - u).
TEST(ContactWithABody, ThrowsTheDroneBackRelativeToTheSurface) {
  Yard yard;
  for (const float restitution : {0.3F, 1.0F}) {
    for (const auto& [plate, drone] : {std::pair(50.0F, 0.0F), std::pair(0.0F, -50.0F), std::pair(25.0F, -25.0F),
                                       std::pair(-10.0F, -60.0F), std::pair(60.0F, 10.0F)}) {
      SCOPED_TRACE(::testing::Message() << restitution << ' ' << plate << ' ' << drone);
      Bodies bodies;
      bodies.add_plate({0, 0, bottom() - 0.05F}, {0, 0, plate});
      const GroupMember result = yard.hit(bodies, config_of(OnContact::bounce, restitution), kOrigin, {0, 0, drone});
      ASSERT_TRUE(result.contact.hit);
      EXPECT_EQ(result.contact.body, 0);
      EXPECT_FALSE(result.contact.inside);
      EXPECT_NEAR(result.contact.velocity.z(), plate, 1e-3F);
      EXPECT_NEAR(result.velocity.linear.z(), plate - restitution * (drone - plate), 0.05F);
      EXPECT_GT(distance(result.pose, bodies), 0.0);
      EXPECT_GT(result.pose.position.z(), bodies.pose(0).position.z()) << "it is still above";
    }
  }
}

TEST(ContactWithABody, StopsOnAPlateThatCarriesTheDrone) {
  Yard yard;
  Bodies bodies;
  const Vec3 speed(1, 0.5F, 2);
  bodies.add_plate({0, 0, bottom() - 0.0035F - 0.001F}, speed);
  Pose pose = kOrigin;
  Vec3 velocity = Vec3::Zero();
  for (int tick = 0; tick < 100; ++tick) {
    if (tick > 0) bodies.go_on(kTick * speed);
    const GroupMember result = yard.hit(bodies, config_of(OnContact::stop), pose, velocity - Vec3(0, 0, 0.02F));
    ASSERT_TRUE(result.contact.hit) << tick;
    ASSERT_FALSE(result.contact.inside) << tick;
    pose = result.pose;
    velocity = result.velocity.linear;
    ASSERT_LT((velocity - speed).norm(), 0.05F) << tick;
    const double gap = distance(pose, bodies);
    ASSERT_GT(gap, 0.0) << tick;
    ASSERT_LT(gap, kNear) << tick;
  }
  EXPECT_NEAR(pose.position.x(), 100 * kTick * speed.x(), 0.01F);
}

TEST(ContactWithABody, PushesADroneThatIsHeld) {
  Yard yard;
  Bodies bodies;
  bodies.add_plate({0, 0, bottom() - 0.05F}, {0, 0, 10});
  Pose pose = kOrigin;
  for (int tick = 0; tick < 50; ++tick) {
    if (tick > 0) bodies.go_on({0, 0, 10 * kTick});
    const GroupMember push = yard.push(bodies, pose);
    ASSERT_FALSE(push.contact.inside);
    pose = push.pose;
    ASSERT_GT(distance(pose, bodies), 0.0);
  }
  EXPECT_NEAR(pose.position.z(), bodies.pose(0).position.z() + 0.0025F - bottom(), kNear);
  Bodies away;
  away.add_plate({0, 0, bottom() - 0.05F}, {0, 0, -10});
  EXPECT_FALSE(yard.push(away, kOrigin).is_deflected);
}

TEST(ContactWithABody, IsReportedAsInsideBetweenPlates) {
  Yard yard;
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    Bodies bodies;
    bodies.add_plate({0, 0, -0.5F}, {0, 0, 240});
    bodies.add_plate({0, 0, 0.5F}, {0, 0, -240});
    const GroupMember result = yard.hit(bodies, config_of(on_contact), kOrigin, Vec3::Zero());
    EXPECT_TRUE(result.contact.hit);
    EXPECT_TRUE(result.contact.inside);
    EXPECT_EQ(result.velocity.linear, Vec3(Vec3::Zero()));
  }
}

// A door turns by 6 degrees about its edge into a drone that stands.
TEST(ContactWithABody, ADoorSweepsTheDroneAside) {
  Yard yard;
  const Vec3 half(1, 0.02F, 1);
  const auto door = [&](float degrees) {
    const Quat turn(Eigen::AngleAxisf(degrees * 0.01745329F, Vec3::UnitZ()));
    return Pose{Vec3(-1, -0.5F, 0) + turn * Vec3(1, 0, 0), turn};
  };
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    Bodies bodies;
    bodies.add(PrimitiveKind::box, half, door(0), door(0));
    Pose pose = kOrigin;
    Vec3 velocity = Vec3::Zero();
    int hits = 0;
    for (int tick = 0; tick < 12; ++tick) {
      bodies.move(0, bodies.pose(0), door(6.0F * static_cast<float>(tick + 1)));
      const GroupMember result = yard.hit(bodies, config_of(on_contact), pose, velocity);
      if (!result.is_deflected) {
        pose.position += kTick * velocity;
      } else {
        pose = result.pose;
        velocity = on_contact == OnContact::terminate ? Vec3(Vec3::Zero()) : result.velocity.linear;
      }
      hits += result.contact.hit;
      ASSERT_FALSE(result.contact.inside);
      ASSERT_GT(distance(pose, bodies), 0.0) << tick;
    }
    EXPECT_GT(hits, 0);
    EXPECT_GT(pose.position.y(), 0.2F);
  }
}

// A plate throws the drone against a wall, from which it returns: it has been farther away than it ends.
TEST(ContactWithABody, TheFarthestPointIsWhereTheDroneTurnsBack) {
  const Primitive room = primitive(PrimitiveKind::room, Vec3::Zero(), {1, 2, 2});
  Yard yard({room});
  const float length = 0.465F, gap = 0.1F, way = 0.4F;  // m: of the drone to the front, before the plate, of the plate
  Bodies bodies;
  const Pose from{{-length - gap - 0.05F, 0, 0}, Quat::Identity()}, to{from.position + Vec3(way, 0, 0), Quat::Identity()};
  bodies.add(PrimitiveKind::box, {0.05F, 1, 1}, from, to);
  const GroupMember result = yard.hit(bodies, config_of(OnContact::bounce, 1.0F), kOrigin, Vec3::Zero());
  const float to_wall = 1.0F - length;
  EXPECT_NEAR(result.reach, to_wall, 1e-3F);
  EXPECT_NEAR(result.pose.position.x(), to_wall - (2.0F * (way - gap) - to_wall), 2e-3F);
  EXPECT_EQ(result.contact.body, -1);
}

// A drone under the plate is pushed against the floor, which it does not enter.
TEST(ContactWithABody, NeverPushesTheDroneThroughAWall) {
  const Primitive room = primitive(PrimitiveKind::room, Vec3::Zero(), {3, 3, 1});
  Yard yard({room});
  Bodies bodies;
  bodies.add_plate({0, 0, 0.5F}, {0, 0, -700});
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    const GroupMember result = yard.hit(bodies, config_of(on_contact), kOrigin, Vec3::Zero());
    EXPECT_GT(distance(result.pose, room), 0.0);
    EXPECT_TRUE(result.contact.inside);
  }
}

// Drones of 16 envs in rooms, each among 8 bodies, flown by dynamics::fly.
class Crowds {
 public:
  static constexpr std::size_t kDrones = 16, kBodies = 8;

  Crowds(const DynamicsConfig& config, unsigned seed, std::size_t far = 0)
      : config_(config), per_env_(kBodies + far), random_(seed), state(flight_state(kDrones, 1)) {
    for (std::size_t env = 0; env < kDrones; ++env) {
      fleet.start(state, DroneIndex(env), {});
      drones_.emplace_back(env);
      for (std::size_t i = 0; i < kBodies; ++i) {
        constexpr PrimitiveKind kKinds[]{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere,
                                         PrimitiveKind::capsule};
        const PrimitiveKind kind = kKinds[i % 4];
        Vec3 half(random_.within(0.05F, 0.3F), random_.within(0.05F, 0.3F), random_.within(0.31F, 0.5F));
        if (kind != PrimitiveKind::box) half.y() = half.x();
        if (kind == PrimitiveKind::sphere) half.z() = half.x();
        const Vec3 at = 2.5F * random_.direction().normalized();
        const Pose pose{at, random_.rotation()};
        bodies.add(kind, half, pose, pose);
        speeds_.emplace_back(random_.point(6.0F));
      }
      for (std::size_t i = 0; i < far; ++i) {
        const Pose pose{{100, 100, 100}, Quat::Identity()};
        bodies.add(PrimitiveKind::sphere, {0.5F, 0.5F, 0.5F}, pose, pose);
        speeds_.emplace_back(Vec3::Zero());
      }
    }
    for (float& value : command_) value = random_.within(-1.0F, 1.0F);
  }

  void tick() {
    const bool is_new_step = tick_ % kClock.substeps() == 0;
    if (is_new_step && tick_ % 50 == 0) {
      for (float& value : command_) value = random_.within(-2.0F, 2.0F);
    }
    for (std::size_t body = 0; body < bodies.count(); ++body) {
      if (body % per_env_ >= kBodies) continue;
      const Pose from = bodies.pose(body);
      Vec3& speed = speeds_[body];
      for (int axis = 0; axis < 3; ++axis) {
        if (std::abs(from.position[axis]) > 2.5F) speed[axis] = -std::copysign(speed[axis], from.position[axis]);
      }
      const Quat turn(Eigen::AngleAxisf(kTick * 4.0F, Vec3(1, 2, static_cast<float>(body % 3)).normalized()));
      bodies.move(body, from, {from.position + kTick * speed, (from.rotation * turn).normalized()});
    }
    dynamics::FlightContext context{fleet,    state,    hull_, slots_, scenes_, obstacles_, bad_, {}, {DroneIndex(0), kDrones},
                                    *tracer_, *scratch_};
    context.bodies = bodies.view();
    context.bodies_per_env = per_env_;
    const dynamics::Commands commands{.command = command_, .target = {}, .step_start = {}};
    dynamics::fly(context, drones_, commands, tick_ % kClock.substeps(), 1);
    for (std::int64_t& ticks : state.tick) ++ticks;
    ++tick_;
  }
  Pose pose(std::size_t drone) const { return load_pose(state.position.data() + 3 * drone, state.quat_wxyz.data() + 4 * drone); }
  double gap(std::size_t drone) const {
    double least = distance(pose(drone), room);
    for (std::size_t body = drone * per_env_; body < drone * per_env_ + kBodies; ++body) {
      const Primitive solid = bodies.solid(body);
      const float apart = (solid.center - pose(drone).position).norm();
      if (apart < solid.half_extents.norm() + hull_.radius()) least = std::min(least, distance(pose(drone), solid));
    }
    return least;
  }

 private:
  DynamicsConfig config_;
  std::size_t per_env_;
  Random random_;

 public:
  const Primitive room = primitive(PrimitiveKind::room, Vec3::Zero(), {3, 3, 3});
  State state;
  Bodies bodies;
  dynamics::Fleet fleet{*quadrotor().airframe(), config_, kClock, 1, kDrones};

 private:
  collision::Hull hull_{quadrotor()};
  collision::Corners corners_{quadrotor().hull()};
  std::shared_ptr<const World> world_ = make_world({room});
  std::vector<DroneIndex> drones_;
  std::vector<Vec3> speeds_;
  std::vector<float> command_ = std::vector<float>(4 * kDrones);
  std::vector<std::int32_t> slots_ = std::vector<std::int32_t>(kDrones, 0);
  std::vector<std::uint8_t> bad_ = std::vector<std::uint8_t>(kDrones, 0);
  std::vector<const trace::Scene*> scenes_{&prepared(*world_).scene()};
  std::vector<const collision::Obstacles*> obstacles_{&prepared(*world_).obstacles()};
  std::unique_ptr<trace::Tracer> tracer_ = std::make_unique<trace::Tracer>();
  std::unique_ptr<dynamics::FlightScratch> scratch_ = std::make_unique<dynamics::FlightScratch>(hull_, corners_);
  int tick_ = 0;
};

TEST(ContactInACrowd, NoDroneIsInsideAnythingUnlessItSaysSo) {
  const long ticks = times_tried(2100);
  long flown = 0, hits = 0, inside = 0;
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    DynamicsConfig config = config_of(on_contact);
    config.control = Control::velocity;
    Crowds crowds(config, 5U + 10U * part_tried() + static_cast<unsigned>(on_contact));
    for (long tick = 0; tick < ticks; ++tick) {
      const bool is_new_episode = tick % 300 == 0;
      for (std::size_t drone = 0; drone < Crowds::kDrones; ++drone) {
        const bool was_inside = crowds.state.contact.inside[drone] != 0;
        if (on_contact != OnContact::terminate || is_new_episode) {
          crowds.state.contact.hit[drone] = 0;
          if (!was_inside || is_new_episode) crowds.state.contact.inside[drone] = 0;
        }
      }
      crowds.tick();
      for (std::size_t drone = 0; drone < Crowds::kDrones; ++drone, ++flown) {
        hits += crowds.state.contact.hit[drone];
        if (crowds.state.contact.inside[drone]) {
          ++inside;
          ASSERT_GT(distance(crowds.pose(drone), crowds.room), 0.0);
          if (crowds.gap(drone) > 0.0) crowds.state.contact.inside[drone] = 0;  // it has left
          continue;
        }
        ASSERT_GT(crowds.gap(drone), 0.0) << "tick " << tick << ", drone " << drone << ", " << static_cast<int>(on_contact);
      }
    }
  }
  EXPECT_GE(flown, 100'000);
  EXPECT_GT(hits, flown / 200);
  EXPECT_LT(inside, flown / 50);
  testing::tried("crushes", flown);
}

TEST(ContactInACrowd, DoesNotDependOnBodiesFarAway) {
  DynamicsConfig config = config_of(OnContact::bounce);
  config.control = Control::velocity;
  Crowds few(config, 7), many(config, 7, 30);
  for (int tick = 0; tick < 500; ++tick) {
    few.tick();
    many.tick();
  }
  EXPECT_GT(std::ranges::count(few.state.contact.hit, 1), 3);
  EXPECT_TRUE(same_bits(few.state.position, many.state.position));
  EXPECT_TRUE(same_bits(few.state.quat_wxyz, many.state.quat_wxyz));
  EXPECT_TRUE(same_bits(few.state.flight.velocity, many.state.flight.velocity));
  EXPECT_EQ(few.state.contact.body, many.state.contact.body);
}

}  // namespace
}  // namespace flockstep
