// The docstrings and signatures of the module at run time.
#pragma once

#include <pybind11/pybind11.h>

namespace flockstep::bindings {

// Gives everything that _core.pyi documents the text that stands there, and signatures that inspect understands.
void document(pybind11::module_& module);

}  // namespace flockstep::bindings
