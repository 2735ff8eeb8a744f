// The engine's terms for Python tasks. Each term is computed in one pass over the batch's current state.
#include "tasks/terms.hpp"

#include <Eigen/Core>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "arrays.hpp"
#include "base/require.hpp"
#include "batch.hpp"
#include "batch/checks.hpp"
#include "convert.hpp"
#include "flockstep/neighbors.hpp"
#include "tasks/flight_action.hpp"
#include "tasks/gates.hpp"

namespace flockstep::bindings {
namespace {

struct Terms {
  py::object owner;

  const Batch& batch() const { return owner.cast<const Batch&>(); }
  std::size_t size() const { return static_cast<std::size_t>(batch().config().num_drones()); }
};

Pose pose_at(const std::vector<float>& position, const std::vector<float>& quat_wxyz, std::size_t drone) {
  const float* const p = position.data() + 3 * drone;
  const float* const q = quat_wxyz.data() + 4 * drone;
  return {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
}

const World& world_of(const Batch& batch, std::size_t drone) {
  return batch.unlit_world_of(EnvIndex(drone / static_cast<std::size_t>(batch.config().drones_per_env)));
}

// Returns the goal of each drone: the waypoint at goal_index, or else the goal marker of its world.
std::vector<Vec3> goals(const Terms& terms, const py::object& goal_index) {
  const Batch& batch = terms.batch();
  const auto n = static_cast<py::ssize_t>(terms.size());
  const auto index = integers<std::int32_t>(goal_index, "goal_index", {n});
  const std::span<const std::int32_t> indices = index;
  std::vector<Vec3> result;
  const std::size_t count = terms.size();
  result.reserve(count);
  for (std::size_t drone = 0; drone < count; ++drone) {
    const World& world = world_of(batch, drone);
    const auto waypoints = static_cast<std::int32_t>(world.markers().waypoints.size());
    const std::int32_t which = indices.empty() ? waypoints : indices[drone];
    if (which < 0) throw py::value_error("goal_index: expected integers >= 0, got " + std::to_string(which));
    if (which >= waypoints && !world.markers().goal) throw py::value_error("world '" + world.name() + "' has no goal marker");
    result.push_back(task::goal_of(world, which));
  }
  return result;
}

// Returns f(drone) for each drone as a new array.
template <class T, class F>
py::array_t<T> per_drone(const Terms& terms, const F& f) {
  const std::size_t n = terms.size();  // one lookup in Python
  py::array_t<T> array(static_cast<py::ssize_t>(n));
  T* const values = array.mutable_data();
  for (std::size_t drone = 0; drone < n; ++drone) values[drone] = static_cast<T>(f(drone));
  return array;
}

// LiDAR scans, one row of rays for each drone.
struct Scans {
  explicit Scans(const Batch& batch) {
    batch.lidar().require_scan();
    const LidarConfig& lidar = batch.config().lidars[0];
    rays = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
    all = batch.lidar().readings().ranges;
    max_range_m = batch.lidar().readings().max_range_m;
  }
  std::span<const float> of(std::size_t drone) const { return all.subspan(drone * rays, rays); }
  task::ScanClearance clearance(std::size_t drone) const { return task::clearance_of(of(drone), max_range_m[drone]); }

  std::size_t rays;
  std::span<const float> all;
  std::span<const float> max_range_m;
};

py::array_t<double> goal_distance(const Terms& terms, const py::object& goal_index) {
  const std::vector<Vec3> points = goals(terms, goal_index);
  const State& state = terms.batch().state();
  return per_drone<double>(terms, [&](std::size_t drone) {
    return task::distance_m(points[drone], pose_at(state.position, state.quat_wxyz, drone).position);
  });
}

// Returns the default start of an episode: the start marker of each env's world.
py::array_t<float> start(const Terms& terms) {
  const Batch& batch = terms.batch();
  std::vector<Vec3> points;
  const std::size_t count = terms.size();
  points.reserve(count);
  for (std::size_t drone = 0; drone < count; ++drone) {
    const World& world = world_of(batch, drone);
    if (!world.markers().start)
      throw py::value_error("world '" + world.name() +
                            "' has no start marker, where Task.reset puts drones: draw markers by "
                            "world.with_drawn_markers(seed), or override reset");
    points.push_back(*world.markers().start);
  }
  return rows(points);
}

py::array_t<float> goal_direction(const Terms& terms, const py::object& goal_index) {
  std::vector<Vec3> points = goals(terms, goal_index);
  const Batch& batch = terms.batch();
  const std::vector<float>& position = batch.pose_readings().position;
  const std::vector<float>& quat_wxyz = batch.pose_readings().quat_wxyz;
  for (std::size_t drone = 0; drone < points.size(); ++drone) {
    points[drone] = task::direction_to(pose_at(position, quat_wxyz, drone), points[drone]);
  }
  return rows(points);
}

// Refuses None for an array.
void require_array(const py::object& object, const char* field, const char* shape) {
  if (object.is_none()) refuse(field, std::string("an array ") + shape, "None");
}

py::array_t<float> displaced(const Terms& terms, const py::object& displacement) {
  require_array(displacement, "displacement_m", "(N, 3)");
  const auto input = floats(displacement, "displacement_m", {static_cast<py::ssize_t>(terms.size()), 3});
  const std::span<const float> d = input;
  const State& state = terms.batch().state();
  std::vector<Vec3> points(terms.size());
  for (std::size_t drone = 0; drone < points.size(); ++drone) {
    const Pose pose = pose_of(state, DroneIndex(drone));
    points[drone] = pose.position + pose.rotation * Vec3(d[3 * drone], d[3 * drone + 1], d[3 * drone + 2]);
  }
  return rows(points);
}

// Rotates a vector by a quaternion with this vector part. The operations are those of flockstep.rotations.rotate in float32, so
// that both give the same bits.
Vec3 rotated(float w, const Vec3& axis, const Vec3& vector) {
  const Vec3 twice = 2.0F * axis.cross(vector);
  return vector + w * twice + axis.cross(twice);
}

// Returns vectors of the world in the body frames that the pose sensor measured, (N, 3) or (N, K, 3). subtracts_position: they
// are points.
py::array_t<float> to_body(const Terms& terms, const py::object& given, const char* field, bool subtracts_position) {
  require_array(given, field, "(N, 3) or (N, K, 3)");
  const auto n = static_cast<py::ssize_t>(terms.size());
  const auto array = py::array::ensure(given);  // null for something that is no array; it is refused below
  const bool has_several = array && array.ndim() == 3;
  const auto input = floats(given, field, has_several ? Shape{n, -1, 3} : Shape{n, 3});
  const std::span<const float> vectors = input;
  const std::size_t row = has_several ? static_cast<std::size_t>(3 * array.shape(1)) : 3;
  py::array_t<float> result(has_several ? Shape{n, array.shape(1), 3} : Shape{n, 3});
  float* out = result.mutable_data();
  const Batch& batch = terms.batch();
  const std::vector<float>& position = batch.pose_readings().position;
  const std::vector<float>& quat_wxyz = batch.pose_readings().quat_wxyz;
  const std::size_t count = terms.size();
  for (std::size_t drone = 0; drone < count; ++drone) {
    const float* const p = position.data() + 3 * drone;
    const float* const q = quat_wxyz.data() + 4 * drone;
    const Vec3 origin = subtracts_position ? Vec3(p[0], p[1], p[2]) : Vec3(Vec3::Zero());
    const Vec3 axis(-q[1], -q[2], -q[3]);
    for (const float* v = vectors.data() + row * drone; v != vectors.data() + row * (drone + 1); v += 3) {
      const Vec3 turned = rotated(q[0], axis, Vec3(v[0], v[1], v[2]) - origin);
      out = std::copy_n(turned.data(), 3, out);
    }
  }
  return result;
}

py::array_t<float> body_velocity(const Terms& terms) {
  const char* const name = terms.batch().pose_readings().velocity.empty() ? "velocity" : "sensed_velocity";
  return to_body(terms, terms.owner.attr(name), name, false);
}

py::array_t<float> neighbors(const Terms& terms, int count, const py::object& velocity) {
  require(count >= 1, "count", "an integer >= 1", count);
  const Batch& batch = terms.batch();
  const State& state = batch.state();
  const auto n = static_cast<py::ssize_t>(terms.size());
  const auto given = floats(velocity, "velocity", {n, 3});
  std::span<const float> velocities = given;
  if (velocities.empty()) velocities = batch.pose_readings().velocity;
  if (velocities.empty()) velocities = state.flight.velocity;
  py::array_t<float> block({n, static_cast<py::ssize_t>(count), static_cast<py::ssize_t>(kNeighborSize)});
  const std::span<float> rows(block.mutable_data(), static_cast<std::size_t>(block.size()));
  const std::size_t size = kNeighborSize * static_cast<std::size_t>(count), drones = terms.size();
  for (std::size_t drone = 0; drone < drones; ++drone) {
    write_neighbors(state, batch.pose_readings(), static_cast<std::size_t>(batch.config().drones_per_env), DroneIndex(drone),
                    velocities, rows.subspan(size * drone, size));
  }
  return block;
}

// Returns the flight model of the drones. Throws AttributeError for kinematic motion.
const Airframe& airframe_of(const Batch& batch, const char* what) {
  if (batch.config().dynamics.is_kinematic()) {
    throw py::attribute_error(std::string("kinematic motion has no ") + what + ": make this Batch with motion=\"rotors\"");
  }
  return *batch.drone().airframe();
}

py::array_t<float> command(const Terms& terms, const py::object& actions, const std::optional<double>& max_thrust_to_weight,
                           const py::kwargs& unknown) {
  refuse_unknown("Terms.command", unknown, {"actions", "max_thrust_to_weight"});
  const Batch& batch = terms.batch();
  const DynamicsConfig& dynamics = batch.config().dynamics;
  const Airframe& frame = airframe_of(batch, "commands");
  const std::string control = '"' + std::string(name_of(dynamics.control)) + '"';
  require(dynamics.control != Control::pose, "control", "one that commands the rotors", control);
  if (max_thrust_to_weight) {
    require(*max_thrust_to_weight > 1.0, "max_thrust_to_weight", "a number > 1", *max_thrust_to_weight);
    require(task::commands_thrust(dynamics.control), "max_thrust_to_weight", "None with a control that commands no thrust",
            "a number with control " + control);
  }
  const auto n = static_cast<py::ssize_t>(terms.size());
  require_array(actions, "actions", "(N, 4)");
  const std::size_t size = batch.command_size();
  const auto input = floats(actions, "actions", {n, static_cast<py::ssize_t>(size)});
  const std::span<const float> given = input;
  const task::FlightAction levels(dynamics, frame, max_thrust_to_weight.value_or(std::numeric_limits<double>::infinity()));
  py::array_t<float> commands({n, static_cast<py::ssize_t>(size)});
  float* const out = commands.mutable_data();
  const std::size_t count = terms.size();
  for (std::size_t drone = 0; drone < count; ++drone) {
    levels.command(given.subspan(size * drone, size), batch.state(), DroneIndex(drone), out + size * drone);
  }
  return commands;
}

py::array_t<float> rotor_levels(const Terms& terms) {
  const Batch& batch = terms.batch();
  const task::ActionRanges range = task::rotor_speed_ranges(airframe_of(batch, "rotors"));
  py::array_t<float> levels({static_cast<py::ssize_t>(terms.size()), static_cast<py::ssize_t>(batch.num_rotors())});
  float* const out = levels.mutable_data();
  const std::vector<float>& speeds = batch.state().flight.rotor_speed;
  for (std::size_t i = 0; i < speeds.size(); ++i) {
    const DroneIndex drone(i / batch.num_rotors());
    out[i] = i % batch.num_rotors() < batch.num_rotors(drone) ? range.action_for(speeds[i]) : 0.0F;
  }
  return levels;
}

py::tuple crossed(const Terms& terms, const py::object& gate, const std::optional<double>& miss_m) {
  const Batch& batch = terms.batch();
  const std::span<const float> paths = batch.path();
  const double most_m = miss_m.value_or(std::numeric_limits<double>::infinity());
  require(most_m > 0.0, "miss_m", "a number > 0 or None", most_m);
  const auto n = static_cast<py::ssize_t>(terms.size());
  require_array(gate, "gate", "(N,)");
  const auto input = integers<std::int64_t>(gate, "gate", {n});
  const std::span<const std::int64_t> targets = input;
  const std::size_t count = terms.size(), row = paths.size() / count;
  const auto per_env = static_cast<std::size_t>(batch.config().drones_per_env);
  py::array_t<std::int32_t> passed(n);
  py::array_t<bool> missed(n);
  for (std::size_t drone = 0; drone < count; ++drone) {
    const World& world = world_of(batch, drone);
    const std::span<const Gate> gates = world.gates();
    if (gates.empty()) refuse("gate", "a world with gates", "world \"" + world.name() + "\", which has none");
    if (targets[drone] < 0 || targets[drone] >= std::ssize(gates)) {
      refuse(checks::row_of("gate", drone),
             "an integer in [0, " + std::to_string(gates.size()) + "), a gate of world \"" + world.name() + '"', targets[drone]);
    }
    task::Crossings crossings;
    if (batch.episodes().flying[drone / per_env]) {
      crossings = task::cross_gates(gates, static_cast<std::size_t>(targets[drone]), paths.subspan(row * drone, row),
                                    static_cast<float>(most_m));
    }
    passed.mutable_data()[drone] = crossings.passed;
    missed.mutable_data()[drone] = crossings.has_missed;
  }
  return py::make_tuple(passed, missed);
}

py::array_t<float> ranges(const Terms& terms) {
  const Scans scans(terms.batch());
  const std::size_t n = terms.size();
  py::array_t<float> array({static_cast<py::ssize_t>(n), static_cast<py::ssize_t>(scans.rays)});
  float* const values = array.mutable_data();
  for (std::size_t drone = 0; drone < n; ++drone) {
    task::normalise(scans.of(drone), scans.max_range_m[drone], values + drone * scans.rays);
  }
  return array;
}

py::array_t<double> clearance(const Terms& terms) {
  const Scans scans(terms.batch());
  return per_drone<double>(terms, [&](std::size_t drone) { return scans.clearance(drone).nearest; });
}

py::array_t<double> free_space(const Terms& terms, double min_clearance) {
  const Scans scans(terms.batch());
  if (!(min_clearance > 0.0 && min_clearance < 1.0)) throw py::value_error("min_clearance: expected a number in (0, 1)");
  return per_drone<double>(
      terms, [&](std::size_t drone) { return task::free_space(scans.clearance(drone).sum, scans.rays, min_clearance); });
}

// Returns the rotation matrices (R, 3, 3) of quaternions (R, 4): the columns are the body's axes in the world frame.
py::array_t<float> rotation_matrices(std::span<const float> quat_wxyz) {
  const std::size_t count = quat_wxyz.size() / 4;
  py::array_t<float> matrices({static_cast<py::ssize_t>(count), py::ssize_t{3}, py::ssize_t{3}});
  float* const out = matrices.mutable_data();
  for (std::size_t row = 0; row < count; ++row) {
    const float* const q = quat_wxyz.data() + 4 * row;
    const Vec3 axis(q[1], q[2], q[3]);
    Eigen::Map<Eigen::Matrix<float, 3, 3, Eigen::RowMajor>> matrix(out + 9 * row);
    for (Eigen::Index k = 0; k < 3; ++k) matrix.col(k) = rotated(q[0], axis, Vec3::Unit(k));
  }
  return matrices;
}

}  // namespace

void add_terms(py::module_& module, BatchClass& cls) {
  const auto none = py::none();
  py::class_<Terms>(module, "Terms",
                    "Reward terms and observations of the engine's own tasks, from the current state of every env.")
      .def(
          "goal", [](const Terms& terms, const py::object& goal_index) { return rows(goals(terms, goal_index)); },
          py::arg("goal_index") = none)
      .def("start", &start)
      .def("goal_distance", &goal_distance, py::arg("goal_index") = none)
      .def("goal_direction", &goal_direction, py::arg("goal_index") = none)
      .def("displaced", &displaced, py::arg("displacement_m"))
      .def(
          "to_body", [](const Terms& terms, const py::object& points) { return to_body(terms, points, "points", true); },
          py::arg("points"))
      .def(
          "rotate_to_body",
          [](const Terms& terms, const py::object& vectors) { return to_body(terms, vectors, "vectors", false); },
          py::arg("vectors"))
      .def("body_velocity", &body_velocity)
      .def("neighbors", &neighbors, py::arg("count"), py::arg("velocity") = none)
      .def("command", &command, py::arg("actions"), py::kw_only(), py::arg("max_thrust_to_weight") = none)
      .def("rotor_levels", &rotor_levels)
      .def("crossed", &crossed, py::arg("gate"), py::kw_only(), py::arg("miss_m") = none)
      .def("ranges", &ranges)
      .def("clearance", &clearance)
      .def("free_space", &free_space, py::arg("min_clearance"))
      .def_property_readonly("action_changed", [](const Terms& terms) {
        return view<bool>(terms.owner, terms.batch().episodes().action_changed.data(), {static_cast<py::ssize_t>(terms.size())});
      });
  cls.def_property_readonly("terms", [](const py::object& batch) { return Terms{batch}; })
      .def_property_readonly("rotation", [](const Batch& batch) { return rotation_matrices(batch.state().quat_wxyz); })
      .def_property_readonly("sensed_rotation",
                             [](const Batch& batch) { return rotation_matrices(batch.pose_readings().quat_wxyz); });
}

}  // namespace flockstep::bindings
