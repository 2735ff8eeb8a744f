// Imu: the readings of an accelerometer and a gyroscope on the drone.
#pragma once

#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/imu.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/readings.hpp"
#include "flockstep/state.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

class Imu final : public BlockSensor {
 public:
  Imu(const ImuConfig& config, const SensorSetup& setup);

  const ImuReadings& readings() const { return readings_.published(); }

  // The biases of a drone are 0 at the present tick of its env.
  void begin(DroneIndex drone, const State& state) override;
  void list_arrays(const std::function<void(const ArrayView&)>& list) const override { for_each_view(readings(), {}, list); }
  void visit(ArrayVisitor& visitor) override;
  void check() const override { readings_.check(); }

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  // The noise of a drone is a function of its env's seed and episode, its number in the env, and the number of the reading.
  // The biases walk with the time since the last reading, so a reading in the same tick finds the same biases.
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;
  bool has_errors() const { return !accelerometer_.is_none() || !gyroscope_.is_none(); }

  struct Bias {
    std::vector<float> accelerometer;
    std::vector<float> gyroscope;
    std::vector<std::int64_t> tick;  // when they were last advanced

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
  // How a bias changes over a time: it keeps a share, and gains a random number of this standard deviation.
  struct Walk {
    float keep = 1.0F;
    float gain = 0.0F;
  };
  // The noise of one of the two instruments.
  struct Noise {
    Noise(float density, float random_walk, float bias_time_s, double interval_s);
    Walk walk_over(double seconds) const;
    bool is_none() const { return white == 0.0F && random_walk == 0.0; }

    double random_walk;
    double bias_time_s;
    float white;        // standard deviation of a reading
    Walk per_interval;  // from one regular reading to the next
  };

  std::uint32_t number_;   // among the IMUs of a drone: each has its own noise
  std::int64_t interval_;  // ticks between regular readings
  double dt_s_;            // of a tick
  std::size_t drones_per_env_;
  Vec3 offset_;
  Mat3 to_sensor_;  // from the body
  Noise accelerometer_, gyroscope_;
  Readings<ImuReadings> readings_;
  Bias bias_;
};

std::unique_ptr<BlockSensor> make_sensor(const ImuConfig& config, const SensorSetup& setup);

}  // namespace flockstep::sensors
