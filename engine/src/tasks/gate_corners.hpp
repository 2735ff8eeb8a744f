// GateCorners: the corners of a gate as a GateDetector finds them.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>

#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "flockstep/tasks/race.hpp"
#include "flockstep/world.hpp"

namespace flockstep::task {

class GateCorners {
 public:
  static constexpr std::size_t kNumbers = 12;  // of a gate: four corners

  explicit GateCorners(const GateDetector& config)
      : config_(config),
        focal_px_(0.5F * static_cast<float>(config.width_px) / std::tan(0.5F * kRadians * config.hfov_deg)),
        to_body_(quat_from_rpy(0.0F, -kRadians * config.tilt_deg, 0.0F)) {}

  // Writes the unit vectors from a drone to the corners of a gate, body frame, or zeros, and returns the end. They go round the
  // gate, as seen from where drones come: lower right, lower left, upper left, upper right. view: number of the gate's view in
  // the episode, for random numbers.
  float* find(const Gate& gate, const State& state, DroneIndex drone, std::size_t drones_per_env, std::size_t view,
              float* to) const {
    const Pose pose = pose_of(state, drone);
    const Quat to_camera = (pose.rotation * to_body_).conjugate();
    const float half = gate.size * (gate.shape == GateShape::ring ? 0.5F / std::numbers::sqrt2_v<float> : 0.5F);
    constexpr std::array<std::array<float, 2>, 4> kSides{{{-1, -1}, {1, -1}, {1, 1}, {-1, 1}}};
    for (std::size_t k = 0; k < kSides.size(); ++k) {
      const auto [left, up] = kSides[k];
      const Vec3 corner = gate.center + gate.rotation * Vec3(0.0F, half * left, half * up);
      Vec3 seen = to_camera * (corner - pose.position);
      const bool is_found = project(seen) && add_errors(state, RandomKey::of(drone, drones_per_env), 4 * view + k, seen);
      const Vec3 direction = is_found ? Vec3(to_body_ * seen.normalized()) : Vec3(Vec3::Zero());
      to = std::copy_n(direction.data(), 3, to);
    }
    return to;
  }

 private:
  // Moves a point of the camera frame (x ahead, y left, z up) to the image, at the focal length in px. False if it is not there.
  bool project(Vec3& point) const {
    if (!(point.x() > 0.0F) || point.norm() > config_.max_range_m) return false;
    point *= focal_px_ / point.x();
    return 2.0F * std::abs(point.y()) <= static_cast<float>(config_.width_px) &&
           2.0F * std::abs(point.z()) <= static_cast<float>(config_.height_px);
  }
  // False if the corner drops out.
  bool add_errors(const State& state, RandomKey key, std::size_t index, Vec3& point) const {
    if (config_.noise_std_px == 0.0F && config_.dropout == 0.0F) return true;
    const auto bits = draw(state, key, stream_named("gate corners"), static_cast<std::uint32_t>(index));
    const auto [left, up] = normal_pair(bits);
    point += config_.noise_std_px * Vec3(0.0F, left, up);
    return uniform01(bits[2]) >= config_.dropout;
  }

  static constexpr float kRadians = std::numbers::pi_v<float> / 180.0F;

  GateDetector config_;
  float focal_px_;
  Quat to_body_;  // from the camera frame
};

}  // namespace flockstep::task
