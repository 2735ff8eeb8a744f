// Exposes fields of configurations as properties.
#pragma once

#include <pybind11/pybind11.h>

#include <cstddef>
#include <initializer_list>
#include <typeinfo>

#include "flockstep/config.hpp"

namespace flockstep::bindings {

// Adds a property for each field of a BatchConfig that is embedded in the C++ object of a class, `offset` bytes from its
// beginning.
void add_batch_fields(const pybind11::object& cls, const std::type_info& type, std::ptrdiff_t offset);

// Sets the fields of a batch that a call gives as keywords; None changes nothing. Throws TypeError that names `callee`
// for a keyword that is neither such a field nor among the `others` that the call has.
void set_batch_fields(BatchConfig& config, const pybind11::kwargs& keywords, const char* callee,
                      std::initializer_list<const char*> others);

}  // namespace flockstep::bindings
