// Collisions of drones do not depend on their order, threads, blocks and ticks.
#include "batch/touching_drones.hpp"

namespace flockstep {
namespace {

using namespace touching;

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

TEST(ContactGroups, TheOrderOfTheDronesDoesNotMatter) {
  Random random(4);
  for (const Many& config : kinds_of_contacts(1, 8)) {
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

TEST(ContactGroups, ThreadsBlocksAndOtherEnvsDoNotMatter) {
  Random random(5);
  for (const Many& config : kinds_of_contacts(6, 5)) {
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

TEST(ContactGroups, ASnapshotContinuesInTheMiddle) {
  Random random(6);
  for (const Many& config : kinds_of_contacts(2, 6)) {
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

TEST(ContactGroups, DronesThatStayApartFlyAsIfTheyWereAlone) {
  Random random(7);
  for (const Many& config : kinds_of_contacts(3, 4)) {
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
TEST(ContactGroups, ManyTicksAreLikeManyCallsOfOne) {
  Random random(9);
  const auto world = make_world({primitive(PrimitiveKind::room, Vec3::Zero(), Vec3(60, 60, 60))});
  int contacts = 0, rows = 0;
  for (const OnContact on_contact : {OnContact::bounce, OnContact::stop, OnContact::terminate}) {
    for (const int drones : {3, 8, 40}) {
      const Many config = Many(2, drones).by_rotors(on_contact);
      Batch whole(config, {world}), ticks(config, {world});
      scatter(whole, random, true);
      for (int round = 0; round < 15; round += kThinning) {
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

}  // namespace
}  // namespace flockstep
