#include "batch/checks.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>
#include <iomanip>
#include <numbers>
#include <sstream>
#include <stdexcept>

#include "base/finite.hpp"
#include "base/in_world.hpp"
#include "base/platform.hpp"
#include "bodies/body_script.hpp"

namespace flockstep::checks {

std::string row_of(std::string_view field, std::size_t row) { return std::string(field) + " (row " + std::to_string(row) + ")"; }

void size(std::size_t size, std::size_t expected, std::string_view field) {
  require(size == expected, field, std::to_string(expected) + " numbers", size);
}

void instances_of_world(const World& world, const BatchConfig& config) {
  const auto& objects = world.triangles().objects;
  const std::size_t meshes = objects.empty() ? 0 : std::size_t{1} + *std::max_element(objects.begin(), objects.end());
  const Markers& markers = world.markers();
  const std::size_t places = markers.waypoints.size() + (markers.start ? 1 : 0) + (markers.goal ? 1 : 0);
  const std::size_t instances = world.primitives().size() + meshes + places;
  const auto check = [&](const auto& sensors, const char* field) {
    if (std::ranges::none_of(sensors, [](const auto& sensor) { return sensor.outputs.instance; })) return;
    require(instances <= 65535, field, "worlds of at most 65535 primitives, meshes and markers",
            std::to_string(instances) + " in " + world.name());
  };
  check(config.cameras, "camera.outputs.instance");
  check(config.lidars, "lidar.outputs.instance");
}

void bodies_of_world(const World& world, const BatchConfig& config, std::size_t slots, float hull_radius) {
  for (const BodyConfig& body : world.bodies()) body_within_ticks(body, config.clock, hull_radius);
  const std::size_t of_world = world.bodies().size(), needed = of_world + config.bodies.size();
  if (of_world == 0 || needed <= slots) return;
  std::string bodies = std::to_string(of_world) + (of_world == 1 ? " body" : " bodies") + " of world \"" + world.name() + '"';
  if (!config.bodies.empty()) bodies += " and " + std::to_string(config.bodies.size()) + " of the batch";
  refuse("max_bodies", "at least " + std::to_string(needed) + ", for the " + bodies, slots);
}

void body_within_ticks(const BodyConfig& body, const ClockConfig& clock, float hull_radius) {
  if (!is_solid(body.visibility)) return;
  const bodies::BodyScript script(body);
  const double most = 0.5 * static_cast<double>(hull_radius);
  const auto is_fine = [&](double hz) {
    const auto reach = script.within(1.0 / hz);
    return reach.turn <= std::numbers::pi && reach.bend <= most;
  };
  const double hz = 1.0 / clock.dt_s();
  if (is_fine(hz)) return;
  double enough = hz;
  while (!is_fine(enough) && enough < 1e6) enough *= 1.1;
  const auto reach = script.within(1.0 / hz);
  std::ostringstream text;
  text << std::setprecision(3) << "body \"" << body.name << "\": too fast for contacts at " << hz << " ticks per second (it ";
  if (reach.turn > std::numbers::pi) {
    text << "turns by " << reach.turn / std::numbers::pi * 180.0 << " degrees in a tick, at most 180 are seen";
  } else {
    text << "leaves the straight line by up to " << reach.bend << " m in a tick, at most " << most << " m are allowed";
  }
  text << "): slow it down, or set physics_hz to " << std::ceil(enough) << " or more";
  throw std::invalid_argument(text.str());
}

void turn_within_ticks(double turn_radps, const ClockConfig& clock, const std::string& where) {
  const double most = std::numbers::pi / clock.dt_s();
  if (turn_radps <= most) return;
  std::ostringstream expected;
  expected << "at most " << most << " rad/s, half a turn in a tick of 1 / physics_hz";
  refuse("angular_velocity" + where, expected.str(), turn_radps);
}

void drawable(const BatchConfig& config, const Light& light) {
  require(config.camera_backend != CameraBackend::gl || config.cameras.empty() || light.fog_visibility_m == 0.0F,
          "fog_visibility_m", "0 with camera_backend=\"gl\", which draws no fog", light.fog_visibility_m);
}

void memory(double bytes, std::string_view field) {
  constexpr double kGibibyte = 1024.0 * 1024.0 * 1024.0;
  const double available = physical_memory();
  if (available == 0.0 || bytes <= available) return;
  const auto gibibytes = [](double value) {
    std::ostringstream text;
    text << std::fixed << std::setprecision(1) << value / kGibibyte << " GiB";
    return text.str();
  };
  refuse(field, "a batch that fits into this machine's " + gibibytes(available) + " of memory",
         gibibytes(bytes) + " of sensor data and observations");
}

void not_stepping(const Simulation& sim, std::string_view call) {
  if (sim.is_stepping) throw std::logic_error(std::string(call) + "() was called by a task while its batch steps or resets");
}

void has_lidar(const Simulation& sim, std::size_t lidar) {
  const std::size_t count = sim.suite.lidars().size();
  if (count == 0) throw std::invalid_argument("this Batch has no LiDAR: give it one (lidar=...; a Task declares lidar)");
  if (lidar >= count) refuse("lidar", "an index below " + std::to_string(count), lidar);
}

void has_scanned(const sensors::Lidar& lidar) {
  if (lidar.has_scanned()) return;
  throw std::logic_error("the LiDAR has not scanned yet: call sense(), or reset() a task, before its ranges are read");
}

void has_camera(const Simulation& sim, std::size_t camera) {
  if (camera >= sim.cameras.size()) refuse("camera", "an index below " + std::to_string(sim.cameras.size()), camera);
}

void capture_mode(const Simulation& sim, std::size_t camera, CaptureMode mode) {
  const bool observed = sim.task_state && sim.task_state->task->observes_camera(camera);
  require(!observed || mode != CaptureMode::on_demand, "capture_mode",
          "every_step or on_movement (the task observes this camera)", "on_demand");
}

void is_kinematic(const Simulation& sim, std::string_view call) {
  if (sim.fleet) throw std::logic_error(std::string(call) + "() is for kinematic motion; this Batch flies by rotors: use fly()");
}

void flies_by_rotors(const Simulation& sim, std::string_view call) {
  if (sim.fleet) return;
  throw std::logic_error(std::string(call) +
                         "() is for motion by rotors; this Batch has kinematic motion (give motion=\"rotors\")");
}

void velocity(std::span<const float> values, std::size_t rows) {
  if (values.empty()) return;
  size(values.size(), 3 * rows, "velocity");
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!(std::abs(values[i]) <= dynamics::kMaxSpeed)) {
      refuse(row_of("velocity", i / 3), "finite numbers within +-10000", values[i]);
    }
  }
}

