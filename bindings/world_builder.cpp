#include "flockstep/world_builder.hpp"

#include "arrays.hpp"
#include "base/json_document.hpp"
#include "convert.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

Vec3 point(const py::object& value, const char* field) {
  const std::span<const float> v = floats(value, field, {3});
  if (v.empty()) throw py::value_error(std::string(field) + ": expected 3 numbers, got None");
  return {v[0], v[1], v[2]};
}

Eigen::Vector2f pair(const py::object& value, const char* field) {
  const std::span<const float> v = floats(value, field, {2});
  if (v.empty()) throw py::value_error(std::string(field) + ": expected 2 numbers, got None");
  return {v[0], v[1]};
}

Quat rotation(const py::object& value) {
  if (value.is_none()) return Quat::Identity();
  const std::span<const float> q = floats(value, "quat_wxyz", {4});
  return {q[0], q[1], q[2], q[3]};
}

Texture texture(const std::string& name, const py::object& pixels, const std::array<std::string, 2>& wrap) {
  refuse_masked(pixels, "pixels");
  const py::array image = py::array::ensure(pixels);
  const bool is_image = image && image.ndim() == 3 && (image.shape(2) == 3 || image.shape(2) == 4) &&
                        image.dtype().is(py::dtype::of<std::uint8_t>());
  if (!is_image)
    throw py::value_error("pixels: expected an array (height, width, 3 or 4) of uint8, got " +
                          std::string(py::repr(py::type::of(pixels))));
  const py::array_t<std::uint8_t, py::array::c_style | py::array::forcecast> bytes(image);
  Texture made{.name = name, .width_px = static_cast<int>(image.shape(1)), .height_px = static_cast<int>(image.shape(0))};
  const auto channels = static_cast<std::size_t>(image.shape(2));
  const std::size_t count = static_cast<std::size_t>(image.shape(0)) * static_cast<std::size_t>(image.shape(1));
  made.rgba.reserve(4 * count);
  for (std::size_t i = 0; i < count; ++i) {
    const std::uint8_t* const pixel = bytes.data() + channels * i;
    made.rgba.insert(made.rgba.end(), {pixel[0], pixel[1], pixel[2], channels == 4 ? pixel[3] : std::uint8_t{255}});
  }
  made.wrap = {enum_of<TextureWrap>(wrap[0], "wrap"), enum_of<TextureWrap>(wrap[1], "wrap")};
  return made;
}

MeshPart part_of(const py::object& vertices, const py::object& triangles, const py::object& uv, const py::object& colors) {
  const Input<float> places = floats(vertices, "vertices", {-1, 3});
  const Input<std::int32_t> corners = integers<std::int32_t>(triangles, "triangles", {-1, 3});
  const Input<float> coordinates = floats(uv, "uv", {-1, 2});
  const Input<float> shown = floats(colors, "colors", {-1, 3});
  MeshPart part;
  const std::span<const float> v = places, t = coordinates, c = shown;
  const std::span<const std::int32_t> i = corners;
  for (std::size_t k = 0; k + 2 < v.size(); k += 3) part.vertices.emplace_back(v[k], v[k + 1], v[k + 2]);
  for (std::size_t k = 0; k + 2 < i.size(); k += 3) part.triangles.push_back({i[k], i[k + 1], i[k + 2]});
  for (std::size_t k = 0; k + 1 < t.size(); k += 2) part.uv.push_back({t[k], t[k + 1]});
  for (std::size_t k = 0; k + 2 < c.size(); k += 3) part.colors.push_back({c[k], c[k + 1], c[k + 2]});
  return part;
}

Heightfield field_of(const py::object& heights, const py::object& corner, float cell_m, float texture_m) {
  const Input<float> rows = floats(heights, "heights", {-1, -1});
  const std::span<const float> values = rows;
  Heightfield field{.corner = pair(corner, "corner"), .cell_m = cell_m, .heights = {}, .texture_m = texture_m};
  if (!rows.given()) throw py::value_error("heights: expected an array (rows, columns), got None");
  field.rows = static_cast<int>(rows.rows());
  field.columns = field.rows == 0 ? 0 : static_cast<int>(values.size() / rows.rows());
  field.heights.assign(values.begin(), values.end());
  return field;
}

Visibility visibility(bool visible, bool solid) {
  if (!visible && !solid) throw py::value_error("visible, solid: expected one of them to be True, got neither");
  return visible && solid ? Visibility::full : (visible ? Visibility::visual : Visibility::solid);
}

}  // namespace

