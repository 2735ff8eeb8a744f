// Batch.lidar and Batch.camera, and the other sensors: those of all drones.

#include <pybind11/stl.h>

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>
#include <type_traits>
#include <vector>

#include "arguments.hpp"
#include "array_views.hpp"
#include "arrays.hpp"
#include "batch.hpp"
#include "convert.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// One LiDAR of a batch. Keeps the batch alive, because its ranges are views.
struct LidarView {
  py::object owner;
  std::size_t index;

  const Batch& batch() const { return owner.cast<const Batch&>(); }
  const Batch::Lidar facet() const { return batch().lidar(index); }
  const LidarConfig& config() const { return batch().config().lidars[index]; }
  Shape shape() const { return {batch().config().num_drones(), config().rows(), config().columns()}; }
};

// Returns true for the name of an output. Throws ValueError if the sensor does not write it.
template <class Config>
bool is_output(const char* kind, const Config& config, std::string_view name) {
  bool found = false;
  for_each_field(config.outputs, [&](const auto& output, bool is_written) {
    if (output.name != name) return;
    found = true;
    if (is_written) return;
    throw py::value_error(std::string(kind) + " \"" + config.name + "\": expected \"" + output.name +
                          "\" among its outputs, got " + std::string(py::repr(py::cast(config).attr("outputs"))));
  });
  return found;
}

Viewed<LidarReadings> readings_of(const py::object& self, const char* name) {
  const auto& lidar = self.cast<const LidarView&>();
  if (is_output("lidar", lidar.config(), name) || name == std::string_view("ranges")) lidar.facet().require_scan();
  return {lidar.facet().readings(), memory_of(lidar.owner), items_of(lidar.config())};
}

py::array_t<float> per_ray(const LidarView& lidar, void (Batch::Lidar::*fill)(std::span<float>) const) {
  return in_turn(lidar.batch(), [&] {  // the shape may change until then
    Shape shape = lidar.shape();
    shape.push_back(3);
    py::array_t<float> array(shape);
    (lidar.facet().*fill)({array.mutable_data(), static_cast<std::size_t>(array.size())});
    return array;
  });
}

// One camera of a batch. Keeps the batch alive, because its images are views.
struct CameraView {
  py::object owner;
  std::size_t index;

  Batch& batch() const { return owner.cast<Batch&>(); }
  Batch::Camera facet() const { return batch().camera(index); }
  const CameraConfig& config() const { return facet().config(); }
};

Viewed<CameraImages> images_of(const py::object& self, const char* name) {
  const auto& camera = self.cast<const CameraView&>();
  const CameraConfig& config = camera.config();
  is_output("camera", config, name);
  return {camera.facet().images(), memory_of(camera.owner), items_of(config)};
}

std::size_t camera_of(const Batch& batch, const std::optional<std::string>& name) {
  return batch.camera(name.value_or("")).index();
}

// The word for such a sensor, which writes its arrays.
template <HasFirstArrays List>
std::string noun_of() {
  return kFields<typename List::value_type::Readings>.template get<0>().info.writer;
}

// The arrays of the first sensor of a list.
template <HasFirstArrays List>
Viewed<typename List::value_type::Readings> first_arrays(const py::object& self, const char*) {
  const auto& batch = self.cast<const Batch&>();
  for_each_field(batch.config(), [&]<class Value>(const auto& field, const Value& list) {
    if constexpr (std::is_same_v<Value, List>) {
      if (!list.empty()) return;
      throw py::attribute_error("this Batch has no " + noun_of<List>() + ": give it one (" + keyword_of(field.name) + "=...)");
    }
  });
  return {batch.readings<typename List::value_type::Readings>(), memory_of(self)};
}

template <class View>
void add_configs(py::class_<View>& cls) {
  cls.def_property_readonly("config", [](const View& sensor) { return sensor.config(); })
      .def(
          "config_of",
          [](const View& sensor, std::int64_t index) {
            return in_turn(sensor.batch(), [&] { return sensor.facet().config(drone_at(sensor.batch(), index)); });
          },
          py::arg("index"));
}

template <class Change, class Facet>
void set_sensor(Batch& batch, Facet sensor, const py::object& mask, const py::kwargs& fields, const char* callee) {
  const auto m = flags(mask, "mask", num_drones(batch));
  const auto change = change_of<Change>(fields, callee);
  released(batch, [&] { sensor.set(change, m); });
}

}  // namespace

void add_sensors(BatchClass& cls) {
  const BatchConfig fields;
  for_each_field(fields, [&]<class Value>(const auto& field, const Value&) {
    if constexpr (SensorList<Value>) {
      const std::string_view about = field.info.about;  // "The IMUs of each drone, with different names."
      const std::string doc = "Configurations of the" + std::string(about.substr(3, about.find_first_of(",.") - 3)) + "; copies.";
      const auto configs = [member = field.member](const Batch& batch) { return batch.config().*member; };
      cls.def_property_readonly(field.name, configs, doc.c_str());
    }
    if constexpr (HasFirstArrays<Value>) add_arrays<typename Value::value_type::Readings, &first_arrays<Value>>(cls);
  });
}

