#include "tasks/color_blob.hpp"

#include <algorithm>

#include "arrays.hpp"
#include "convert.hpp"
#include "imaging/color_components.hpp"

namespace flockstep::bindings {
namespace {

// Images from the caller, (..., H, W, 3) or (..., 3, H, W).
struct Images {
  py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast> pixels;
  Shape leading;  // dimensions before those of an image
  int width, height;
  ImageLayout layout;

  std::size_t values() const { return 3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }
  std::size_t count() const { return static_cast<std::size_t>(pixels.size()) / values(); }
  std::span<const std::uint8_t> operator[](std::size_t i) const { return {pixels.data() + i * values(), values()}; }
  // Returns the shape of an array with one item of shape `of_image` per image.
  Shape shape(std::initializer_list<py::ssize_t> of_image) const {
    Shape shape = leading;
    shape.insert(shape.end(), of_image);
    return shape;
  }
};

Images images_of(const py::array& images, const std::string& layout, bool one) {
  refuse_masked(images, "image");
  if (layout != "hwc" && layout != "chw") throw py::value_error("layout: expected \"hwc\" or \"chw\", got \"" + layout + '"');
  const bool chw = layout == "chw";
  const Shape shape(images.shape(), images.shape() + images.ndim());
  const std::size_t before = shape.size() < 3 ? 0 : shape.size() - 3;
  const bool fits = shape.size() >= 3 && (before == 0 || !one) && shape[before + (chw ? 0 : 2)] == 3 &&
                    std::all_of(shape.begin() + static_cast<std::ptrdiff_t>(before), shape.end(), [](auto n) { return n > 0; });
  if (!images.dtype().is(py::dtype::of<std::uint8_t>()) || !fits) {
    const std::string expected = std::string(one ? "(" : "(..., ") + (chw ? "3, height, width)" : "height, width, 3)");
    throw py::value_error("image: expected uint8 of shape " + expected + ", got " + std::string(py::str(images.dtype())) +
                          " of shape " + text_of(shape));
  }
  return {.pixels = images,
          .leading = Shape(shape.begin(), shape.begin() + static_cast<std::ptrdiff_t>(before)),
          .width = static_cast<int>(shape[before + (chw ? 2 : 1)]),
          .height = static_cast<int>(shape[before + (chw ? 1 : 0)]),
          .layout = chw ? ImageLayout::chw : ImageLayout::hwc};
}

// Bounding boxes of a colour in some images: for each quantity an array with the leading shape.
struct Blobs {
  py::array_t<bool> found;
  py::array_t<std::int32_t> x, y, width, height;
  py::array_t<float> offset, area;
  py::array_t<bool> mask;
};

Blobs color_blob(const py::array& given, const ColorRange& color, const std::string& layout) {
  color.validate();
  const Images images = images_of(given, layout, false);
  const Shape shape = images.shape({});
  using Ints = py::array_t<std::int32_t>;
  Blobs blobs{py::array_t<bool>(shape),
              Ints(shape),
              Ints(shape),
              Ints(shape),
              Ints(shape),
              py::array_t<float>(shape),
              py::array_t<float>(shape),
              py::array_t<bool>(images.shape({images.height, images.width}))};
  task::ColorBlobScratch scratch;
  bool* mask = blobs.mask.mutable_data();
  for (std::size_t i = 0; i < images.count(); ++i) {
    const task::ColorBlob blob = task::find_color(images[i], images.width, images.height, images.layout, color, scratch);
    blobs.found.mutable_data()[i] = blob.found;
    blobs.x.mutable_data()[i] = blob.x;
    blobs.y.mutable_data()[i] = blob.y;
    blobs.width.mutable_data()[i] = blob.width;
    blobs.height.mutable_data()[i] = blob.height;
    blobs.offset.mutable_data()[i] = blob.offset;
    blobs.area.mutable_data()[i] = blob.area;
    mask = std::transform(scratch.mask.begin(), scratch.mask.end(), mask, [](std::uint8_t value) { return value != 0; });
  }
  return blobs;
}

struct Components {
  py::array_t<std::int32_t> box;
  py::array_t<double> centroid;
  py::array_t<std::int32_t> area_px, labels;
};

Components color_components(const py::array& given, const ColorRange& color, const std::string& layout) {
  color.validate();
  const Images image = images_of(given, layout, true);
  const imaging::ColorComponents found = imaging::find_components(image[0], image.width, image.height, image.layout, color);
  const auto count = static_cast<py::ssize_t>(found.list.size());
  Components components{py::array_t<std::int32_t>({count, py::ssize_t{4}}), py::array_t<double>({count, py::ssize_t{2}}),
                        py::array_t<std::int32_t>(count), py::array_t<std::int32_t>(image.shape({image.height, image.width}))};
  std::int32_t* box = components.box.mutable_data();
  double* centroid = components.centroid.mutable_data();
  std::int32_t* area = components.area_px.mutable_data();
  for (const imaging::ColorComponent& component : found.list) {
    for (const int value : {component.x, component.y, component.width, component.height}) *box++ = value;
    *centroid++ = component.center_x;
    *centroid++ = component.center_y;
    *area++ = component.area;
  }
  std::copy(found.labels.begin(), found.labels.end(), components.labels.mutable_data());
  return components;
}

struct Seen : task::ColorBlob {
  py::array_t<bool> mask;
};

Seen green_blob(const py::array& given, const std::string& layout) {
  const Images image = images_of(given, layout, true);
  task::ColorBlobScratch scratch;
  Seen seen{{task::find_color(image[0], image.width, image.height, image.layout, ColorRange(), scratch)},
            py::array_t<bool>(image.shape({image.height, image.width}))};
  std::transform(scratch.mask.begin(), scratch.mask.end(), seen.mask.mutable_data(),
                 [](std::uint8_t value) { return value != 0; });
  return seen;
}

template <class Blob>
void add_blob(py::module_& module, const char* name, const char* doc) {
  py::class_<Blob>(module, name, doc)
      .def_readonly("found", &Blob::found)
      .def_readonly("x", &Blob::x)
      .def_readonly("y", &Blob::y)
      .def_readonly("width", &Blob::width)
      .def_readonly("height", &Blob::height)
      .def_readonly("offset", &Blob::offset)
      .def_readonly("area", &Blob::area)
      .def_readonly("mask", &Blob::mask);
}

}  // namespace

void register_color_blob(py::module_& module) {
  add_blob<Seen>(module, "GreenBlob", "The green part of an image.");
  module.def("green_blob", &green_blob, py::arg("image"), py::arg("layout") = "hwc");
  add_blob<Blobs>(module, "ColorBlob", "Position and size of a colour in images.");
  py::class_<Components>(module, "ColorComponents", "Connected parts of an image with a colour.")
      .def_readonly("box", &Components::box)
      .def_readonly("centroid", &Components::centroid)
      .def_readonly("area_px", &Components::area_px)
      .def_readonly("labels", &Components::labels);
  const auto add = [&](const char* name, auto find) {
    module.def(
        name,
        [find](const py::array& image, const py::object& color, const std::string& layout) {
          return find(image, argument<ColorRange>(color, "color", "a flockstep.ColorRange"), layout);
        },
        py::arg("image"), py::arg("color"), py::arg("layout") = "hwc");
    // Other calls get here: name an unknown keyword.
    module.def(name, [name](const py::args&, const py::kwargs& keywords) {
      refuse_unknown(name, keywords, {"image", "color", "layout"});
      throw py::reference_cast_error();
    });
  };
  add("color_blob", &color_blob);
  add("color_components", &color_components);
}

}  // namespace flockstep::bindings
