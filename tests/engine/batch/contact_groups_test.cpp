// Drones of one env that touch each other, in a batch: no drone ends inside another one, and results depend neither on threads
// nor on other envs nor on the order of the drones.
#include "batch/contact_groups.hpp"

#include "batch/touching_drones.hpp"

namespace flockstep {
namespace {

using namespace touching;

TEST(ContactGroups, KinematicDronesNeverEndInsideEachOther) {
  Random random(1 + 100U * part_tried());
  long moves = 0, contacts = 0;
  const long wanted = times_tried(40000);
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
  testing::tried("contact_groups", moves);
}

TEST(ContactGroups, RotorDronesNeverEndInsideEachOther) {
  Random random(2 + 100U * part_tried());
  long moves = 0, contacts = 0;
  const long wanted = times_tried(150000);
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
  testing::tried("contact_groups", moves);
}

TEST(ContactGroups, BodiesPushNoDroneIntoAnother) {
  Random random(3 + 100U * part_tried());
  long moves = 0, pushes = 0;
  const long wanted = times_tried(50000);
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
  testing::tried("contact_groups", moves);
}

// Two drones fly towards each other and stop 0.1 mm apart.
TEST(ContactGroups, AContactNamesBothDrones) {
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
TEST(ContactGroups, ADroneThatHoldsStillIsInTheWay) {
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
TEST(ContactGroups, ABodyPushesADroneThatHoldsStill) {
  for (const Interaction interaction : {Interaction::none, Interaction::collide}) {
    Many config(1, 2, interaction);
    config.by_rotors(OnContact::bounce);
    BodyConfig body;
    body.position_m = {-2.2F, -1, 0};
    body.motion.velocity_mps = {1, 0, 0};
    config.bodies = {body};
    Batch batch(config, {meeting_hall()});
    const std::vector<float> start{-0.9F, -1, 0, 0.35F, -1, 0};  // so near that they form a group
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
TEST(ContactGroups, BodiesPushDronesThatDoNotTouchAsIfTheyCouldNot) {
  Random random(10);
  int contacts = 0, ticks = 0;
  for (const OnContact on_contact : {OnContact::bounce, OnContact::stop, OnContact::terminate}) {
    for (int trial = 0; trial < 60; trial += kThinning) {
      Many config = Many(1, 2).by_rotors(on_contact);
      BodyConfig body{.shape = trial % 2 == 0 ? BodyShape::box : BodyShape::sphere, .size_m = {0.3F, 0.3F, 0.3F}};
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
        expect_same(first, Copy{second, in_order(2)});
        ASSERT_FALSE(::testing::Test::HasFailure()) << "trial " << trial << ", tick " << tick;
        contacts += contact.body[0] >= 0 || contact.body[1] >= 0;
        ++ticks;
      }
    }
  }
  EXPECT_GT(contacts, ticks / 50);
  EXPECT_GT(ticks, 1000 / kThinning);
}

// A drone that has been hit by another one flies into a wall later, in another leg of the call.
TEST(ContactGroups, AContactWithAWallReplacesThatWithADrone) {
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
TEST(ContactGroups, AnInterruptedFlightLeavesNoDroneInsideAnother) {
  struct Stopped {};
  static int polls;
  constexpr int kPairs = 32;
  Many config = Many(1, 2 * kPairs).by_rotors(OnContact::stop);
  config.clock = {.policy_hz = 1.0F, .physics_hz = 1000.0F};
  Batch batch(config, {make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(20, 20, 1.5F))})});
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
TEST(ContactGroups, AGroupCanBeInterrupted) {
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
TEST(ContactGroups, DronesAtOnePointSeparate) {
  for (const Many& config : kinds_of_contacts(1, 6)) {
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

TEST(ContactGroups, RemovedDronesAreNotThere) {
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

TEST(ContactGroups, TooManyDronesAreRefused) {
  EXPECT_REFUSED(Batch(Many(1, 10000), {meeting_hall()}), R"(drones_per_env: ... 4096 ... "none" ... 10000)");
}

}  // namespace
}  // namespace flockstep
