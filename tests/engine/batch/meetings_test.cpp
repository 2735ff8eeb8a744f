// Drones of one env that touch each other, in a batch: no drone ends inside another one, and results depend neither on threads
// nor on other envs nor on the order of the drones.
#include "batch/meetings.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <numeric>
#include <span>
#include <string>
#include <vector>

#include "base/interrupt.hpp"
#include "batch_helpers.hpp"
#include "convex_oracle.hpp"
#include "flockstep/batch.hpp"
#include "random.hpp"
#include "tried.hpp"

namespace flockstep {
namespace {

using testing::primitive;
using testing::Random;
using testing::same_bits;

constexpr float kReach = 2.5F;  // m, of a hall

const DroneModel& met_drone() {
  static const DroneModel model = DroneModel::quadrotor650();
  return model;
}

std::shared_ptr<const World> meeting_hall() {
  return testing::make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(kReach + 1, kReach + 1, 1.5F)),
                              primitive(PrimitiveKind::box, {0.5F, 0, 0}, Vec3(0.2F, 0.2F, 1.5F))});
}

struct Many : BatchConfig {
  Many(int envs, int drones, Interaction touched = Interaction::collide) {
    num_envs = envs;
    drones_per_env = drones;
    interaction = touched;
    num_threads = 1;
  }
  Many& by_rotors(OnContact on_contact) {
    dynamics.motion = Motion::rotors;
    dynamics.control = Control::velocity;
    dynamics.on_contact = on_contact;
    dynamics.restitution = 0.6F;
    clock.policy_hz = 10.0F;
    clock.physics_hz = 200.0F;
    return *this;
  }
};

oracle::Support hull_of(const Batch& batch, std::size_t drone) {
  const float *const p = batch.state().position.data() + 3 * drone, *const q = batch.state().quat_wxyz.data() + 4 * drone;
  return oracle::hull_at(met_drone(), Vec3(p[0], p[1], p[2]).cast<double>(), Quat(q[0], q[1], q[2], q[3]).cast<double>());
}

bool are_apart(const Batch& batch, std::size_t a, std::size_t b) {
  const auto place = [&](std::size_t drone) { return Vec3::Map(batch.state().position.data() + 3 * drone); };
  if ((place(a) - place(b)).norm() > 2.0F * met_drone().radius()) return true;
  return oracle::distance(hull_of(batch, a), hull_of(batch, b)).lower > 0.0;
}

// Pairs of drones that overlap although neither reports it.
int unreported_overlaps(const Batch& batch) {
  const auto m = static_cast<std::size_t>(batch.config().drones_per_env),
             n = static_cast<std::size_t>(batch.config().num_drones());
  int count = 0;
  for (std::size_t a = 0; a < n; ++a) {
    for (std::size_t b = a + 1; b < n && b / m == a / m; ++b) {
      count += !are_apart(batch, a, b) && !batch.state().contact.inside[a] && !batch.state().contact.inside[b];
    }
  }
  return count;
}

Pose any_pose(Random& random, bool level) {
  return {Vec3(random.within(-kReach, kReach), random.within(-kReach, kReach), random.within(-0.8F, 0.8F)),
          level ? Quat(Eigen::AngleAxisf(random.within(-3, 3), Vec3::UnitZ())) : random.rotation()};
}

void put(const Pose& pose, std::size_t drone, std::vector<float>& position, std::vector<float>& quat) {
  std::copy_n(pose.position.data(), 3, position.begin() + static_cast<std::ptrdiff_t>(3 * drone));
  const std::array q{pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z()};
  std::copy_n(q.begin(), 4, quat.begin() + static_cast<std::ptrdiff_t>(4 * drone));
}

