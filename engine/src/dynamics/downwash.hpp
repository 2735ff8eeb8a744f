// Downwash: the thrust that rotors lose in the wash of other drones of their env.
//
// The air below a quadrotor is a turbulent jet along its -z axis. Let d be the largest distance between two hubs, v the velocity
// that the thrust T of all n rotors, of radius r, induces in the air of density p by momentum theory,
// v = sqrt(T / (2 pi n p r^2)),
// s d the distance from the mean of the hubs along the jet, and q d the distance from its axis. The velocity in the jet is
//   U / v = B / (s - s0) / (1 + (sqrt(2) - 1) x^2)^2,  x = q / (S (s - s0)),  B = 10.11, S = 0.07668, s0 = -5.817:
// L. Bauersfeld, K. Muller, D. Ziegler, F. Coletti, D. Scaramuzza, "Robotics meets Fluid Dynamics: A Characterization of the
// Induced Airflow below a Quadrotor as a Turbulent Jet", IEEE Robotics and Automation Letters, 2024, fitted to six quadrotors in
// hover, from s = 2.5 on. Here the jet also grows linearly from s = 0 to s = 1, fades out linearly from s = 20 to s = 30, and
// ends at 1/49 of the velocity on its axis, which is subtracted.
//
// A rotor loses the share k U / v of its thrust in an axial wash U, with its own v in hover: to first order, blade elements and
// momentum theory give k = m / (1 + m), m = a c W r / (16 v), for blades with lift slope a and solidity c that turn at W rad/s
// (J. G. Leishman, "Principles of Helicopter Aerodynamics", 2nd ed., 2006, chapter 3). That is 0.3 to 0.5 for small propellers.
// The momenta of jets add, and so do the squares of their velocities.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/airframe.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

struct Fleet;

// The coefficients of an airframe in its own wash and in that of others; 0 without a rotor radius.
struct WashNumbers {
  WashNumbers() = default;
  explicit WashNumbers(const Airframe& frame);

  Vec3 center = Vec3::Zero();    // m, mean of the hubs, body frame
  float length = 0.0F;           // m, largest distance between two hubs
  float reach = 0.0F;            // m, largest distance of a hub from the centre
  float load_per_thrust = 0.0F;  // 1/m^2, disc loading divided by the thrust of all rotors
  float hover_load = 0.0F;       // N/m^2, disc loading in hover
};

// Working memory of a thread.
class Downwash {
 public:
  // Writes Fleet::thrust_share of all active drones of the envs of some drones, which are sorted by env, for the current poses
  // and rotor speeds. Does nothing without DynamicsConfig::downwash. The result does not depend on the order of the drones.
  void update(Fleet& fleet, const State& state, std::span<const DroneIndex> drones);

 private:
  struct Member {
    Vec3 center, up;    // m; unit, the axis of the rotors
    float load = 0.0F;  // N/m^2, disc loading
    const WashNumbers* numbers = nullptr;
    DroneIndex drone{};
    // Sums of the squares of the shares that the rotors lose, in units of kUnit: sums of integers do not depend on their order.
    std::array<std::int64_t, kMaxRotors> lost2{};
  };

  void update_env(Fleet& fleet, const State& state, std::size_t env);
  // Adds the wash of a member to those that are near.
  void add_wash(const Member& source, const Fleet& fleet, const State& state);

  std::vector<Member> members_;     // active drones of an env, sorted by the x of their centres
  std::vector<float> x_, y_, z_;    // m, their centres
  std::vector<std::int32_t> near_;  // those that may be in the jet of one of them
  float farthest_ = 0.0F;           // m, largest reach
};

}  // namespace flockstep::dynamics
