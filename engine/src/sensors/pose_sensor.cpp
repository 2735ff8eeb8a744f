#include "sensors/pose_sensor.hpp"

#include <algorithm>
#include <numbers>

#include "base/pose_access.hpp"
#include "base/random.hpp"

namespace flockstep::sensors {

void sense_pose(std::span<const std::uint32_t> drones, const PoseSensorConfig& config, State& state) {
  const float tilt_std_rad = config.tilt_noise_std_deg * std::numbers::pi_v<float> / 180.0F;
  for (const std::uint32_t drone : drones) {
    Pose pose = pose_of(state, drone);
    if (!config.is_exact()) {
      const auto step = static_cast<std::uint32_t>(state.scans[drone]);
      const auto [px, py] = normal_pair(draw(state, drone, Stream::position_noise, 2 * step));
      const auto [pz, unused] = normal_pair(draw(state, drone, Stream::position_noise, 2 * step + 1));
      pose.position += config.position_noise_std_m * Vec3(px, py, pz);
      const auto [rx, ry] = normal_pair(draw(state, drone, Stream::tilt_noise, 2 * step));
      const auto [rz, unused_too] = normal_pair(draw(state, drone, Stream::tilt_noise, 2 * step + 1));
      const Vec3 rotation_vector = tilt_std_rad * Vec3(rx, ry, rz);
      const float angle = rotation_vector.norm();
      if (angle > 0.0F) pose.rotation = pose.rotation * Quat(Eigen::AngleAxisf(angle, rotation_vector / angle));
    }
    store_pose(state.sensed_position.data() + 3 * std::size_t{drone}, state.sensed_quat_wxyz.data() + 4 * std::size_t{drone},
               pose);
  }
}

}  // namespace flockstep::sensors
