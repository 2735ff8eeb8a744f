// Rotor motion: a drone flies identically in envs of several drones, in lists with gaps, and with gathered or contiguous lanes.
#include "dynamics/rotor_motion.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <span>
#include <string>
#include <vector>

#include "flight_room.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using dynamics::DroneRange;
using testing::FlightRoom;
using testing::kRoomDrones;
using testing::kWholeRoom;
using testing::Random;
using testing::room_dynamics;
using testing::same_bits;

std::vector<float> positions(Random& random) {
  std::vector<float> command;
  for (std::size_t i = 0; i < 4 * kRoomDrones; ++i) command.push_back(random.within(-3.0F, 3.0F));
  return command;
}

std::vector<DroneIndex> every(std::size_t step) {
  std::vector<DroneIndex> list;
  for (std::size_t drone = 0; drone < kRoomDrones; drone += step) list.emplace_back(drone);
  return list;
}

// Compares the arrays of two states, except the per-env arrays.
void expect_same_flight(const State& a, const State& b) {
  testing::for_each_float_array(a, b, [](const std::string& name, const auto& values, const auto& others) {
    EXPECT_TRUE(same_bits(values, others)) << name;
  });
  EXPECT_EQ(a.contact.hit, b.contact.hit);
  EXPECT_EQ(a.contact.inside, b.contact.inside);
}

TEST(RotorMotion, OfADroneIsTheSameInEnvsOfThree) {
  const DroneModel model = DroneModel::load("crazyflie");
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    SCOPED_TRACE(static_cast<int>(on_contact));
    const DynamicsConfig config = room_dynamics(on_contact, Control::position);
    FlightRoom single(config, model), triple(config, model, 3);
    const std::vector<DroneIndex> all = every(1);
    Random random(23);
    const std::vector<float> command = positions(random);
    for (int step = 0; step < 60; ++step) {
      single.fly(all, kWholeRoom, command);
      triple.fly(all, kWholeRoom, command);
    }
    EXPECT_GT(single.hits(), 5U);
    expect_same_flight(single.state, triple.state);
  }
}

TEST(RotorMotion, IsTheSameGatheredAndContiguousAndChangesNoOthers) {
  const DroneModel model = DroneModel::load("kingfisher").scaled(0.4, 0.1);
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    for (const Control control : {Control::position, Control::velocity}) {
      SCOPED_TRACE(::testing::Message() << static_cast<int>(on_contact) << ' ' << static_cast<int>(control));
      DynamicsConfig config = room_dynamics(on_contact, control);
      config.wind.gusts = Gusts::dryden;
      FlightRoom row(config, model), gathered(config, model);
      const State before = row.state;
      const std::vector<DroneIndex> odd = every(2);
      row.update_accelerations(odd, kWholeRoom);
      gathered.update_accelerations(odd, {});
      expect_same_flight(row.state, gathered.state);
      Random random(29);
      const std::vector<float> command = positions(random);
      for (int step = 0; step < 60; ++step) {
        row.fly(odd, kWholeRoom, command);
        gathered.fly(odd, {}, command);
      }
      EXPECT_GT(row.hits(), 3U);
      expect_same_flight(row.state, gathered.state);
      testing::for_each_float_array(row.state, before, [](const std::string& name, const auto& values, const auto& old) {
        const std::size_t columns = values.size() / kRoomDrones;
        for (std::size_t drone = 1; drone < kRoomDrones; drone += 2) {
          EXPECT_TRUE(same_bits(testing::row(values, drone, columns), testing::row(old, drone, columns))) << name << ' ' << drone;
        }
      });
    }
  }
}

}  // namespace
}  // namespace flockstep
