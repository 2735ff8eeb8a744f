// PoseSensor: position and orientation, and if asked the velocity, exact or as an estimate that drifts.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "flockstep/pose.hpp"
#include "flockstep/sensors/pose_sensor.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "sensors/noisy_sensor.hpp"

namespace flockstep::sensors {

class PoseSensor final : public NoisySensor<PoseReadings> {
 public:
  PoseSensor(const PoseSensorConfig& config, const SensorSetup& setup);

  // Sets the readings of all drones to their true poses, for use before the first reading.
  void assume_truth(const State& state);

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;
  // Adds drifts to a drone's pose, and writes its noisy velocity.
  void add_drift(const State& state, DroneIndex drone, Pose& pose);

  PoseSensorConfig config_;
};

std::unique_ptr<BlockSensor> make_sensor(const PoseSensorConfig& config, const SensorSetup& setup);

}  // namespace flockstep::sensors
