// What the calls of a batch refuse: std::invalid_argument naming the field, what was expected and what came; std::logic_error for
// calls at the wrong time. Nothing has changed then.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>

#include "base/require.hpp"
#include "batch/simulation.hpp"

namespace flockstep::checks {

std::string row_of(std::string_view field, std::size_t row);
void size(std::size_t size, std::size_t expected, std::string_view field);

// Whether so many bytes, of arrays that are about to be made, fit into the machine. Asking the system for them would succeed, and
// using them end the process.
void memory(double bytes);

void own_process(const Simulation& sim);
void not_stepping(const Simulation& sim, std::string_view call);  // a task calls its own batch
void has_lidar(const Simulation& sim, std::size_t lidar);
void has_scanned(const sensors::Lidar& lidar);  // once at least
void has_camera(const Simulation& sim, std::size_t camera);
void capture_mode(const Simulation& sim, std::size_t camera, CaptureMode mode);
void is_kinematic(const Simulation& sim, std::string_view call);
void flies_by_rotors(const Simulation& sim, std::string_view call);
void velocity(const Simulation& sim, std::span<const float> values);
void angular_velocity(const Simulation& sim, std::span<const float> values);
void rotor_speeds(const Simulation& sim, std::span<const float> values);
void command(const Simulation& sim, std::span<const float> values);
// Angles in rows of four numbers, as the control has them: an angle that is finite, and yet too large, is most often in degrees.
void angles(Control control, std::span<const float> command, std::string_view field);
void has_task(const Simulation& sim);
void spec(const TaskSpec& spec);                      // what a task has declared
void require_not_interrupted(const Simulation& sim);  // no step or reset has been cut short
void require_started(const Simulation& sim);          // every active env is in an episode

void index(const Simulation& sim, std::int64_t index);
void indices(const Simulation& sim, std::span<const std::int64_t> indices);
void mask(const Simulation& sim, EnvMask mask);
void mask(const Simulation& sim, DroneMask mask);
// Which envs begin when drones are spawned: a task takes all drones of an env at once, and an env is in one world.
void spawns(const Simulation& sim, std::span<const std::int64_t> indices, std::span<const std::uint8_t> begins,
            std::span<const std::int32_t> world_index);
void poses(std::span<const float> position, std::span<const float> quat_wxyz, std::size_t rows);
void world_index(const Simulation& sim, std::span<const std::int32_t> world_index, std::size_t rows);
void actions(const Simulation& sim, std::span<const std::int64_t> actions);
void actions(const Simulation& sim, std::span<const float> actions);

}  // namespace flockstep::checks
