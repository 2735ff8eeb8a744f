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

  // Reads the listed drones. The noise of an env is a function of its seed, its episode, and which reading of the episode it is;
  // at the first moment of an episode the biases are 0.
  void read(std::span<const std::uint32_t> drones, const State& state);

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

    static constexpr auto fields() {
      using C = Readings;
      return field_list(field("accelerometer", &C::accelerometer), field("gyroscope", &C::gyroscope),
                        field("accelerometer_bias", &C::accelerometer_bias), field("gyroscope_bias", &C::gyroscope_bias));
    }
  };
  // Of one of the two, from one reading to the next.
  struct Noise {
    Noise(float density, float walk, float time_s, double step_s);
    bool is_none() const { return white == 0.0F && step == 0.0F; }
    float white;  // standard deviation of a reading
    float keep;   // of the bias
    float step;   // standard deviation of what it gains
  };

  std::int64_t period_;
  std::size_t drones_per_env_;
  Vec3 offset_;
  Mat3 to_sensor_;  // from the body
  Noise accelerometer_, gyroscope_;
  Readings readings_;
};

}  // namespace flockstep::sensors
