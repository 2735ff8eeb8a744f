// Rotor motion: a drone flies the same in envs of several drones, in lists with gaps, and gathered or in one piece.
#include "dynamics/rotor_motion.hpp"

#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "collision/hull.hpp"
#include "compiled/compiled_world.hpp"
#include "flight_state.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using dynamics::DroneRange;
using dynamics::Fleet;
using testing::primitive;
using testing::Random;
using testing::same_bits;

constexpr std::size_t kDrones = 39;  // not a multiple of the lanes
const ClockConfig kClock{.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = 250.0F};

// A room with a pillar, so low and narrow that drones hit it.
std::shared_ptr<const World> low_room() {
  return testing::make_world({primitive(PrimitiveKind::room, Vec3::Zero(), {2.0F, 2.0F, 1.0F}),
                              primitive(PrimitiveKind::cylinder, {1.2F, 0.4F, 0.0F}, {0.3F, 0.3F, 1.0F})});
}

// Drones in the room that fly outside of a batch.
class Room {
 public:
  Room(const DynamicsConfig& config, const DroneModel& model, std::size_t drones_per_env)
      : hull_(model),
        state(testing::flight_state(kDrones / drones_per_env, drones_per_env)),
        fleet(*model.airframe(), config, kClock, drones_per_env, kDrones),
        slots_(kDrones / drones_per_env) {
    Random random(17);
    for (std::size_t drone = 0; drone < kDrones; ++drone) {
      fleet.start(state, DroneIndex(drone), {random.point(1.5F), random.point(1.0F)});
      const Vec3 at = random.point(0.7F);
      std::copy_n(at.data(), 3, state.position.data() + 3 * drone);
    }
  }

  // Flies the listed drones for a step, then lets them accelerate freely.
  void fly(std::span<const DroneIndex> drones, const DroneRange& own, std::span<const float> command) {
    const dynamics::FlightContext context{fleet, state, hull_, slots_, scenes_, obstacles_, {}, 1, own, *tracer_, *scratch_};
    fleet.update_wind(state, drones, 0);
    const dynamics::Commands commands{.command = command, .target = {}, .step_start = {}};
    for (int tick = 0; tick < kClock.substeps(); tick += 5) {
      dynamics::fly(context, drones, commands, tick, 5);
      for (std::int64_t& ticks : state.tick) ticks += 5;
    }
    EXPECT_EQ(scratch_->lost.count, 0U);
  }
  void update_accelerations(std::span<const DroneIndex> drones, const DroneRange& own) {
    dynamics::update_accelerations({fleet, state, hull_, slots_, scenes_, obstacles_, {}, 1, own, *tracer_, *scratch_}, drones);
  }
  std::size_t hits() const { return static_cast<std::size_t>(std::ranges::count(state.contact.hit, 1)); }

 private:
  std::shared_ptr<const World> world_ = low_room();
  collision::Hull hull_;

 public:
  State state;
  Fleet fleet;

 private:
  std::vector<std::int32_t> slots_;
  std::vector<const trace::Scene*> scenes_{&compiled(*world_).scene()};
  std::vector<const collision::Obstacles*> obstacles_{&compiled(*world_).obstacles()};
  std::unique_ptr<trace::Tracer> tracer_ = std::make_unique<trace::Tracer>();
  std::unique_ptr<dynamics::FlightScratch> scratch_ = std::make_unique<dynamics::FlightScratch>();
};

DynamicsConfig dynamics_of(OnContact on_contact, Control control) {
  DynamicsConfig config;
  config.motion = Motion::rotors;
  config.control = control;
  config.on_contact = on_contact;
  config.ground_effect = true;
  config.wind.mean_mps = {1.0F, 0.5F, 0.0F};
  return config;
}

std::vector<float> positions(Random& random) {
  std::vector<float> command;
  for (std::size_t i = 0; i < 4 * kDrones; ++i) command.push_back(random.within(-3.0F, 3.0F));
  return command;
}

const DroneRange kAll{DroneIndex(0), kDrones};

std::vector<DroneIndex> every(std::size_t step) {
  std::vector<DroneIndex> list;
  for (std::size_t drone = 0; drone < kDrones; drone += step) list.emplace_back(drone);
  return list;
}

// Every array of two states, those of envs excepted.
void expect_same_flight(const State& a, const State& b) {
  testing::for_each_float_array(a, [&](const std::string& name, const std::vector<float>& values) {
    testing::for_each_float_array(b, [&](const std::string& other, const std::vector<float>& others) {
      if (name == other) {
        EXPECT_TRUE(same_bits(values, others)) << name;
      }
    });
  });
  EXPECT_EQ(a.contact.hit, b.contact.hit);
  EXPECT_EQ(a.contact.inside, b.contact.inside);
}

TEST(RotorMotion, OfADroneIsTheSameInEnvsOfThree) {
  const DroneModel model = DroneModel::load("crazyflie");
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    SCOPED_TRACE(static_cast<int>(on_contact));
    const DynamicsConfig config = dynamics_of(on_contact, Control::position);
    Room single(config, model, 1), triple(config, model, 3);
    const std::vector<DroneIndex> all = every(1);
    Random random(23);
    const std::vector<float> command = positions(random);
    for (int step = 0; step < 60; ++step) {
      single.fly(all, kAll, command);
      triple.fly(all, kAll, command);
    }
    EXPECT_GT(single.hits(), 5U);
    expect_same_flight(single.state, triple.state);
  }
}

TEST(RotorMotion, IsTheSameGatheredAndInOnePieceAndLeavesOthersAlone) {
  const DroneModel model = DroneModel::load("kingfisher").scaled(0.4, 0.1);
  for (const OnContact on_contact : {OnContact::terminate, OnContact::stop, OnContact::bounce}) {
    for (const Control control : {Control::position, Control::velocity}) {
      SCOPED_TRACE(::testing::Message() << static_cast<int>(on_contact) << ' ' << static_cast<int>(control));
      DynamicsConfig config = dynamics_of(on_contact, control);
      config.wind.gusts = Gusts::dryden;
      Room row(config, model, 1), gathered(config, model, 1);
      const State before = row.state;
      const std::vector<DroneIndex> odd = every(2);
      row.update_accelerations(odd, kAll);
      gathered.update_accelerations(odd, {});
      expect_same_flight(row.state, gathered.state);
      Random random(29);
      const std::vector<float> command = positions(random);
      for (int step = 0; step < 60; ++step) {
        row.fly(odd, kAll, command);
        gathered.fly(odd, {}, command);
      }
      EXPECT_GT(row.hits(), 3U);
      expect_same_flight(row.state, gathered.state);
      testing::for_each_float_array(row.state, [&](const std::string& name, const std::vector<float>& values) {
        testing::for_each_float_array(before, [&](const std::string& other, const std::vector<float>& old) {
          if (name != other) return;
          const std::size_t columns = values.size() / kDrones;
          for (std::size_t drone = 1; drone < kDrones; drone += 2) {
            EXPECT_TRUE(
                same_bits(std::span(values).subspan(drone * columns, columns), std::span(old).subspan(drone * columns, columns)))
                << name << ' ' << drone;
          }
        });
      });
    }
  }
}

}  // namespace
}  // namespace flockstep
