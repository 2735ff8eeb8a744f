// FlightRoom: drones with simulated rotors in a room, without a batch.
#pragma once

#include "batch_helpers.hpp"
#include "collision/hull.hpp"
#include "dynamics/rotor_motion.hpp"
#include "flight_state.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep::testing {

inline constexpr std::size_t kRoomDrones = 39;  // not a multiple of the lanes
inline const dynamics::DroneRange kWholeRoom{DroneIndex(0), kRoomDrones};
inline const ClockConfig kRoomClock{.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = 250.0F};

class FlightRoom {
 public:
  // airframe_index: (N,) row of each drone's airframe in the table. All drones have the model's hull.
  FlightRoom(const DynamicsConfig& config, const DroneModel& model, std::span<const Airframe> airframes,
             std::span<const std::int32_t> airframe_index, std::size_t drones_per_env = 1)
      : hull_(model),
        corners_(model.hull()),
        state(flight_state(kRoomDrones / drones_per_env, drones_per_env)),
        fleet(airframes, airframe_index, config, kRoomClock, drones_per_env),
        slots_(kRoomDrones / drones_per_env) {
    start();
  }
  FlightRoom(const DynamicsConfig& config, const DroneModel& model, std::size_t drones_per_env = 1)
      : hull_(model),
        corners_(model.hull()),
        state(flight_state(kRoomDrones / drones_per_env, drones_per_env)),
        fleet(*model.airframe(), config, kRoomClock, drones_per_env, kRoomDrones),
        slots_(kRoomDrones / drones_per_env) {
    start();
  }

  // Flies the listed drones for one step. For `own` see dynamics::FlightContext.
  void fly(std::span<const DroneIndex> drones, const dynamics::DroneRange& own, std::span<const float> command) {
    fleet.update_wind(state, drones, 0);
    const dynamics::Commands commands{.command = command, .target = {}, .step_start = {}};
    for (int tick = 0; tick < kRoomClock.substeps(); tick += 5) {
      dynamics::fly(context(own), drones, commands, tick, 5);
      for (std::int64_t& ticks : state.tick) ticks += 5;
    }
    EXPECT_EQ(std::ranges::count(bad_, 1), 0);
  }
  void update_accelerations(std::span<const DroneIndex> drones, const dynamics::DroneRange& own) {
    dynamics::update_accelerations(context(own), drones);
  }
  std::size_t hits() const { return static_cast<std::size_t>(std::ranges::count(state.contact.hit, 1)); }

 private:
  void start() {
    Random random(17);
    for (std::size_t drone = 0; drone < kRoomDrones; ++drone) {
      fleet.start(state, DroneIndex(drone), {random.point(1.5F), random.point(1.0F)});
      const Vec3 at = random.point(0.7F);
      std::copy_n(at.data(), 3, state.position.data() + 3 * drone);
    }
  }
  dynamics::FlightContext context(const dynamics::DroneRange& own) {
    return {fleet, state, hull_, slots_, scenes_, obstacles_, bad_, {}, own, *tracer_, *scratch_};
  }

  // Low and narrow, so that drones hit it.
  std::shared_ptr<const World> world_ = make_world({primitive(PrimitiveKind::room, Vec3::Zero(), {2.0F, 2.0F, 1.0F}),
                                                    primitive(PrimitiveKind::cylinder, {1.2F, 0.4F, 0.0F}, {0.3F, 0.3F, 1.0F})});
  collision::Hull hull_;
  collision::Corners corners_;

 public:
  State state;
  dynamics::Fleet fleet;

 private:
  std::vector<std::int32_t> slots_;
  std::vector<std::uint8_t> bad_ = std::vector<std::uint8_t>(kRoomDrones);
  std::vector<const trace::Scene*> scenes_{&prepared(*world_).scene()};
  std::vector<const collision::Obstacles*> obstacles_{&prepared(*world_).obstacles()};
  std::unique_ptr<trace::Tracer> tracer_ = std::make_unique<trace::Tracer>();
  std::unique_ptr<dynamics::FlightScratch> scratch_ = std::make_unique<dynamics::FlightScratch>(hull_, corners_);
};

inline DynamicsConfig room_dynamics(OnContact on_contact, Control control) {
  DynamicsConfig config{.motion = Motion::rotors, .control = control, .on_contact = on_contact, .ground_effect = true};
  config.wind.mean_mps = {1.0F, 0.5F, 0.0F};
  return config;
}

}  // namespace flockstep::testing
