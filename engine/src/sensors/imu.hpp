// Imu: what an accelerometer and a gyroscope on the drone read.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/imu.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep::sensors {

class Imu {
 public:
  Imu(const ImuConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones);

  // The biases of a drone are 0 at the present tick of its env, as when an episode begins.
  void begin(DroneIndex drone, const State& state);
  // Reads the listed drones. The noise of a drone is a function of its env's seed and episode, its number in the env, and the
  // number of the reading.
  // The biases walk with the time since the last reading, so a reading in the same tick finds the same biases.
  void read(std::span<const DroneIndex> drones, const State& state);

  std::int64_t period() const { return period_; }                                      // ticks, as period_in_ticks() has it
  const std::vector<float>& accelerometer() const { return readings_.accelerometer; }  // (N, 3) m/s^2, sensor frame
  const std::vector<float>& gyroscope() const { return readings_.gyroscope; }          // (N, 3) rad/s, sensor frame

  void visit(ArrayVisitor& visitor);

 private:
  struct Readings {
    std::vector<float> accelerometer;       // (N, 3)
    std::vector<float> gyroscope;           // (N, 3)
    std::vector<float> accelerometer_bias;  // (N, 3)
    std::vector<float> gyroscope_bias;      // (N, 3)
    std::vector<std::int64_t> tick;         // (N,) of the episode: when the biases were last advanced

    static constexpr auto fields() {
      using C = Readings;
      return field_list(field("accelerometer", &C::accelerometer), field("gyroscope", &C::gyroscope),
                        field("accelerometer_bias", &C::accelerometer_bias), field("gyroscope_bias", &C::gyroscope_bias),
                        field("tick", &C::tick));
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

  std::int64_t period_;
  std::int64_t interval_;  // ticks between regular readings
  double dt_s_;            // of a tick
  std::size_t drones_per_env_;
  Vec3 offset_;
  Mat3 to_sensor_;  // from the body
  Noise accelerometer_, gyroscope_;
  Readings readings_;
};

}  // namespace flockstep::sensors