// Places all drones apart from each other.
void scatter(Batch& batch, Random& random, bool level) {
  const auto m = static_cast<std::size_t>(batch.config().drones_per_env),
             n = static_cast<std::size_t>(batch.config().num_drones());
  for (std::size_t drone = 0; drone < n; ++drone) {
    const std::int64_t row = static_cast<std::int64_t>(drone);
    for (int attempt = 0; attempt < 1000; ++attempt) {
      std::vector<float> position(3), quat(4);
      put(any_pose(random, level), 0, position, quat);
      batch.set_poses({&row, 1}, position, quat);
      bool is_apart = true;
      for (std::size_t other = drone / m * m; other < drone && is_apart; ++other) is_apart = are_apart(batch, drone, other);
      if (is_apart) break;
    }
  }
}

struct Targets {
  std::vector<float> position, quat;
};

Targets any_targets(const Batch& batch, Random& random, float length) {
  const auto n = static_cast<std::size_t>(batch.config().num_drones());
  Targets targets{std::vector<float>(3 * n), std::vector<float>(4 * n)};
  for (std::size_t drone = 0; drone < n; ++drone) {
    const float *const p = batch.state().position.data() + 3 * drone, *const q = batch.state().quat_wxyz.data() + 4 * drone;
    Pose pose{Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
    if (random.within(0, 1) < 0.8F) pose.position += random.point(length);
    if (random.within(0, 1) < 0.5F)
      pose.rotation =
          (pose.rotation * Quat(Eigen::AngleAxisf(random.within(-0.5F, 0.5F), random.direction().normalized()))).normalized();
    put(pose, drone, targets.position, targets.quat);
  }
  return targets;
}

TEST(Meetings, KinematicDronesNeverEndInsideEachOther) {
  Random random(1 + 100U * testing::part_tried());
  long moves = 0, contacts = 0;
  const long wanted = testing::times_tried(40000);
  while (moves < wanted) {
    const int drones = 2 + static_cast<int>(random.generator()() % 9);
    Many config(2, drones);
    if (random.generator()() % 3 == 0) config.clock = {.policy_hz = 10.0F, .physics_hz = 30.0F};
    Batch batch(config, {meeting_hall()});
    scatter(batch, random, random.generator()() % 2 == 0);
    ASSERT_EQ(unreported_overlaps(batch), 0);
    for (int round = 0; round < 20; ++round) {
      const Targets targets = any_targets(batch, random, random.within(0, 1) < 0.3F ? 3.0F : 0.4F);
      batch.move(targets.position, targets.quat);
      ASSERT_EQ(unreported_overlaps(batch), 0) << "after " << moves << " moves";
      for (const std::int32_t other : batch.state().contact.drone) contacts += other >= 0;
      moves += 2 * drones;
    }
  }
  EXPECT_GT(contacts, moves / 20);
  testing::tried("meetings", moves);
}

TEST(Meetings, RotorDronesNeverEndInsideEachOther) {
  Random random(2 + 100U * testing::part_tried());
  long moves = 0, contacts = 0;
  const long wanted = testing::times_tried(150000);
  while (moves < wanted) {
    const auto on_contact = std::array{OnContact::bounce, OnContact::stop, OnContact::terminate}[random.generator()() % 3];
    const int drones = 2 + static_cast<int>(random.generator()() % 7);
    Batch batch(Many(2, drones).by_rotors(on_contact), {meeting_hall()});
    scatter(batch, random, true);
    for (int round = 0; round < 20; ++round) {
      std::vector<float> command;
      for (int drone = 0; drone < 2 * drones; ++drone) {
        const Vec3 velocity = random.point(4.0F);
        command.insert(command.end(), {velocity.x(), velocity.y(), 0.2F * velocity.z(), random.within(-1, 1)});
      }
      batch.fly(command);
      ASSERT_EQ(unreported_overlaps(batch), 0) << "after " << moves << " moves";
      for (const std::int32_t other : batch.state().contact.drone) contacts += other >= 0;
      moves += 20 * 2 * drones;
    }
  }
  EXPECT_GT(contacts, moves / 5000);
  testing::tried("meetings", moves);
}

TEST(Meetings, BodiesPushNoDroneIntoAnother) {
  Random random(3 + 100U * testing::part_tried());
  long moves = 0, pushes = 0;
  const long wanted = testing::times_tried(50000);
  while (moves < wanted) {
    const bool rotors = random.generator()() % 2 == 0;
    const int drones = 2 + static_cast<int>(random.generator()() % 5);
    Many config(2, drones);
    if (rotors) config.by_rotors(random.generator()() % 2 == 0 ? OnContact::bounce : OnContact::terminate);
    for (int body = 0; body < 3; ++body) {
      BodyConfig made;
      made.shape = body == 0 ? BodyShape::box : BodyShape::sphere;
      const float size = random.within(0.2F, 0.8F);
      made.size_m = {size, size, size};
      made.position_m = {random.within(-2, 2), random.within(-2, 2), 0};
      made.motion.kind = BodyMotionKind::random_walk;
      made.motion.period_s = 1.5F;
      made.motion.box_min_m = {-2.5F, -2.5F, -0.5F};
      made.motion.box_max_m = {2.5F, 2.5F, 0.5F};
      config.bodies.push_back(made);
    }
    Batch batch(config, {meeting_hall()});
    scatter(batch, random, true);
    for (int round = 0; round < 10; ++round) {
      if (rotors) {
        const std::vector<float> command(static_cast<std::size_t>(4 * 2 * drones), 0.0F);
        batch.fly(command);
        moves += 20 * 2 * drones;
      } else {
        const Targets targets = any_targets(batch, random, 0.2F);
        batch.move(targets.position, targets.quat);
        moves += 2 * drones;
      }
      for (const std::int32_t body : batch.state().contact.body) pushes += body >= 0;
      ASSERT_EQ(unreported_overlaps(batch), 0) << "after " << moves << " moves";
    }
  }
  EXPECT_GT(pushes, 100);
  testing::tried("meetings", moves);
}

// A batch whose drone of[i] does what drone i of another one does; -1: it has no such drone.
struct Copy {
  Batch& batch;
  std::vector<int> of;
};

std::vector<int> in_order(int count) {
  std::vector<int> of(static_cast<std::size_t>(count));
  std::iota(of.begin(), of.end(), 0);
  return of;
}

// Takes the rows of an array that a copy has.
std::vector<float> rows_for(const Copy& copy, const std::vector<float>& rows, std::size_t columns) {
  std::vector<float> taken(columns * static_cast<std::size_t>(copy.batch.config().num_drones()));
  for (std::size_t i = 0; i < copy.of.size(); ++i) {
    if (copy.of[i] < 0) continue;
    std::copy_n(rows.data() + columns * i, columns, taken.data() + columns * static_cast<std::size_t>(copy.of[i]));
  }
  return taken;
}

// Gives a copy the poses of a batch.
void place(const Batch& batch, const Copy& copy) {
  copy.batch.set_pose(rows_for(copy, batch.state().position, 3), rows_for(copy, batch.state().quat_wxyz, 4));
}

// Flies or moves a batch and its copies.
void act(Batch& batch, Random& random, const std::vector<Copy>& copies, float length = 0.6F) {
  if (batch.config().dynamics.is_kinematic()) {
    const Targets targets = any_targets(batch, random, length);
    batch.move(targets.position, targets.quat);
    for (const Copy& copy : copies) copy.batch.move(rows_for(copy, targets.position, 3), rows_for(copy, targets.quat, 4));
    return;
  }
  std::vector<float> command;
  for (int i = 0; i < batch.config().num_drones(); ++i) {
    const Vec3 velocity = random.point(3.0F) - Vec3::Map(batch.state().position.data() + 3 * i);  // mostly to the middle
    command.insert(command.end(), {velocity.x(), velocity.y(), 0.2F * velocity.z(), 0.5F});
  }
  batch.fly(command);
  for (const Copy& copy : copies) copy.batch.fly(rows_for(copy, command, 4));
}

// Checks that the drones of a copy have the same state, except the numbers of drones that they touched.
void expect_same(const Batch& batch, const Copy& copy) {
  const auto n = copy.of.size();
  testing::for_each_array(batch.state(), [&](const std::string& name, const auto& array) {
    if (array.size() % n != 0 || array.empty() || name == "drone") return;
    testing::for_each_array(copy.batch.state(), [&](const std::string& other_name, const auto& other) {
      if (other_name != name) return;
      const std::size_t width = array.size() / n;
      for (std::size_t i = 0; i < n; ++i) {
        if (copy.of[i] < 0) continue;
        EXPECT_TRUE(same_bits(std::span(array).subspan(width * i, width),
                              std::span(other).subspan(width * static_cast<std::size_t>(copy.of[i]), width)))
            << name << " of drone " << i;
      }
    });
  });
}

std::vector<Many> kinds_of_meetings(int envs, int drones) {
  return {Many(envs, drones), Many(envs, drones).by_rotors(OnContact::bounce),
          Many(envs, drones).by_rotors(OnContact::terminate)};
}

TEST(Meetings, TheOrderOfTheDronesDoesNotMatter) {
  Random random(4);
  for (const Many& config : kinds_of_meetings(1, 8)) {
    Batch first(config, {meeting_hall()}), second(config, {meeting_hall()});
    scatter(first, random, true);
    const Copy copy{second, in_order(8)};
    Copy shuffled(copy);
    std::ranges::shuffle(shuffled.of, random.generator());
    place(first, shuffled);
    int contacts = 0;
    for (int round = 0; round < 60; ++round) {
      act(first, random, {shuffled});
      expect_same(first, shuffled);
      for (std::size_t i = 0; i < 8; ++i) {
        const std::int32_t other = first.state().contact.drone[i];
        contacts += other >= 0;
        EXPECT_EQ(second.state().contact.drone[static_cast<std::size_t>(shuffled.of[i])],
                  other < 0 ? -1 : shuffled.of[static_cast<std::size_t>(other)]);
      }
      ASSERT_FALSE(::testing::Test::HasFailure()) << "round " << round;
    }
    EXPECT_GT(contacts, 5);
  }
}

TEST(Meetings, ThreadsBlocksAndOtherEnvsDoNotMatter) {
  Random random(5);
  for (const Many& config : kinds_of_meetings(6, 5)) {
    Many other = config, single = config;
    other.num_threads = 3;
    other.block_size = 2;
    single.num_envs = 1;
    Batch first(config, {meeting_hall()}), second(other, {meeting_hall()}), third(single, {meeting_hall()});
    scatter(first, random, true);
    const Copy threaded{second, in_order(30)};
    Copy alone{third, std::vector<int>(30, -1)};
    std::iota(alone.of.begin() + 15, alone.of.begin() + 20, 0);  // env 3
    for (const Copy& copy : {threaded, alone}) place(first, copy);
    for (int round = 0; round < 10; ++round) {
      act(first, random, {threaded, alone});
      expect_same(first, threaded);
      expect_same(first, alone);
      ASSERT_FALSE(::testing::Test::HasFailure()) << "round " << round;
    }
  }
}

TEST(Meetings, ASnapshotContinuesInTheMiddle) {
  Random random(6);
  for (const Many& config : kinds_of_meetings(2, 6)) {
    Batch first(config, {meeting_hall()}), second(config, {meeting_hall()});
    scatter(first, random, true);
    for (int round = 0; round < 6; ++round) {
      second.restore(first.snapshot());
      const Copy copy{second, in_order(12)};
      act(first, random, {copy});
      expect_same(first, copy);
      ASSERT_FALSE(::testing::Test::HasFailure()) << "round " << round;
    }
  }
}

TEST(Meetings, DronesThatStayApartFlyAsIfTheyWereAlone) {
  Random random(7);
  for (const Many& config : kinds_of_meetings(3, 4)) {
    Many never = config;
    never.interaction = Interaction::none;
    Batch first(config, {meeting_hall()}), second(never, {meeting_hall()});
    std::vector<float> position, quat;
    for (int i = 0; i < 12; ++i) {
      position.insert(position.end(),
                      {(i % 2 == 0 ? 2.2F : -2.2F), (i / 2 % 2 == 0 ? 2.2F : -2.2F), 0.1F * static_cast<float>(i)});
      quat.insert(quat.end(), {1, 0, 0, 0});
    }
    first.set_pose(position, quat);
    const Copy copy{second, in_order(12)};
    place(first, copy);
    for (int round = 0; round < 3; ++round) {
      if (config.dynamics.is_kinematic()) {
        act(first, random, {copy}, 0.2F);
      } else {
        const std::vector<float> command(48, 0.3F);
        first.fly(command);
        second.fly(command);
      }
      expect_same(first, copy);
    }
  }
}

// In a call of many ticks, drones fly freely until the tick in which they may first touch. In calls of one tick there is nothing
// to find. Positions differ by rounding, because free drones add up the way of a whole call.
TEST(Meetings, ManyTicksAreLikeManyCallsOfOne) {
  Random random(9);
  const auto world = testing::make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(60, 60, 60))});
  int contacts = 0, rows = 0;
  for (const OnContact on_contact : {OnContact::bounce, OnContact::stop, OnContact::terminate}) {
    for (const int drones : {3, 8, 40}) {
      const Many config = Many(2, drones).by_rotors(on_contact);
      Batch whole(config, {world}), ticks(config, {world});
      scatter(whole, random, true);
      for (int round = 0; round < 15; ++round) {
        std::vector<float> command;
        for (int i = 0; i < 2 * drones; ++i) {
          const Vec3 velocity = random.point(3.0F) - Vec3::Map(whole.state().position.data() + 3 * i);
          command.insert(command.end(), {velocity.x(), velocity.y(), 0.5F * velocity.z(), 0.5F});
        }
        ticks.restore(whole.snapshot());
        whole.fly(command);
        std::vector<std::uint8_t> is_stopped(static_cast<std::size_t>(2 * drones));
        for (int tick = 0; tick < 20; ++tick) {
          std::vector<std::uint8_t> mask(is_stopped.size());
          for (std::size_t i = 0; i < mask.size(); ++i) mask[i] = is_stopped[i] == 0;
          ticks.fly(command, 1, mask);
          for (std::size_t i = 0; on_contact == OnContact::terminate && i < mask.size(); ++i) {
            is_stopped[i] |= ticks.state().contact.hit[i];
          }
        }
        ASSERT_EQ(unreported_overlaps(whole), 0);
        for (std::size_t i = 0; i < is_stopped.size(); ++i) {
          const auto row = [i](const Batch& batch) { return Vec3(Vec3::Map(batch.state().position.data() + 3 * i)); };
          ASSERT_LT((row(whole) - row(ticks)).norm(), 1e-5F) << "drone " << i << " of " << drones << ", round " << round;
          ++rows;
          contacts += whole.state().contact.drone[i] >= 0 ? 1 : 0;
        }
      }
    }
  }
  EXPECT_GT(contacts, rows / 20);
}

