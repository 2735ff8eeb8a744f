#include "bodies/body_script.hpp"

#include <algorithm>
#include <numbers>

namespace flockstep::bodies {
namespace {

constexpr double kDegree = std::numbers::pi / 180.0;

Eigen::Vector3d vector_of(const std::array<float, 3>& values) { return {values[0], values[1], values[2]}; }

Quat turned(const Quat& first, const Eigen::Vector3d& rate, double time_s) {
  const double angle = rate.norm() * time_s;
  if (angle == 0.0) return first;
  return (first.cast<double>() * Eigen::Quaterniond(Eigen::AngleAxisd(angle, rate.normalized()))).normalized().cast<float>();
}

}  // namespace

BodyScript::BodyScript(const BodyConfig& config)
    : motion_(config.motion),
      first_{Vec3(config.position_m[0], config.position_m[1], config.position_m[2]),
             Quat(config.quat_wxyz[0], config.quat_wxyz[1], config.quat_wxyz[2], config.quat_wxyz[3]).normalized()} {
  moves_ = vector_of(motion_.velocity_mps).squaredNorm() > 0.0 || vector_of(motion_.turn_rate_dps).squaredNorm() > 0.0;
}

Moment BodyScript::at(double time_s, const ScriptKey&) const {
  const Eigen::Vector3d velocity = vector_of(motion_.velocity_mps), rate = kDegree * vector_of(motion_.turn_rate_dps);
  return {{(first_.position.cast<double>() + time_s * velocity).cast<float>(), turned(first_.rotation, rate, time_s)},
          {velocity.cast<float>(), rate.cast<float>()}};
}

}  // namespace flockstep::bodies
