// LaneGroup: state arrays are loaded to lanes and stored back, gathered or contiguous. Drones that are not stored keep their
// values.
#include "dynamics/lane_group.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cstddef>
#include <cstring>
#include <initializer_list>
#include <span>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "flight_state.hpp"

namespace flockstep {
namespace {

using dynamics::DroneRange;
using dynamics::Flock;
using dynamics::kLanes;
using dynamics::LaneFlags;
using dynamics::LaneGroup;

constexpr std::size_t kNumDrones = 40;

// A state in which every element of every array has a different number.
State numbered_state() {
  State state = testing::flight_state(kNumDrones, 1);
  float next = 1.0F;
  testing::for_each_float_array(state, [&](const std::string&, std::vector<float>& array) {
    for (float& value : array) value = next++;
  });
  return state;
}

std::vector<DroneIndex> indices(std::initializer_list<int> drones) {
  std::vector<DroneIndex> list;
  for (const int drone : drones) list.emplace_back(drone);
  return list;
}

TEST(LaneGroup, TakesTheLanesThatFit) {
  const std::vector<DroneIndex> list = indices({3, 4, 9, 20, 38, 39});
  std::span<const DroneIndex> drones(list);
  const LaneGroup gathered(drones, {});
  EXPECT_TRUE(drones.empty());
  EXPECT_FALSE(gathered.is_row());
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(gathered[lane], list[std::min<std::size_t>(lane, 5)]);
    EXPECT_EQ(gathered.is_listed(lane), lane < 6);
  }

  drones = list;
  const DroneRange own{DroneIndex(2), 38};
  const LaneGroup row(drones, own);  // drones 3 to 18
  EXPECT_TRUE(row.is_row());
  EXPECT_EQ(drones.size(), 3U);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(row[lane], DroneIndex(3 + lane));
    EXPECT_EQ(row.is_listed(lane), lane == 0 || lane == 1 || lane == 6);
  }
  const LaneGroup last(drones, own);  // 20 to 35
  EXPECT_EQ(last[0], DroneIndex(20));
  const LaneGroup end(drones, own);
  EXPECT_TRUE(drones.empty());
  EXPECT_EQ(end[0], DroneIndex(24)) << "moved back to end with the range";
  EXPECT_TRUE(end.is_listed(14) && end.is_listed(15));
}

TEST(LaneGroup, LoadsTheSameGatheredAndContiguous) {
  const State state = numbered_state();
  std::vector<DroneIndex> list;
  for (std::size_t lane = 0; lane < kLanes; ++lane) list.emplace_back(5 + lane);
  Flock loaded[2];
  for (const bool is_row : {false, true}) {
    std::span<const DroneIndex> drones(list);
    const LaneGroup group(drones, is_row ? DroneRange{DroneIndex(0), kNumDrones} : DroneRange{});
    ASSERT_EQ(group.is_row(), is_row);
    group.load(state, loaded[is_row]);
  }
  EXPECT_EQ(std::memcmp(&loaded[0], &loaded[1], sizeof(Flock)), 0);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    EXPECT_EQ(loaded[0].origin[1][lane], state.position[3 * (5 + lane) + 1]);
    EXPECT_EQ(loaded[0].travelled[2][lane], state.flight.remainder[3 * (5 + lane) + 2]);
    EXPECT_EQ(loaded[0].rotor_command[3][lane], state.flight.rotor_command[4 * (5 + lane) + 3]);
    EXPECT_EQ(loaded[0].wind[0][lane], state.flight.wind[3 * (5 + lane)]);
  }
}

TEST(LaneGroup, StoresTheGivenLanesOnly) {
  const State before = numbered_state();
  const std::vector<DroneIndex> list = indices({5, 6, 8, 17, 20});
  for (const bool is_row : {false, true}) {
    State state = before;
    Flock flock;
    std::span<const DroneIndex> drones(list);
    const LaneGroup group(drones, is_row ? DroneRange{DroneIndex(0), kNumDrones} : DroneRange{});
    group.load(state, flock);
    for (auto* const lanes : {&flock.position, &flock.remainder, &flock.velocity, &flock.turn, &flock.error_integral,
                              &flock.acceleration, &flock.angular_acceleration}) {
      for (auto& lane : *lanes) lane.fill(-1.0F);
    }
    for (auto* const lanes : {&flock.rotation, &flock.rotor, &flock.rotor_command}) {
      for (auto& lane : *lanes) lane.fill(-1.0F);
    }
    LaneFlags lanes{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      lanes[lane] = group.is_listed(lane) && (group[lane] == DroneIndex(6) || group[lane] == DroneIndex(17));
    }
    group.store(lanes, flock, state);
    int arrays = 0;
    testing::for_each_float_array(state, [&](const std::string& name, const std::vector<float>& values) {
      testing::for_each_float_array(before, [&](const std::string& other, const std::vector<float>& old) {
        if (name != other) return;
        const bool is_stored = testing::is_written_by_flight(name);
        arrays += is_stored;
        const std::size_t columns = values.size() / kNumDrones;
        for (std::size_t i = 0; i < values.size(); ++i) {
          const bool is_changed = is_stored && (i / columns == 6 || i / columns == 17);
          EXPECT_EQ(values[i], is_changed ? -1.0F : old[i]) << name << ' ' << i / columns;
        }
      });
    });
    EXPECT_EQ(arrays, 10);
  }
}

TEST(LaneGroup, StoresOnlyOneLaneAndItsAccelerations) {
  const State before = numbered_state();
  const std::vector<DroneIndex> list = indices({7, 9});
  std::span<const DroneIndex> drones(list);
  const LaneGroup group(drones, {});
  Flock flock;
  group.load(before, flock);
  for (auto* const lanes : {&flock.position, &flock.remainder, &flock.acceleration, &flock.angular_acceleration}) {
    for (auto& lane : *lanes) lane.fill(-1.0F);
  }
  State one = before, accelerations = before;
  group.store(1, flock, one);
  group.store_accelerations(1, flock, accelerations);
  const auto row = [](const std::vector<float>& values, std::size_t drone) {
    const std::span<const float> found = testing::row(values, drone, 3);
    return std::vector<float>(found.begin(), found.end());
  };
  const std::vector<float> changed(3, -1.0F);
  EXPECT_EQ(row(one.position, 9), changed);
  EXPECT_EQ(row(one.flight.acceleration, 9), changed);
  EXPECT_EQ(row(one.flight.velocity, 9), row(before.flight.velocity, 9));
  EXPECT_EQ(row(one.position, 7), row(before.position, 7));
  EXPECT_EQ(row(accelerations.position, 9), row(before.position, 9));
  EXPECT_EQ(row(accelerations.flight.acceleration, 9), changed);
  EXPECT_EQ(row(accelerations.flight.angular_acceleration, 9), changed);
  EXPECT_EQ(row(accelerations.flight.acceleration, 7), row(before.flight.acceleration, 7));
}

}  // namespace
}  // namespace flockstep
