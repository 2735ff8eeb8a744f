#pragma once

#include <pybind11/pybind11.h>

namespace flockstep::bindings {

// What Batch.terms returns; it keeps its batch alive.
pybind11::object terms_of(const pybind11::object& batch);

}  // namespace flockstep::bindings
