#include "world/random_drone.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <string>
#include <vector>

#include "base/random.hpp"

namespace flockstep {
namespace {

// Numbers of a drone, uniform in a range.
class DroneDraws {
 public:
  explicit DroneDraws(std::uint64_t seed) : seed_(seed) {}
  double operator()(double low, double high) {
    constexpr auto kStream = static_cast<std::uint32_t>(stream_named("random drone"));
    const double u = draw(seed_, 0, kStream, next_++)[0] * 0x1p-32;
    return low + u * (high - low);
  }

 private:
  std::uint64_t seed_;
  std::uint32_t next_ = 0;
};

}  // namespace

DroneModel random_drone(std::uint64_t seed) {
  // A Crazyflie by the same source: its mass gives the size of others.
  constexpr double kUsualMass = 0.027, kUsualArm = 0.028;  // kg; m, along x and along y
  constexpr double kTipSpeed = 80.0, kFlatness = 1.8;      // m/s; inertia about z over that about x
  DroneDraws draws(seed);
  Airframe frame;
  const double root = draws(std::cbrt(0.02), std::cbrt(5.0));
  frame.mass_kg = root * root * root;
  const double lift = draws(1.5, 5.0);  // thrust to weight
  const double arm = kUsualArm * root / std::cbrt(kUsualMass) * draws(0.9, 1.1);
  const double most = lift * frame.mass_kg * kGravity / static_cast<double>(kMinRotors);  // N, one rotor
  const double turning = draws(40.0, 1200.0);                                             // rad/s^2
  // Two rotors at full thrust, as its source has it. Unlike there, a small drone that turns slowly gets no inertia that its mass
  // cannot have within its hull, which is kReach arms wide.
  constexpr double kReach = 2.4;
  const double inertia = std::min(2.0 * arm * most / turning, frame.mass_kg * (kReach * arm) * (kReach * arm) / kFlatness);
  frame.inertia_kgm2 = {inertia, inertia, kFlatness * inertia};
  frame.torque_ratio_m = draws(0.005, 0.05);
  frame.lag_up_s = draws(0.03, 0.10);
  frame.lag_down_s = draws(0.03, 0.30);
  const double drag = frame.mass_kg * draws(0.1, 0.5);
  frame.linear_drag = {drag, drag, drag};
  frame.position_m = {{arm, -arm, 0.0}, {-arm, arm, 0.0}, {arm, arm, 0.0}, {-arm, -arm, 0.0}};
  frame.spin = {Spin::ccw, Spin::ccw, Spin::cw, Spin::cw};
  frame.radius_m = 0.7 * arm;
  frame.max_speed_radps = kTipSpeed / frame.radius_m;
  frame.min_speed_radps = 0.1 * frame.max_speed_radps;
  frame.thrust_n = {0.0, 0.0, most / (frame.max_speed_radps * frame.max_speed_radps)};
  const auto half = static_cast<float>(arm + frame.radius_m), high = 0.3F * half;
  std::vector<Vec3> hull;
  for (const float x : {-half, half}) {
    for (const float y : {-half, half}) {
      for (const float z : {-high, high}) hull.emplace_back(x, y, z);
    }
  }
  return DroneModel(std::move(hull), frame, std::string(kRandomDrone) + std::to_string(seed));
}

}  // namespace flockstep
