#include "sensors/sensor_suite.hpp"

#include <utility>

namespace flockstep::sensors {
namespace {

template <class T>
concept SensorConfig = requires(const T& config, const SensorSetup& setup) { make_sensor(config, setup); };

}  // namespace

SensorSuite::SensorSuite(const BatchConfig& config) {
  SensorSetup setup{.clock = config.clock,
                    .tracer = config.tracer,
                    .drones_per_env = static_cast<std::size_t>(config.drones_per_env),
                    .num_drones = static_cast<std::size_t>(config.num_drones()),
                    .has_velocities = !config.dynamics.is_kinematic()};
  for_each_field(config, [&]<class Value>(const auto&, const Value& value) {
    if constexpr (SensorConfig<Value>) {
      all_.push_back(make_sensor(value, setup));
    } else if constexpr (requires { requires SensorConfig<typename Value::value_type>; }) {
      setup.number = 0;
      for (const auto& sensor : value) {
        all_.push_back(make_sensor(sensor, setup));
        ++setup.number;
      }
    }
  });
  for (const auto& sensor : all_) {
    reads_between_ticks_ |= sensor->period() > 0;
    if (auto* const pose = dynamic_cast<PoseSensor*>(sensor.get())) pose_ = pose;
    if (auto* const lidar = dynamic_cast<Lidar*>(sensor.get())) lidars_.push_back(lidar);
  }
}

const void* SensorSuite::find_readings(const std::type_info& type, std::size_t index) const {
  for (const auto& sensor : all_) {
    const void* const found = sensor->readings_of(type);
    if (found != nullptr && index-- == 0) return found;
  }
  return nullptr;
}

}  // namespace flockstep::sensors
