// Vectors in the rows of a sensor's arrays, the rotation of its mounting, and angles.
#pragma once

#include <array>
#include <numbers>
#include <vector>

#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::sensors {

inline Vec3 of_row(const std::vector<float>& values, DroneIndex drone) {
  return {values[3 * drone], values[3 * drone + 1], values[3 * drone + 2]};
}

inline void put(const Vec3& value, std::vector<float>& values, DroneIndex drone) { Vec3::Map(values.data() + 3 * drone) = value; }

inline float radians(float degrees) { return degrees * std::numbers::pi_v<float> / 180.0F; }

// Returns the rotation from the body to a sensor with this rotation from sensor to body.
inline Mat3 rotation_to_sensor(const std::array<float, 4>& quat_wxyz) {
  const Quat mounting(quat_wxyz[0], quat_wxyz[1], quat_wxyz[2], quat_wxyz[3]);
  return mounting.normalized().toRotationMatrix().transpose();
}

}  // namespace flockstep::sensors
