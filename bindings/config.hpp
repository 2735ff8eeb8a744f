// Exposes fields of configurations as properties.
#pragma once

#include <pybind11/pybind11.h>

#include <cstddef>
#include <typeinfo>

namespace flockstep::bindings {

// Adds a property for each field of a BatchConfig that is embedded in the C++ object of a class, `offset` bytes from its
// beginning.
void add_batch_fields(const pybind11::object& cls, const std::type_info& type, std::ptrdiff_t offset);

}  // namespace flockstep::bindings
