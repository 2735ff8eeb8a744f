// PoseSensor: position and orientation, exact or with Gaussian noise.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/pose_sensor.hpp"
#include "flockstep/state.hpp"

namespace flockstep::sensors {

class PoseSensor {
 public:
  PoseSensor(const PoseSensorConfig& config, const ClockConfig& clock, std::size_t drones_per_env, std::size_t num_drones);

  // Reads the listed drones. The noise of a drone is a function of its env's seed and episode, its number in the env, and the
  // number of the reading.
  void read(std::span<const DroneIndex> drones, const State& state);

  std::int64_t period() const { return period_; }                              // ticks, as period_in_ticks() has it
  const std::vector<float>& position() const { return readings_.position; }    // (N, 3) m
  const std::vector<float>& quat_wxyz() const { return readings_.quat_wxyz; }  // (N, 4)
  Pose pose(DroneIndex drone) const;                                           // as it was read last

  // Of drones that nobody has read yet: the truth.
  void assume_truth(const State& state);

  void visit(ArrayVisitor& visitor);

 private:
  struct Readings {
    std::vector<float> position;   // (N, 3) m
    std::vector<float> quat_wxyz;  // (N, 4)

    static constexpr auto fields() {
      return field_list(field("sensed_position", &Readings::position), field("sensed_quat_wxyz", &Readings::quat_wxyz));
    }
  };

  PoseSensorConfig config_;
  std::int64_t period_;
  std::size_t drones_per_env_;
  Readings readings_;
};

}  // namespace flockstep::sensors