// Two drones fly towards each other and stop 0.1 mm apart.
TEST(Meetings, AContactNamesBothDrones) {
  for (const Interaction interaction : {Interaction::none, Interaction::sense, Interaction::collide, Interaction::both}) {
    Batch batch(Many(1, 3, interaction), {meeting_hall()});
    const std::vector<float> start{-2, -1, 0, 0, -1, 0, 2, 2, 0};
    batch.set_pose(start, {});
    const std::vector<float> target{0, -1, 0, -2, -1, 0, 2, 2, 0};
    batch.move(target, {});
    const ContactState& contact = batch.state().contact;
    if (!collides(interaction)) {
      EXPECT_EQ(std::count(contact.hit.begin(), contact.hit.end(), 1), 0);
      EXPECT_EQ(batch.state().position, target);
      continue;
    }
    EXPECT_EQ(contact.drone, (std::vector<std::int32_t>{1, 0, -1}));
    EXPECT_EQ(contact.body, (std::vector<std::int32_t>{-1, -1, -1}));
    const float length = 0.93F;  // of the drone
    const float meeting = 0.5F * (2.0F - length);
    EXPECT_NEAR(batch.state().position[0], -2.0F + meeting, 1e-3F);
    EXPECT_NEAR(batch.state().position[3], -meeting, 1e-3F);
    EXPECT_NEAR(contact.fraction[0], meeting / 2.0F, 1e-3F);
    EXPECT_EQ(contact.fraction[0], contact.fraction[1]);
    EXPECT_NEAR(contact.normal[0], -1.0F, 1e-3F);
    EXPECT_NEAR(contact.surface_velocity[0], -20.0F, 0.1F);
    EXPECT_NEAR(contact.surface_velocity[3], 20.0F, 0.1F);
    // They rest against each other, and may leave.
    batch.move(target, {});
    EXPECT_NEAR(batch.state().position[0], -2.0F + meeting, 1e-3F);
    batch.move(start, {});
    EXPECT_EQ(batch.state().position, start);
  }
}

