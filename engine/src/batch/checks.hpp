// Checks of the arguments and preconditions of Batch calls. They throw before anything has changed: std::invalid_argument with
// the field, the expected and the given value for a bad argument, otherwise std::logic_error or std::runtime_error.
#pragma once

#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>

#include "base/require.hpp"
#include "batch/simulation.hpp"

namespace flockstep::checks {

std::string row_of(std::string_view field, std::size_t row);
void size(std::size_t size, std::size_t expected, std::string_view field);

// Checks that arrays of this many bytes fit into the machine's memory. Without this check the allocation would succeed, and
// using the arrays would kill the process.
void memory(double bytes, std::string_view field = "num_drones");

// Checks that the camera backend can draw this light, which is valid.
void drawable(const BatchConfig& config, const Light& light);

// Checks that the instance ids of a world, which have 16 bits, are enough for the sensors that write them.
void instances_of_world(const World& world, const BatchConfig& config);

// Checks that the bodies of a world and of the configuration fit into the slots of an env, and body_within_ticks().
void bodies_of_world(const World& world, const BatchConfig& config, std::size_t slots, float hull_radius);
// Checks that contacts see the whole motion of a body with this script. hull_radius: m, of the drones.
void body_within_ticks(const BodyConfig& body, const ClockConfig& clock, float hull_radius);
void turn_within_ticks(double turn_radps, const ClockConfig& clock, const std::string& where);

void not_stepping(const Simulation& sim, std::string_view call);  // against calls of a task on its own batch
void has_lidar(const Simulation& sim, std::size_t lidar);
void has_scanned(const sensors::Lidar& lidar);  // at least once
void has_camera(const Simulation& sim, std::size_t camera);
void capture_mode(const Simulation& sim, std::size_t camera, CaptureMode mode);
void is_kinematic(const Simulation& sim, std::string_view call);
void flies_by_rotors(const Simulation& sim, std::string_view call);
void velocity(std::span<const float> values, std::size_t rows);
void angular_velocity(const Simulation& sim, std::span<const float> values, std::size_t rows);
// drones: (rows,) the drones of the rows; empty: all drones.
void rotor_speeds(const Simulation& sim, std::span<const float> values, std::span<const std::int64_t> drones);
// Returns what angles() returns.
std::optional<std::size_t> command(const Simulation& sim, std::span<const float> values, std::optional<Control> control);
// Checks the angles in rows of four numbers, as the control defines them: a finite angle that is too large is usually in
// degrees. Returns the first row with a yaw of more than two turns, which is allowed but suspicious.
std::optional<std::size_t> angles(Control control, std::span<const float> command, std::string_view field);
// Returns a warning of such a row.
std::string far_yaw(std::string_view field, std::span<const float> command, std::size_t row);
void has_task(const Simulation& sim);
void can_step(const Simulation& sim);
void spec(const TaskSpec& spec);                      // fields that a task declares
void require_not_interrupted(const Simulation& sim);  // no step or reset was cut short
void require_started(const Simulation& sim);          // every active env is in an episode

void index(const Simulation& sim, DroneIndex drone);
void indices(const Simulation& sim, std::span<const std::int64_t> indices);
// Checks that each number of a field is an index below `end`.
void indices(std::span<const std::int64_t> indices, std::size_t end, std::string_view field);
void random(std::uint32_t stream, int count);
void mask(const Simulation& sim, EnvMask mask);
void mask(const Simulation& sim, DroneMask mask);
// Checks drones to be spawned: with a task all drones of an env must begin together, and all drones of an env are in one world.
// begins: (E,) 1 if the env has no other active drones.
void spawns(const Simulation& sim, std::span<const std::int64_t> indices, std::span<const std::uint8_t> begins,
            std::span<const std::int32_t> world_index);
// name(): returns the field, for the message.
template <class Name>
void unit_quaternion(const float* q, const Name& name) {
  const double norm = std::hypot(std::hypot(static_cast<double>(q[0]), q[1]), std::hypot(static_cast<double>(q[2]), q[3]));
  if (!(std::abs(norm - 1.0) < 1e-2)) refuse(name(), "a unit quaternion (w, x, y, z)", "one of norm " + std::to_string(norm));
}
void poses(std::span<const float> position, std::span<const float> quat_wxyz, std::size_t rows);
void world_index(const Simulation& sim, std::span<const std::int32_t> world_index, std::size_t rows);
void actions(const Simulation& sim, std::span<const std::int64_t> actions);
void actions(const Simulation& sim, std::span<const float> actions);

}  // namespace flockstep::checks
