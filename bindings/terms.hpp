#pragma once

#include <pybind11/pybind11.h>

namespace flockstep::bindings {

// Implements Batch.terms; the returned object keeps its batch alive.
pybind11::object terms_of(const pybind11::object& batch);

}  // namespace flockstep::bindings
