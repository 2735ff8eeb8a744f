// Batch.lidar and Batch.camera: the sensors of all drones.

#include <pybind11/stl.h>

#include <algorithm>
#include <optional>
#include <string>
#include <string_view>
#include <vector>

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

Viewed<LidarReadings> readings_of(const py::object& self, const char* name) {
  const auto& lidar = self.cast<const LidarView&>();
  if (name == std::string_view("ranges")) lidar.facet().require_scan();
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
  for_each_field(config.outputs, [&](const auto& output, bool is_written) {
    if (is_written || std::string_view(output.name) != name) return;
    throw py::value_error("camera \"" + config.name + "\": expected \"" + name + "\" among its outputs, got " +
                          std::string(py::repr(py::cast(config).attr("outputs"))));
  });
  return {camera.facet().images(), memory_of(camera.owner), items_of(config)};
}

std::size_t camera_of(const Batch& batch, const std::optional<std::string>& name) {
  return batch.camera(name.value_or("")).index();
}

}  // namespace

void add_lidars(py::module_& module, BatchClass& batch_cls) {
  py::class_<LidarView> cls(module, "Lidar", "One LiDAR of every drone of a batch.");
  add_arrays<LidarReadings, &readings_of>(cls);
  cls.def_property_readonly("config", [](const LidarView& lidar) { return lidar.config(); })
      .def(
          "config_of",
          [](const LidarView& lidar, std::int64_t index) {
            return in_turn(lidar.batch(), [&] { return lidar.facet().config(drone_at(lidar.batch(), index)); });
          },
          py::arg("index"))
      .def_property_readonly("directions",
                             [](const LidarView& lidar) {
                               const auto all =
                                   static_cast<void (Batch::Lidar::*)(std::span<float>) const>(&Batch::Lidar::directions);
                               return per_ray(lidar, all);
                             })
      .def_property_readonly("points", [](const LidarView& lidar) {
        lidar.facet().require_scan();
        return per_ray(lidar, &Batch::Lidar::points);
      });
  batch_cls.def_property_readonly("lidars", [](const Batch& batch) { return batch.config().lidars; })
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
            const std::size_t index = batch.lidar(lidar.value_or("")).index();
            const auto m = flags(mask, "mask", num_drones(batch));
            const auto change = change_of<LidarChange>(fields, "set_lidar");
            released(batch, [&] { batch.lidar(index).set(change, m); });
          },
          py::arg("mask") = py::none(), py::arg("lidar") = py::none());
}

void add_cameras(py::module_& module, BatchClass& batch_cls) {
  py::class_<CameraView> cls(module, "Camera", "One camera of every drone of a batch.");
  add_arrays<CameraImages, &images_of>(cls);
  cls.def_property_readonly("config", [](const CameraView& camera) { return camera.config(); })
      .def(
          "config_of",
          [](const CameraView& camera, std::int64_t index) {
            return in_turn(camera.batch(), [&] { return camera.facet().config(drone_at(camera.batch(), index)); });
          },
          py::arg("index"))
      .def(
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
  batch_cls.def_property_readonly("cameras", [](const Batch& batch) { return batch.config().cameras; })
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
            const std::size_t index = camera_of(batch, camera);
            const auto m = flags(mask, "mask", num_drones(batch));
            const auto change = change_of<CameraChange>(fields, "set_camera");
            released(batch, [&] { batch.camera(index).set(change, m); });
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
