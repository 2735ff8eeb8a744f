// PoseSensor: position and orientation, exact or with Gaussian noise.
#pragma once

#include <cstddef>
#include <memory>
#include <span>

#include "flockstep/sensors/pose_sensor.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

class PoseSensor final : public SensorOf<PoseReadings> {
 public:
  PoseSensor(const PoseSensorConfig& config, const SensorSetup& setup);

  // Sets the readings of all drones to their true poses, for use before the first reading.
  void assume_truth(const State& state);

 private:
  void measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) override;
  // A drone's noise is a function of its env's seed and episode, its number in the env, and the number of the reading.
  void add_errors(std::span<const DroneIndex> drones, const State& state) override;

  PoseSensorConfig config_;
};

std::unique_ptr<BlockSensor> make_sensor(const PoseSensorConfig& config, const SensorSetup& setup);

}  // namespace flockstep::sensors
