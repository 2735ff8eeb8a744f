#include "swiftlet/plan.hpp"

#include <pybind11/stl.h>

#include "arrays.hpp"

namespace swiftlet::bindings {
void register_plan(py::module_& module);
}
