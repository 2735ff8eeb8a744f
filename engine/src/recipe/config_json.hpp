// Converts configurations to JSON and back, based on their lists of fields.
//
// A configuration is an object with a member for each field, in the order of the list. A list of fields that are all bools,
// such as CameraOutputs, is an array of the names of the true ones. Enumerations are names, and unset optionals are null. Every
// float32 is read back with the same bits.
#pragma once

#include <nlohmann/json.hpp>
#include <string>

#include "base/config_values.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {

// Rejects non-finite numbers, which JSON cannot represent.
template <HasFields Config>
nlohmann::ordered_json json_of(const Config& config) {
  return config_values::written(config, "");
}

// Reads a configuration. Missing fields keep their values. Throws std::invalid_argument that names the place
// ("lidar.offset_m[2]"), the expected value and the actual one for unknown members, values of the wrong type and numbers
// outside the limits of their fields. validate() checks the rules that compare fields with each other. `path` is the place of
// the configuration itself.
template <HasFields Config>
void read_config(const nlohmann::json& json, const std::string& path, Config& config) {
  config_values::read_value({json, {}, path, true}, {}, config);
}

// A task is null, or an object with the fields of its configuration and a "name": the task's name or the id of a registered
// task.
nlohmann::ordered_json json_of(const TaskConfig& task);
TaskConfig read_task(const nlohmann::json& json);

// Returns the quoted names of the engine's tasks, for messages.
std::string names_of_tasks();

}  // namespace flockstep
