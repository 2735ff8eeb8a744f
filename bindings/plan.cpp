#include <chrono>

#include "arrays.hpp"
#include "flockstep/planning.hpp"
#include "named.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

py::object plan_path(const py::object& given_world, const py::object& start, const py::object& goals, const py::object& drone,
                     float cell_m, const std::optional<py::function>& progress) {
  const std::shared_ptr<World> world = world_argument(given_world);
  const Input<float> start_input = floats(start, "start", {3});
  if (!start_input.given()) throw py::value_error("start: expected an array of real numbers, got None");
  const std::span<const float> from = start_input;
  const Input<float> goal_input = floats(goals, "goals", {-1, 3});
  const std::span<const float> over = goal_input;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i < over.size(); i += 3) points.emplace_back(over[i], over[i + 1], over[i + 2]);
  const DroneModel model = drone_argument(drone);
  const Vec3 first(from[0], from[1], from[2]);
  Progress report;
  if (progress) {
    report = [&progress, next = std::chrono::steady_clock::now()](double share) mutable {
      const auto now = std::chrono::steady_clock::now();
      if (now < next) return;  // the interpreter lock costs more than the search between two calls
      next = now + std::chrono::milliseconds(100);
      const py::gil_scoped_acquire acquire;
      (*progress)(share);
    };
  }
  const std::optional<std::vector<Vec3>> path = released([&] { return plan(*world, model, first, points, cell_m, report); });
  if (!path) return py::none();
  return rows(*path);
}

}  // namespace

void register_plan(py::module_& module) {
  module.def("plan", &plan_path, py::arg("world"), py::arg("start"), py::arg("goals"), py::arg("drone") = py::none(),
             py::arg("cell_m") = 0.1F, py::arg("progress") = py::none());
}

}  // namespace flockstep::bindings
