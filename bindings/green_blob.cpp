#include "task/green_blob.hpp"

#include "arrays.hpp"

namespace flockstep::bindings {
namespace {

struct Seen {
  task::GreenBlob blob;
  py::array_t<bool> mask;
};

Seen green_blob(const py::array& image, const std::string& layout) {
  if (layout != "hwc" && layout != "chw") throw py::value_error("layout: expected \"hwc\" or \"chw\", got \"" + layout + '"');
  const bool chw = layout == "chw";
  const Shape shape(image.shape(), image.shape() + image.ndim());
  const bool fits = shape.size() == 3 && shape[chw ? 0 : 2] == 3 && image.size() > 0;
  if (!image.dtype().is(py::dtype::of<std::uint8_t>()) || !fits) {
    throw py::value_error(std::string("image: expected uint8 of shape ") + (chw ? "(3, height, width)" : "(height, width, 3)") +
                          ", got " + std::string(py::str(image.dtype())) + " of shape " + text_of(shape));
  }
  const py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast> pixels(image);
  const py::ssize_t height = shape[chw ? 1 : 0];
  const py::ssize_t width = shape[chw ? 2 : 1];
  task::GreenBlobScratch scratch;
  Seen seen{task::find_green({pixels.data(), static_cast<std::size_t>(pixels.size())}, static_cast<int>(width),
                             static_cast<int>(height), chw ? ImageLayout::chw : ImageLayout::hwc, scratch),
            py::array_t<bool>({height, width})};
  std::transform(scratch.mask.begin(), scratch.mask.end(), seen.mask.mutable_data(),
                 [](std::uint8_t value) { return value != 0; });
  return seen;
}

}  // namespace

void register_green_blob(py::module_& module) {
  py::class_<Seen>(module, "GreenBlob", "What is green in an image.")
      .def_property_readonly("found", [](const Seen& seen) { return seen.blob.found; })
      .def_property_readonly("x", [](const Seen& seen) { return seen.blob.x; })
      .def_property_readonly("y", [](const Seen& seen) { return seen.blob.y; })
      .def_property_readonly("width", [](const Seen& seen) { return seen.blob.width; })
      .def_property_readonly("height", [](const Seen& seen) { return seen.blob.height; })
      .def_property_readonly("offset", [](const Seen& seen) { return seen.blob.offset; })
      .def_property_readonly("area", [](const Seen& seen) { return seen.blob.area; })
      .def_readonly("mask", &Seen::mask);
  module.def("green_blob", &green_blob, py::arg("image"), py::arg("layout") = "hwc");
}

}  // namespace flockstep::bindings
