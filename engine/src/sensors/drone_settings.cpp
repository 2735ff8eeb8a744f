#include "sensors/drone_settings.hpp"

#include <optional>

namespace flockstep::sensors {

Setting setting_of(const LidarConfig& config) {
  return {config.hfov_deg, config.vfov_deg, config.max_range_m, config.offset_m, config.quat_wxyz, config.errors};
}

Setting setting_of(const CameraConfig& config) {
  return {config.hfov_deg.value_or(0.0F), config.vfov_deg.value_or(0.0F), 0.0F, config.offset_m, config.quat_wxyz, {}};
}

LidarConfig with(LidarConfig config, const Setting& setting) {
  config.hfov_deg = setting.hfov_deg;
  config.vfov_deg = setting.vfov_deg;
  config.max_range_m = setting.max_range_m;
  config.offset_m = setting.offset_m;
  config.quat_wxyz = setting.quat_wxyz;
  config.errors = setting.errors;
  return config;
}

CameraConfig with(CameraConfig config, const Setting& setting) {
  config.hfov_deg = setting.hfov_deg != 0.0F ? std::optional(setting.hfov_deg) : std::nullopt;
  config.vfov_deg = setting.vfov_deg != 0.0F ? std::optional(setting.vfov_deg) : std::nullopt;
  config.offset_m = setting.offset_m;
  config.quat_wxyz = setting.quat_wxyz;
  return config;
}

}  // namespace flockstep::sensors
