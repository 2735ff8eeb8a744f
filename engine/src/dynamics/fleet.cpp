#include "dynamics/fleet.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "base/random.hpp"
#include "base/require.hpp"

namespace flockstep::dynamics {
namespace {

GustNoise gust_noise(const Fleet& fleet, const State& state, DroneIndex drone, std::int64_t tick) {
  constexpr std::uint32_t kDraws = 3;  // two numbers each
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

void require_integrable(const Airframe& frame, const std::string& name, const DynamicsConfig& config, const ClockConfig& clock) {
  require(config.integrator != Integrator::rk4 || can_rk4(frame, config, clock.dt_s()), "integrator",
          "midpoint or automatic if a tick is longer than twice the rotors' lag", "rk4");
  constexpr double kMaxStiffness = 2.0;  // per tick; above this a midpoint step amplifies instead of damping
  const double ticks = clock.ticks_hz();
  if (const double rate = stiffness(frame, config); rate > kMaxStiffness * ticks) {
    std::ostringstream expected;
    expected << "drag and rotor inertia with rates of at most " << kMaxStiffness * ticks
             << " 1/s, two per tick (or a physics_hz of at least " << std::ceil(rate / kMaxStiffness) << ")";
    refuse(name, expected.str(), rate);
  }
}

std::vector<Airframe> checked(std::span<const Airframe> airframes, const DynamicsConfig& config, const ClockConfig& clock) {
  require(!airframes.empty(), "airframes", "at least one", "none");
  for (std::size_t row = 0; row < airframes.size(); ++row) {
    const std::string name = airframes.size() == 1 ? "drone" : "airframes (row " + std::to_string(row) + ")";
    require_integrable(airframes[row], name, config, clock);
  }
  return {airframes.begin(), airframes.end()};
}

void check_row(std::int32_t row, std::size_t num_airframes) {
  require(row >= 0 && static_cast<std::size_t>(row) < num_airframes, "airframe_index",
          "an integer in [0, " + std::to_string(num_airframes) + ")", row);
}

std::vector<std::int32_t> checked(std::span<const std::int32_t> airframe_index, std::size_t num_airframes) {
  for (const std::int32_t row : airframe_index) check_row(row, num_airframes);
  return num_airframes == 1 ? std::vector<std::int32_t>() : std::vector(airframe_index.begin(), airframe_index.end());
}

std::vector<AirframeNumbers<float>> numbers_of(std::span<const Airframe> airframes, const DynamicsConfig& config,
                                               const ClockConfig& clock) {
  std::vector<AirframeNumbers<float>> numbers;
  for (const Airframe& frame : airframes) {
    numbers.push_back(Physics(frame, config, clock.dt_s(), clock.control_ticks()).numbers);
  }
  return numbers;
}

Physics physics_of(std::span<const Airframe> airframes, const DynamicsConfig& config, const ClockConfig& clock, std::size_t m) {
  Physics physics(airframes[0], config, clock.dt_s(), clock.control_ticks());
  for (const Airframe& frame : airframes.subspan(1)) {
    physics.include(Physics(frame, config, clock.dt_s(), clock.control_ticks()));
  }
  physics.downwash &= m > 1;  // there is no other drone
  return physics;
}

}  // namespace

Fleet::Fleet(const Airframe& frame, const DynamicsConfig& config_in, const ClockConfig& clock_in, std::size_t m,
             std::size_t num_drones)
    : Fleet(std::span(&frame, 1), std::vector<std::int32_t>(num_drones), config_in, clock_in, m) {}

Fleet::Fleet(std::span<const Airframe> frames, std::span<const std::int32_t> index, const DynamicsConfig& config_in,
             const ClockConfig& clock_in, std::size_t m)
    : config(config_in),
      clock(clock_in),
      drones_per_env(m),
      airframes(checked(frames, config, clock)),
      numbers(numbers_of(airframes, config, clock)),
      airframe_index(checked(index, airframes.size())),
      physics(physics_of(airframes, config, clock, m)),
      wash(airframes.begin(), airframes.end()),
      wind(config.wind, clock.step_s()) {
  const std::size_t num_drones = index.size();
  open.center.resize(3 * num_drones);
  open.radius.resize(num_drones, -1.0F);
  open.world.resize(num_drones);
  if (physics.downwash) thrust_share.resize(kRotors * num_drones, 1.0F);
}

void Fleet::set_airframe(DroneIndex drone, std::int32_t row) {
  check_row(row, airframes.size());
  if (!airframe_index.empty()) airframe_index[drone] = row;
}

Physics Fleet::physics_for(Control control) const {
  DynamicsConfig changed = config;
  changed.control = control;
  Physics other = physics;
  other.stage = stage_of(control);
  other.is_rk4 =
      std::ranges::all_of(airframes, [&](const Airframe& frame) { return Physics::flies_by_rk4(frame, changed, clock.dt_s()); });
  return other;
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
  const auto hover_speed = static_cast<float>(airframe_of(drone).hover_speed());
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
    // Index the noise by ticks: a batch without a task has no steps.
    const std::int64_t tick = state.tick[env_of(drone)] + ticks_ahead;
    set_gust(wind, state, drone, wind.next(gust, gust_noise(*this, state, drone, tick + 1)));
  }
}

}  // namespace flockstep::dynamics
