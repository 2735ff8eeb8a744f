// Pools of worlds across the boundary: what Batch(worlds=...) takes beside a list.
#pragma once

#include <pybind11/pybind11.h>

#include <optional>

#include "flockstep/config.hpp"
#include "flockstep/world_pool.hpp"

namespace flockstep::bindings {

// The pool that a flockstep.WorldPool describes, for a batch of this configuration; nothing where it is something else.
std::optional<WorldPool> world_pool(const pybind11::object& worlds, const BatchConfig& config);

}  // namespace flockstep::bindings
