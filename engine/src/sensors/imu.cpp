#include "flockstep/sensors/imu.hpp"

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string_view>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "sensors/flown_motion.hpp"
#include "sensors/noisy_sensor.hpp"
#include "sensors/presets.hpp"
#include "sensors/rows.hpp"

namespace flockstep {

void ImuConfig::validate() const { check_fields(*this, "imu."); }

void ImuConfig::check_motion(const DynamicsConfig& dynamics) const {
  const auto require_still = [&](float vibration, const char* name) {
    require(!dynamics.is_kinematic() || vibration == 0.0F, name,
            "0 for kinematic motion (it has no rotors: give motion=\"rotors\")", vibration);
  };
  require_still(accelerometer_vibration_mps2, "imu.accelerometer_vibration_mps2");
  require_still(gyroscope_vibration_radps, "imu.gyroscope_vibration_radps");
}

ImuConfig ImuConfig::preset(std::string_view product) {
  const std::array presets{
      // AirSim's random walks: its bias stability over the square root of its tau.
      ImuConfig{.name = "mpu-6000",
                .accelerometer_noise_density = 2.35e-3F,
                .accelerometer_random_walk = 1.25e-5F,
                .gyroscope_noise_density = 8.7e-5F,
                .gyroscope_random_walk = 1.0e-6F},
      ImuConfig{.name = "bmi088",
                .accelerometer_noise_density = 1.57e-3F,
                .accelerometer_random_walk = 1.36e-3F,
                .gyroscope_noise_density = 2.44e-4F,
                .gyroscope_random_walk = 1.44e-5F},
      ImuConfig{.name = "vn-100",
                .accelerometer_noise_density = 1.373e-3F,
                .accelerometer_random_walk = 9.8e-7F,
                .gyroscope_noise_density = 6.11e-5F,
                .gyroscope_random_walk = 2.65e-5F,
                .accelerometer_range_mps2 = 157.0F,
                .gyroscope_range_radps = 34.9F},
  };
  return sensors::preset_named(product, presets, "ImuConfig.preset");
}

namespace sensors {
namespace {

// Stream of the noise, in the numbers of Stream.
constexpr auto kNoiseStream = static_cast<Stream>(0x80000006U);

bool has_noise(const ImuConfig& config) {
  return config.accelerometer_noise_density > 0.0F || config.gyroscope_noise_density > 0.0F ||
         config.accelerometer_vibration_mps2 > 0.0F || config.gyroscope_vibration_radps > 0.0F ||
         config.accelerometer_range_mps2 || config.gyroscope_range_radps;
}

constexpr std::size_t kBiases = 6;

// The biases of both instruments, then 3 x 3 numbers for each: the errors of its scale, and the angles of its axes.
std::array<Drift, kBiases + 18> drifts_of(const ImuConfig& config) {
  const float angle_std = radians(config.misalignment_std_deg);
  std::array<Drift, kBiases + 18> drifts;
  for (std::size_t i = 0; i < drifts.size(); ++i) {
    drifts[i] =
        i < 3 ? Drift{config.accelerometer_random_walk, config.accelerometer_bias_time_s, config.accelerometer_bias_std_mps2}
        : i < kBiases ? Drift{config.gyroscope_random_walk, config.gyroscope_bias_time_s, config.gyroscope_bias_std_radps}
                      : Drift{.start_std = (i - kBiases) % 9 % 4 == 0 ? config.scale_std : angle_std};
  }
  return drifts;
}

// An accelerometer and a gyroscope on each drone.
class Imu final : public NoisySensor<ImuReadings> {
 public:
  Imu(const ImuConfig& config, const SensorSetup& setup);

  void begin(DroneIndex drone, const State& state) override;
  void visit(ArrayVisitor& visitor) override;
  void check() const override;

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;

  bool vibrates() const { return config_.accelerometer_vibration_mps2 > 0.0F || config_.gyroscope_vibration_radps > 0.0F; }
  // Returns the direction of the unbalanced force, body frame: the sum over the rotors, times the squares of their speeds in
  // 1000 rad/s. The force of a rotor turns with it.
  Vec3 advance_vibration(const State& state, DroneIndex drone);

