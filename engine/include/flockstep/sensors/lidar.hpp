// LidarConfig: a scanning LiDAR.
#pragma once

#include <array>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/sensors/range_errors.hpp"
#include "flockstep/sensors/sensor_fields.hpp"

namespace flockstep {

// Arrays that a LiDAR writes besides its ranges; see LidarReadings.
struct LidarOutputs {
  bool semantic = false;   // class of the material
  bool instance = false;   // number of the object
  bool intensity = false;  // share of the light that returns

  static constexpr auto fields() {
    using C = LidarOutputs;
    return field_list(field("semantic", &C::semantic), field("instance", &C::instance), field("intensity", &C::intensity));
  }

  bool any() const { return semantic || instance || intensity; }  // true if one is chosen
};

// A grid of channels x beams, as many along waves, or a pattern of beams given by azimuth_deg and elevation_deg, lists of equal
// length.
struct LidarConfig {
  std::string name = "lidar";
  int channels = 1;
  int beams = 35;
  float hfov_deg = 270.0F;
  float vfov_deg = 0.0F;
  float vfov_center_deg = 0.0F;
  float waves = 0.0F;
  float turn_deg = 0.0F;
  float max_range_m = 3.0F;
  std::array<float, 3> offset_m{0, 0, 0};
  std::array<float, 4> quat_wxyz{1, 0, 0, 0};
  std::vector<float> azimuth_deg;
  std::vector<float> elevation_deg;
  LidarOutputs outputs;
  RangeErrors errors;
  float scan_time_s = 0.0F;
  std::optional<float> rate_hz;
  float latency_s = 0.0F;
  float jitter_s = 0.0F;
  float loss = 0.0F;

  static constexpr int kMaxRays = 1 << 18;  // per drone, in all channels

  static constexpr auto fields() {
    using C = LidarConfig;
    return field_list(
        field("name", &C::name, {.about = "Name for `Batch.lidar`, unique among the LiDARs.", .form = Form::plain_name}),
        field("channels", &C::channels,
              {.about = "Channels, from -vfov/2 to +vfov/2 around the middle, both included. A single one lies there.",
               .limits = between(1, kMaxRays)}),
        field("beams", &C::beams,
              {.about = "Beams of a channel, counter-clockwise from -hfov/2 to +hfov/2, both included (at 360 without the end). "
                        "At most 262144 in all channels.",
               .limits = between(1, kMaxRays)}),
        field("hfov_deg", &C::hfov_deg, {.about = "Horizontal field of view.", .unit = "deg", .limits = above_up_to(0, 360)}),
        field("vfov_deg", &C::vfov_deg, {.about = "Vertical field of view.", .unit = "deg", .limits = between(0, 180)}),
        field("vfov_center_deg", &C::vfov_center_deg, {.about = "Elevation of its middle.", .unit = "deg", .limits = within(90)}),
        field(
            "waves", &C::waves,
            {.about = "Waves of the elevation along a channel, +-vfov/2 around the middle. Channels differ in phase. 0: a grid.",
             .limits = between(0, 1000)}),
        field("turn_deg", &C::turn_deg,
              {.about = "Angle by which the beams turn about the LiDAR's z axis from reading to reading.",
               .unit = "deg",
               .limits = within(360)}),
        field(
            "max_range_m", &C::max_range_m,
            {.about = "Maximum range. Beyond it is a miss: inf in metres, 1 when normalised.", .unit = "m", .limits = above(0)}),
        field("offset_m", &C::offset_m, kMountOffset), field("quat_wxyz", &C::quat_wxyz, kMountRotation),
        field("azimuth_deg", &C::azimuth_deg,
              {.about = "Azimuths of a pattern, which replaces the grid. Leave ``channels`` and the fields of view at their "
                        "defaults.",
               .unit = "deg",
               .limits = within(360)}),
        field("elevation_deg", &C::elevation_deg,
              {.about = "Elevations of the pattern, one for each azimuth.", .unit = "deg", .limits = within(90)}),
        field("outputs", &C::outputs, {.about = "Further arrays: ``\"semantic\"``, ``\"instance\"``, ``\"intensity\"``."}),
        field("errors", &C::errors, {.about = "How ranges err."}),
        field("scan_time_s", &C::scan_time_s,
              {.about = "Time of a scan, up to its reading. Its columns are traced one by one, from poses between the last two "
                        "readings.",
               .unit = "s",
               .limits = between(0, 1)}),
        field("rate_hz", &C::rate_hz, kSensorRate), field("latency_s", &C::latency_s, kSensorLatency),
        field("jitter_s", &C::jitter_s, kSensorJitter), field("loss", &C::loss, kSensorLoss));
  }

  // Returns the LiDAR of a product, such as "vlp-16", with its errors; docs/reference/sensors.md lists the products. Throws
  // std::invalid_argument that lists the names.
  FLOCKSTEP_API static LidarConfig preset(std::string_view product);

  FLOCKSTEP_API void validate() const;
  bool needs_hits() const { return outputs.any() || errors.need_surfaces(); }          // true if ranges are not enough
  bool has_pattern() const { return !azimuth_deg.empty() || !elevation_deg.empty(); }  // true if beams are given one by one
  int rows() const { return has_pattern() ? 1 : channels; }                            // channels; 1 for a pattern
  int columns() const { return has_pattern() ? static_cast<int>(azimuth_deg.size()) : beams; }  // beams of a channel
};

// Run-time changes to a LiDAR of some drones; unset fields stay unchanged. All drones have the same number of rays.
struct LidarChange {
  std::optional<float> max_range_m;               // m
  std::optional<float> hfov_deg;                  // deg
  std::optional<float> vfov_deg;                  // deg
  std::optional<std::array<float, 3>> offset_m;   // m, body frame
  std::optional<std::array<float, 4>> quat_wxyz;  // sensor to body
  std::optional<RangeErrors> errors;              // replaces all
  std::optional<int> beams;                       // all drones'; moves the arrays of the batch
  std::optional<int> channels;                    // all drones'; moves the arrays of the batch

  static constexpr auto fields() {
    using C = LidarChange;
    return field_list(field("max_range_m", &C::max_range_m), field("hfov_deg", &C::hfov_deg), field("vfov_deg", &C::vfov_deg),
                      field("offset_m", &C::offset_m), field("quat_wxyz", &C::quat_wxyz), field("errors", &C::errors),
                      field("beams", &C::beams), field("channels", &C::channels));
  }
};

}  // namespace flockstep
