// Recipe: everything that a batch is built from, as one value that goes to JSON and back.
#pragma once

#include <filesystem>
#include <memory>
#include <string>
#include <variant>
#include <vector>

#include "flockstep/batch.hpp"
#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {

// The drone of a recipe: the name of a bundled airframe or the path of a JSON file (empty: "t650"), or the model itself.
using DroneChoice = std::variant<std::string, DroneModel>;

struct Recipe {
  TaskConfig task;                  // std::monostate: none
  std::vector<std::string> worlds;  // names of sets or scenes, or paths of scene files; see flockstep/scenes.hpp
  DroneChoice drone;
  BatchConfig batch;

  // The defaults of a task: its worlds, drone, sensors, dynamics and rates.
  FLOCKSTEP_API static Recipe for_task(TaskConfig task);

  // A JSON object with the members "task" (null, or an object with the task's "name" and the fields of its configuration),
  // "worlds", "drone" (a string, or an object as DroneModel::from_json() reads it) and the fields of BatchConfig. Members that
  // are not given have the defaults of the task. from_json() opens no file; it throws std::invalid_argument naming the place,
  // what was expected and what came, and the nearest name if one is misspelt.
  FLOCKSTEP_API std::string to_json() const;
  FLOCKSTEP_API static Recipe from_json(const std::string& text);
};

// The files that a recipe may open. A recipe from a file or the network is safe by default: bundled and generated scenes and
// bundled drones only.
struct RecipeAccess {
  std::filesystem::path scenes;  // the folder of the bundled scenes; files in it may be opened
  bool allows_files = false;     // scene and drone files may be anywhere
};

// Throws std::invalid_argument at a path in the recipe that is not allowed.
FLOCKSTEP_API void check_access(const Recipe& recipe, const RecipeAccess& access);

// Throws std::invalid_argument at an invalid recipe, at a RegisteredTask, and at a path that is not allowed.
FLOCKSTEP_API std::unique_ptr<Batch> make_batch(const Recipe& recipe, const RecipeAccess& access);

FLOCKSTEP_API DroneModel load_drone(const DroneChoice& drone);

// The task of a recipe; null without one. Throws std::invalid_argument at a RegisteredTask.
FLOCKSTEP_API std::unique_ptr<Task> make_task(const TaskConfig& task);

}  // namespace flockstep
