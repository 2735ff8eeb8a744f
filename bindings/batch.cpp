#include "batch.hpp"

#include <pybind11/stl.h>

#include <algorithm>
#include <array>
#include <cstdint>
#include <functional>
#include <iterator>
#include <limits>
#include <memory>
#include <optional>
#include <span>
#include <string>

#include "arguments.hpp"
#include "array_views.hpp"
#include "arrays.hpp"
#include "base/array_shape.hpp"
#include "base/require.hpp"
#include "convert.hpp"
#include "flockstep/recipe.hpp"
#include "flockstep/world_pool.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

using Worlds = std::vector<std::shared_ptr<World>>;

Shape n_by(const Batch& batch, py::ssize_t columns) { return {num_drones(batch), columns}; }

// Lets the arrays move only while the interpreter lock is held. Every reader holds it.
void hold_interpreter(Batch& batch) {
  ServedBatch::run_moves_with(batch, [](const std::function<void()>& move) {
    const py::gil_scoped_acquire acquire;
    move();
  });
}

// Worlds that the threads of flockstep.world_pool.Builds build. The wait for a world is in Python, so that Ctrl-C can end it.
class Builds final : public WorldSource {
 public:
  explicit Builds(py::object builds)
      : builds_(new py::object(std::move(builds)), [](py::object* object) {
          const py::gil_scoped_acquire acquire;
          std::default_delete<py::object>()(object);
        }) {}

  std::shared_ptr<const World> get(std::int32_t number) override {
    const py::gil_scoped_acquire acquire;
    return builds_->attr("get")(number).cast<std::shared_ptr<World>>();
  }

  void want(std::span<const std::int32_t> numbers) override {
    const py::gil_scoped_acquire acquire;
    py::list list;
    for (const std::int32_t number : numbers) list.append(number);
    builds_->attr("want")(list);
  }

 private:
  std::shared_ptr<py::object> builds_;
};

// Returns the pool that a flockstep.WorldPool describes, for a batch with this configuration; nothing for other objects.
std::optional<WorldPool> world_pool(const py::object& worlds, const BatchConfig& config) {
  const auto module = py::module_::import("flockstep.world_pool");
  if (!py::isinstance(worlds, module.attr("WorldPool"))) return std::nullopt;
  const py::cpp_function prepare([config](const World& world) { released([&] { build_ahead(world, config); }); });
  WorldPool pool{.size = worlds.attr("size").cast<std::int32_t>(), .fresh = worlds.attr("fresh").cast<double>()};
  pool.source = std::make_shared<Builds>(module.attr("Builds")(worlds, config.num_envs, prepare));
  return pool;
}

// Takes all arguments as py::object, because pybind11's error for a wrong argument names every other one as well.
std::unique_ptr<Batch, Released> make_batch(const py::object& given_worlds, const py::object& num_drones, const py::object& task,
                                            const py::object& drone, const py::object& world_index, const py::kwargs& fields) {
  BatchConfig config;
  set_batch_fields(config, fields, "Batch.__init__", {"worlds", "num_drones", "task", "drone", "world_index"});
  const int drones = from_python<int>(num_drones, "num_drones");
  const int per_env = config.drones_per_env;
  require(per_env >= 0, "drones_per_env", "an integer >= 0", per_env);
  require(per_env > 0 ? drones % per_env == 0 && (drones != 0 || per_env == 1) : drones == 0, "num_drones",
          per_env > 0 ? "a multiple of drones_per_env (" + std::to_string(per_env) + ")" : "0 with drones_per_env=0", drones);
  config.num_envs = per_env > 0 ? drones / per_env : 1;  // an env that drones will share
  const DroneModel model = drone_argument(drone);
  const auto index = integers<std::int32_t>(world_index, "world_index", {config.num_envs});
  std::optional<WorldPool> pool = world_pool(given_worlds, config);
  const Worlds worlds = pool ? Worlds() : worlds_argument(given_worlds);
  if (pool && index.given()) throw py::value_error("world_index: not allowed with a WorldPool: each episode draws its world");
  std::unique_ptr<Task> own_task = make_task(task);
  auto batch = released([&] {  // prepares worlds for tracing, times backends
    auto made =
        pool ? std::make_unique<Batch>(config, std::move(*pool), std::move(own_task), model)
             : std::make_unique<Batch>(config, Batch::Worlds(worlds.begin(), worlds.end()), std::move(own_task), model, index);
    return std::unique_ptr<Batch, Released>(made.release());
  });
  hold_interpreter(*batch);
  warn(*batch);
  return batch;
}