// A drone that a mask leaves out is in the way of the others.
TEST(Meetings, ADroneThatHoldsStillIsInTheWay) {
  const std::vector<float> start{-2, -1, 0, -0.9F, -1, 0};
  const std::vector<std::uint8_t> first{1, 0};
  Batch kinematic(Many(1, 2), {meeting_hall()});
  kinematic.set_pose(start, {});
  kinematic.move(std::vector<float>{0, -1, 0, 0, 0, 0}, {}, first);
  EXPECT_EQ(kinematic.state().contact.drone, (std::vector<std::int32_t>{1, 0}));
  EXPECT_LT(kinematic.state().position[0], -1.5F);
  EXPECT_EQ(kinematic.state().position[3], -0.9F);
  EXPECT_EQ(unreported_overlaps(kinematic), 0);
  for (const OnContact on_contact : {OnContact::stop, OnContact::bounce}) {
    Batch batch(Many(1, 2).by_rotors(on_contact), {meeting_hall()});
    batch.set_pose(start, {});
    int contacts = 0;
    for (int step = 0; step < 10; ++step) {
      batch.fly(std::vector<float>{4, 0, 0, 0, 0, 0, 0, 0}, 0, first);
      contacts += batch.state().contact.drone[0] == 1 ? 1 : 0;
      EXPECT_EQ(batch.state().position[3], -0.9F);
      EXPECT_EQ(unreported_overlaps(batch), 0);
    }
    EXPECT_GT(contacts, 0);
    if (on_contact == OnContact::stop) {  // with bounces, a tilted drone slides below the other one
      EXPECT_LT(batch.state().position[0], -1.5F);
    }
  }
}

