// Imu: an accelerometer and a gyroscope on each drone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/sensors/imu.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

class Imu final : public BlockSensor {
 public:
  Imu(const ImuConfig& config, const SensorSetup& setup);

  const ImuReadings& readings() const { return readings_.published(); }

  // Sets the biases of the drone to 0 at the current tick of its env.
  void begin(DroneIndex drone, const State& state) override;
  void list_arrays(const std::function<void(const ArrayView&)>& list) const override { for_each_view(readings(), {}, list); }
  void visit(ArrayVisitor& visitor) override;
  void check() const override { readings_.check(); }

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  // A drone's noise is a function of its env's seed and episode, its number in the env, and the number of the reading. The
  // biases walk with the time since the last reading, so a second reading in the same tick has the same biases.
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;
  bool has_errors() const { return !accelerometer_.is_none() || !gyroscope_.is_none(); }

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
    bool is_none() const { return white == 0.0F && random_walk == 0.0; }

    double random_walk;
    double bias_time_s;
    float white;        // standard deviation of a reading
    Walk per_interval;  // walk between two regular readings
  };

  std::uint32_t number_;   // number among the drone's IMUs; each has its own noise
  std::int64_t interval_;  // ticks between regular readings
  double dt_s_;            // s, length of a tick
  std::size_t drones_per_env_;
  Vec3 offset_;
  Mat3 to_sensor_;  // rotation, body to sensor
  Noise accelerometer_, gyroscope_;
  Readings<ImuReadings> readings_;
  Bias bias_;
};

std::unique_ptr<BlockSensor> make_sensor(const ImuConfig& config, const SensorSetup& setup);

}  // namespace flockstep::sensors
