#include "camera.hpp"

#include <pybind11/stl.h>

#include <string_view>

#include "array_views.hpp"
#include "arrays.hpp"
#include "flockstep/batch.hpp"
#include "memory.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// One camera of a batch. Keeps the batch alive, because its images are views.
struct CameraView {
  py::object owner;
  std::size_t index;

  Batch& batch() const { return owner.cast<Batch&>(); }
  const CameraConfig& config() const { return batch().camera_config(index); }
};

Viewed<CameraImages> images_of(const py::object& self, const char* name) {
  const auto& camera = self.cast<const CameraView&>();
  const CameraConfig& config = camera.config();
  for_each_field(config.outputs, [&](const auto& output, bool is_written) {
    if (is_written || std::string_view(output.name) != name) return;
    throw py::value_error("camera \"" + config.name + "\": expected \"" + name + "\" among its outputs, got " +
                          std::string(py::repr(py::cast(config).attr("outputs"))));
  });
  return {camera.batch().images(camera.index), memory_of(camera.owner), items_of(config)};
}

}  // namespace

py::object camera_view(const py::object& batch, const std::optional<std::string>& name) {
  return py::cast(CameraView{batch, batch.cast<const Batch&>().camera_index(name.value_or(""))});
}

void register_camera(py::module_& module) {
  py::class_<CameraView> cls(module, "Camera", "One camera of every drone of a batch.");
  add_arrays<CameraImages, &images_of>(cls);
  cls.def_property_readonly("config", [](const CameraView& camera) { return camera.config(); })
      .def(
          "config_of",
          [](const CameraView& camera, std::int64_t index) {
            const Batch& batch = camera.batch();
            return in_turn(batch, [&] { return batch.camera_config(camera.index, index); });
          },
          py::arg("index"))
      .def(
          "jpeg",
          [](const CameraView& camera, std::int64_t index, int quality) {
            std::string file;
            released(camera.batch(), [&] { file = camera.batch().jpeg(camera.index, index, quality); });
            return py::bytes(file);
          },
          py::arg("index"), py::arg("quality") = 90)
      .def(
          "save_frames",
          [](const py::object& camera, const py::object& folder, const py::object& indices, const py::object& outputs) {
            return py::module_::import("flockstep.pictures.frames").attr("save_frames")(camera, folder, indices, outputs);
          },
          py::arg("folder"), py::arg("indices") = py::none(), py::arg("outputs") = py::none());
}

}  // namespace flockstep::bindings