// Creates a batch from a recipe. `given_worlds` and `task` replace those of the recipe unless they are None.
std::unique_ptr<Batch, Released> batch_from_recipe(const Recipe& recipe, const py::object& given_worlds, const py::object& task,
                                                   bool allow_files, std::size_t max_worlds) {
  const RecipeAccess access{.scenes = py::module_::import("flockstep.scenes").attr("directory")().cast<std::filesystem::path>(),
                            .allows_files = allow_files,
                            .max_worlds = given_worlds.is_none() ? max_worlds : std::numeric_limits<std::size_t>::max()};
  std::unique_ptr<Batch> made;
  if (given_worlds.is_none() && task.is_none()) {
    released([&] { made = make_batch(recipe, access); });
  } else {
    check_access(recipe, access);
    std::optional<WorldPool> pool = given_worlds.is_none() ? std::nullopt : world_pool(given_worlds, recipe.batch);
    const Worlds worlds = pool ? Worlds() : worlds_argument(given_worlds.is_none() ? py::cast(recipe.worlds) : given_worlds);
    std::unique_ptr<Task> own_task = task.is_none() ? make_task(recipe.task) : make_task(task);
    DroneModel drone = load_drone(recipe.drone);
    released([&] {
      made = pool ? std::make_unique<Batch>(recipe.batch, std::move(*pool), std::move(own_task), std::move(drone))
                  : std::make_unique<Batch>(recipe.batch, Batch::Worlds(worlds.begin(), worlds.end()), std::move(own_task),
                                            std::move(drone));
    });
  }
  std::unique_ptr<Batch, Released> batch(made.release());
  hold_interpreter(*batch);
  warn(*batch);
  return batch;
}

// Contact of a batch's last move. Keeps the batch alive, because its arrays are views.
struct ContactView {
  py::object owner;

  const ContactState& state() const { return owner.cast<const Batch&>().state().contact; }
};

std::string describe_contact(const ContactView& contact) {
  const FlagArray& hit = contact.state().hit;
  return "<Contact: " + std::to_string(std::ranges::count(hit, 1)) + " of " + counted(std::ssize(hit), "drone") +
         " hit something>";
}

std::string describe_batch(const Batch& batch) {
  const BatchConfig& config = batch.config();
  std::string text = "<Batch: " + counted(config.num_drones(), "drone");
  text += batch.worlds().empty() ? " in worlds of a WorldPool" : " in " + counted(std::ssize(batch.worlds()), "world");
  text += ", motion \"" + std::string(name_of(config.dynamics.motion)) + '"';
  return text + describe_sensors(config) + (batch.task() == nullptr ? ", no task>" : ", a task>");
}

// Returns the drones of a call by their indices; not given for None. Throws ValueError if there is also a mask.
Input<std::int64_t> rows_argument(const py::object& rows, const py::object& mask) {
  if (!rows.is_none() && !mask.is_none()) throw py::value_error("mask: expected None with rows, got an array");
  return integers<std::int64_t>(rows, "rows", {-1});
}

// Returns a mask of envs from a bool mask, from indices, or from one index; None gives an empty one.
std::vector<std::uint8_t> env_mask(const Batch& batch, const py::object& envs) {
  if (envs.is_none()) return {};
  const auto count = static_cast<std::size_t>(num_envs(batch));
  std::vector<std::uint8_t> mask(count);
  const py::array given(py::module_::import("numpy").attr("atleast_1d")(envs));
  if (given.dtype().kind() == 'b') {
    const auto flagged = flags(given, "envs", num_envs(batch));
    const std::span<const std::uint8_t> values = flagged;
    mask.assign(values.begin(), values.end());
  } else if (given.size() > 0) {
    const auto indices = integers<std::int64_t>(given, "envs", {-1});
    const std::span<const std::int64_t> values = indices;
    for (const std::int64_t env : values) {
      require(env >= 0 && static_cast<std::size_t>(env) < count, "envs", "integers in [0, " + std::to_string(count) + ")", env);
    }
    for (const std::int64_t env : values) mask[static_cast<std::size_t>(env)] = 1;
  }
  return mask;
}

