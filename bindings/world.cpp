#include "flockstep/world.hpp"

#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <string_view>

#include "arrays.hpp"
#include "convert.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/raycast.hpp"
#include "named.hpp"
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
  const Light& light = world.light();
  py::dict entry;
  entry["sun_direction"] = triple(light.sun_direction);
  entry["sun_color"] = triple(light.sun_color);
  entry["sky_ambient"] = triple(light.sky_ambient);
  entry["ground_ambient"] = triple(light.ground_ambient);
  entry["zenith_color"] = triple(light.zenith_color);
  entry["horizon_color"] = triple(light.horizon_color);
  entry["gamma"] = light.gamma;
  entry["sun_radius_deg"] = light.sun_radius_deg;
  entry["sun_glow"] = light.sun_glow;
  entry["fog_visibility_m"] = light.fog_visibility_m;
  return entry;
}

std::shared_ptr<World> with_light(const std::shared_ptr<World>& world, const ColorArgument& sun_direction,
                                  const ColorArgument& sun_color, const ColorArgument& sky_ambient,
                                  const ColorArgument& ground_ambient, const ColorArgument& zenith_color,
                                  const ColorArgument& horizon_color, const std::optional<float>& gamma,
                                  const std::optional<float>& sun_radius_deg, const std::optional<float>& sun_glow,
                                  const std::optional<float>& fog_visibility_m, const py::object& tint) {
  const Lighting lighting = lighting_argument(*world, sun_direction, sun_color, sky_ambient, ground_ambient, zenith_color,
                                              horizon_color, gamma, sun_radius_deg, sun_glow, fog_visibility_m, tint);
  return released([&] { return std::make_shared<World>(world, lighting); });
}

py::dict raycast(const World& world, const py::object& origins, const py::object& directions, float max_range_m) {
  const Input<float> from = floats(origins, "origins", {-1, 3});
  const Input<float> along = floats(directions, "directions", {-1, 3});
  const RayHits hits = released([&] { return flockstep::raycast(world, from, along, max_range_m); });
  py::dict result;
  result["t_hit"] = py::array_t<float>(static_cast<py::ssize_t>(hits.t_hit.size()), hits.t_hit.data());
  result["normal"] = rows(hits.normal);
  result["u"] = py::array_t<float>(static_cast<py::ssize_t>(hits.u.size()), hits.u.data());
  result["v"] = py::array_t<float>(static_cast<py::ssize_t>(hits.v.size()), hits.v.data());
  result["primitive"] = py::array_t<std::int32_t>(static_cast<py::ssize_t>(hits.primitive.size()), hits.primitive.data());
  result["material"] = py::array_t<std::int32_t>(static_cast<py::ssize_t>(hits.material.size()), hits.material.data());
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
  py::array_t<std::int32_t> materials(count(mesh.materials));
  std::copy(mesh.materials.begin(), mesh.materials.end(), materials.mutable_data());
  py::dict result;
  result["vertices"] = rows(mesh.vertices);
  result["triangles"] = triangles;
  result["uv"] = uv;
  result["materials"] = materials;
  result["objects"] = py::array_t<std::int32_t>(count(objects), objects.data());
  return result;
}

}  // namespace

