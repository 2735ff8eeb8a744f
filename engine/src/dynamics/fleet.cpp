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

constexpr float kNever = 1e6F;  // s, default of DroneParameters::dead_from_s
constexpr std::size_t kBatteryLife = offsetof(DroneParameters, battery_life_s) / sizeof(float);
constexpr std::size_t kWind = offsetof(DroneParameters, wind_mps) / sizeof(float);

void set_gust(const Fleet& fleet, State& state, DroneIndex drone, const GustState& gust) {
  std::copy(gust.begin(), gust.end(), state.flight.gust.data() + kGustStates * drone);
  Vec3 velocity = fleet.wind.at(gust);
  if (fleet.has_parameters()) velocity += Vec3::Map(state.parameters.params.data() + kNumParameters * drone + kWind);
  Vec3::Map(state.flight.wind.data() + 3 * drone) = velocity;
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

// The drone of these variations that is hardest to integrate, and the one that is hardest to lift.
Airframe stiffest(const Airframe& frame, const Variations& variations) {
  const DroneParameters least = variations.least(), greatest = variations.greatest();
  DroneParameters p;
  p.mass_scale = least.mass_scale;
  p.stretch = least.stretch;
  p.arm_scale = greatest.arm_scale;
  p.lag_up_scale = least.lag_up_scale;
  p.lag_down_scale = least.lag_down_scale;
  p.body_drag_scale = greatest.body_drag_scale;
  p.rotor_drag_scale = greatest.rotor_drag_scale;
  return varied(frame, p);
}
Airframe weakest(const Airframe& frame, const Variations& variations) {
  const DroneParameters least = variations.least(), greatest = variations.greatest();
  DroneParameters p;
  p.mass_scale = greatest.mass_scale;
  p.payload_kg = greatest.payload_kg;
  float thrust = 0.0F;
  const auto share = 1.0F / static_cast<float>(frame.num_rotors());
  for (std::size_t i = 0; i < frame.num_rotors(); ++i) thrust += share * least.rotor_thrust_scale[i];
  p.thrust_scale = std::max(least.thrust_scale * thrust, 1e-3F);
  return varied(frame, p);
}

std::vector<Airframe> checked(std::span<const Airframe> airframes, const DynamicsConfig& config, const ClockConfig& clock,
                              const Variations& variations) {
  require(!airframes.empty(), "airframes", "at least one", "none");
  for (std::size_t row = 0; row < airframes.size(); ++row) {
    const std::string name = airframes.size() == 1 ? "drone" : "airframes (row " + std::to_string(row) + ")";
    require_integrable(stiffest(airframes[row], variations), name, config, clock);
    if (variations.empty()) continue;
    const double lift = weakest(airframes[row], variations).thrust_to_weight();
    require(lift > 1.0, "variations of mass and thrust", "every drone to lift its weight (a thrust above 1 weight) with " + name,
            lift);
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

Physics physics_of(std::span<const Airframe> airframes, const DynamicsConfig& config, const ClockConfig& clock, std::size_t m,
                   const Variations& variations) {
  Physics physics(airframes[0], config, clock.dt_s(), clock.control_ticks());
  for (const Airframe& frame : airframes.subspan(1)) {
    physics.include(Physics(frame, config, clock.dt_s(), clock.control_ticks()));
  }
  for (const Airframe& frame : airframes) {
    physics.is_rk4 &= Physics::flies_by_rk4(stiffest(frame, variations), config, clock.dt_s());
  }
  physics.downwash &= m > 1;  // there is no other drone
  return physics;
}

// Commands of a drone that may be under way at once.
std::size_t commands_under_way(const Variations& variations, const ClockConfig& clock) {
  const DroneParameters most = variations.greatest();
  const double time = static_cast<double>(most.action_delay_s + most.action_jitter_s);
  return static_cast<std::size_t>(std::ceil(time / clock.dt_s()));
}

}  // namespace

Fleet::Fleet(const Airframe& frame, const DynamicsConfig& config_in, const ClockConfig& clock_in, std::size_t m,
             std::size_t num_drones)
    : Fleet(std::span(&frame, 1), std::vector<std::int32_t>(num_drones), config_in, clock_in, m) {}

Fleet::Fleet(std::span<const Airframe> frames, std::span<const std::int32_t> index, const DynamicsConfig& config_in,
             const ClockConfig& clock_in, std::size_t m, const Variations& variations_in)
    : config(config_in),
      clock(clock_in),
      drones_per_env(m),
      airframes(checked(frames, config, clock, variations_in)),
      numbers(numbers_of(airframes, config, clock)),
      airframe_index(checked(index, airframes.size())),
      variations(variations_in),
      physics(physics_of(airframes, config, clock, m, variations)),
      wash(airframes.begin(), airframes.end()),
      wind(config.wind, clock.step_s()) {
  const std::size_t num_drones = index.size();
  open.center.resize(3 * num_drones);
  open.radius.resize(num_drones, -1.0F);
  open.world.resize(num_drones);
  if (physics.downwash) thrust_share.resize(num_rotors() * num_drones, 1.0F);
  const DroneParameters least = variations.least(), greatest = variations.greatest();
  turn_on(least, greatest);
  if (greatest.action_delay_s > 0.0F || greatest.action_jitter_s > 0.0F || greatest.action_loss > 0.0F) {
    require(!config.is_kinematic() && config.control != Control::pose, "variations: action_delay_s",
            "a control other than \"pose\", whose commands can be late", "\"pose\"");
    commands = CommandRing(num_drones, commands_under_way(variations, clock), command_size(config.control));
  }
  if (airframes.size() > 1 || !variations.empty()) true_airframes.resize(num_drones, airframes[0]);
  for (Airframe& frame : true_airframes) {  // resets allocate nothing
    frame.position_m.reserve(num_rotors());
    frame.spin.reserve(num_rotors());
  }
  if (airframes.size() > 1 || variations.differ()) lane_numbers.resize((num_drones + kLanes - 1) / kLanes);
  for (std::size_t drone = 0; drone < num_drones; ++drone) renew(DroneIndex(drone), {});
  if (!variations.empty() && lane_numbers.empty()) {  // all drones differ from the airframe in the same way
    physics.numbers = dynamics::numbers_of(airframes[0], varied(airframes[0], least), numbers[0], least, config, clock.dt_s(),
                                           clock.dt_s() * clock.control_ticks());
    std::array<const AirframeNumbers<float>*, kLanes> same;
    same.fill(&physics.numbers);
    set_lanes(same, physics.lanes);
  }
}

void Fleet::turn_on(const DroneParameters& least, const DroneParameters& greatest) {
  const auto is_any = [](const auto& values) { return std::ranges::any_of(values, [](float v) { return v != 0.0F; }); };
  physics.pushed |=
      is_any(least.push_mps2) || is_any(greatest.push_mps2) || is_any(least.twist_radps2) || is_any(greatest.twist_radps2);
  physics.drains |= greatest.battery_fall > 0.0F || greatest.battery_sag > 0.0F || least.dead_from_s < kNever;
}

void Fleet::set_airframe(DroneIndex drone, std::int32_t row) {
  check_row(row, airframes.size());
  if (airframe_index.empty()) return;
  airframe_index[drone] = row;
  renew(drone, {});
}

void Fleet::renew(DroneIndex drone, const DroneParameters& parameters) {
  if (true_airframes.empty()) return;
  const Airframe& frame = airframe_of(drone);
  Airframe& made = true_airframes[drone];
  variations.empty() ? void(made = frame) : set_varied(frame, parameters, made);
  if (lane_numbers.empty()) return;
  const AirframeNumbers<float>& known = numbers[airframe_row(drone)];
  const double dt = clock.dt_s();
  set_lane(
      variations.empty() ? known : dynamics::numbers_of(frame, made, known, parameters, config, dt, dt * clock.control_ticks()),
      drone % kLanes, lane_numbers[drone / kLanes]);
}

DroneParameters Fleet::parameters_of(const State& state, DroneIndex drone) {
  DroneParameters parameters;
  std::ranges::copy(std::span(state.parameters.params).subspan(kNumParameters * drone, kNumParameters),
                    floats_of(parameters).begin());
  return parameters;
}

void Fleet::begin_parameters(State& state, DroneIndex drone) {
  if (!has_parameters()) return;
  DroneParameters parameters;
  variations.begin(state, RandomKey::of(drone, drones_per_env), parameters);
  std::ranges::copy(floats_of(parameters), state.parameters.params.data() + kNumParameters * drone);
  state.parameters.battery[drone] = parameters.battery_used;
  if (!commands.empty()) commands.clear(drone);
  apply_parameters(state, drone);
}

void Fleet::set_variations(const Variations& next) {
  for (std::size_t i = 0; i < kNumParameters; ++i) {
    require(next.lists(i) == variations.lists(i), "variations", "laws of the same parameters as before",
            (next.lists(i) ? "also " : "none of ") + parameter_names()[i]);
  }
  require(commands_under_way(next, clock) <= commands.most(), "variations: action_delay_s, action_jitter_s",
          "at most the delay and jitter that the batch was made with (" +
              std::to_string(static_cast<double>(commands.most()) * clock.dt_s()) + " s)",
          next.greatest().action_delay_s + next.greatest().action_jitter_s);
  require(!commands.empty() || next.greatest().action_loss <= 0.0F, "variations: action_loss", "0, as in the batch's making",
          next.greatest().action_loss);
  (void)checked(airframes, config, clock, next);
  for (const Airframe& frame : airframes) {
    require(!physics.is_rk4 || can_rk4(stiffest(frame, next), config, clock.dt_s()), "variations: lag_up_scale, lag_down_scale",
            "a lag of at least half a tick", std::min(next.least().lag_up_scale, next.least().lag_down_scale));
  }
  const DroneParameters before = variations.least(), after = next.least();
  const bool is_same = !next.differ() && std::ranges::equal(floats_of(before), floats_of(after));
  variations = next;
  turn_on(next.least(), next.greatest());
  if (!is_same) part();  // drones whose episodes go on keep the numbers of the constants before
}

void Fleet::check_parameters(std::span<const float> numbers_given) const {
  dynamics::check_parameters(numbers_given, "params: ");
  DroneParameters p;
  std::ranges::copy(numbers_given, floats_of(p).begin());
  const DroneParameters defaults, most = variations.greatest();
  for (std::size_t i = 0; i < kNumParameters; ++i) {
    if (numbers_given[i] == floats_of(defaults)[i] || variations.lists(i)) continue;
    refuse("params: " + parameter_names()[i], "its default (no variation lists it)", numbers_given[i]);
  }
  const float slowest = most.action_delay_s + most.action_jitter_s;
  require(p.action_delay_s + p.action_jitter_s <= slowest, "params: action_delay_s",
          "at most the greatest delay and jitter of the variations (" + std::to_string(slowest) + " s)",
          p.action_delay_s + p.action_jitter_s);
  require(p.airframe < static_cast<float>(airframes.size()), "params: airframe",
          "below the number of airframes (" + std::to_string(airframes.size()) + ")", p.airframe);
  const Airframe made = varied(airframes[static_cast<std::size_t>(p.airframe)], p);
  require_integrable(made, "params", config, clock);
  require(!physics.is_rk4 || can_rk4(made, config, clock.dt_s()), "params: lag_up_scale, lag_down_scale",
          "a lag of at least half a tick", std::min(p.lag_up_scale, p.lag_down_scale));
}

void Fleet::part() {
  if (!lane_numbers.empty()) return;
  lane_numbers.resize((true_airframes.size() + kLanes - 1) / kLanes);
  for (std::size_t drone = 0; drone < true_airframes.size(); ++drone) {
    set_lane(physics.numbers, drone % kLanes, lane_numbers[drone / kLanes]);
  }
}

void Fleet::apply_parameters(State& state, DroneIndex drone) {
  const DroneParameters parameters = parameters_of(state, drone);
  turn_on(parameters, parameters);
  if (!airframe_index.empty()) airframe_index[drone] = static_cast<std::int32_t>(parameters.airframe);
  renew(drone, parameters);
  clear_absent_rotors(state, drone);
  GustState gust;
  std::copy_n(state.flight.gust.data() + kGustStates * drone, kGustStates, gust.data());
  set_gust(*this, state, drone, gust);
}

void Fleet::redraw_parameters(State& state, std::span<const DroneIndex> drones, int ticks_ahead) {
  if (!variations.has_interval()) return;
  for (const DroneIndex drone : drones) {
    DroneParameters parameters = parameters_of(state, drone);
    const std::int64_t tick = state.tick[env_of(drone)] + ticks_ahead;
    if (!variations.redraw(state, RandomKey::of(drone, drones_per_env), tick, parameters)) continue;
    std::ranges::copy(floats_of(parameters), state.parameters.params.data() + kNumParameters * drone);
    apply_parameters(state, drone);
  }
}

// A rotor's power grows with the cube of its speed.
void Fleet::drain_batteries(State& state, std::span<const DroneIndex> drones) const {
  if (!physics.drains) return;
  for (const DroneIndex drone : drones) {
    const float* const speed = state.flight.rotor_speed.data() + num_rotors() * drone;
    const auto hover = static_cast<float>(airframe_of(drone).hover_speed());
    const float share = 1.0F / static_cast<float>(airframe_of(drone).num_rotors());
    float power = 0.0F;  // in units of hovering
    for (std::size_t i = 0; i < num_rotors(); ++i) power += share * (speed[i] / hover) * (speed[i] / hover) * (speed[i] / hover);
    const float life = state.parameters.params[kNumParameters * drone + kBatteryLife];
    float& used = state.parameters.battery[drone];
    used = std::min(used + power * static_cast<float>(clock.step_s()) / life, 1.0F);
  }
}

std::array<float, kMaxRotors> Fleet::speed_share(const State& state, DroneIndex drone, std::int64_t tick) const {
  const DroneParameters parameters = parameters_of(state, drone);
  const float* const speed = state.flight.rotor_speed.data() + num_rotors() * drone;
  const auto fastest = static_cast<float>(airframe_of(drone).max_speed_radps);
  const float share = 1.0F / static_cast<float>(airframe_of(drone).num_rotors());
  float load = 0.0F;  // share of full power
  for (std::size_t i = 0; i < num_rotors(); ++i)
    load += share * (speed[i] / fastest) * (speed[i] / fastest) * (speed[i] / fastest);
  const float left = 1.0F - parameters.battery_fall * state.parameters.battery[drone] - parameters.battery_sag * load;
  std::array<float, kMaxRotors> shares;
  shares.fill(std::max(left, 0.0F));
  const double dead_from = std::round(static_cast<double>(parameters.dead_from_s) / clock.step_s()) * clock.substeps();
  if (static_cast<double>(tick) >= dead_from) shares[static_cast<std::size_t>(parameters.dead_rotor)] = 0.0F;
  return shares;
}

void Fleet::send_commands(const State& state, std::span<const DroneIndex> drones, std::span<const float> command) {
  if (commands.empty()) return;
  constexpr Stream kStream = stream_named("latency");
  for (const DroneIndex drone : drones) {
    const DroneParameters parameters = parameters_of(state, drone);
    const std::int64_t now = state.tick[env_of(drone)];
    const auto bits = draw(state, RandomKey::of(drone, drones_per_env), kStream, static_cast<std::uint32_t>(now));
    const bool is_first = commands.has_none(drone), is_lost = !is_first && uniform01(bits[0]) < parameters.action_loss;
    if (!is_lost) {
      const double late = static_cast<double>(parameters.action_delay_s + uniform01(bits[1]) * parameters.action_jitter_s);
      commands.add(drone, command.data() + command_size(config.control) * drone,
                   is_first ? now : now + std::llround(late / clock.dt_s()));
    }
    if (on_sent) on_sent(drone, !is_lost);
  }
}

void Fleet::restored(State& state) {
  const auto is_row = [&](std::int32_t row) { return row >= 0 && static_cast<std::size_t>(row) < airframes.size(); };
  for (const std::int32_t row : airframe_index) {
    require(is_row(row), "snapshot: airframe_index", "rows of the table of airframes", row);
  }
  require(commands.is_valid(), "snapshot: ring_count", "numbers >= 0", "another");
  dynamics::check_parameters(state.parameters.params, "snapshot: params: ");
  for (std::size_t drone = 0; has_parameters() && drone < true_airframes.size(); ++drone) {
    const float row = parameters_of(state, DroneIndex(drone)).airframe;
    require(is_row(static_cast<std::int32_t>(row)), "snapshot: params: airframe", "rows of the table of airframes", row);
  }
  for (std::size_t drone = 0; drone < true_airframes.size(); ++drone) {
    const DroneIndex d(drone);
    if (!has_parameters()) {
      renew(d, {});
      clear_absent_rotors(state, d);
      continue;
    }
    const DroneParameters parameters = parameters_of(state, d);
    turn_on(parameters, parameters);
    renew(d, parameters);
    clear_absent_rotors(state, d);
  }
}

void Fleet::clear_absent_rotors(State& state, DroneIndex drone) const {
  for (std::size_t i = num_rotors() * drone + airframe_of(drone).num_rotors(); i < num_rotors() * (drone + 1); ++i) {
    state.flight.rotor_speed[i] = state.flight.rotor_command[i] = 0.0F;
  }
}

Physics Fleet::physics_for(Control control) const {
  require(commands.empty(), "control", "that of the batch, because commands may be late", "another");
  DynamicsConfig changed = config;
  changed.control = control;
  Physics other = physics;
  other.stage = stage_of(control);
  other.is_rk4 = std::ranges::all_of(airframes, [&](const Airframe& frame) {
    return Physics::flies_by_rk4(stiffest(frame, variations), changed, clock.dt_s());
  });
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
  const auto hover_speed = static_cast<float>(true_airframe_of(drone).hover_speed());
  for (std::size_t i = num_rotors() * drone; i < num_rotors() * (drone + 1); ++i) {
    flight.rotor_speed[i] = flight.rotor_command[i] = hover_speed;
  }
  clear_absent_rotors(state, drone);
}

void Fleet::begin_gusts(State& state, DroneIndex drone) const {
  set_gust(*this, state, drone, wind.has_gusts() ? wind.begin(gust_noise(*this, state, drone, 0)) : GustState{});
}

void Fleet::update_wind(State& state, std::span<const DroneIndex> drones, int ticks_ahead) const {
  if (!wind.has_gusts()) return;
  for (const DroneIndex drone : drones) {
    GustState gust;
    std::copy_n(state.flight.gust.data() + kGustStates * drone, kGustStates, gust.data());
    // Index the noise by ticks: a batch without a task has no steps.
    const std::int64_t tick = state.tick[env_of(drone)] + ticks_ahead;
    set_gust(*this, state, drone, wind.next(gust, gust_noise(*this, state, drone, tick + 1)));
  }
}

}  // namespace flockstep::dynamics
