// Converts tasks for Batch(task=...).
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <cstdint>
#include <memory>
#include <optional>
#include <string>

#include "flockstep/task.hpp"
#include "flockstep/tasks.hpp"

namespace flockstep::bindings {

// Returns the configuration of an engine task; nothing for other objects.
std::optional<TaskConfig> engine_task(const pybind11::object& description);

// Returns the path of the library of a NativeTask; nothing for other objects.
std::optional<std::string> library_of(const pybind11::object& description);

// Names the configuration classes of the engine's tasks, for messages: "one of NavigationConfig, ...".
std::string names_of_task_configs();

// Creates a task from an engine task's configuration, a NativeTask or a PythonTask; null for None.
std::unique_ptr<Task> make_task(const pybind11::object& description);

// Returns the rows whose episodes a task's reset is beginning, within the reset of a task written in Python.
std::optional<pybind11::array_t<std::int64_t>> rows_of_reset(const Task& task);

}  // namespace flockstep::bindings
