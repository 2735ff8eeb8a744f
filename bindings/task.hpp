// Tasks across the boundary: what Batch(task=...) takes.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <optional>
#include <string>

#include "flockstep/task.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep::bindings {

// The configuration of a task of the engine; nothing for other objects.
std::optional<TaskConfig> engine_task(const pybind11::object& description);

// Their classes, for messages: "one of NavigationConfig, ...".
std::string names_of_task_configs();

// A new task from the configuration of one of the engine, a NativeTask or a PythonTask; null for None.
std::unique_ptr<Task> make_task(const pybind11::object& description);

}  // namespace flockstep::bindings
