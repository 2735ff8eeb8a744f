#pragma once

#include <pybind11/pybind11.h>

#include <optional>
#include <string>

namespace flockstep::bindings {

// Implements Batch.lidar(); the returned view keeps its batch alive.
pybind11::object lidar_view(const pybind11::object& batch, const std::optional<std::string>& name);

}  // namespace flockstep::bindings