// A body pushes a drone that holds still. It does so in the same way near a drone that it does not touch.
TEST(Meetings, ABodyPushesADroneThatHoldsStill) {
  for (const Interaction interaction : {Interaction::none, Interaction::collide}) {
    Many config(1, 2, interaction);
    config.by_rotors(OnContact::bounce);
    BodyConfig body;
    body.position_m = {-2.2F, -1, 0};
    body.motion.velocity_mps = {1, 0, 0};
    config.bodies = {body};
    Batch batch(config, {meeting_hall()});
    const std::vector<float> start{-0.9F, -1, 0, 0.35F, -1, 0};  // so near that they form a crowd
    batch.set_pose(start, {});
    const std::vector<std::uint8_t> second{0, 1};
    for (int step = 0; step < 6; ++step) {
      batch.fly(std::vector<float>(8, 0.0F), 0, second);
      ASSERT_EQ(unreported_overlaps(batch), 0) << "step " << step;
    }
    EXPECT_NEAR(batch.state().position[0], -1.1F + 0.465F, 1e-3F);  // at the body's front
    EXPECT_EQ(batch.state().flight.velocity[0], 0.0F);
    EXPECT_EQ(batch.state().contact.body[0], 0);
    EXPECT_NEAR(batch.state().contact.point[0], start[0] - 0.465F, 1e-3F);  // the first contact
  }
}