void angular_velocity(const Simulation& sim, std::span<const float> values, std::size_t rows) {
  if (values.empty()) return;
  size(values.size(), 3 * rows, "angular_velocity");
  const float most = sim.fleet->physics.max_turn;
  for (std::size_t row = 0; row < rows; ++row) {
    const float* const w = values.data() + 3 * row;
    const float norm = Vec3(w[0], w[1], w[2]).norm();
    if (norm <= most) continue;
    std::ostringstream expected;
    expected << "at most " << most << " rad/s, half a turn in a tick of 1 / physics_hz";
    refuse(row_of("angular_velocity", row), expected.str(), norm);
  }
}

void rotor_speeds(const Simulation& sim, std::span<const float> values, std::span<const std::int64_t> drones) {
  if (values.empty()) return;
  const std::size_t rotors = sim.fleet->num_rotors();
  size(values.size(), rotors * (drones.empty() ? sim.num_drones() : drones.size()), "rotor_speed");
  for (std::size_t i = 0; i < values.size(); ++i) {
    const DroneIndex drone(drones.empty() ? i / rotors : static_cast<std::size_t>(drones[i / rotors]));
    const auto most = static_cast<float>(sim.fleet->airframe_of(drone).max_speed_radps);
    if (values[i] >= 0.0F && values[i] <= most) continue;
    refuse(row_of("rotor_speed", i / rotors), "numbers in [0, " + std::to_string(most) + "] rad/s", values[i]);
  }
}

std::optional<std::size_t> command(const Simulation& sim, std::span<const float> values, std::optional<Control> control) {
  require(control != Control::pose, "control", "a control other than \"pose\", which only tasks use", "\"pose\"");
  if (!control && sim.config.dynamics.control == Control::pose) {
    throw std::logic_error(
        "fly() takes commands of a controller; this Batch has control=\"pose\", which only tasks use: give another control");
  }
  std::string field = "command";
  if (control) field += std::string(" of control \"") + EnumNames<Control>::kNames[static_cast<std::size_t>(*control)] + '"';
  const std::size_t columns = sim.fleet->command_size(control.value_or(sim.config.dynamics.control));
  size(values.size(), columns * sim.num_drones(), "command");
  for (std::size_t i = 0; i < values.size(); ++i) {
    if (!(std::abs(values[i]) <= 2e6F)) refuse(row_of(field, i / columns), "finite numbers within +-2e+06", values[i]);
  }
  return angles(control.value_or(sim.config.dynamics.control), values, field);
}