// Getters for the arrays' properties.
Viewed<State> state_arrays(const py::object& self, const char*) { return {self.cast<const Batch&>().state(), memory_of(self)}; }
Viewed<ParameterState> parameter_arrays(const py::object& self, const char*) {
  return {self.cast<const Batch&>().state().parameters, memory_of(self)};
}
Viewed<OwnEpisodes> own_arrays(const py::object& self, const char*) {
  return {self.cast<const Batch&>().state().own, memory_of(self)};
}
Viewed<FlightState> flight_arrays(const py::object& self, const char*) {
  const auto& batch = self.cast<const Batch&>();
  if (batch.config().dynamics.is_kinematic()) {
    throw py::attribute_error("kinematic motion has no velocities or rotors: make this Batch with motion=\"rotors\"");
  }
  return {batch.state().flight, memory_of(self), {.sizes = {static_cast<std::int64_t>(batch.num_rotors()), 1}, .dimensions = 1}};
}
Viewed<MoveLineState> move_line_arrays(const py::object& self, const char*) {
  return {self.cast<const Batch&>().move_lines().state(), memory_of(self)};
}
Viewed<PoseReadings> poses_arrays(const py::object& self, const char*) {
  return {self.cast<const Batch&>().pose_readings(), memory_of(self)};
}
Viewed<ContactState> contacts_arrays(const py::object& self, const char*) {
  const auto& view = self.cast<const ContactView&>();
  return {view.state(), memory_of(view.owner)};
}

}  // namespace