void register_world_builder(py::module_& module) {
  const py::object none = py::none();
  const auto wall = py::arg("material");
  const auto turned = py::arg("quat_wxyz") = none;
  const py::kw_only keywords;
  const auto seen = py::arg("visible").noconvert() = true;
  const auto hit = py::arg("solid").noconvert() = true;
  py::class_<WorldBuilder> cls(module, "WorldBuilder");
  using Round = void (WorldBuilder::*)(const Vec3&, float, float, std::uint16_t, const Quat&, Visibility);
  const auto add_round = [&](const char* name, Round add) {
    cls.def(
        name,
        [add](WorldBuilder& b, const py::object& center, float radius, float height, std::uint16_t material, const py::object& q,
              bool visible, bool solid) {
          (b.*add)(point(center, "center"), radius, height, material, rotation(q), visibility(visible, solid));
        },
        py::arg("center"), py::arg("radius"), py::arg("height"), wall, turned, keywords, seen, hit);
  };
  add_round("cylinder", &WorldBuilder::cylinder);
  add_round("capsule", &WorldBuilder::capsule);
  const auto add_marker = [&](const char* name, void (WorldBuilder::*add)(const Vec3&)) {
    cls.def(name, [add](WorldBuilder& b, const py::object& place) { (b.*add)(point(place, "place")); }, py::arg("place"));
  };
  add_marker("start", &WorldBuilder::start);
  add_marker("waypoint", &WorldBuilder::waypoint);
  add_marker("goal", &WorldBuilder::goal);
  cls.def(py::init<std::string>(), py::arg("name") = "unnamed")
      .def(
          "texture",
          [](WorldBuilder& b, const std::string& name, const py::object& pixels, const std::array<std::string, 2>& wrap) {
            return b.texture(texture(name, pixels, wrap));
          },
          py::arg("name"), py::arg("pixels"), py::arg("wrap") = std::array<std::string, 2>{"repeat", "repeat"})
      .def(
          "material",
          [](WorldBuilder& b, const std::string& name, const py::object& base_color, std::uint16_t semantic,
             const std::optional<std::uint16_t>& texture, const std::array<float, 3>& emissive, float alpha_cutoff) {
            const Vec3 color = point(base_color, "base_color");
            return b.material({name, {color.x(), color.y(), color.z()}, semantic, texture, emissive, alpha_cutoff});
          },
          py::arg("name"), py::arg("base_color") = py::make_tuple(1.0, 1.0, 1.0), py::kw_only(), py::arg("semantic") = 0,
          py::arg("texture") = none, py::arg("emissive") = Material().emissive, py::arg("alpha_cutoff") = Material().alpha_cutoff)
      .def(
          "room",
          [](WorldBuilder& b, const py::object& min, const py::object& max, std::uint16_t material) {
            b.room(point(min, "min"), point(max, "max"), material);
          },
          py::arg("min"), py::arg("max"), wall)
      .def(
          "box",
          [](WorldBuilder& b, const py::object& center, const py::object& size, std::uint16_t material, const py::object& q,
             bool visible, bool solid) {
            b.box(point(center, "center"), point(size, "size"), material, rotation(q), visibility(visible, solid));
          },
          py::arg("center"), py::arg("size"), wall, turned, keywords, seen, hit)
      .def(
          "sphere",
          [](WorldBuilder& b, const py::object& center, float radius, std::uint16_t material, bool visible, bool solid) {
            b.sphere(point(center, "center"), radius, material, visibility(visible, solid));
          },
          py::arg("center"), py::arg("radius"), wall, keywords, seen, hit)
      .def(
          "plane",
          [](WorldBuilder& b, const py::object& center, const py::object& size, std::uint16_t material, const py::object& q,
             bool visible, bool solid) {
            b.plane(point(center, "center"), pair(size, "size"), material, rotation(q), visibility(visible, solid));
          },
          py::arg("center"), py::arg("size"), wall, turned, keywords, seen, hit)
      .def(
          "disc",
          [](WorldBuilder& b, const py::object& center, float radius, std::uint16_t material, const py::object& q, bool visible,
             bool solid) { b.disc(point(center, "center"), radius, material, rotation(q), visibility(visible, solid)); },
          py::arg("center"), py::arg("radius"), wall, turned, keywords, seen, hit)
      .def(
          "gate",
          [](WorldBuilder& b, const py::object& center, std::uint16_t material, const py::object& q, const std::string& shape,
             float size_m, float bar_m, bool visible, bool solid) {
            b.gate({enum_of<GateShape>(shape, "shape"), point(center, "center"), rotation(q), size_m, bar_m, material,
                    visibility(visible, solid)});
          },
          py::arg("center"), wall, turned, keywords, py::arg("shape") = "square", py::arg("size_m") = Gate().size,
          py::arg("bar_m") = json::shortest(Gate().bar), seen, hit)
      .def(
          "body",
          [](WorldBuilder& b, const py::object& body) { b.body(argument<BodyConfig>(body, "body", "a flockstep.BodyConfig")); },
          py::arg("body"))
      .def(
          "mesh",
          [](WorldBuilder& b, const py::object& vertices, const py::object& triangles, std::uint16_t material,
             const py::object& uv, const py::object& colors, bool visible,
             bool solid) { b.mesh(part_of(vertices, triangles, uv, colors), material, visibility(visible, solid)); },
          py::arg("vertices"), py::arg("triangles"), wall, py::arg("uv") = none, py::arg("colors") = none, keywords, seen, hit)
      .def(
          "heightfield",
          [](WorldBuilder& b, const py::object& heights, std::uint16_t material, const py::object& corner, float cell_m,
             float texture_m, bool visible,
             bool solid) { b.heightfield(field_of(heights, corner, cell_m, texture_m), material, visibility(visible, solid)); },
          py::arg("heights"), wall, py::kw_only(), py::arg("corner") = py::make_tuple(0.0, 0.0), py::arg("cell_m") = 1.0F,
          py::arg("texture_m") = Heightfield().texture_m, seen, hit)
      .def("light", [](WorldBuilder& b, const py::kwargs& fields) { b.light(py::type::of<Light>()(**fields).cast<Light>()); })
      .def(
          "spawn_box",
          [](WorldBuilder& b, const py::object& min, const py::object& max) {
            b.spawn_box({point(min, "min"), point(max, "max")});
          },
          py::arg("min"), py::arg("max"))
      .def("build", [](const WorldBuilder& b) {
        const WorldBuilder copy = b;  // another thread may modify it after the interpreter lock is released
        return std::const_pointer_cast<World>(released([&] { return copy.build(); }));
      });
}

}  // namespace flockstep::bindings
