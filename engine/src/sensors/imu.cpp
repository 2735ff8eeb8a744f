#include "flockstep/sensors/imu.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "sensors/sensor.hpp"

namespace flockstep {

void ImuConfig::validate() const { check_fields(*this, "imu."); }

void ImuConfig::check_motion(const DynamicsConfig& dynamics) const {
  require(!dynamics.is_kinematic(), "imu", "None for kinematic motion (it has no accelerations: give motion=\"rotors\")",
          "an ImuConfig");
}

namespace sensors {
namespace {

// Stream of the noise, in the numbers of Stream.
constexpr auto kNoiseStream = static_cast<Stream>(0x80000006U);

Vec3 of_row(const std::vector<float>& values, DroneIndex drone) {
  return {values[3 * drone], values[3 * drone + 1], values[3 * drone + 2]};
}

void put(const Vec3& value, std::vector<float>& values, DroneIndex drone) {
  std::copy_n(value.data(), 3, values.data() + 3 * drone);
}

double seconds_between(std::int64_t period, const ClockConfig& clock) {
  return period == 0 ? clock.step_s() : static_cast<double>(period) * clock.dt_s();
}

// An accelerometer and a gyroscope on each drone.
class Imu final : public SensorOf<ImuReadings> {
 public:
  Imu(const ImuConfig& config, const SensorSetup& setup);

  // Sets the biases of the drone to 0 at the current tick of its env.
  void begin(DroneIndex drone, const State& state) override;
  void visit(ArrayVisitor& visitor) override;

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  // A drone's noise is a function of its env's seed and episode, its number in the env, and the number of the reading. The
  // biases walk with the time since the last reading, so a second reading in the same tick has the same biases.
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;
  static bool has_errors(const ImuConfig& config) {
    return config.accelerometer_noise_density > 0.0F || config.accelerometer_random_walk > 0.0F ||
           config.gyroscope_noise_density > 0.0F || config.gyroscope_random_walk > 0.0F;
  }

  struct Bias {
    std::vector<float> accelerometer;
    std::vector<float> gyroscope;
    std::vector<std::int64_t> tick;  // tick of the last update

    static constexpr auto fields() {
      using C = Bias;
      constexpr auto info = [](int columns, const char* about) {
        return ArrayInfo{.columns = columns, .access = Access::internal, .writer = "IMU", .about = about};
      };
      return field_list(array("accelerometer_bias", &C::accelerometer, info(3, "bias of the accelerometer, m/s^2")),
                        array("gyroscope_bias", &C::gyroscope, info(3, "bias of the gyroscope, rad/s")),
                        array("bias_tick", &C::tick, info(0, "tick of the episode at which they were last advanced")));
    }
  };
  // Change of a bias over a time span: the bias is multiplied by `keep`, then noise of standard deviation `gain` is added.
  struct Walk {
    float keep = 1.0F;
    float gain = 0.0F;
  };
  // Noise of one of the two instruments.
  struct Noise {
    Noise(float density, float random_walk, float bias_time_s, double interval_s);
    Walk walk_over(double seconds) const;

    double random_walk;
    double bias_time_s;
    float white;        // standard deviation of a reading
    Walk per_interval;  // walk between two regular readings
  };

