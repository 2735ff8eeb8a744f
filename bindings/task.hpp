// Tasks across the boundary: what Batch(task=...) takes.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "flockstep/task.hpp"

namespace flockstep::bindings {

// A new task from a NavigationConfig, a NativeTask or a PythonTask; null for None.
std::unique_ptr<Task> make_task(const pybind11::object& description);

}  // namespace flockstep::bindings
