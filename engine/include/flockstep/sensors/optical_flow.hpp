// OpticalFlowConfig: an optical flow sensor, and its readings. It requires rotor motion.
#pragma once

#include <array>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/arrays.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// Readings of one sensor.
struct OpticalFlowReadings {
  std::vector<float> flow;
  std::vector<float> distance;
  std::vector<float> age_s;

  static constexpr auto fields() {
    using C = OpticalFlowReadings;
    constexpr const char* kWriter = "optical flow sensor";
    return field_list(array("optical_flow", &C::flow,
                            {.columns = 2,
                             .unit = "rad/s",
                             .frame = Frame::body,
                             .writer = kWriter,
                             .about = "latest reading of the motion of what is below along x and y. 0 if nothing is seen"}),
                      array("flow_distance", &C::distance,
                            {.unit = "m",
                             .values = Values::range,
                             .writer = kWriter,
                             .about = "distance of what is below along the body's -z. inf beyond `max_range_m`"}),
                      array("flow_age_s", &C::age_s, {.unit = "s", .writer = kWriter, .about = "age of the reading"}));
  }
};

// Angular velocity of what a drone sees along its -z axis, from its velocity, body rates and the distance of the first surface.
struct OpticalFlowConfig {
  using Readings = OpticalFlowReadings;  // what it publishes
  static constexpr const char* kAbout = "An optical flow sensor that looks down. It requires ``motion=\"rotors\"``.";

  std::string name = "flow";
  float max_range_m = 30.0F;
  std::optional<float> max_flow_radps;
  float noise_std_radps = 0.0F;
  std::array<float, 3> offset_m{0.0F, 0.0F, 0.0F};
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr auto fields() {
    using C = OpticalFlowConfig;
    return field_list(
        field("name", &C::name, {.about = "Name, unique among them.", .form = Form::plain_name}),
        field("max_range_m", &C::max_range_m, {.about = "Maximum distance of what it sees.", .unit = "m", .limits = above(0)}),
        field("max_flow_radps", &C::max_flow_radps,
              {.about = "Greatest reading of an axis. None: no limit.", .unit = "rad/s", .limits = above(0)}),
        field("noise_std_radps", &C::noise_std_radps, {.about = "Gaussian noise.", .unit = "rad/s", .limits = between(0, 1000)}),
        field("offset_m", &C::offset_m, kMountOffset), field("rate_hz", &C::rate_hz, kSensorRate),
        field("latency_s", &C::latency_s, kSensorLatency), field("jitter_s", &C::jitter_s, kSensorJitter),
        field("loss", &C::loss, kSensorLoss));
  }

  // Returns the sensor of a part; docs/reference/sensors.md lists them. Throws std::invalid_argument that lists the names.
  FLOCKSTEP_API static OpticalFlowConfig preset(std::string_view product);

  FLOCKSTEP_API void validate() const;
  FLOCKSTEP_API void check_motion(const DynamicsConfig& dynamics) const;  // refuses kinematic motion
};

namespace sensors {
// Makes the sensor of a batch.
std::unique_ptr<BlockSensor> make_sensor(const OpticalFlowConfig& config, const SensorSetup& setup);
}  // namespace sensors

}  // namespace flockstep
