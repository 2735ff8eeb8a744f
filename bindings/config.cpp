#include "flockstep/config.hpp"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <algorithm>
#include <iterator>

#include "names.hpp"

namespace flockstep::bindings {
namespace {

namespace py = pybind11;

constexpr const char* kActions[] = {"discrete", "displacement", "displacement_yaw", "discrete_forward"};
constexpr const char* kObservations[] = {"goal", "blob", "pixels"};
constexpr const char* kDepthKinds[] = {"planar", "range"};
constexpr const char* kLayouts[] = {"hwc", "chw"};

// The member of an enumeration whose name is given, for enumerators 0, 1, ...
template <class Enum, std::size_t kCount>
Enum named(const char* const (&names)[kCount], const std::string& text, const std::string& field) {
  std::string expected;
  for (std::size_t i = 0; i < kCount; ++i) {
    if (text == names[i]) return static_cast<Enum>(i);
    expected += (i == 0 ? "\"" : i + 1 == kCount ? " or \"" : ", \"") + std::string(names[i]) + '"';
  }
  throw py::value_error(field + ": expected " + expected + ", got \"" + text + '"');
}

struct Output {
  const char* name;
  bool CameraOutputs::* member;
};
constexpr Output kOutputs[] = {{"rgb", &CameraOutputs::rgb},           {"depth", &CameraOutputs::depth},
                               {"semantic", &CameraOutputs::semantic}, {"instance", &CameraOutputs::instance},
                               {"normal", &CameraOutputs::normal},     {"grey", &CameraOutputs::grey}};

CameraOutputs outputs_of(const py::object& names) {
  CameraOutputs outputs{.rgb = false};
  if (py::isinstance<py::str>(names)) throw py::type_error("outputs: expected a sequence of names, got a string");
  for (const py::handle name : names) {
    const auto text = py::str(name).cast<std::string>();
    const auto* const output =
        std::find_if(std::begin(kOutputs), std::end(kOutputs), [&](const Output& o) { return text == o.name; });
    if (output == std::end(kOutputs)) {
      throw py::value_error("outputs: expected names among rgb, depth, semantic, instance, normal, grey, got \"" + text + '"');
    }
    outputs.*(output->member) = true;
  }
  return outputs;
}

py::tuple names_of(const CameraOutputs& outputs) {
  py::list names;
  for (const Output& output : kOutputs) {
    if (outputs.*(output.member)) names.append(output.name);
  }
  return py::tuple(names);
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

constexpr const char* kCaptureModes[] = {"every_step", "on_movement", "on_demand"};
constexpr const char* kBackends[] = {"raycast", "gl", "auto"};

}  // namespace

CaptureMode capture_mode(const std::string& text) { return named<CaptureMode>(kCaptureModes, text, "capture_mode"); }
CameraBackend camera_backend(const std::string& text) { return named<CameraBackend>(kBackends, text, "camera_backend"); }

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

  py::class_<CameraConfig> camera(module, "CameraConfig", "A pinhole camera.");
  camera.def_readwrite("name", &CameraConfig::name)
      .def_readwrite("width_px", &CameraConfig::width_px)
      .def_readwrite("height_px", &CameraConfig::height_px)
      .def_readwrite("hfov_deg", &CameraConfig::hfov_deg)
      .def_readwrite("vfov_deg", &CameraConfig::vfov_deg)
      .def_readwrite("offset_m", &CameraConfig::offset_m)
      .def_readwrite("quat_wxyz", &CameraConfig::quat_wxyz)
      .def_readwrite("near_m", &CameraConfig::near_m)
      .def_readwrite("far_m", &CameraConfig::far_m)
      .def_property(
          "outputs", [](const CameraConfig& c) { return names_of(c.outputs); },
          [](CameraConfig& c, const py::object& names) { c.outputs = outputs_of(names); })
      .def_property(
          "depth_kind", [](const CameraConfig& c) { return kDepthKinds[static_cast<int>(c.depth_kind)]; },
          [](CameraConfig& c, const std::string& text) { c.depth_kind = named<DepthKind>(kDepthKinds, text, "depth_kind"); })
      .def_property(
          "layout", [](const CameraConfig& c) { return kLayouts[static_cast<int>(c.layout)]; },
          [](CameraConfig& c, const std::string& text) { c.layout = named<ImageLayout>(kLayouts, text, "layout"); })
      .def_property(
          "capture_mode", [](const CameraConfig& c) { return kCaptureModes[static_cast<int>(c.capture_mode)]; },
          [](CameraConfig& c, const std::string& text) { c.capture_mode = capture_mode(text); })
      .def_readwrite("samples_per_pixel", &CameraConfig::samples_per_pixel)
      .def_readwrite("shadows", &CameraConfig::shadows)
      .def_property_readonly("fx", &CameraConfig::fx)
      .def_property_readonly("fy", &CameraConfig::fy)
      .def_property_readonly("cx", [](const CameraConfig& c) { return 0.5 * c.width_px; })
      .def_property_readonly("cy", [](const CameraConfig& c) { return 0.5 * c.height_px; });
  add_common(camera, {"name", "width_px", "height_px", "hfov_deg", "vfov_deg", "offset_m", "quat_wxyz", "near_m", "far_m",
                      "outputs", "depth_kind", "layout", "capture_mode", "samples_per_pixel", "shadows"});

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
      .def_readwrite("overshoot_weight", &NavigationReward::overshoot_weight)
      .def_readwrite("goal_reward", &NavigationReward::goal_reward)
      .def_readwrite("waypoint_share", &NavigationReward::waypoint_share)
      .def_readwrite("goal_radius_m", &NavigationReward::goal_radius_m)
      .def_readwrite("min_clearance", &NavigationReward::min_clearance)
      .def_readwrite("step_scale", &NavigationReward::step_scale)
      .def_readwrite("carry_over_distance", &NavigationReward::carry_over_distance);
  add_common(reward,
             {"distance_weight", "crash_weight", "free_space_weight", "step_weight", "action_change_weight", "overshoot_weight",
              "goal_reward", "waypoint_share", "goal_radius_m", "min_clearance", "step_scale", "carry_over_distance"});

  py::class_<NavigationConfig> navigation(module, "NavigationConfig", "Fly from the start over the waypoints to the goal.");
  navigation
      .def_property(
          "action", [](const NavigationConfig& c) { return kActions[static_cast<int>(c.action)]; },
          [](NavigationConfig& c, const std::string& text) { c.action = named<ActionKind>(kActions, text, "action"); })
      .def_property(
          "observation", [](const NavigationConfig& c) { return kObservations[static_cast<int>(c.observation)]; },
          [](NavigationConfig& c, const std::string& text) {
            c.observation = named<ObservationKind>(kObservations, text, "observation");
          })
      .def_readwrite("step_m", &NavigationConfig::step_m)
      .def_readwrite("yaw_step_deg", &NavigationConfig::yaw_step_deg)
      .def_readwrite("max_episode_steps", &NavigationConfig::max_episode_steps)
      .def_readwrite("frame_skip", &NavigationConfig::frame_skip)
      .def_readwrite("reward", &NavigationConfig::reward)
      .def_readwrite("random_start", &NavigationConfig::random_start)
      .def_readwrite("random_world", &NavigationConfig::random_world)
      .def_readwrite("stagger_first_episode", &NavigationConfig::stagger_first_episode);
  add_common(navigation, {"action", "observation", "step_m", "yaw_step_deg", "max_episode_steps", "frame_skip", "reward",
                          "random_start", "random_world", "stagger_first_episode"});
}

}  // namespace flockstep::bindings