  bool has_errors_;
  std::uint32_t number_;   // number among the drone's IMUs; each has its own noise
  std::int64_t interval_;  // ticks between regular readings
  double dt_s_;            // s, length of a tick
  Vec3 offset_;
  Mat3 to_sensor_;  // rotation, body to sensor
  Noise accelerometer_, gyroscope_;
  Bias bias_;
};

// White noise of density s has the standard deviation s / sqrt(d) in readings that are d seconds apart.
Imu::Noise::Noise(float density, float walk, float time, double d)
    : random_walk(static_cast<double>(walk)),
      bias_time_s(static_cast<double>(time)),
      white(static_cast<float>(static_cast<double>(density) / std::sqrt(d))),
      per_interval(walk_over(d)) {}

// In d seconds, a bias driven by white noise of density w gains the standard deviation w sqrt(d). With a correlation time T
// it gains w sqrt(T/2 (1 - e^(-2d/T))).
Imu::Walk Imu::Noise::walk_over(double d) const {
  const double t = bias_time_s;
  const double gain = t > 0.0 ? std::sqrt(0.5 * t * -std::expm1(-2.0 * d / t)) : std::sqrt(d);
  return {t > 0.0 ? static_cast<float>(std::exp(-d / t)) : 1.0F, static_cast<float>(random_walk * gain)};
}

Imu::Imu(const ImuConfig& config, const SensorSetup& setup)
    : SensorOf("imu", config.name, config, setup, {.num_drones = setup.num_drones}, has_errors(config)),
      has_errors_(has_errors(config)),
      number_(setup.number),
      interval_(period() == 0 ? setup.clock.substeps() : period()),
      dt_s_(setup.clock.dt_s()),
      offset_(config.offset_m[0], config.offset_m[1], config.offset_m[2]),
      to_sensor_(Quat(config.quat_wxyz[0], config.quat_wxyz[1], config.quat_wxyz[2], config.quat_wxyz[3])
                     .normalized()
                     .toRotationMatrix()
                     .transpose()),
      accelerometer_(config.accelerometer_noise_density, config.accelerometer_random_walk, config.accelerometer_bias_time_s,
                     seconds_between(period(), setup.clock)),
      gyroscope_(config.gyroscope_noise_density, config.gyroscope_random_walk, config.gyroscope_bias_time_s,
                 seconds_between(period(), setup.clock)) {
  allocate(bias_, {.num_drones = setup.num_drones});
}

void Imu::begin(DroneIndex drone, const State& state) {
  SensorOf::begin(drone, state);
  put(Vec3::Zero(), bias_.accelerometer, drone);
  put(Vec3::Zero(), bias_.gyroscope, drone);
  bias_.tick[drone] = state.tick[RandomKey::of(drone, drones_per_env_).env];
}

void Imu::visit(ArrayVisitor& visitor) {
  SensorOf::visit(visitor);
  visitor.fields(bias_);
}

// The accelerometer measures all forces except gravity, R^T (dv/dt + g e3). An offset r adds dw/dt x r + w x (w x r).
void Imu::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  const State& state = surroundings.state;
  ImuReadings& truth = readings_.truth();
  for (const DroneIndex drone : drones) {
    const Vec3 turn = of_row(state.flight.angular_velocity, drone);
    const Vec3 turning = of_row(state.flight.angular_acceleration, drone);
    const Vec3 felt = of_row(state.flight.acceleration, drone) + Vec3(0.0F, 0.0F, static_cast<float>(kGravity));
    const Vec3 at_sensor =
        pose_of(state, drone).rotation.conjugate() * felt + turning.cross(offset_) + turn.cross(turn.cross(offset_));
    put(to_sensor_ * at_sensor, truth.accelerometer, drone);
    put(to_sensor_ * turn, truth.gyroscope, drone);
  }
}

void Imu::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (!has_errors_) return;
  const ImuReadings& truth = readings_.truth();
  ImuReadings& noisy = readings_.noisy();
  for (const DroneIndex drone : drones) {
    const RandomKey key = RandomKey::of(drone, drones_per_env_);
    const EnvIndex env = key.env;
    constexpr std::uint32_t kDraws = 6;  // draws per reading, two numbers each
    const std::uint32_t index = kDraws * reading_of(state, env);
    std::array<float, 2 * kDraws> n;
    for (std::uint32_t k = 0; k < kDraws; ++k) {
      const auto [first, second] = normal_pair(draw(state, key, kNoiseStream, index + k, number_));
      n[2 * k] = first;
      n[2 * k + 1] = second;
    }
    const std::int64_t elapsed = state.tick[env] - bias_.tick[drone];
    const auto disturbed = [&](const Noise& noise, const float* numbers, std::vector<float>& biases, const Vec3& value) -> Vec3 {
      Vec3 bias = of_row(biases, drone);
      if (elapsed > 0) {
        const Walk walk = elapsed == interval_ ? noise.per_interval : noise.walk_over(static_cast<double>(elapsed) * dt_s_);
        bias = walk.keep * bias + walk.gain * Vec3(numbers[3], numbers[4], numbers[5]);
        put(bias, biases, drone);
      }
      const Vec3 error = bias + noise.white * Vec3(numbers[0], numbers[1], numbers[2]);
      return value + error;
    };
    put(disturbed(accelerometer_, n.data(), bias_.accelerometer, of_row(truth.accelerometer, drone)), noisy.accelerometer, drone);
    put(disturbed(gyroscope_, n.data() + 6, bias_.gyroscope, of_row(truth.gyroscope, drone)), noisy.gyroscope, drone);
    bias_.tick[drone] = state.tick[env];
  }
}

}  // namespace

std::unique_ptr<BlockSensor> make_sensor(const ImuConfig& config, const SensorSetup& setup) {
  return std::make_unique<Imu>(config, setup);
}

}  // namespace sensors
}  // namespace flockstep
