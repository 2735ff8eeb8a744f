#include "flockstep/drone_model.hpp"

#include "arrays.hpp"

namespace flockstep::bindings {
namespace {

DroneModel make_drone_model(const py::object& hull) {
  if (hull.is_none()) return DroneModel::quadrotor650();
  const Input<float> input = floats(hull, "hull", {-1, 3});
  const std::span<const float> numbers = input;
  std::vector<Vec3> points;
  for (std::size_t i = 0; i + 2 < numbers.size(); i += 3) points.emplace_back(numbers[i], numbers[i + 1], numbers[i + 2]);
  return DroneModel(std::move(points));
}

py::array_t<float> hull_of(const py::object& self) {
  const std::span<const Vec3> hull = self.cast<const DroneModel&>().hull();
  return view<float>(self, hull.front().data(), {static_cast<py::ssize_t>(hull.size()), 3});
}

}  // namespace

void register_drone_model(py::module_& module) {
  py::class_<DroneModel>(module, "DroneModel", "What a drone is made of: its convex hull is its collision body.")
      .def(py::init(&make_drone_model), py::arg("hull") = py::none())
      .def_property_readonly("hull", &hull_of)
      .def(py::pickle([](const py::object& self) { return hull_of(self).attr("tolist")(); }, &make_drone_model));
}

}  // namespace flockstep::bindings
