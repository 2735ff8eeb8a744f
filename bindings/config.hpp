// Fields of configurations as properties.
#pragma once

#include <pybind11/pybind11.h>

#include <cstddef>
#include <typeinfo>

namespace flockstep::bindings {

// Adds a property for each field of the BatchConfig that lies `offset` bytes from the beginning of the C++ object of a class.
void add_batch_fields(const pybind11::object& cls, const std::type_info& type, std::ptrdiff_t offset);

}  // namespace flockstep::bindings