void register_batch(py::module_& module) {
  py::class_<ContactView> contact(module, "Contact", "Contacts of the last motion of each drone.");
  contact.def("__repr__", &describe_contact);
  add_arrays<ContactState, &contacts_arrays>(contact);

  const auto none = py::none();
  py::class_<ServedBatch>(module, "_ServedBatch").def("end", [](ServedBatch& served) { released([&] { served.end(); }); });
  BatchClass cls(module, "Batch", "N drone slots over W worlds, stepped together.");
  suggest_attributes(cls);
  add_arrays<State, &state_arrays>(cls);
  add_arrays<ParameterState, &parameter_arrays>(cls);
  add_arrays<OwnEpisodes, &own_arrays>(cls);
  add_arrays<FlightState, &flight_arrays>(cls);
  add_arrays<PoseReadings, &poses_arrays>(cls);
  add_sensors(cls);
  add_task(cls);
  add_gradient(cls);
  add_arrays<MoveLineState, &move_line_arrays>(cls);
  cls.def(py::init(&make_batch), py::arg("worlds"), py::arg("num_drones") = 1, py::kw_only(), py::arg("task") = none,
          py::arg("drone") = none, py::arg("world_index") = none)
      .def_static("from_recipe", &batch_from_recipe, py::arg("recipe"), py::arg("worlds") = none, py::arg("task") = none,
                  py::kw_only(), py::arg("allow_files") = false, py::arg("max_worlds") = RecipeAccess().max_worlds)
      .def_property_readonly("num_envs", [](const Batch& batch) { return batch.config().num_envs; })
      .def_property_readonly("drones_per_env", [](const Batch& batch) { return batch.config().drones_per_env; })
      .def_property_readonly("num_rotors", [](const Batch& batch) { return batch.num_rotors(); })
      .def_property_readonly("num_drones", [](const Batch& batch) { return batch.config().num_drones(); })
      .def_property_readonly("generation", [](const Batch& batch) { return ServedBatch::generation(batch); })
      .def_property_readonly("num_threads", [](const Batch& batch) { return batch.num_threads(); })
      .def_property_readonly("embree_rays", [](const Batch& batch) { return batch.embree().rays; })
      .def_property_readonly("embree_packets", [](const Batch& batch) { return batch.embree().packets; })
      .def_property_readonly("dynamics", [](const Batch& batch) { return batch.config().dynamics; })
      .def_property_readonly("clock", [](const Batch& batch) { return batch.config().clock; })
      .def_property_readonly("variations", [](const Batch& batch) { return batch.config().variations; })
      .def_property_readonly("airframes", [](const Batch& batch) { return batch.config().airframes; })
      .def_property_readonly(
          "worlds",
          [](const Batch& batch) {
            Worlds worlds;
            if (batch.worlds().empty()) {
              throw py::attribute_error(
                  "this Batch draws its worlds from an unlimited WorldPool: use world_of(i) for the world of drone i");
            }
            for (const auto& world : batch.worlds()) worlds.push_back(std::const_pointer_cast<World>(world));
            return worlds;
          })
      .def(
          "world_of",
          [](const Batch& batch, const py::object& index) {
            const auto drone = from_python<std::int64_t>(index, "index");
            if (drone < 0 || drone >= num_drones(batch)) {
              throw py::index_error("index: expected an integer in [0, " + std::to_string(num_drones(batch)) + "), got " +
                                    std::to_string(drone));
            }
            return std::const_pointer_cast<World>(batch.world_of(EnvIndex(drone / batch.config().drones_per_env)));
          },
          py::arg("index"))
      .def_property_readonly("drone", [](const Batch& batch) { return batch.drone(); })
      .def_property_readonly("contact", [](const py::object& self) { return ContactView{self}; })
      .def(
          "set_pose",
          [](Batch& batch, const py::object& position, const py::object& quat_wxyz, const py::object& mask,
             const py::object& rows) {
            const auto r = rows_argument(rows, mask);
            const py::ssize_t n = r.given() ? static_cast<py::ssize_t>(r.rows()) : num_drones(batch);
            const auto p = row_floats(position, "position", n, 3);
            const auto q = row_floats(quat_wxyz, "quat_wxyz", n, 4);
            const auto m = flags(mask, "mask", num_drones(batch));
            in_turn(batch, [&] { r.given() ? batch.set_pose(r, p, q) : batch.set_pose(p, q, m); });
          },
          py::arg("position") = none, py::arg("quat_wxyz") = none, py::arg("mask") = none, py::kw_only(), py::arg("rows") = none)
      .def(
          "is_free",
          [](const Batch& batch, const py::object& position, const py::object& quat_wxyz, const py::object& rows) {
            const auto r = integers<std::int64_t>(rows, "rows", {-1});
            if (position.is_none()) throw py::value_error("position: expected an array (K, 3), got None");
            const py::ssize_t n = r.given() ? static_cast<py::ssize_t>(r.rows()) : num_drones(batch);
            const auto p = floats(position, "position", {n, 3});
            const auto q = floats(quat_wxyz, "quat_wxyz", {n, 4});
            py::array_t<bool> free(n);
            if (n == 0) return free;
            const std::span out(reinterpret_cast<std::uint8_t*>(free.mutable_data()), static_cast<std::size_t>(n));
            in_turn(batch, [&] { batch.is_free(r, p, q, out); });
            return free;
          },
          py::arg("position"), py::arg("quat_wxyz") = none, py::kw_only(), py::arg("rows") = none)
      .def(
          "move",
          [](const py::object& self, const py::object& position, const py::object& quat_wxyz, const py::object& mask) {
            auto& batch = self.cast<Batch&>();
            const auto p = row_floats(position, "position", num_drones(batch), 3);
            const auto q = row_floats(quat_wxyz, "quat_wxyz", num_drones(batch), 4);
            const auto m = flags(mask, "mask", num_drones(batch));
            released(batch, [&] { batch.move(p, q, m); });
            return ContactView{self};
          },
          py::arg("position") = none, py::arg("quat_wxyz") = none, py::arg("mask") = none)
      .def(
          "set_velocity",
          [](Batch& batch, const py::object& velocity, const py::object& angular_velocity, const py::object& rotor_speed,
             const py::object& mask, const py::object& rows) {
            const auto drones = rows_argument(rows, mask);
            const py::ssize_t n = drones.given() ? static_cast<py::ssize_t>(drones.rows()) : num_drones(batch);
            const auto v = row_floats(velocity, "velocity", n, 3);
            const auto w = row_floats(angular_velocity, "angular_velocity", n, 3);
            const auto r = row_floats(rotor_speed, "rotor_speed", n, static_cast<py::ssize_t>(batch.num_rotors()));
            const auto m = flags(mask, "mask", num_drones(batch));
            in_turn(batch, [&] { drones.given() ? batch.set_velocity(drones, v, w, r) : batch.set_velocity(v, w, r, m); });
          },
          py::arg("velocity") = none, py::arg("angular_velocity") = none, py::arg("rotor_speed") = none, py::arg("mask") = none,
          py::kw_only(), py::arg("rows") = none)
      .def(
          "set_params",
          [](Batch& batch, const py::object& params, const py::object& mask) {
            const auto p = row_floats(params, "params", num_drones(batch), py::ssize_t{kNumParameters});
            const auto m = flags(mask, "mask", num_drones(batch));
            in_turn(batch, [&] { batch.set_params(p, m); });
          },
          py::arg("params"), py::arg("mask") = none)
      .def(
          "set_variations",
          [](Batch& batch, const std::vector<Variation>& variations) {
            in_turn(batch, [&] { batch.set_variations(variations); });
          },
          py::arg("variations"))
      .def(
          "fly",
          [](const py::object& self, const py::object& command, const py::object& ticks, const py::object& mask,
             const py::object& control) {
            auto& batch = self.cast<Batch&>();
            if (command.is_none()) throw py::value_error("command: expected an array (N, 4), got None");
            const auto meaning = control.is_none() ? std::nullopt : std::optional(from_python<Control>(control, "control"));
            const auto c = floats(command, "command", n_by(batch, static_cast<py::ssize_t>(batch.command_size(meaning))));
            const int count = ticks.is_none() ? 0 : from_python<int>(ticks, "ticks");
            if (!ticks.is_none()) require(count >= 1, "ticks", "an integer >= 1", count);
            const auto m = flags(mask, "mask", num_drones(batch));
            released(batch, [&] { batch.fly(c, count, m, meaning); });
            return ContactView{self};
          },
          py::arg("command"), py::arg("ticks") = none, py::arg("mask") = none, py::arg("control") = none)
      .def(
          "sense",
          [](Batch& batch, const py::object& mask) {
            const auto m = flags(mask, "mask", num_drones(batch));
            released(batch, [&] { batch.sense(m); });
          },
          py::arg("mask") = none)
      .def(
          "spawn",
          [](Batch& batch, const py::object& indices, const py::object& position, const py::object& quat_wxyz,
             const py::object& world_index, const py::object& env) {
            const auto rows = integers<std::int64_t>(indices, "indices", {-1});
            const auto envs = integers<std::int64_t>(env, "env", {-1});
            if (rows.given() && envs.given()) throw py::value_error("env: expected None with indices, got an array");
            const bool counts = !rows.given() && !envs.given();  // the rows of the positions
            if (counts && position.is_none()) {
              throw py::value_error("position: expected an array (K, 3) without indices and env, got None");
            }
            const auto given = static_cast<py::ssize_t>(rows.given() ? rows.rows() : envs.given() ? envs.rows() : 0);
            const auto p = floats(position, "position", {counts ? -1 : given, 3});
            const auto n = counts ? static_cast<py::ssize_t>(p.rows()) : given;
            const auto q = floats(quat_wxyz, "quat_wxyz", {n, 4});
            const auto w = integers<std::int32_t>(world_index, "world_index", {n});
            std::vector<std::int64_t> spawned;
            released(batch, [&] { spawned = batch.spawn(rows, p, q, w, envs); });
            return array_of(spawned);
          },
          py::arg("indices") = none, py::arg("position") = none, py::arg("quat_wxyz") = none, py::arg("world_index") = none,
          py::kw_only(), py::arg("env") = none)
      .def(
          "remove",
          [](Batch& batch, const py::object& indices) {
            const auto rows = integers<std::int64_t>(indices, "indices", {-1});
            in_turn(batch, [&] { batch.remove(rows); });
          },
          py::arg("indices"))
      .def(
          "set_world",
          [](Batch& batch, const py::object& world_index, const py::object& mask) {
            const auto w = integers<std::int32_t>(world_index, "world_index", {num_envs(batch)});
            const auto m = flags(mask, "mask", num_envs(batch));
            in_turn(batch, [&] { batch.set_world(w, m); });
          },
          py::arg("world_index"), py::arg("mask") = none)
      .def(
          "set_light",
          [](Batch& batch, const py::object& light, const py::object& envs, const py::object& world_index, const py::object& tint,
             const py::kwargs& keywords) {
            const py::kwargs changes = light_changes(keywords, "set_light");
            const auto changed = [&](const World& world) { return lighting_argument(world, changes, tint); };
            const bool is_number = py::isinstance<py::int_>(light) || py::hasattr(light, "__index__");
            if (is_number || !world_index.is_none()) {
              if (!light.is_none() && !world_index.is_none()) throw py::type_error("light: expected None with world_index");
              if (!envs.is_none()) throw py::type_error("envs: expected None with the index of a world, for all envs in it");
              const auto number = from_python<std::int64_t>(is_number ? light : world_index, "world_index");
              const auto& worlds = batch.worlds();
              const bool is_known = number >= 0 && number < std::ssize(worlds);
              const Lighting lighting = is_known ? changed(*worlds[static_cast<std::size_t>(number)]) : Lighting();
              released(batch, [&] { batch.set_light(number, lighting); });
              return;
            }
            if (!tint.is_none()) throw py::type_error("tint: expected None without the index of a world (envs share materials)");
            const std::vector<std::uint8_t> mask = env_mask(batch, envs);
            if (!light.is_none()) {
              if (!changes.empty()) throw py::type_error("light: expected None with fields of a light, got a Light");
              const auto given = argument<Light>(light, "light", "a flockstep.Light, the index of a world, or None");
              released(batch, [&] { batch.set_light(given, mask); });
            } else if (!changes.empty()) {
              std::vector<Light> lights(static_cast<std::size_t>(num_envs(batch)));
              for (std::size_t env = 0; env < lights.size(); ++env) {
                if (mask.empty() || mask[env] != 0) lights[env] = changed(*batch.world_of(EnvIndex(env))).light;
              }
              released(batch, [&] { batch.set_light(lights, mask); });
            } else {
              released(batch, [&] { batch.use_world_light(mask); });
            }
          },
          py::arg("light") = none, py::arg("envs") = none, py::kw_only(), py::arg("world_index") = none, py::arg("tint") = none)
      .def(
          "sensor",
          [](const py::object& self, const std::string& name) {
            py::dict arrays;
            const py::object memory = memory_of(self);
            for (const ArrayView& array : self.cast<const Batch&>().sensor_arrays(name)) {
              arrays[array.name] = view(memory, dtype_of(array), array.data, shape_of(array).span());
            }
            return arrays;
          },
          py::arg("name"))
      .def(
          "set_move_line_visible",
          [](Batch& batch, const py::object& visible, const py::object& mask) {
            const bool shown = from_python<bool>(visible, "visible");
            const auto m = flags(mask, "mask", num_drones(batch));
            in_turn(batch, [&] { batch.move_lines().set_visible(shown, m); });
          },
          py::arg("visible"), py::arg("mask") = none)
      .def(
          "set_beams_visible",
          [](Batch& batch, const py::object& visible, const py::object& mask) {
            const bool shown = from_python<bool>(visible, "visible");
            const auto m = flags(mask, "mask", num_drones(batch));
            in_turn(batch, [&] { batch.move_lines().set_beams_visible(shown, m); });
          },
          py::arg("visible"), py::arg("mask") = none)
      .def(
          "move_line",
          [](const Batch& batch, std::int64_t index) {
            return rows(in_turn(batch, [&] { return batch.move_lines().path(drone_at(batch, index)); }));
          },
          py::arg("index"))
      .def(
          "seed",
          [](Batch& batch, const py::object& seeds, const py::object& mask) {
            const auto s = integers<std::uint64_t>(seeds, "seeds", {num_envs(batch)});
            const auto m = flags(mask, "mask", num_envs(batch));
            in_turn(batch, [&] { batch.seed(s, m); });
          },
          py::arg("seeds"), py::arg("mask") = none)
      .def(
          "begin_episode",
          [](Batch& batch, const py::object& mask) {
            const auto m = flags(mask, "mask", num_envs(batch));
            in_turn(batch, [&] { batch.begin_episode(m); });
          },
          py::arg("mask") = none)
      .def("snapshot",
           [](Batch& batch) {
             std::string blob;
             released(batch, [&] { blob = batch.snapshot(); });
             return py::bytes(blob);
           })
      .def(
          "restore",
          [](Batch& batch, const py::bytes& bytes) {
            const std::string blob = bytes;
            released(batch, [&] { batch.restore(blob); });
          },
          py::arg("blob"))
      // For tests, without before_long_call.
      .def(
          "_served", [](Batch& batch) { return released([&] { return std::make_unique<ServedBatch>(batch); }); },
          py::keep_alive<0, 1>())
      .def("__repr__", &describe_batch);
  add_bodies(module, cls);
  add_lidars(module, cls);
  add_cameras(module, cls);
  add_terms(module, cls);
}

}  // namespace flockstep::bindings
