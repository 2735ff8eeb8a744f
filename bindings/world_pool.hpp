// Converts world pools, which Batch(worlds=...) accepts in addition to lists.
#pragma once

#include <pybind11/pybind11.h>

#include <optional>

#include "flockstep/config.hpp"
#include "flockstep/world_pool.hpp"

namespace flockstep::bindings {

// Returns the pool that a flockstep.WorldPool describes, for a batch with this configuration; nothing for other objects.
std::optional<WorldPool> world_pool(const pybind11::object& worlds, const BatchConfig& config);

}  // namespace flockstep::bindings