std::string describe_sensors(const BatchConfig& config) {
  std::string text;
  for (const LidarConfig& lidar : config.lidars) {
    text += ", a LiDAR of " + counted(std::int64_t{lidar.rows()} * lidar.columns(), "ray");
  }
  if (!config.cameras.empty()) text += ", " + counted(std::ssize(config.cameras), "camera");
  for_each_field(config, [&]<class Value>(const auto&, const Value& list) {
    if constexpr (HasFirstArrays<Value>) {
      const std::string noun = noun_of<Value>();
      const bool is_vowel = std::string_view("AEIOaeio").find(noun[0]) != std::string_view::npos;
      for (std::size_t i = 0; i < list.size(); ++i) text += (is_vowel ? ", an " : ", a ") + noun;
    }
  });
  return text;
}

void add_lidars(py::module_& module, BatchClass& batch_cls) {
  py::class_<LidarView> cls(module, "Lidar", "One LiDAR of every drone of a batch.");
  add_arrays<LidarReadings, &readings_of>(cls);
  add_configs(cls);
  cls.def_property_readonly("directions",
                            [](const LidarView& lidar) {
                              const auto all =
                                  static_cast<void (Batch::Lidar::*)(std::span<float>) const>(&Batch::Lidar::directions);
                              return per_ray(lidar, all);
                            })
      .def_property_readonly("points", [](const LidarView& lidar) {
        lidar.facet().require_scan();
        return per_ray(lidar, &Batch::Lidar::points);
      });
  batch_cls
      .def_property_readonly("lidar_name",
                             [](const Batch& batch) -> std::optional<std::string> {
                               const auto& lidars = batch.config().lidars;
                               return lidars.empty() ? std::nullopt : std::optional(lidars[0].name);
                             })
      .def(
          "lidar",
          [](const py::object& batch, const std::optional<std::string>& name) {
            return LidarView{batch, batch.cast<const Batch&>().lidar(name.value_or("")).index()};
          },
          py::arg("name") = py::none())
      .def(
          "set_lidar",
          [](Batch& batch, const py::object& mask, const std::optional<std::string>& lidar, const py::kwargs& fields) {
            set_sensor<LidarChange>(batch, batch.lidar(lidar.value_or("")), mask, fields, "set_lidar");
          },
          py::arg("mask") = py::none(), py::arg("lidar") = py::none());
}

void add_cameras(py::module_& module, BatchClass& batch_cls) {
  py::class_<CameraView> cls(module, "Camera", "One camera of every drone of a batch.");
  add_arrays<CameraImages, &images_of>(cls);
  add_configs(cls);
  cls.def(
         "jpeg",
         [](const CameraView& camera, std::int64_t index, int quality) {
           std::string file;
           released(camera.batch(), [&] { file = camera.facet().jpeg(drone_at(camera.batch(), index), quality); });
           return py::bytes(file);
         },
         py::arg("index"), py::arg("quality") = 90)
      .def(
          "save_frames",
          [](const py::object& camera, const py::object& folder, const py::object& indices, const py::object& outputs) {
            return py::module_::import("flockstep.pictures.frames").attr("save_frames")(camera, folder, indices, outputs);
          },
          py::arg("folder"), py::arg("indices") = py::none(), py::arg("outputs") = py::none());
  batch_cls
      .def(
          "camera",
          [](const py::object& batch, const std::optional<std::string>& name) {
            return CameraView{batch, camera_of(batch.cast<const Batch&>(), name)};
          },
          py::arg("name") = py::none())
      .def(
          "capture",
          [](Batch& batch, const py::object& mask, const std::optional<std::string>& camera) {
            const auto m = flags(mask, "mask", num_drones(batch));
            const std::size_t index = camera_of(batch, camera);
            released(batch, [&] { batch.camera(index).capture(m); });
          },
          py::arg("mask") = py::none(), py::arg("camera") = py::none())
      .def(
          "set_capture_mode",
          [](Batch& batch, const std::string& mode, const std::optional<std::string>& camera) {
            const std::size_t index = camera_of(batch, camera);
            const auto chosen = enum_of<CaptureMode>(mode, "capture_mode");
            in_turn(batch, [&] { batch.camera(index).set_capture_mode(chosen); });
          },
          py::arg("mode"), py::arg("camera") = py::none())
      .def(
          "set_camera",
          [](Batch& batch, const py::object& mask, const std::optional<std::string>& camera, const py::kwargs& fields) {
            set_sensor<CameraChange>(batch, batch.camera(camera.value_or("")), mask, fields, "set_camera");
          },
          py::arg("mask") = py::none(), py::arg("camera") = py::none())
      .def(
          "picture",
          [](Batch& batch, std::int64_t index, const std::optional<std::string>& camera) {
            const std::size_t number = camera_of(batch, camera);
            std::vector<std::uint8_t> rgb;
            released(batch, [&] { rgb = batch.camera(number).picture(drone_at(batch, index)); });
            const CameraConfig& config = batch.camera(number).config();
            py::array_t<std::uint8_t> picture({config.image_height_px(), config.image_width_px(), 3});
            std::copy(rgb.begin(), rgb.end(), picture.mutable_data());
            return picture;
          },
          py::arg("index"), py::arg("camera") = py::none())
      .def("camera_backend_report", [](const Batch& batch) { return batch.camera_backend_report(); });
}

}  // namespace flockstep::bindings
