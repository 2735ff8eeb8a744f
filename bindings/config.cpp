#include "swiftlet/config.hpp"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

namespace swiftlet::bindings {
namespace {

namespace py = pybind11;

struct Name {
  const char* text;
  ActionKind kind;
};
constexpr Name kActions[] = {{"discrete", ActionKind::discrete},
                             {"displacement", ActionKind::displacement},
                             {"displacement_yaw", ActionKind::displacement_yaw}};

ActionKind action_kind(const std::string& text) {
  for (const Name& name : kActions) {
    if (text == name.text) return name.kind;
  }
  throw py::value_error("action: expected \"discrete\", \"displacement\" or \"displacement_yaw\", got \"" + text + "\"");
}

// A keyword-only constructor: every field by its name, unset ones keep their default.
template <class Config>
Config from_keywords(const py::kwargs& kwargs) {
  py::object config = py::cast(Config());
  for (const auto& [key, value] : kwargs) {
    if (!py::hasattr(config, key)) {
      throw py::type_error(std::string(py::str(py::type::of(config).attr("__name__"))) + ": unknown field " +
                           std::string(py::repr(key)));
    }
    py::setattr(config, key, py::reinterpret_borrow<py::object>(value));
  }
  const auto made = config.cast<Config>();
  made.validate();
  return made;
}

// What every config has: keywords in, repr, equality by value, pickling (Gymnasium copies the keywords of an env).
template <class Config>
void add_common(py::class_<Config>& cls, std::vector<const char*> fields) {
  const auto to_dict = [fields](const py::object& self) {
    py::dict state;
    for (const char* field : fields) state[field] = self.attr(field);
    return state;
  };
  cls.def(py::init(&from_keywords<Config>))
      .def("__repr__",
           [fields](const py::object& self) {
             py::list parts;
             for (const char* field : fields) parts.append(py::str("{}={!r}").format(field, self.attr(field)));
             return py::str("{}({})").format(py::type::of(self).attr("__name__"), py::str(", ").attr("join")(parts));
           })
      .def("__eq__",
           [to_dict](const py::object& self, const py::object& other) -> py::object {
             if (!py::isinstance<Config>(other)) return py::reinterpret_borrow<py::object>(Py_NotImplemented);
             return py::bool_(to_dict(self).equal(to_dict(other)));
           })
      .def(py::pickle(to_dict, [](const py::dict& state) { return from_keywords<Config>(py::kwargs(state)); }));
  cls.attr("__hash__") = py::none();  // it can change
}

}  // namespace

void register_config(py::module_& module) {
  py::class_<LidarConfig> lidar(module, "LidarConfig", "A scanning LiDAR: a grid of channels x beams, or a beam pattern.");
  lidar.def_readwrite("channels", &LidarConfig::channels)
      .def_readwrite("beams", &LidarConfig::beams)
      .def_readwrite("hfov_deg", &LidarConfig::hfov_deg)
      .def_readwrite("vfov_deg", &LidarConfig::vfov_deg)
      .def_readwrite("max_range_m", &LidarConfig::max_range_m)
      .def_readwrite("offset_m", &LidarConfig::offset_m)
      .def_readwrite("quat_wxyz", &LidarConfig::quat_wxyz)
      .def_readwrite("azimuth_deg", &LidarConfig::azimuth_deg)
      .def_readwrite("elevation_deg", &LidarConfig::elevation_deg)
      .def_property_readonly("shape", [](const LidarConfig& c) { return py::make_tuple(c.rows(), c.columns()); });
  add_common(lidar, {"channels", "beams", "hfov_deg", "vfov_deg", "max_range_m", "offset_m", "quat_wxyz", "azimuth_deg",
                     "elevation_deg"});

  py::class_<PoseSensorConfig> pose_sensor(module, "PoseSensorConfig", "Exact pose, with optional Gaussian noise.");
  pose_sensor.def_readwrite("position_noise_std_m", &PoseSensorConfig::position_noise_std_m)
      .def_readwrite("tilt_noise_std_deg", &PoseSensorConfig::tilt_noise_std_deg);
  add_common(pose_sensor, {"position_noise_std_m", "tilt_noise_std_deg"});

  py::class_<NavigationReward> reward(module, "NavigationReward", "The terms of the navigation reward and their weights.");
  reward.def_readwrite("distance_weight", &NavigationReward::distance_weight)
      .def_readwrite("crash_weight", &NavigationReward::crash_weight)
      .def_readwrite("free_space_weight", &NavigationReward::free_space_weight)
      .def_readwrite("step_weight", &NavigationReward::step_weight)
      .def_readwrite("action_change_weight", &NavigationReward::action_change_weight)
      .def_readwrite("outrun_weight", &NavigationReward::outrun_weight)
      .def_readwrite("goal_reward", &NavigationReward::goal_reward)
      .def_readwrite("waypoint_share", &NavigationReward::waypoint_share)
      .def_readwrite("goal_radius_m", &NavigationReward::goal_radius_m)
      .def_readwrite("min_clearance", &NavigationReward::min_clearance)
      .def_readwrite("step_scale", &NavigationReward::step_scale)
      .def_readwrite("thesis_switch", &NavigationReward::thesis_switch);
  add_common(reward,
             {"distance_weight", "crash_weight", "free_space_weight", "step_weight", "action_change_weight", "outrun_weight",
              "goal_reward", "waypoint_share", "goal_radius_m", "min_clearance", "step_scale", "thesis_switch"});

  py::class_<NavigationConfig> navigation(module, "NavigationConfig",
                                          "Fly from the start over the waypoints to the goal by LiDAR.");
  navigation
      .def_property(
          "action", [](const NavigationConfig& c) { return kActions[static_cast<int>(c.action)].text; },
          [](NavigationConfig& c, const std::string& text) { c.action = action_kind(text); })
      .def_readwrite("step_m", &NavigationConfig::step_m)
      .def_readwrite("yaw_step_deg", &NavigationConfig::yaw_step_deg)
      .def_readwrite("max_episode_steps", &NavigationConfig::max_episode_steps)
      .def_readwrite("reward", &NavigationConfig::reward)
      .def_readwrite("random_start", &NavigationConfig::random_start)
      .def_readwrite("random_world", &NavigationConfig::random_world)
      .def_readwrite("stagger_first_episode", &NavigationConfig::stagger_first_episode);
  add_common(navigation, {"action", "step_m", "yaw_step_deg", "max_episode_steps", "reward", "random_start", "random_world",
                          "stagger_first_episode"});
}

}  // namespace swiftlet::bindings
