#include "flockstep/world.hpp"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <algorithm>
#include <string>
#include <string_view>
#include <vector>

#include "arguments.hpp"
#include "arrays.hpp"
#include "convert.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/raycast.hpp"
#include "released.hpp"
#include "world/scene_keys.hpp"

namespace flockstep::bindings {
namespace {

// Resolves a scene name in Python, where the paths of packaged files and the names of generated scenes are known.
py::object found(const py::object& source) { return py::module_::import("flockstep.scenes").attr("find")(source); }

UpAxis up_axis(const std::string& name) {
  if (name != "y" && name != "z") throw py::value_error("up: expected \"y\" or \"z\", got \"" + name + '"');
  return name == "y" ? UpAxis::y : UpAxis::z;
}

void warn_of_ignored(const World& world, const std::filesystem::path& path) {
  if (world.ignored().empty()) return;
  std::string warning = path.string() + ": ignored ";
  for (const std::string& what : world.ignored()) warning += (&what == world.ignored().data() ? "" : ", ") + what;
  if (PyErr_WarnEx(PyExc_UserWarning, warning.c_str(), 1) != 0) throw py::error_already_set();
}

py::object row(const std::optional<Vec3>& point) {
  if (!point) return py::none();
  return rows({&*point, 1}).attr("reshape")(3);
}

py::array_t<float> box_rows(const Aabb& box) {
  const std::array<Vec3, 2> corners{box.min, box.max};
  return rows(corners);
}

const char* kind_name(PrimitiveKind kind) { return EnumNames<PrimitiveKind>::kNames[static_cast<std::size_t>(kind)]; }

py::list primitives(const World& world) {
  py::list list;
  for (const Primitive& primitive : world.primitives()) {
    py::dict entry;
    entry["kind"] = kind_name(primitive.kind);
    entry["center"] = row(primitive.center);
    const Quat& q = primitive.rotation;
    entry["quat_wxyz"] = py::make_tuple(q.w(), q.x(), q.y(), q.z());
    entry["half_extents"] = row(primitive.half_extents);
    entry["material"] = world.materials()[primitive.material].name;
    entry["visible"] = is_visible(primitive.visibility);
    entry["solid"] = is_solid(primitive.visibility);
    list.append(entry);
  }
  return list;
}

py::list gates(const World& world) {
  py::list list;
  for (const Gate& gate : world.gates()) {
    py::dict entry;
    entry["shape"] = EnumNames<GateShape>::kNames[static_cast<std::size_t>(gate.shape)];
    entry["center"] = row(gate.center);
    const Quat& q = gate.rotation;
    entry["quat_wxyz"] = py::make_tuple(q.w(), q.x(), q.y(), q.z());
    entry["size_m"] = gate.size;
    entry["bar_m"] = gate.bar;
    entry["material"] = world.materials()[gate.material].name;
    entry["visible"] = is_visible(gate.visibility);
    entry["solid"] = is_solid(gate.visibility);
    list.append(entry);
  }
  return list;
}

py::tuple triple(const std::array<float, 3>& v) { return py::make_tuple(v[0], v[1], v[2]); }
py::object fields_value(float value) { return py::float_(value); }
py::object fields_value(const std::array<float, 3>& value) { return triple(value); }

// Returns the materials. Semantic ids are those that cameras report.
py::list materials(const World& world) {
  py::list list;
  for (std::size_t i = 0; i < world.materials().size(); ++i) {
    const Material& material = world.materials()[i];
    py::dict entry;
    entry["name"] = material.name;
    entry["base_color"] = triple(material.base_color);
    entry["semantic"] = world.semantic(i);
    entry["emissive"] = triple(material.emissive);
    entry["alpha_cutoff"] = material.alpha_cutoff;
    list.append(entry);
  }
  return list;
}

py::dict light(const World& world) {
  py::dict entry;
  for_each_field(world.light(), [&](const auto& field, const auto& value) { entry[field.name] = fields_value(value); });
  return entry;
}

std::shared_ptr<World> with_light(const std::shared_ptr<World>& world, const py::object& tint, const py::kwargs& keywords) {
  const Lighting lighting = lighting_argument(*world, light_changes(keywords, "with_light"), tint);
  return released([&] { return std::make_shared<World>(world, lighting); });
}

// Returns an argument of a call, by its place or its name; null if it is not given. The first is required.
py::object argument_at(std::size_t place, const char* name, const std::string& callee, const py::args& positional,
                       const py::kwargs& keywords) {
  const bool is_named = keywords.contains(name);
  if (place >= positional.size()) {
    if (!is_named && place == 0) {
      throw py::type_error(callee + "() missing 1 required positional argument: '" + name + '\'');
    }
    return is_named ? py::object(keywords[name]) : py::object();
  }
  if (is_named) throw py::type_error(callee + "() got multiple values for argument '" + name + '\'');
  return positional[place];
}

// Returns the configuration whose fields are the arguments of a call, in their order.
template <class Config>
Config config_argument(const std::string& callee, const py::args& positional, const py::kwargs& keywords) {
  Config config;
  std::vector<std::string> known;
  for_each_field(config, [&]<class Value>(const auto& field, Value& value) {
    const py::object given = argument_at(known.size(), field.name, callee, positional, keywords);
    known.emplace_back(field.name);
    if (given) value = from_python<Value>(given, field.name);
  });
  if (positional.size() > known.size()) {
    throw py::type_error(callee + "() takes at most " + std::to_string(known.size()) + " arguments, got " +
                         std::to_string(positional.size()));
  }
  refuse_unknown(callee, keywords, known);
  return config;
}

template <class Config, std::shared_ptr<const World> (*kMake)(const Config&)>
void add_generator(py::class_<World, std::shared_ptr<World>>& cls, const char* name) {
  cls.def_static(name, [name](const py::args& positional, const py::kwargs& keywords) {
    const auto config = config_argument<Config>(name, positional, keywords);
    return std::const_pointer_cast<World>(released([&] { return kMake(config); }));
  });
}

py::dict raycast(const World& world, const py::object& origins, const py::object& directions, float max_range_m) {
  const Input<float> from = floats(origins, "origins", {-1, 3});
  const Input<float> along = floats(directions, "directions", {-1, 3});
  const RayHits hits = released([&] { return flockstep::raycast(world, from, along, max_range_m); });
  py::dict result;
  result["t_hit"] = array_of(hits.t_hit);
  result["normal"] = rows(hits.normal);
  result["u"] = array_of(hits.u);
  result["v"] = array_of(hits.v);
  result["primitive"] = array_of(hits.primitive);
  result["material"] = array_of(hits.material);
  return result;
}

py::dict mesh(const World& world, float chord_error_m) {
  std::vector<std::int32_t> objects;
  TriangleMesh mesh = released([&] { return world.mesh(chord_error_m, &objects); });
  mesh.uv.resize(mesh.vertices.size());
  const auto count = [](const auto& list) { return static_cast<py::ssize_t>(list.size()); };
  py::array_t<std::int32_t> triangles({count(mesh.triangles), py::ssize_t{3}});
  std::int32_t* index = triangles.mutable_data();
  for (const auto& triangle : mesh.triangles) index = std::copy(triangle.begin(), triangle.end(), index);
  py::array_t<float> uv({count(mesh.uv), py::ssize_t{2}});
  float* place = uv.mutable_data();
  for (const auto& pair : mesh.uv) place = std::copy(pair.begin(), pair.end(), place);
  py::dict result;
  result["vertices"] = rows(mesh.vertices);
  result["triangles"] = triangles;
  result["uv"] = uv;
  result["materials"] = array_of(std::vector<std::int32_t>(mesh.materials.begin(), mesh.materials.end()));
  result["objects"] = array_of(objects);
  return result;
}

}  // namespace

py::kwargs light_changes(const py::kwargs& keywords, const char* callee) {
  const auto known = py::type::of<Light>().attr("__match_args__").cast<std::vector<std::string>>();
  refuse_unknown(callee, keywords, known);
  py::kwargs changes;
  for (const auto& [name, value] : keywords) {
    if (!value.is_none()) changes[name] = value;
  }
  return changes;
}

Lighting lighting_argument(const World& world, const py::kwargs& changes, const py::object& tint) {
  Lighting lighting{.light = world.light(), .tint = {}};
  for_each_field(lighting.light, [&]<class Value>(const auto& field, Value& value) {
    if (changes.contains(field.name)) value = from_python<Value>(changes[field.name], field.name);
  });
  if (!tint.is_none()) {
    const Input<float> rows = floats(py::module_::import("numpy").attr("atleast_2d")(tint), "tint", {-1, 3});
    const std::span<const float> values = rows;
    for (std::size_t i = 0; i < values.size(); i += 3) lighting.tint.push_back({values[i], values[i + 1], values[i + 2]});
  }
  return lighting;
}

std::vector<std::shared_ptr<World>> worlds_argument(const py::object& worlds) {
  return py::module_::import("flockstep.scenes").attr("load")(worlds).cast<std::vector<std::shared_ptr<World>>>();
}

std::shared_ptr<World> world_argument(const py::object& world) {
  if (py::isinstance<World>(world)) return world.cast<std::shared_ptr<World>>();
  return py::module_::import("flockstep.scenes").attr("load_one")(world).cast<std::shared_ptr<World>>();
}

void register_world(py::module_& module) {
  module.def("_scene_keys", &scene_keys_as_json);
  py::class_<World, std::shared_ptr<World>> cls(module, "World", "Immutable geometry, materials and named markers.");
  add_generator<PlaygroundConfig, &playground>(cls, "playground");
  add_generator<ForestConfig, &forest>(cls, "forest");
  add_generator<CityConfig, &city>(cls, "city");
  add_generator<OfficeConfig, &office>(cls, "office");
  add_generator<WarehouseConfig, &warehouse>(cls, "warehouse");
  add_generator<RaceTrackConfig, &race_track>(cls, "race_track");
  cls.def_static(
         "load",
         [](const py::object& source, bool meshes_anywhere, double scale, const std::array<float, 3>& origin,
            const std::optional<std::string>& up) {
           LoadOptions options{.scale = scale, .origin = Vec3(origin.data())};
           if (meshes_anywhere) options.files = MeshFiles::anywhere;
           if (up) options.up = up_axis(*up);
           const py::object scene = found(source);
           if (py::isinstance<World>(scene)) {
             const bool is_placed = scale != 1.0 || !options.origin.isZero(0.0F) || options.up == UpAxis::y;
             if (is_placed) throw py::value_error("scale, origin, up: not allowed for a generated scene");
             return scene.cast<std::shared_ptr<World>>();
           }
           const auto path = scene.cast<std::filesystem::path>();
           const auto world = released([&] { return World::load(path, options); });
           warn_of_ignored(*world, path);
           return std::const_pointer_cast<World>(world);
         },
         py::arg("source"), py::kw_only(), py::arg("meshes_anywhere") = false, py::arg("scale") = 1.0,
         py::arg("origin") = std::array<float, 3>{}, py::arg("up") = py::none())
      .def_static(
          "from_dict",
          [](const py::object& scene, const std::filesystem::path& base_dir, bool meshes_anywhere) {
            const std::string text = json_text(scene, "scene");
            const auto files = meshes_anywhere ? MeshFiles::anywhere : MeshFiles::in_folder;
            const auto world = released([&] { return World::from_json(text, base_dir, files); });
            warn_of_ignored(*world, "scene");
            return std::const_pointer_cast<World>(world);
          },
          py::arg("scene"), py::arg("base_dir") = "", py::kw_only(), py::arg("meshes_anywhere") = false)
      .def_property_readonly("name", [](const World& world) { return world.name(); })
      .def_property_readonly("bounds", [](const World& world) { return box_rows(world.bounds()); })
      .def_property_readonly("start", [](const World& world) { return row(world.markers().start); })
      .def_property_readonly("waypoints", [](const World& world) { return rows(world.markers().waypoints); })
      .def_property_readonly("goal", [](const World& world) { return row(world.markers().goal); })
      .def_property_readonly("spawn_box",
                             [](const World& world) -> py::object {
                               const auto& box = world.markers().spawn_box;
                               return box ? py::object(box_rows(*box)) : py::none();
                             })
      .def_property_readonly("marker_radius_m", [](const World& world) { return world.markers().radius; })
      .def_property_readonly("materials", &materials)
      .def_property_readonly("light", &light)
      .def("with_light", &with_light, py::kw_only(), py::arg("tint") = py::none())
      .def_property_readonly("primitives", &primitives)
      .def_property_readonly("gates", &gates)
      .def_property_readonly("bodies",
                             [](const World& world) {
                               py::list list;
                               for (const BodyConfig& body : world.bodies()) list.append(py::cast(body));
                               return list;
                             })
      .def(
          "with_bodies",
          [](const World& world, const py::object& given) {
            std::vector<BodyConfig> bodies = configs_of<std::vector<BodyConfig>>(given, "bodies");
            return std::const_pointer_cast<World>(released([&] { return world.with_bodies(std::move(bodies)); }));
          },
          py::arg("bodies"))
      .def(
          "to_dict",
          [](const World& world) { return py::module_::import("json").attr("loads")(released([&] { return world.to_json(); })); })
      .def(
          "save", [](const World& world, const std::filesystem::path& path) { released([&] { world.save(path); }); },
          py::arg("path"))
      .def("to_glb", [](const World& world) { return py::bytes(released([&] { return world.to_glb(); })); })
      .def_static(
          "from_glb",
          [](const py::bytes& data) {
            const std::string bytes = data;
            return std::const_pointer_cast<World>(released([&] { return World::from_glb(bytes, "data"); }));
          },
          py::arg("data"))
      .def("mesh", &mesh, py::arg("chord_error_m") = 1e-3F)
      .def("raycast", &raycast, py::arg("origins"), py::arg("directions"), py::arg("max_range_m"))
      .def("__copy__", [](const py::object& self) { return self; })  // immutable
      .def(
          "__deepcopy__", [](const py::object& self, const py::dict&) { return self; }, py::arg("memo"))
      .def(py::pickle([](const World& world) { return py::bytes(released([&] { return world.to_bytes(); })); },
                      [](const py::bytes& packed) {
                        const std::string_view bytes = packed;
                        return std::const_pointer_cast<World>(released([&] { return World::from_bytes(bytes); }));
                      }))
      .def("__repr__", [](const World& world) { return "World('" + world.name() + "')"; });
  py::reinterpret_borrow<py::class_<Light>>(module.attr("Light"))
      .def_static(
          "at_hour",
          [](const py::object& hour, const py::object& latitude_deg, const py::object& day_of_year) {
            return Light::at_hour(from_python<float>(hour, "hour"), from_python<float>(latitude_deg, "latitude_deg"),
                                  from_python<int>(day_of_year, "day_of_year"));
          },
          py::arg("hour"), py::arg("latitude_deg") = 48.0, py::arg("day_of_year") = 172);
}

}  // namespace flockstep::bindings
