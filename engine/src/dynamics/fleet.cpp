#include "dynamics/fleet.hpp"

#include <algorithm>

#include "base/random.hpp"

namespace flockstep::dynamics {
namespace {

GustNoise gust_noise(const Fleet& fleet, const State& state, DroneIndex drone, std::int64_t tick) {
  constexpr std::uint32_t kDraws = 3;  // of two numbers each
  const RandomKey key = RandomKey::of(drone, fleet.drones_per_env);
  const std::uint32_t index = kDraws * static_cast<std::uint32_t>(tick);
  const auto [a, b] = normal_pair(draw(state, key, Stream::gust, index));
  const auto [c, d] = normal_pair(draw(state, key, Stream::gust, index + 1));
  const auto [e, unused] = normal_pair(draw(state, key, Stream::gust, index + 2));
  return {a, b, c, d, e};
}

void set_gust(const Wind& wind, State& state, DroneIndex drone, const GustState& gust) {
  std::copy(gust.begin(), gust.end(), state.flight.gust.data() + kGustStates * drone);
  const Vec3 velocity = wind.at(gust);
  std::copy_n(velocity.data(), 3, state.flight.wind.data() + 3 * drone);
}

}  // namespace

Fleet::Fleet(const Airframe& frame, const DynamicsConfig& config_in, const ClockConfig& clock_in, std::size_t m,
             std::size_t num_drones)
    : config(config_in),
      clock(clock_in),
      drones_per_env(m),
      airframe(frame),
      physics(frame, config, clock.dt_s(), clock.control_ticks()),
      wind(config.wind, clock.step_s()) {
  open.center.resize(3 * num_drones);
  open.radius.resize(num_drones, -1.0F);
  open.world.resize(num_drones);
}

void Fleet::start(State& state, DroneIndex drone, const Velocity& velocity) const {
  begin_gusts(state, drone);
  FlightState& flight = state.flight;
  for (std::size_t k = 0; k < 3; ++k) {
    const std::size_t i = 3 * drone + k;
    flight.velocity[i] = velocity.linear[static_cast<Eigen::Index>(k)];
    flight.angular_velocity[i] = velocity.angular[static_cast<Eigen::Index>(k)];
    flight.acceleration[i] = flight.angular_acceleration[i] = flight.error_integral[i] = flight.remainder[i] = 0.0F;
  }
  const auto hover_speed = static_cast<float>(airframe.hover_speed());
  for (std::size_t i = kRotors * drone; i < kRotors * (drone + 1); ++i) {
    flight.rotor_speed[i] = flight.rotor_command[i] = hover_speed;
  }
}

void Fleet::begin_gusts(State& state, DroneIndex drone) const {
  set_gust(wind, state, drone, wind.has_gusts() ? wind.begin(gust_noise(*this, state, drone, 0)) : GustState{});
}

void Fleet::update_wind(State& state, std::span<const DroneIndex> drones, int ticks_ahead) const {
  if (!wind.has_gusts()) return;
  for (const DroneIndex drone : drones) {
    GustState gust;
    std::copy_n(state.flight.gust.data() + kGustStates * drone, kGustStates, gust.data());
    // The noise is indexed by ticks, since a batch without a task has no steps.
    const std::int64_t tick = state.tick[env_of(drone)] + ticks_ahead;
    set_gust(wind, state, drone, wind.next(gust, gust_noise(*this, state, drone, tick + 1)));
  }
}

}  // namespace flockstep::dynamics
