// Fleet: drones of a mixed fleet fly exactly as in a fleet with a single airframe.
#include "dynamics/fleet.hpp"

#include "batch/simulation.hpp"
#include "batch/snapshot.hpp"
#include "batch_helpers.hpp"
#include "dynamics/rotor_motion.hpp"
#include "flight_room.hpp"
#include "flight_state.hpp"

namespace flockstep {
namespace {

using dynamics::DroneRange;
using dynamics::Fleet;
using namespace testing;

const std::vector<std::int32_t> kFirstRow(kRoomDrones);  // all drones have the first airframe

std::vector<DroneIndex> all_drones() {
  std::vector<DroneIndex> list;
  for (std::size_t drone = 0; drone < kRoomDrones; ++drone) list.emplace_back(drone);
  return list;
}

// Expects a drone to have the same bits in two states.
void expect_same_drone(const State& a, const State& b, std::size_t drone) {
  for_each_float_array(a, b, [&](const std::string& name, const auto& values, const auto& others) {
    const std::size_t columns = values.size() / kRoomDrones;
    EXPECT_TRUE(same_bits(testing::row(values, drone, columns), testing::row(others, drone, columns))) << name << ' ' << drone;
  });
  EXPECT_EQ(a.contact.hit[drone], b.contact.hit[drone]);
  EXPECT_EQ(a.contact.inside[drone], b.contact.inside[drone]);
}

// Returns table rows in which consecutive drones have different airframes.
std::vector<std::int32_t> mixed_index(std::size_t num_airframes) {
  std::vector<std::int32_t> index;
  for (std::size_t drone = 0; drone < kRoomDrones; ++drone) {
    index.push_back(static_cast<std::int32_t>((7 * drone + drone / num_airframes) % num_airframes));
  }
  return index;
}

std::vector<Airframe> by_drone(const Fleet& fleet) {
  std::vector<Airframe> airframes;
  for (std::size_t drone = 0; drone < kRoomDrones; ++drone) airframes.push_back(fleet.airframe_of(DroneIndex(drone)));
  return airframes;
}

void expect_same_flights(const DynamicsConfig& config, bool is_row) {
  const DroneModel model = DroneModel::load("crazyflie");
  const std::vector<Airframe> airframes = different_airframes();
  const std::vector<std::int32_t> index = mixed_index(airframes.size());
  const std::vector<DroneIndex> drones = all_drones();
  const DroneRange own = is_row ? kWholeRoom : DroneRange{};
  FlightRoom mixed(config, model, airframes, index);
  Random random(31);
  const std::vector<float> command = flight_commands(random, config.control, by_drone(mixed.fleet));
  const auto fly = [&](FlightRoom& room) {
    room.update_accelerations(drones, own);
    for (int step = 0; step < 40; ++step) room.fly(drones, own, command);
  };
  fly(mixed);
  EXPECT_GT(mixed.hits(), 3U);
  for (std::size_t row = 0; row < airframes.size(); ++row) {
    FlightRoom same(config, model, std::span(airframes).subspan(row, 1), kFirstRow);
    fly(same);
    for (std::size_t drone = 0; drone < kRoomDrones; ++drone) {
      if (index[drone] == static_cast<std::int32_t>(row)) expect_same_drone(mixed.state, same.state, drone);
    }
  }
}

TEST(Fleet, OfSeveralAirframesFliesEachDroneAsAFleetOfItsAirframe) {
  int tried = 0;
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    for (const Control control : kFlightControls) {
      SCOPED_TRACE(::testing::Message() << static_cast<int>(on_contact) << ' ' << static_cast<int>(control));
      DynamicsConfig config = room_dynamics(on_contact, control);
      config.wind.gusts = Gusts::dryden;
      config.integrator = tried++ % 2 == 0 ? Integrator::midpoint : Integrator::rk4;
      expect_same_flights(config, tried % 3 != 0);
    }
  }
}

// From the third step on, a drone with a new airframe flies as in a fleet of that airframe that starts from the same state.
TEST(Fleet, GivesADroneAnotherAirframeBetweenSteps) {
  const DroneModel model = DroneModel::load("crazyflie");
  const std::vector<Airframe> airframes{*model.airframe(), *DroneModel::load("hummingbird").airframe()};
  const DynamicsConfig config = room_dynamics(OnContact::bounce, Control::velocity);
  const std::vector<DroneIndex> drones = all_drones();
  FlightRoom mixed(config, model, airframes, kFirstRow);
  FlightRoom first(config, model, std::span(airframes).first(1), kFirstRow);
  FlightRoom second(config, model, std::span(airframes).last(1), kFirstRow);
  Random random(37);
  const std::vector<float> command = flight_commands(random, config.control, by_drone(mixed.fleet));
  for (int step = 0; step < 2; ++step) {
    mixed.fly(drones, kWholeRoom, command);
    first.fly(drones, kWholeRoom, command);
  }
  second.state = first.state;
  for (const std::size_t drone : {3U, 20U}) mixed.fleet.set_airframe(DroneIndex(drone), 1);
  for (int step = 0; step < 5; ++step) {
    mixed.fly(drones, kWholeRoom, command);
    first.fly(drones, kWholeRoom, command);
    second.fly(drones, kWholeRoom, command);
  }
  EXPECT_FALSE(same_bits(first.state.position, second.state.position));
  for (std::size_t drone = 0; drone < kRoomDrones; ++drone) {
    expect_same_drone(mixed.state, drone == 3 || drone == 20 ? second.state : first.state, drone);
  }
}

TEST(Fleet, UsesAnIntegratorThatSuitsEveryAirframe) {
  const Airframe slow = *DroneModel::load("kingfisher").airframe();
  Airframe fast = slow;
  fast.lag_up_s = fast.lag_down_s = 1e-4;
  const DynamicsConfig config = room_dynamics(OnContact::stop, Control::rotor_speeds);
  const auto is_rk4 = [&](std::vector<Airframe> airframes) {
    return Fleet(airframes, kFirstRow, config, kRoomClock, 1).physics.is_rk4;
  };
  EXPECT_TRUE(is_rk4({slow, slow}));
  EXPECT_FALSE(is_rk4({slow, fast}));
  EXPECT_FALSE(is_rk4({fast, slow}));
}

TEST(Fleet, HasThePhysicsOfEveryControl) {
  const Airframe slow = *DroneModel::load("kingfisher").airframe();
  Airframe fast = slow;
  fast.lag_up_s = fast.lag_down_s = 1e-4;
  for (const std::vector<Airframe>& airframes : {std::vector{slow}, std::vector{slow, fast}}) {
    for (const Integrator integrator : {Integrator::automatic, Integrator::midpoint}) {
      const auto fleet = [&](std::size_t control) {
        DynamicsConfig config = room_dynamics(OnContact::stop, static_cast<Control>(control));
        config.integrator = integrator;
        return Fleet(airframes, kFirstRow, config, kRoomClock, 1);
      };
      for (std::size_t made = 0; made < EnumNames<Control>::kNames.size(); ++made) {
        for (std::size_t flown = 0; flown < EnumNames<Control>::kNames.size(); ++flown) {
          const dynamics::Physics physics = fleet(made).physics_for(static_cast<Control>(flown));
          const dynamics::Physics expected = fleet(flown).physics;
          EXPECT_EQ(physics.stage, expected.stage);
          EXPECT_EQ(physics.is_rk4, expected.is_rk4);
        }
      }
    }
  }
}

TEST(Fleet, RefusesAirframesThatItCannotIntegrate) {
  const Airframe good = *DroneModel::load("kingfisher").airframe();
  Airframe fast = good, stiff = good;
  fast.lag_up_s = 1e-4;
  stiff.linear_drag = {0.0, 1e4, 0.0};
  DynamicsConfig config = room_dynamics(OnContact::stop, Control::rotor_speeds);
  const auto make = [&](std::vector<Airframe> airframes, std::int32_t row) {
    Fleet(airframes, std::vector(kRoomDrones, row), config, kRoomClock, 1);
  };
  make({good, good, good}, 2);
  EXPECT_REFUSED(make({}, 0), "airframes: ");
  EXPECT_REFUSED(make({good, good}, 2), "airframe_index: ... [0, 2) ... 2");
  EXPECT_REFUSED(make({good, good}, -1), "airframe_index: ");
  EXPECT_REFUSED(make({good, stiff}, 0), "airframes (row 1): ");
  EXPECT_REFUSED(make({stiff}, 0), "drone: ");
  config.integrator = Integrator::rk4;
  make({good, good}, 0);
  EXPECT_REFUSED(make({good, fast}, 0), "integrator: ");
  Fleet fleet(std::vector{good, good}, kFirstRow, config, kRoomClock, 1);
  EXPECT_REFUSED(fleet.set_airframe(DroneIndex(0), 2), "airframe_index: ");
}

// A simulation of two drones whose fleet has the given airframes.
std::unique_ptr<Simulation> simulation_of(const std::vector<Airframe>& airframes) {
  BatchConfig config;
  config.num_envs = 2;
  config.num_threads = 1;
  config.clock = kRoomClock;
  config.dynamics = room_dynamics(OnContact::stop, Control::velocity);
  auto sim = std::make_unique<Simulation>(config, Batch::Worlds{closet()}, nullptr, DroneModel::load("crazyflie"),
                                          std::span<const std::int32_t>());
  sim->fleet.emplace(airframes, std::vector<std::int32_t>(2), config.dynamics, config.clock, 1);
  return sim;
}

TEST(Fleet, IsPartOfASnapshotIfItHasSeveralAirframes) {
  const Airframe airframe = *DroneModel::load("crazyflie").airframe(), other = *DroneModel::load("x500").airframe();
  const auto sim = simulation_of({airframe, other}), same = simulation_of({airframe, other});
  sim->fleet->set_airframe(DroneIndex(1), 1);
  const std::string snapshot = make_snapshot(*sim);
  restore_snapshot(*same, snapshot);
  EXPECT_EQ(same->fleet->airframe_index, (std::vector<std::int32_t>{0, 1}));
  EXPECT_REFUSED(restore_snapshot(*simulation_of({airframe, airframe}), snapshot), "snapshot: ");
  EXPECT_REFUSED(restore_snapshot(*simulation_of({airframe}), snapshot), "snapshot: ");

  sim->fleet->airframe_index[1] = 2;
  EXPECT_REFUSED(restore_snapshot(*same, make_snapshot(*sim)), "airframe_index");
  EXPECT_EQ(same->fleet->airframe_index, (std::vector<std::int32_t>{0, 1}));
}

// -- Rotor motion: a drone flies identically in envs of several drones, in lists with gaps, and with gathered or contiguous
// lanes.

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
  for_each_float_array(a, b, [](const std::string& name, const auto& values, const auto& others) {
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
      for_each_float_array(row.state, before, [](const std::string& name, const auto& values, const auto& old) {
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