// Bodies move drones that are near each other but do not touch, in the same way as if they could not touch.
TEST(Meetings, BodiesPushDronesThatDoNotTouchAsIfTheyCouldNot) {
  Random random(10);
  int contacts = 0, ticks = 0;
  for (const OnContact on_contact : {OnContact::bounce, OnContact::stop, OnContact::terminate}) {
    for (int trial = 0; trial < 60; ++trial) {
      Many config = Many(1, 2).by_rotors(on_contact);
      BodyConfig body;
      body.shape = trial % 2 == 0 ? BodyShape::box : BodyShape::sphere;
      body.size_m = {0.3F, 0.3F, 0.3F};
      body.motion.kind = BodyMotionKind::random_walk;
      body.motion.period_s = 0.5F;
      body.motion.box_min_m = {-2.4F, -2.4F, -0.4F};
      body.motion.box_max_m = {0.0F, 0.0F, 0.4F};
      config.bodies = {body, body};
      Many never = config;
      never.interaction = Interaction::none;
      Batch first(config, {meeting_hall()}), second(never, {meeting_hall()});
      const std::vector<float> start{-1, -1, 0, -1, -1, 0.5F};  // one above the other, nearer than their length
      const auto seed = static_cast<std::uint64_t>(trial);
      for (Batch* const batch : {&first, &second}) {
        batch->seed({&seed, 1});
        batch->set_pose(start, {});
      }
      const std::vector<std::uint8_t> mask{1, static_cast<std::uint8_t>(trial % 3 == 0 ? 0 : 1)};
      std::vector<float> command;
      for (int tick = 0; tick < 200; ++tick) {
        if (tick % 20 == 0) {
          const Vec3 velocity = random.point(0.5F);
          command = {velocity.x(), velocity.y(), 0, 0, velocity.x(), velocity.y(), 0, 0};
        }
        for (Batch* const batch : {&first, &second}) batch->fly(command, 1, mask);
        const ContactState& contact = first.state().contact;
        if (contact.drone[0] >= 0 || contact.drone[1] >= 0 || contact.inside[0] || contact.inside[1]) break;
        const std::vector<float>& position = first.state().position;
        if (position[5] - position[2] < 0.35F) break;  // one may be in the way of the other
        expect_same(first, {second, in_order(2)});
        ASSERT_FALSE(::testing::Test::HasFailure()) << "trial " << trial << ", tick " << tick;
        contacts += contact.body[0] >= 0 || contact.body[1] >= 0;
        ++ticks;
      }
    }
  }
  EXPECT_GT(contacts, ticks / 50);
  EXPECT_GT(ticks, 1000);
}

