// Implements batch.camera(name), which returns a view of one camera of a batch.
#pragma once

#include <pybind11/pybind11.h>

#include <optional>
#include <string>

namespace flockstep::bindings {

// Throws ValueError if the batch has no camera with that name.
pybind11::object camera_view(const pybind11::object& batch, const std::optional<std::string>& name);

}  // namespace flockstep::bindings
