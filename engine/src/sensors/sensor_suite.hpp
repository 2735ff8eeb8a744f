// SensorSuite: the sensors of a batch that are read block by block. Cameras belong to CameraRig.
#pragma once

#include <cstddef>
#include <memory>
#include <typeinfo>
#include <vector>

#include "flockstep/config.hpp"
#include "sensors/lidar.hpp"
#include "sensors/pose_sensor.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

class SensorSuite {
 public:
  // Creates a sensor for each config in BatchConfig that has a make_sensor().
  explicit SensorSuite(const BatchConfig& config);

  auto begin() const { return all_.begin(); }
  auto end() const { return all_.end(); }
  // True if a sensor has its own rate and may therefore be due in the middle of a flown step.
  bool reads_between_ticks() const { return reads_between_ticks_; }

  PoseSensor& pose() const { return *pose_; }
  const std::vector<Lidar*>& lidars() const { return lidars_; }
  // Returns the published readings of this type of a sensor, by its number among those that have them; null if there is none.
  const void* find_readings(const std::type_info& type, std::size_t index) const;

 private:
  std::vector<std::unique_ptr<BlockSensor>> all_;  // in the order of BatchConfig
  PoseSensor* pose_ = nullptr;
  std::vector<Lidar*> lidars_;
  bool reads_between_ticks_ = false;
};

}  // namespace flockstep::sensors