// A drone that has been hit by another one flies into a wall later, in another leg of the call.
TEST(Meetings, AContactWithAWallReplacesThatWithADrone) {
  for (const bool has_bodies : {false, true}) {
    Many config = Many(1, 2).by_rotors(OnContact::bounce);
    if (has_bodies) {
      BodyConfig body;
      body.position_m = {2, 2, 0};
      config.bodies = {body};
    }
    Batch batch(config, {meeting_hall()});
    batch.set_pose(std::vector<float>{-2, -1, 0, -1, -1, 0}, {});
    const std::vector<float> velocity{0, 0, 0, -6, 0, 0};
    batch.set_velocity(velocity, {}, {});
    const std::vector<float> command{-6, 0, 0, 0, 6, 0, 0, 0};
    bool was_met = false, was_at_wall = false;
    for (int ticks = 5; ticks <= 100 && !was_at_wall; ticks += 5) {
      Batch copy(config, {meeting_hall()});
      copy.restore(batch.snapshot());
      copy.fly(command, ticks);
      const ContactState& contact = copy.state().contact;
      was_at_wall = contact.normal[0] > 0.0F;
      was_met |= contact.drone[0] == 1;
      EXPECT_EQ(contact.drone[0], was_at_wall || !contact.hit[0] ? -1 : 1) << ticks;
      EXPECT_TRUE(!was_at_wall || contact.surface_velocity[0] == 0.0F) << ticks;
    }
    EXPECT_TRUE(was_met && was_at_wall);
  }
}