std::optional<std::size_t> angles(Control control, std::span<const float> command, std::string_view field) {
  constexpr float kHalfTurn = 3.1416F;  // pi plus rounding
  constexpr float kMaxYaw = 1e4F;       // 1,600 turns: float32 resolves 0.001 rad there
  const bool is_attitude = control == Control::attitude;
  if (!is_attitude && control != Control::acceleration && control != Control::position) return {};
  constexpr float kTwoTurns = 4.0F * std::numbers::pi_v<float>;
  std::size_t far = 0;  // 1 + the first row with such a yaw
  const auto check = [&](std::size_t row, std::size_t column, float most, std::string_view expected) {
    const float value = command[4 * row + column];
    if (std::isfinite(value) && std::abs(value) > most) refuse(row_of(field, row), expected, value);
  };
  for (std::size_t row = 0; row < command.size() / 4; ++row) {
    if (is_attitude) {
      check(row, 1, kHalfTurn, "a roll within +-pi rad (not degrees)");
      check(row, 2, kHalfTurn, "a pitch within +-pi rad (not degrees)");
    }
    check(row, 3, kMaxYaw, "a yaw within +-10000 rad");
    if (far == 0 && std::abs(command[4 * row + 3]) > kTwoTurns) far = row + 1;
  }
  return far == 0 ? std::nullopt : std::optional(far - 1);
}

std::string far_yaw(std::string_view field, std::span<const float> command, std::size_t row) {
  std::ostringstream text;
  text << row_of(field, row) << ": a yaw of " << command[4 * row + 3] << " rad is more than two turns: is it in degrees?";
  return text.str();
}

void has_task(const Simulation& sim) {
  if (!sim.task_state) throw std::logic_error("this Batch has no task: give it one (task=...) to reset and step it");
}

void spec(const TaskSpec& spec) {
  const auto check = [](const Field& declared) {
    const std::string name = "task's field " + declared.name;
    for (const std::int64_t extent : declared.shape) require(extent >= 0, name, "a shape without negative extents", extent);
    const auto fits = [&](const std::vector<double>& values, const char* kind) {
      require(values.size() == 1 || values.size() == declared.size(), name,
              std::string("one number as ") + kind + ", or one for each value", values.size());
    };
    fits(declared.low, "low");
    fits(declared.high, "high");
    fits(declared.absent, "absent");
    for (std::size_t i = 0; i < std::max(declared.low.size(), declared.high.size()); ++i) {
      const double low = declared.low[declared.low.size() == 1 ? 0 : i];
      const double high = declared.high[declared.high.size() == 1 ? 0 : i];
      require(low <= high, name, "low <= high", std::to_string(low) + " and " + std::to_string(high));
    }
  };
  check(spec.action);
  const DType type = spec.action.type;
  require(type == DType::int32 || type == DType::int64 || type == DType::float32, "task's action", "int32, int64 or float32",
          EnumNames<DType>::kNames[static_cast<std::size_t>(type)]);
  require(is_floating(type) || spec.action.shape.empty(), "task's action", "a scalar if its type is an integer",
          std::to_string(spec.action.shape.size()) + " dimensions");
  constexpr double kLargest = 0x1p31;  // limit on the number of choices; a larger double may not fit the integer type
  require(is_floating(type) || (spec.action.low[0] >= -kLargest && spec.action.high[0] < kLargest), "task's action",
          "bounds within 32 bits if its type is an integer", spec.action.high[0]);
  require(!spec.observation.empty(), "task's observation", "at least one field", "none");
  for (std::size_t i = 0; i < spec.observation.size(); ++i) {
    check(spec.observation[i]);
    for (std::size_t k = 0; k < i; ++k) {
      require(spec.observation[k].name != spec.observation[i].name, "task's observation", "fields with different names",
              '"' + spec.observation[i].name + "\" twice");
    }
  }
}

void require_not_interrupted(const Simulation& sim) {
  if (!sim.is_cut_short) return;
  throw std::runtime_error(
      "an exception interrupted the last step() or reset() of this Batch: reset() every env, or restore() a snapshot");
}

void require_started(const Simulation& sim) {
  const FlagArray& started = sim.episodes.started;
  if (started.empty() || std::memchr(started.data(), 0, started.size()) == nullptr) return;
  for (std::size_t i = 0; i < sim.num_drones(); ++i) {
    if (const DroneIndex drone(i); sim.state.active[drone] && !started[sim.env_of(drone)]) {
      throw std::logic_error("reset() must come before the first step()");
    }
  }
}

void can_step(const Simulation& sim) {
  not_stepping(sim, "step");
  has_task(sim);
  require_not_interrupted(sim);
  require_started(sim);
}

void index(const Simulation& sim, DroneIndex drone) {
  if (drone < sim.num_drones()) return;
  refuse("index", "an integer in [0, " + std::to_string(sim.num_drones()) + ")", std::size_t{drone});
}

