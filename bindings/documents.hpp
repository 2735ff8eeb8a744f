// Docstrings and signatures of the module at run time.
#pragma once

#include <pybind11/pybind11.h>

namespace flockstep::bindings {

// Sets the docstrings from _core.pyi on the module's objects, with signatures that inspect can parse.
void document(pybind11::module_& module);

}  // namespace flockstep::bindings
