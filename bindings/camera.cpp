#include "camera.hpp"

#include <pybind11/stl.h>

#include "arrays.hpp"
#include "flockstep/batch.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// One camera of a batch, which it keeps alive: its images are views.
struct CameraView {
  py::object owner;
  std::size_t index;

  Batch& batch() const { return owner.cast<Batch&>(); }
  const CameraConfig& config() const { return batch().camera_config(index); }
};

template <class T, class Stored>
py::array_t<T> image(const CameraView& camera, const std::vector<Stored>& values, py::ssize_t channels, const char* output) {
  const CameraConfig& config = camera.config();
  if (values.empty()) {
    throw py::value_error("camera \"" + config.name + "\": expected \"" + output + "\" among its outputs, got " +
                          std::string(py::repr(py::cast(config).attr("outputs"))));
  }
  Shape shape{camera.batch().config().num_drones()};
  if (channels > 1 && config.layout == ImageLayout::chw) shape.push_back(channels);
  shape.push_back(config.image_height_px());
  shape.push_back(config.image_width_px());
  if (channels > 1 && config.layout == ImageLayout::hwc) shape.push_back(channels);
  return view<T>(camera.owner, values.data(), shape);
}

template <class T, class Member>
auto image_view(Member member, py::ssize_t channels, const char* output) {
  return
      [=](const CameraView& camera) { return image<T>(camera, camera.batch().images(camera.index).*member, channels, output); };
}

}  // namespace

py::object camera_view(const py::object& batch, const std::optional<std::string>& name) {
  return py::cast(CameraView{batch, batch.cast<const Batch&>().camera_index(name.value_or(""))});
}

void register_camera(py::module_& module) {
  py::class_<CameraView>(module, "Camera", "One camera of every drone of a batch.")
      .def_property_readonly("config", [](const CameraView& camera) { return camera.config(); })
      .def(
          "config_of",
          [](const CameraView& camera, std::int64_t index) { return camera.batch().camera_config(camera.index, index); },
          py::arg("index"))
      .def_property_readonly("rgb", image_view<std::uint8_t>(&CameraImages::rgb, 3, "rgb"))
      .def_property_readonly("depth", image_view<float>(&CameraImages::depth, 1, "depth"))
      .def_property_readonly("semantic", image_view<std::uint16_t>(&CameraImages::semantic, 1, "semantic"))
      .def_property_readonly("instance", image_view<std::uint16_t>(&CameraImages::instance, 1, "instance"))
      .def_property_readonly("normal", image_view<float>(&CameraImages::normal, 3, "normal"))
      .def_property_readonly("grey", image_view<std::uint8_t>(&CameraImages::grey, 1, "grey"))
      .def_property_readonly("hsv", image_view<std::uint8_t>(&CameraImages::hsv, 3, "hsv"))
      .def_property_readonly("frame_step",
                             [](const CameraView& camera) {
                               const Batch& batch = camera.batch();
                               return view<std::int64_t>(camera.owner, batch.images(camera.index).frame_step.data(),
                                                         {batch.config().num_drones()});
                             })
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
            return py::module_::import("flockstep.viewer.frames").attr("save_frames")(camera, folder, indices, outputs);
          },
          py::arg("folder"), py::arg("indices") = py::none(), py::arg("outputs") = py::none());
}

}  // namespace flockstep::bindings