void indices(const Simulation& sim, std::span<const std::int64_t> numbers) { indices(numbers, sim.num_drones(), "indices"); }

void indices(std::span<const std::int64_t> indices, std::size_t end, std::string_view field) {
  for (std::size_t row = 0; row < indices.size(); ++row) {
    if (indices[row] >= 0 && static_cast<std::size_t>(indices[row]) < end) continue;
    refuse(row_of(field, row), "an integer in [0, " + std::to_string(end) + ")", indices[row]);
  }
}

void random(std::uint32_t stream, int count) {
  require(stream < 0x80000000U, "stream", "an integer in [0, 2147483648)", stream);
  require(count >= 0, "count", "an integer >= 0", count);
}

namespace {

void mask_size(std::size_t size, std::size_t expected, const char* of) {
  if (size != 0 && size != expected) refuse("mask", std::to_string(expected) + " flags, one for each " + of, size);
}

}  // namespace

void mask(const Simulation& sim, EnvMask mask) { mask_size(mask.size(), sim.num_envs(), "env"); }
void mask(const Simulation& sim, DroneMask mask) { mask_size(mask.size(), sim.num_drones(), "drone"); }

void spawns(const Simulation& sim, std::span<const std::int64_t> indices, std::span<const std::uint8_t> begins,
            std::span<const std::int32_t> world_index) {
  std::vector<std::int32_t> worlds(sim.num_envs(), -1);
  for (std::size_t row = 0; row < indices.size(); ++row) {
    const EnvIndex env = sim.env_of(DroneIndex(indices[row]));
    require(begins[env] || !sim.task_state || sim.episodes_mode() == Episodes::each, row_of("indices", row),
            "all drones of an env, since they begin their episodes together (or remove its other drones first)", indices[row]);
    if (world_index.empty()) continue;
    if (worlds[env] < 0) worlds[env] = begins[env] ? world_index[row] : sim.state.world_index[env];
    require(world_index[row] == worlds[env], row_of("world_index", row),
            std::to_string(worlds[env]) + ", the world of the other drones of its env", world_index[row]);
  }
}

void poses(std::span<const float> position, std::span<const float> quat_wxyz, std::size_t rows) {
  if (!position.empty()) size(position.size(), 3 * rows, "position");
  if (!quat_wxyz.empty()) size(quat_wxyz.size(), 4 * rows, "quat_wxyz");
  for (std::size_t i = 0; i < position.size(); ++i) {
    if (!is_in_world(position[i])) refuse(row_of("position", i / 3), in_world("finite coordinates"), position[i]);
  }
  for (std::size_t row = 0; row < quat_wxyz.size() / 4; ++row) {
    unit_quaternion(quat_wxyz.data() + 4 * row, [&] { return row_of("quat_wxyz", row); });
  }
}

void world_index(const Simulation& sim, std::span<const std::int32_t> world_index, std::size_t rows) {
  if (world_index.empty()) return;
  if (sim.pool) throw std::invalid_argument("world_index: not allowed with a WorldPool: each episode draws its world");
  size(world_index.size(), rows, "world_index");
  for (std::size_t row = 0; row < rows; ++row) {
    if (world_index[row] >= 0 && static_cast<std::size_t>(world_index[row]) < sim.worlds.size()) continue;
    refuse(row_of("world_index", row), "an integer in [0, " + std::to_string(sim.worlds.size()) + ")", world_index[row]);
  }
}

void actions(const Simulation& sim, std::span<const std::int64_t> actions) {
  const Field& field = sim.task_state->spec().action;
  require(!is_floating(field.type), "actions", "floating-point numbers", "integers");
  size(actions.size(), sim.num_rows(), "actions");
  const auto least = static_cast<std::int64_t>(field.low.at(0));
  const auto greatest = static_cast<std::int64_t>(field.high.at(0));
  for (std::size_t row = 0; row < actions.size(); ++row) {
    if (actions[row] >= least && actions[row] <= greatest) continue;
    refuse(row_of("actions", row), "an integer in [" + std::to_string(least) + ", " + std::to_string(greatest + 1) + ")",
           actions[row]);
  }
}

void actions(const Simulation& sim, std::span<const float> actions) {
  const Field& field = sim.task_state->spec().action;
  require(is_floating(field.type), "actions", "integers (the task's actions are discrete)", "floating-point numbers");
  size(actions.size(), sim.num_rows() * field.size(), "actions");
  if (are_finite(actions)) return;
  for (std::size_t i = 0; i < actions.size(); ++i) {
    if (!std::isfinite(actions[i])) refuse(row_of("actions", i / field.size()), "finite numbers", actions[i]);
  }
}

}  // namespace flockstep::checks