  ImuConfig config_;
  double dt_s_;  // s, length of a tick
  Vec3 offset_;
  Mat3 to_sensor_;                               // rotation, body to sensor
  float accelerometer_white_, gyroscope_white_;  // standard deviations of a reading's white noise
  // Angles of the rotors since the episode began, (N, kMaxRotors) rad, at a tick (N,). Empty without vibration.
  std::vector<float> rotor_angle_;
  std::vector<std::int64_t> rotor_tick_;
  std::optional<FlownMotion> flown_;  // unless the state has the motion
};

// White noise of density s has the standard deviation s / sqrt(d) in readings that are d seconds apart.
float white_std(float density, std::int64_t period, const ClockConfig& clock) {
  const double d = period == 0 ? clock.step_s() : static_cast<double>(period) * clock.dt_s();
  return static_cast<float>(static_cast<double>(density) / std::sqrt(d));
}

Imu::Imu(const ImuConfig& config, const SensorSetup& setup)
    : NoisySensor("imu", config.name, config, setup, kNoiseStream, allocated<ImuReadings>({.num_drones = setup.num_drones}),
                  has_noise(config), drifts_of(config)),
      config_(config),
      dt_s_(setup.clock.dt_s()),
      offset_(config.offset_m[0], config.offset_m[1], config.offset_m[2]),
      to_sensor_(rotation_to_sensor(config.quat_wxyz)),
      accelerometer_white_(white_std(config.accelerometer_noise_density, period(), setup.clock)),
      gyroscope_white_(white_std(config.gyroscope_noise_density, period(), setup.clock)) {
  rotor_angle_.resize(vibrates() ? kMaxRotors * setup.num_drones : 0);
  rotor_tick_.assign(vibrates() ? setup.num_drones : 0, -1);
  if (!setup.has_velocities) flown_.emplace(setup);
}

void Imu::begin(DroneIndex drone, const State& state) {
  NoisySensor::begin(drone, state);
  if (vibrates()) rotor_tick_[drone] = -1;
  if (flown_) flown_->begin(drone);
}

void Imu::visit(ArrayVisitor& visitor) {
  NoisySensor::visit(visitor);
  if (flown_) flown_->visit(visitor);
  if (!vibrates()) return;
  visitor.array("rotor_angle", rotor_angle_);
  visitor.array("rotor_tick", rotor_tick_);
}

void Imu::check() const {
  NoisySensor::check();
  if (flown_) flown_->check();
  check_values(rotor_angle_, "rotor_angle", Values::finite);
  check_values(rotor_tick_, "rotor_tick", Values::last_count);
}

Kinematics kinematics_of(const FlightState& flight, DroneIndex drone) {
  return {{of_row(flight.velocity, drone), of_row(flight.angular_velocity, drone)},
          {of_row(flight.acceleration, drone), of_row(flight.angular_acceleration, drone)}};
}

// The accelerometer measures all forces except gravity, R^T (dv/dt + g e3). An offset r adds dw/dt x r + w x (w x r).
void Imu::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  const State& state = surroundings.state;
  ImuReadings& truth = readings_.truth();
  for (const DroneIndex drone : drones) {
    const Kinematics motion = flown_ ? flown_->advance(state, drone) : kinematics_of(state.flight, drone);
    const Vec3 turn = motion.velocity.angular, turning = motion.acceleration.angular;
    const Vec3 felt = motion.acceleration.linear + Vec3(0.0F, 0.0F, static_cast<float>(kGravity));
    const Vec3 at_sensor =
        pose_of(state, drone).rotation.conjugate() * felt + turning.cross(offset_) + turn.cross(turn.cross(offset_));
    put(to_sensor_ * at_sensor, truth.accelerometer, drone);
    put(to_sensor_ * turn, truth.gyroscope, drone);
  }
}

Vec3 Imu::advance_vibration(const State& state, DroneIndex drone) {
  const std::size_t rotors = state.flight.rotor_speed.size() / rotor_tick_.size();
  const float* const speed = state.flight.rotor_speed.data() + rotors * drone;
  const RandomKey key = RandomKey::of(drone, drones_per_env_);
  const std::int64_t now = state.tick[key.env], before = std::exchange(rotor_tick_[drone], now);
  constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;
  Vec3 direction = Vec3::Zero();
  for (std::size_t rotor = 0; rotor < rotors; ++rotor) {
    float& angle = rotor_angle_[kMaxRotors * drone + rotor];
    if (before < 0) {
      angle = kTurn * uniform01(draw(state, key, stream_named("rotor angles"), static_cast<std::uint32_t>(rotor), number_)[0]);
    } else {
      const double turned =
          static_cast<double>(angle) + static_cast<double>(speed[rotor]) * static_cast<double>(now - before) * dt_s_;
      angle = static_cast<float>(std::fmod(turned, 2.0 * std::numbers::pi));
    }
    const float squared = speed[rotor] * speed[rotor] * 1e-6F;
    direction += squared * Vec3(std::cos(angle), std::sin(angle), 0.0F);
  }
  return direction;
}

void Imu::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (!has_errors_) return;
  const ImuReadings& truth = readings_.truth();
  ImuReadings& noisy = readings_.noisy();
  for (const DroneIndex drone : drones) {
    const std::array<float, 12> n = normals<12>(state, drone);  // for each instrument: noise, then bias
    const std::array<float, kBiases> moves{n[3], n[4], n[5], n[9], n[10], n[11]};
    const float* const drift = drifts_.advance(state, drone, moves);
    const Vec3 direction = vibrates() ? advance_vibration(state, drone) : Vec3(Vec3::Zero());
    // The torque of an unbalanced force is at right angles to it.
    const Vec3 force = to_sensor_ * direction, torque = to_sensor_ * Vec3(-direction.y(), direction.x(), 0.0F);
    const auto disturbed = [&](const Vec3& value, const float* bias, const float* axes, float white, const float* numbers,
                               const Vec3& vibration, const std::optional<float>& range) -> Vec3 {
      const Vec3 felt = value + vibration;
      const Vec3 error = Vec3::Map(bias) + white * Vec3::Map(numbers);
      const Vec3 reading = felt + (Mat3::Map(axes) * felt + error);
      const float most = range.value_or(std::numeric_limits<float>::infinity());
      return reading.cwiseMax(-most).cwiseMin(most);
    };
    put(disturbed(of_row(truth.accelerometer, drone), drift, drift + kBiases, accelerometer_white_, n.data(),
                  config_.accelerometer_vibration_mps2 * force, config_.accelerometer_range_mps2),
        noisy.accelerometer, drone);
    put(disturbed(of_row(truth.gyroscope, drone), drift + 3, drift + kBiases + 9, gyroscope_white_, n.data() + 6,
                  config_.gyroscope_vibration_radps * torque, config_.gyroscope_range_radps),
        noisy.gyroscope, drone);
  }
}

}  // namespace

std::unique_ptr<BlockSensor> make_sensor(const ImuConfig& config, const SensorSetup& setup) {
  return std::make_unique<Imu>(config, setup);
}

}  // namespace sensors
}  // namespace flockstep
