// The configurations, made from their lists of fields.
#include "flockstep/config.hpp"

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include "convert.hpp"
#include "flockstep/hover.hpp"
#include "flockstep/navigation.hpp"
#include "flockstep/track.hpp"

namespace flockstep::bindings {
namespace {

template <class Config>
constexpr auto field_names() {
  return std::apply([](const auto&... fields) { return std::array{fields.name...}; }, Config::fields());
}

std::string class_name(const py::object& self) { return py::str(py::type::of(self).attr("__name__")); }

// A keyword-only constructor: every field by its name, unset ones keep their default.
template <class Config>
Config from_keywords(const py::kwargs& kwargs) {
  py::object config = py::cast(Config());
  for (const auto& [key, value] : kwargs) {
    if (!py::hasattr(config, key)) {
      throw py::type_error(unexpected_keyword(class_name(config) + ".__init__", py::str(key), config.attr("__match_args__")));
    }
    py::setattr(config, key, py::reinterpret_borrow<py::object>(value));
  }
  const auto made = config.cast<Config>();
  made.validate();
  return made;
}

py::dict state_of(const py::object& self, const auto& names) {
  py::dict state;
  for (const char* name : names) state[name] = self.attr(name);
  return state;
}

// What every config has: its fields, keywords in, repr, equality by value, pickling (Gymnasium copies the keywords of an env).
template <class Config>
py::class_<Config> register_fields(py::module_& module, const char* name, const char* doc) {
  py::class_<Config> cls(module, name, doc);
  std::apply(
      [&](const auto&... fields) {
        (cls.def_property(
             fields.name, [member = fields.member](const Config& config) { return to_python(config.*member); },
             [member = fields.member, field = fields.name](Config& config, const py::object& value) {
               using Value = std::remove_cvref_t<decltype(config.*member)>;
               config.*member = from_python<Value>(value, field);
             }),
         ...);
      },
      Config::fields());
  constexpr auto kNames = field_names<Config>();
  cls.def(py::init(&from_keywords<Config>))
      .def("__repr__",
           [kNames](const py::object& self) {
             py::list parts;
             for (const char* field : kNames) parts.append(py::str("{}={!r}").format(field, self.attr(field)));
             return py::str("{}({})").format(class_name(self), py::str(", ").attr("join")(parts));
           })
      .def("__eq__",
           [kNames](const py::object& self, const py::object& other) -> py::object {
             if (!py::isinstance<Config>(other)) return py::reinterpret_borrow<py::object>(Py_NotImplemented);
             return py::bool_(state_of(self, kNames).equal(state_of(other, kNames)));
           })
      .def(py::pickle([kNames](const py::object& self) { return state_of(self, kNames); },
                      [](const py::dict& state) { return from_keywords<Config>(py::kwargs(state)); }));
  cls.attr("__hash__") = py::none();  // it can change
  py::dict types;                     // for the stubs
  std::apply(
      [&](const auto&... fields) {
        ((types[fields.name] = StubType<std::remove_cvref_t<decltype(std::declval<Config>().*(fields.member))>>::of()), ...);
      },
      Config::fields());
  cls.attr("_field_types") = types;
  cls.attr("__match_args__") = py::tuple(py::cast(std::vector<std::string>(kNames.begin(), kNames.end())));
  return cls;
}

}  // namespace

void register_config(py::module_& module) {
  register_fields<LidarConfig>(module, "LidarConfig", "A scanning LiDAR: a grid of channels x beams, or a beam pattern.")
      .def_property_readonly("shape", [](const LidarConfig& c) { return py::make_tuple(c.rows(), c.columns()); });
  register_fields<CameraConfig>(module, "CameraConfig", "A pinhole camera.")
      .def_property_readonly("fx", [](const CameraConfig& camera) { return camera.fx(); })
      .def_property_readonly("fy", [](const CameraConfig& camera) { return camera.fy(); })
      .def_property_readonly("cx", [](const CameraConfig& c) { return 0.5 * c.width_px; })
      .def_property_readonly("cy", [](const CameraConfig& c) { return 0.5 * c.height_px; });
  register_fields<PoseSensorConfig>(module, "PoseSensorConfig", "The exact pose, with optional Gaussian noise.");
  register_fields<ImuConfig>(module, "ImuConfig", "An inertial measurement unit, for drones that fly by their rotors.");
  register_fields<EpisodeConfig>(module, "EpisodeConfig", "When episodes begin and end; the same for every task.");
  register_fields<ClockConfig>(module, "ClockConfig", "How time passes: the rates of policy, controller and physics.");
  register_fields<WindConfig>(module, "WindConfig", "The wind that drones fly in by their rotors.");
  register_fields<DynamicsConfig>(module, "DynamicsConfig", "How drones move, and what they are told.");
  register_fields<NavigationReward>(module, "NavigationReward", "The terms of the navigation reward and their weights.");
  register_fields<NavigationConfig>(module, "NavigationConfig", "Fly from the start over the waypoints to the goal.")
      .def_static(
          "observing",
          [](const std::string& observation) {
            return NavigationConfig::observing(enum_of<ObservationKind>(observation, "observation"));
          },
          py::arg("observation"));
  register_fields<HoverConfig>(module, "HoverConfig", "Catch a drone that is thrown, and hold a point.");
  register_fields<TrackConfig>(module, "TrackConfig", "Follow a point that moves along a smooth path.");
}

}  // namespace flockstep::bindings
