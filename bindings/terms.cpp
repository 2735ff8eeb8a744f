// The engine's terms for Python tasks. Each term is computed in one pass over the batch's current state.
#include "terms.hpp"

#include "arrays.hpp"
#include "flockstep/batch.hpp"
#include "tasks/terms.hpp"

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
  return *batch.world_of(EnvIndex(drone / static_cast<std::size_t>(batch.config().drones_per_env)));
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
    batch.require_scan();
    const LidarConfig& lidar = batch.config().lidars[0];
    rays = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
    all = batch.lidar_readings().ranges;
    max_range_m = batch.lidar_readings().max_range_m;
  }
  std::span<const float> of(std::size_t drone) const { return all.subspan(drone * rays, rays); }
  task::Clearance clearance(std::size_t drone) const { return task::clearance_of(of(drone), max_range_m[drone]); }

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
      throw py::value_error("world '" + world.name() + "' has no start marker, where Task.reset puts drones; override it");
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

py::array_t<float> displaced(const Terms& terms, const py::object& displacement) {
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

}  // namespace

py::object terms_of(const py::object& batch) { return py::cast(Terms{batch}); }

void register_terms(py::module_& module) {
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
      .def("ranges", &ranges)
      .def("clearance", &clearance)
      .def("free_space", &free_space, py::arg("min_clearance"))
      .def_property_readonly("action_changed", [](const Terms& terms) {
        return view<bool>(terms.owner, terms.batch().episodes().action_changed.data(), {static_cast<py::ssize_t>(terms.size())});
      });
}

}  // namespace flockstep::bindings
