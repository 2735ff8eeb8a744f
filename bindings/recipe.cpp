// Recipes, and the scene names that they may use.
#include "flockstep/recipe.hpp"

#include <pybind11/pybind11.h>
#include <pybind11/stl.h>
#include <pybind11/stl/filesystem.h>

#include <memory>
#include <optional>
#include <span>
#include <string>
#include <type_traits>
#include <typeinfo>
#include <utility>
#include <vector>

#include "arguments.hpp"
#include "convert.hpp"
#include "flockstep/scenes.hpp"
#include "recipe/unknown_scene.hpp"
#include "released.hpp"

namespace flockstep::bindings {
namespace {

// Converts a task argument: a configuration, the id of a registered task, or None.
TaskConfig task_of(const py::object& task) {
  if (task.is_none()) return {};
  if (std::optional<TaskConfig> config = engine_task(task)) return *std::move(config);
  if (py::isinstance<py::str>(task)) return RegisteredTask{task.cast<std::string>()};
  throw py::type_error("task: expected " + names_of_task_configs() + ", the id of a registered task or None, got " +
                       std::string(py::repr(task)));
}

// Returns a recipe with the defaults of a task, which may also be one from a library.
Recipe recipe_for(const py::object& task) {
  const std::optional<std::string> library = library_of(task);
  if (!library) return Recipe::for_task(task_of(task));
  Recipe recipe = Recipe::for_task(RegisteredTask{"library/" + *library});
  recipe.take(make_task(task)->defaults());
  return recipe;
}

DroneChoice drone_of(const py::object& drone) {
  if (py::isinstance<py::str>(drone)) return drone.cast<std::string>();
  if (py::hasattr(drone, "__fspath__")) return drone.attr("__fspath__")().cast<std::string>();
  return argument<DroneModel>(drone, "drone", "a flockstep.DroneModel, the name or path of one, or None");
}

py::object task_to_python(const Recipe& recipe) {
  return std::visit(
      []<class Config>(const Config& config) -> py::object {
        if constexpr (std::is_same_v<Config, std::monostate>) {
          return py::none();
        } else if constexpr (std::is_same_v<Config, RegisteredTask>) {
          return py::str(config.id);
        } else {
          return py::cast(config);
        }
      },
      recipe.task);
}

std::shared_ptr<World> mutable_world(const std::shared_ptr<const World>& world) { return std::const_pointer_cast<World>(world); }

template <class Named>
py::tuple names_of(std::span<const Named> all) {
  py::list names;
  for (const Named& one : all) names.append(std::string(one.name));
  return names;
}

}  // namespace

void register_recipe(py::module_& module) {
  py::class_<Recipe> cls(module, "Recipe", "Everything that a batch is built from, as one value that converts to and from JSON.");
  suggest_attributes(cls);
  cls.def(py::init(&recipe_for), py::arg("task") = py::none())
      .def_static("from_json", &Recipe::from_json, py::arg("text"))
      .def("to_json", &Recipe::to_json)
      .def_property("task", &task_to_python, [](Recipe& recipe, const py::object& task) { recipe.task = task_of(task); })
      .def_readwrite("worlds", &Recipe::worlds, "Names of sets or scenes, or paths of files; see `flockstep.scenes`.")
      .def_property(
          "drone", [](const Recipe& recipe) { return recipe.drone; },
          [](Recipe& recipe, const py::object& drone) { recipe.drone = drone_of(drone); })
      .def("_set", [](Recipe& recipe, const py::kwargs& fields) { set_batch_fields(recipe.batch, fields, "Recipe._set", {}); })
      .def(
          "check_access",
          [](const Recipe& recipe, const std::filesystem::path& scenes, bool allow_files, std::size_t max_worlds) {
            check_access(recipe, {.scenes = scenes, .allows_files = allow_files, .max_worlds = max_worlds});
          },
          py::arg("scenes"), py::arg("allow_files") = false, py::arg("max_worlds") = RecipeAccess().max_worlds)
      .def(
          "__eq__", [](const Recipe& a, const Recipe& b) { return a.to_json() == b.to_json(); }, py::is_operator())
      .def("__repr__",
           [](const Recipe& recipe) { return "Recipe.from_json(" + std::string(py::repr(py::str(recipe.to_json()))) + ")"; })
      .def(py::pickle([](const Recipe& recipe) { return py::str(recipe.to_json()); },
                      [](const py::str& text) { return Recipe::from_json(text); }));
  cls.attr("__hash__") = py::none();  // mutable
  const Recipe recipe;
  add_batch_fields(cls, typeid(Recipe), reinterpret_cast<const char*>(&recipe.batch) - reinterpret_cast<const char*>(&recipe));
  cls.attr("_attributes") = module.attr("_other_fields")["BatchConfig"];  // for the stub

  py::dict sets;
  for (const SceneSet& set : scene_sets()) {
    py::list scenes;
    for (const std::string_view scene : set.scenes) scenes.append(std::string(scene));
    sets[py::str(std::string(set.name))] = py::tuple(scenes);
  }
  module.attr("scene_sets") = sets;
  module.attr("scene_suffixes") = py::tuple(py::cast(World::suffixes()));
  module.attr("generated_scenes") = names_of(generated_scenes());
  module.attr("scene_generators") = names_of(scene_generators());
  module.def(
      "_unknown_scene", [](const std::string& name, const std::vector<std::string>& known) { return unknown_scene(name, known); },
      py::arg("name"), py::arg("known"));
  module.def(
      "load_scene",
      [](const std::string& name, const std::filesystem::path& folder) {
        std::shared_ptr<const World> world;
        released([&] { world = load_scene(name, folder); });
        return mutable_world(world);
      },
      py::arg("name"), py::arg("folder"));
}

}  // namespace flockstep::bindings
