// FlownMotion: velocities and accelerations of drones whose motion has none, from their poses at successive readings.
#pragma once

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "sensors/sensor.hpp"

namespace flockstep::sensors {

// Linear parts in the world's frame, m/s and m/s^2. Angular parts in the body's, rad/s and rad/s^2.
struct Kinematics {
  Velocity velocity;
  Velocity acceleration;
};

class FlownMotion {
 public:
  explicit FlownMotion(const SensorSetup& setup)
      : dt_s_(setup.clock.dt_s()), drones_per_env_(setup.drones_per_env), past_(setup.num_drones) {}

  // The drone is at rest at its next reading.
  void begin(DroneIndex drone) { past_[drone] = {}; }

  // Returns the mean velocity since the last reading, and its change. A further reading in the same tick has the same motion.
  Kinematics advance(const State& state, DroneIndex drone) {
    Past& past = past_[drone];
    const std::int64_t now = state.tick[RandomKey::of(drone, drones_per_env_).env];
    const Pose pose = pose_of(state, drone);
    if (past.tick >= 0 && now > past.tick) {
      const auto elapsed_s = static_cast<float>(static_cast<double>(now - past.tick) * dt_s_);
      const Quat before(past.quat_wxyz[0], past.quat_wxyz[1], past.quat_wxyz[2], past.quat_wxyz[3]);
      const Vec3 moved = pose.position - Vec3::Map(past.position.data());
      step(past.linear, moved, elapsed_s);
      step(past.angular, rotation_vector(before.conjugate() * pose.rotation), elapsed_s);
    }
    past.tick = now;
    std::copy_n(pose.position.data(), 3, past.position.begin());
    past.quat_wxyz = {pose.rotation.w(), pose.rotation.x(), pose.rotation.y(), pose.rotation.z()};
    const auto part = [&](std::size_t order) {
      return Velocity{Vec3::Map(past.linear.data() + order), Vec3::Map(past.angular.data() + order)};
    };
    return {part(0), part(3)};
  }

  void visit(ArrayVisitor& visitor) { visitor.array("flown_motion", past_); }
  // Throws std::invalid_argument if restored numbers cannot be used.
  void check() const {
    for (const Past& past : past_) {
      check_values(past.linear, "flown_motion", Values::finite);
      check_values(past.angular, "flown_motion", Values::finite);
      check_values(past.position, "flown_motion", Values::finite);
      check_values(past.quat_wxyz, "flown_motion", Values::finite);
      check_values(std::span(&past.tick, 1), "flown_motion", Values::last_count);
    }
  }

 private:
  using Derivatives = std::array<float, 6>;  // the first, then the second
  struct Past {
    std::int64_t tick = -1;  // of the last reading; -1: none in this episode
    std::array<float, 3> position{};
    std::array<float, 4> quat_wxyz{};
    Derivatives linear{}, angular{};
  };

  static void step(Derivatives& derivatives, const Vec3& moved, float elapsed_s) {
    const Vec3 rate = moved / elapsed_s;
    const Vec3 change = (rate - Vec3::Map(derivatives.data())) / elapsed_s;
    std::copy_n(rate.data(), 3, derivatives.begin());
    std::copy_n(change.data(), 3, derivatives.begin() + 3);
  }

  // The shorter of the two rotations about the axis.
  static Vec3 rotation_vector(const Quat& rotation) {
    const float sine = rotation.vec().norm();
    if (sine == 0.0F) return Vec3::Zero();
    const float sign = rotation.w() < 0.0F ? -1.0F : 1.0F;
    return 2.0F * std::atan2(sine, sign * rotation.w()) * sign / sine * rotation.vec();
  }

  double dt_s_;
  std::size_t drones_per_env_;
  std::vector<Past> past_;  // (N,)
};

}  // namespace flockstep::sensors
