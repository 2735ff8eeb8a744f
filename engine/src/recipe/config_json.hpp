// Configurations as JSON and back, by their lists of fields.
//
// A configuration is an object with a member for each field, in the order of the list; a list of fields that are all bools, such
// as CameraOutputs, is an array of the names of those that are true. Enumerations are names, an optional that is not set is null.
// Every float32 comes back with the same bits.
#pragma once

#include <nlohmann/json_fwd.hpp>
#include <string>

#include "flockstep/fields.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep {

// Refuses numbers that are not finite, which JSON does not have.
template <HasFields Config>
nlohmann::ordered_json json_of(const Config& config);

// Fields that are not given keep their values. Throws std::invalid_argument naming the place ("lidar.offset_m[2]"), what was
// expected and what came: of an unknown member, a value of another type, a number beyond the limits of its field. Rules that
// compare fields with each other are left to validate(). `path` is the place of the configuration itself.
template <HasFields Config>
void read_config(const nlohmann::json& json, const std::string& path, Config& config);

// A task is null, or an object with the "name" of the task or the id of a registered one, and the fields of its configuration.
nlohmann::ordered_json json_of(const TaskConfig& task);
TaskConfig read_task(const nlohmann::json& json);

// The quoted names of the engine's tasks, for messages.
std::string names_of_tasks();

}  // namespace flockstep