Lighting lighting_argument(const World& world, const ColorArgument& sun_direction, const ColorArgument& sun_color,
                           const ColorArgument& sky_ambient, const ColorArgument& ground_ambient,
                           const ColorArgument& zenith_color, const ColorArgument& horizon_color,
                           const std::optional<float>& gamma, const std::optional<float>& sun_radius_deg,
                           const std::optional<float>& sun_glow, const std::optional<float>& fog_visibility_m,
                           const py::object& tint) {
  const Light& usual = world.light();
  Lighting lighting;
  lighting.light = {sun_direction.value_or(usual.sun_direction),
                    sun_color.value_or(usual.sun_color),
                    sky_ambient.value_or(usual.sky_ambient),
                    ground_ambient.value_or(usual.ground_ambient),
                    zenith_color.value_or(usual.zenith_color),
                    horizon_color.value_or(usual.horizon_color),
                    gamma.value_or(usual.gamma),
                    sun_radius_deg.value_or(usual.sun_radius_deg),
                    sun_glow.value_or(usual.sun_glow),
                    fog_visibility_m.value_or(usual.fog_visibility_m)};
  if (!tint.is_none()) {
    const Input<float> rows = floats(py::module_::import("numpy").attr("atleast_2d")(tint), "tint", {-1, 3});
    const std::span<const float> values = rows;
    for (std::size_t i = 0; i < values.size(); i += 3) lighting.tint.push_back({values[i], values[i + 1], values[i + 2]});
    if (lighting.tint.size() == 1) lighting.tint.assign(world.materials().size(), std::array(lighting.tint[0]));
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
  py::class_<World, std::shared_ptr<World>>(module, "World", "Immutable geometry, materials and named markers.")
      .def_static(
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
      .def_static(
          "playground",
          [](std::uint64_t seed, int pillars, const std::array<float, 3>& size_m, float pillar_radius_m, int movers) {
            return std::const_pointer_cast<World>(
                released([&] { return playground({seed, pillars, size_m, pillar_radius_m, movers}); }));
          },
          py::arg("seed"), py::arg("pillars") = PlaygroundConfig().pillars, py::arg("size_m") = PlaygroundConfig().size_m,
          py::arg("pillar_radius_m") = PlaygroundConfig().pillar_radius_m, py::arg("movers") = 0)
      .def_static(
          "forest",
          [](std::uint64_t seed, int trees, const std::array<float, 2>& size_m, float relief_m) {
            return std::const_pointer_cast<World>(released([&] { return forest({seed, trees, size_m, relief_m}); }));
          },
          py::arg("seed"), py::arg("trees") = ForestConfig().trees, py::arg("size_m") = ForestConfig().size_m,
          py::arg("relief_m") = ForestConfig().relief_m)
      .def_static(
          "city",
          [](std::uint64_t seed, const std::array<int, 2>& blocks, float height_m, int traffic) {
            return std::const_pointer_cast<World>(released([&] { return city({seed, blocks, height_m, traffic}); }));
          },
          py::arg("seed"), py::arg("blocks") = CityConfig().blocks, py::arg("height_m") = CityConfig().height_m,
          py::arg("traffic") = 0)
      .def_static(
          "office",
          [](std::uint64_t seed, const std::array<float, 2>& size_m, float furniture, bool waypoints, int walkers) {
            return std::const_pointer_cast<World>(
                released([&] { return office({seed, size_m, furniture, waypoints, walkers}); }));
          },
          py::arg("seed"), py::arg("size_m") = OfficeConfig().size_m, py::arg("furniture") = OfficeConfig().furniture,
          py::arg("waypoints") = false, py::arg("walkers") = 0)
      .def_static(
          "warehouse",
          [](std::uint64_t seed, const std::array<float, 2>& size_m, float height_m, bool waypoints, int forklifts) {
            return std::const_pointer_cast<World>(
                released([&] { return warehouse({seed, size_m, height_m, waypoints, forklifts}); }));
          },
          py::arg("seed"), py::arg("size_m") = WarehouseConfig().size_m, py::arg("height_m") = WarehouseConfig().height_m,
          py::arg("waypoints") = false, py::arg("forklifts") = 0)
      .def_static(
          "race_track",
          [](std::uint64_t seed, int gates, const std::array<float, 3>& size_m, float gate_size_m, float rings) {
            const RaceTrackConfig config{seed, gates, size_m, gate_size_m, rings};
            return std::const_pointer_cast<World>(released([&] { return race_track(config); }));
          },
          py::arg("seed"), py::arg("gates") = RaceTrackConfig().gates, py::arg("size_m") = RaceTrackConfig().size_m,
          py::arg("gate_size_m") = RaceTrackConfig().gate_size_m, py::arg("rings") = RaceTrackConfig().rings)
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
      .def("with_light", &with_light, py::kw_only(), py::arg("sun_direction") = py::none(), py::arg("sun_color") = py::none(),
           py::arg("sky_ambient") = py::none(), py::arg("ground_ambient") = py::none(), py::arg("zenith_color") = py::none(),
           py::arg("horizon_color") = py::none(), py::arg("gamma") = py::none(), py::arg("sun_radius_deg") = py::none(),
           py::arg("sun_glow") = py::none(), py::arg("fog_visibility_m") = py::none(), py::arg("tint") = py::none())
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
}

}  // namespace flockstep::bindings
