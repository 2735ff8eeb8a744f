// The native module swiftlet._core: a list of what it registers.
#include <pybind11/pybind11.h>

#include "swiftlet/version.hpp"
#include "trace/user_geometry.hpp"

namespace swiftlet::bindings {
void register_config(pybind11::module_& module);
void register_drone_model(pybind11::module_& module);
void register_world(pybind11::module_& module);
void register_plan(pybind11::module_& module);
void register_green_blob(pybind11::module_& module);
void register_camera(pybind11::module_& module);
void register_batch(pybind11::module_& module);
}  // namespace swiftlet::bindings

PYBIND11_MODULE(_core, module) {
  module.doc() = "The native module of swiftlet.";
  module.attr("__version__") = SWIFTLET_VERSION;
  module.attr("embree_version") =
      std::to_string(RTC_VERSION_MAJOR) + "." + std::to_string(RTC_VERSION_MINOR) + "." + std::to_string(RTC_VERSION_PATCH);
  module.attr("simd_target") = swiftlet::trace::simd_target();
  swiftlet::bindings::register_config(module);
  swiftlet::bindings::register_drone_model(module);
  swiftlet::bindings::register_world(module);
  swiftlet::bindings::register_plan(module);
  swiftlet::bindings::register_green_blob(module);
  swiftlet::bindings::register_camera(module);
  swiftlet::bindings::register_batch(module);
}