// At first, drones fly as if the others were not there. An interrupt leaves none of them inside another one all the same.
TEST(Meetings, AnInterruptedFlightLeavesNoDroneInsideAnother) {
  struct Stopped {};
  static int polls;
  constexpr int kPairs = 32;
  Many config = Many(1, 2 * kPairs).by_rotors(OnContact::stop);
  config.clock = {.policy_hz = 1.0F, .physics_hz = 1000.0F};
  Batch batch(config, {testing::make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(20, 20, 1.5F))})});
  std::vector<float> start, command;  // near the floor, where they fly tick by tick, two and two towards each other
  for (int i = 0; i < 2 * kPairs; ++i) {
    const float side = i % 2 == 0 ? -1.0F : 1.0F;
    start.insert(start.end(), {side * 0.5F, 0.8F * static_cast<float>(i / 2 - kPairs / 2), -1.3F});
    command.insert(command.end(), {-2.0F * side, 0, -0.5F, 0});
  }
  batch.set_pose(start, {});
  ASSERT_EQ(unreported_overlaps(batch), 0);
  polls = 0;
  {
    const Interrupt interrupt([] {
      if (++polls > 2) throw Stopped();
    });
    EXPECT_THROW(batch.fly(command, 1000), Stopped);
  }
  EXPECT_EQ(unreported_overlaps(batch), 0);
  for (int i = 0; i < 2 * kPairs; ++i) {
    EXPECT_EQ(batch.state().position[static_cast<std::size_t>(3 * i)] > 0.0F, i % 2 != 0)
        << "drone " << i << " has flown through";
  }
}

// A motion that takes seconds can be interrupted. It has then moved no drone into another one.
TEST(Meetings, ACrowdCanBeInterrupted) {
  struct Stopped {};
  constexpr int kDrones = 150;
  Batch batch(Many(1, kDrones), {meeting_hall()});
  std::vector<float> position;
  for (int i = 0; i < kDrones; ++i) position.insert(position.end(), {-1, -1, 0});
  batch.set_pose(position, {});
  Random random(12);
  const Targets targets = any_targets(batch, random, 0.1F);
  static int polls;
  polls = 0;
  {
    const Interrupt interrupt([] {
      if (++polls > 1) throw Stopped();
    });
    EXPECT_THROW(batch.move(targets.position, targets.quat), Stopped);
  }
  EXPECT_EQ(batch.state().position, position);
  batch.move(targets.position, targets.quat);
  EXPECT_EQ(unreported_overlaps(batch), 0);
}

// Drones at one point may leave each other, but come no nearer; nothing hangs.
TEST(Meetings, DronesAtOnePointSeparate) {
  for (const Many& config : kinds_of_meetings(1, 6)) {
    Batch batch(config, {meeting_hall()});
    std::vector<float> position;
    for (int i = 0; i < 6; ++i) position.insert(position.end(), {-1, -1, 0});
    batch.set_pose(position, {});
    Random random(8);
    for (int round = 0; round < 30; ++round) {
      if (config.dynamics.is_kinematic()) {
        const Targets targets = any_targets(batch, random, 1.0F);
        batch.move(targets.position, targets.quat);
      } else {
        batch.fly(std::vector<float>(24, 0.5F));
      }
      ASSERT_EQ(unreported_overlaps(batch), 0);
      for (const float value : batch.state().position) ASSERT_TRUE(std::isfinite(value));
    }
  }
}

TEST(Meetings, RemovedDronesAreNotThere) {
  Batch batch(Many(1, 2), {meeting_hall()});
  const std::vector<float> start{-2, -1, 0, -0.5F, -1, 0};
  batch.set_pose(start, {});
  const std::int64_t second = 1;
  batch.remove({&second, 1});
  const std::vector<float> target{0, -1, 0, 0, 0, 0};
  batch.move(target, {});
  EXPECT_EQ(batch.state().position[0], 0.0F);
  EXPECT_FALSE(batch.state().contact.hit[0]);
}

TEST(Meetings, TooManyDronesAreRefused) {
  EXPECT_EQ(testing::message_of([] { Batch(Many(1, 10000), {meeting_hall()}); }),
            "drones_per_env: expected at most 4096 unless interaction is \"none\", got 10000");
}

}  // namespace
}  // namespace flockstep
