// The position and tilt sensor: the pose, with optional Gaussian noise.
#pragma once

#include <span>

#include "flockstep/config.hpp"
#include "flockstep/state.hpp"

namespace flockstep::sensors {

// Writes state.sensed_position and sensed_quat_wxyz of the listed drones. The noise of an env is a function of its seed, its
// episode and how often it was sensed in that episode.
void sense_pose(std::span<const std::uint32_t> drones, const PoseSensorConfig& config, State& state);

}  // namespace flockstep::sensors
