// Random drones: quadrotors of any size, drawn by a seed.
#pragma once

#include <cstdint>
#include <string_view>

#include "flockstep/drone_model.hpp"

namespace flockstep {

inline constexpr std::string_view kRandomDrone = "random/seed-";  // followed by the seed, the name of a random drone

// A quadrotor by the ranges from which the policy RAPTOR learned (J. Eschmann, D. Albani, G. Loianno, "RAPTOR: A Foundation
// Policy for Quadrotor Control", arXiv:2509.11481, and its program rl-tools): mass 0.02 to 5 kg, uniform in its cube root;
// thrust 1.5 to 5 weights; arms by the cube root of the mass, within 10 %; greatest torque over inertia 40 to 1,200 rad/s^2;
// torque ratio 0.005 to 0.05 m; lag 30 to 100 ms up and 30 to 300 ms down. Ours: the inertia about z is 1.8 times that about x,
// rotors reach 80 m/s at their tips, and the drag of the body is 0.1 to 0.5 1/s of its mass.
DroneModel random_drone(std::uint64_t seed);

}  // namespace flockstep
