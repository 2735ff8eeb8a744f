#include "flockstep/drone_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

#include "arguments.hpp"
#include "arrays.hpp"
#include "convert.hpp"

namespace flockstep::bindings {
namespace {

DroneModel make_drone_model(const py::object& hull) {
  if (hull.is_none()) return DroneModel::quadrotor650();
  return DroneModel(points_of(floats(hull, "hull", {-1, 3})));
}

py::array_t<float> hull_of(const py::object& self) {
  const std::span<const Vec3> hull = self.cast<const DroneModel&>().hull();
  return view<float>(self, hull.front().data(), {static_cast<py::ssize_t>(hull.size()), 3});
}

const Airframe& airframe_of(const DroneModel& drone) {
  if (!drone.airframe()) throw py::attribute_error("this DroneModel has no airframe, only a hull");
  return *drone.airframe();
}

py::str path_of(const py::handle& name_or_path) {
  const py::object path = py::module_::import("os").attr("fspath")(name_or_path);
  return py::str(path);
}

// Returns a text for each number that is possible but probably in another unit, such as an inertia in g cm^2.
std::vector<std::string> doubts_about(const DroneModel& drone) {
  constexpr double kMaxThrustToWeight = 20.0;
  constexpr double kSpeedOfSound = 340.0;  // m/s
  std::vector<std::string> doubts;
  if (!drone.airframe()) return doubts;
  const auto check = [&doubts](double got, double most, const std::string& field, const std::string& what,
                               const std::string& hint) {
    std::ostringstream text;
    text << field << ": expected " << what << " of at most " << most << ", got " << got << ": " << hint;
    if (got > most) doubts.push_back(text.str());
  };
  const Airframe& frame = *drone.airframe();
  // No mass within a ball has a larger moment about its centre than the same mass on its surface.
  check(*std::ranges::max_element(frame.inertia_kgm2), frame.mass_kg * std::pow(static_cast<double>(drone.radius()), 2.0),
        "inertia_kgm2", "moments in kg m^2 (mass times squared radius of the hull)",
        "are they in g m^2 (1e-3 kg m^2) or g cm^2 (1e-7)?");
  check(frame.thrust_to_weight(), kMaxThrustToWeight, "rotors max_thrust_n", "a thrust-to-weight",
        "is the thrust in grams (1 g is 0.00981 N) or that of all rotors?");
  // Without a radius, half the distance of two rotors stands for it, which is the largest propeller that fits.
  double radius_m = frame.radius_m;
  if (radius_m == 0.0) {
    const auto& [x, y, z] = frame.position_m[0];
    radius_m = std::numeric_limits<double>::infinity();
    for (std::size_t i = 1; i < frame.position_m.size(); ++i) {
      radius_m = std::min(radius_m, 0.5 * std::hypot(frame.position_m[i][0] - x, frame.position_m[i][1] - y));
    }
  }
  check(frame.max_speed_radps * radius_m, kSpeedOfSound, "rotors max_speed_radps", "propeller tips in m/s",
        "is the speed in rpm (1 rpm is 0.1047 rad/s), or radius_m a diameter?");
  return doubts;
}

// Returns the drone, after warnings about numbers that are probably in another unit.
DroneModel warned(DroneModel drone) {
  for (const std::string& doubt : doubts_about(drone)) {
    if (PyErr_WarnEx(PyExc_UserWarning, doubt.c_str(), 1) != 0) throw py::error_already_set();
  }
  return drone;
}

}  // namespace

DroneModel drone_argument(const py::object& drone) {
  if (drone.is_none()) return DroneModel::quadrotor650();
  if (py::isinstance<py::str>(drone) || py::hasattr(drone, "__fspath__")) return warned(DroneModel::load(path_of(drone)));
  return argument<DroneModel>(drone, "drone", "a flockstep.DroneModel, the name or path of one, or None");
}

void register_drone_model(py::module_& module) {
  const auto json = [](const char* function) { return py::module_::import("json").attr(function); };
  py::class_<DroneModel>(module, "DroneModel", "A drone: its convex hull, and its airframe if it has one.")
      .def(py::init(&make_drone_model), py::arg("hull") = py::none())
      .def_static(
          "load", [](const py::object& name_or_path) { return warned(DroneModel::load(path_of(name_or_path))); },
          py::arg("name_or_path"))
      .def_static("names", &DroneModel::names)
      .def_static(
          "from_dict", [](const py::dict& data) { return warned(DroneModel::from_json(json_text(data, "data"))); },
          py::arg("data"))
      .def("to_dict", [json](const DroneModel& drone) { return json("loads")(drone.to_json()); })
      .def("scaled", &DroneModel::scaled, py::kw_only(), py::arg("size") = 1.0, py::arg("mass") = 1.0)
      .def_property_readonly("name", [](const DroneModel& drone) { return drone.name(); })
      .def_property_readonly("hull", &hull_of)
      .def_property_readonly("mass_kg", [](const DroneModel& drone) { return airframe_of(drone).mass_kg; })
      .def_property_readonly("thrust_to_weight", [](const DroneModel& drone) { return airframe_of(drone).thrust_to_weight(); })
      .def_property_readonly("max_thrust_n", [](const DroneModel& drone) { return airframe_of(drone).max_thrust(); })
      .def_property_readonly("num_rotors", [](const DroneModel& drone) { return airframe_of(drone).num_rotors(); })
      .def_property_readonly("hover_speed_radps", [](const DroneModel& drone) { return airframe_of(drone).hover_speed(); })
      .def("__eq__",
           [](const DroneModel& drone, const py::object& other) -> py::object {
             if (!py::isinstance<DroneModel>(other)) return py::reinterpret_borrow<py::object>(Py_NotImplemented);
             return py::bool_(drone.to_json() == other.cast<const DroneModel&>().to_json());
           })
      .def("__hash__", [](const DroneModel& drone) { return std::hash<std::string>()(drone.to_json()); })
      .def("__repr__",
           [](const DroneModel& drone) {
             std::string text = "<DroneModel";
             if (!drone.name().empty()) text += " '" + drone.name() + '\'';
             text += ", " + std::to_string(drone.hull().size()) + " hull points";
             if (drone.airframe()) text += ", " + std::string(py::str("{:g} kg").format(drone.airframe()->mass_kg));
             return text + '>';
           })
      .def(py::pickle([](const DroneModel& drone) { return drone.to_json(); },
                      [](const std::string& text) { return DroneModel::from_json(text); }));
}

}  // namespace flockstep::bindings
