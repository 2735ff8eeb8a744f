// The native module flockstep._core. This file lists the parts that it registers.
#include <pybind11/pybind11.h>
#include <pybind11/stl.h>

#include <exception>
#include <string>
#include <string_view>
#include <vector>

#include "base/nearest_name.hpp"
#include "base/platform.hpp"
#include "base/require.hpp"
#include "convert.hpp"
#include "documents.hpp"
#include "flockstep/version.hpp"
#include "trace/user_geometry.hpp"

namespace flockstep::bindings {
void register_config(pybind11::module_& module);
void register_drone_model(pybind11::module_& module);
void register_world(pybind11::module_& module);
void register_world_builder(pybind11::module_& module);
void register_survey(pybind11::module_& module);
void register_color_blob(pybind11::module_& module);
void register_task(pybind11::module_& module);
void register_batch(pybind11::module_& module);
void register_recipe(pybind11::module_& module);
void register_server(pybind11::module_& module);
void register_learner(pybind11::module_& module);
namespace {

// Rejects objects from a plain `cls.__new__(cls)`, which have no value. pybind11 would give them uninitialized memory.
void refuse_uninitialised_objects(const pybind11::module_& module) {
  for (const auto& [name, item] : pybind11::dict(module.attr("__dict__"))) {
    if (!pybind11::isinstance<pybind11::type>(item)) continue;
    auto* const info = pybind11::detail::get_type_info(reinterpret_cast<PyTypeObject*>(item.ptr()));
    if (info == nullptr) continue;
    info->operator_new = [](std::size_t) -> void* {
      throw pybind11::type_error("this object was never initialised: create it by calling its class");
    };
  }
}

}  // namespace
}  // namespace flockstep::bindings

PYBIND11_MODULE(_core, module) {
  if (!flockstep::has_instructions()) {
    throw pybind11::import_error("flockstep needs a processor with SSE4.2 (x86-64-v2), as nearly all since 2009 have");
  }
  pybind11::register_exception_translator([](std::exception_ptr thrown) {
    try {
      if (thrown) std::rethrow_exception(thrown);
    } catch (const flockstep::MissingFile& error) {
      const auto type = pybind11::module_::import("flockstep.errors").attr("MissingFileError");
      pybind11::set_error(type, error.what());
    }
  });
  module.attr("__version__") = FLOCKSTEP_VERSION;
  module.attr("embree_version") =
      std::to_string(RTC_VERSION_MAJOR) + "." + std::to_string(RTC_VERSION_MINOR) + "." + std::to_string(RTC_VERSION_PATCH);
  module.attr("simd_target") = flockstep::trace::simd_target();
  flockstep::bindings::register_config(module);
  flockstep::bindings::register_drone_model(module);
  flockstep::bindings::register_world(module);
  flockstep::bindings::register_world_builder(module);
  flockstep::bindings::register_survey(module);
  flockstep::bindings::register_color_blob(module);
  flockstep::bindings::register_task(module);
  flockstep::bindings::register_recipe(module);
  flockstep::bindings::register_batch(module);
  flockstep::bindings::register_server(module);
  flockstep::bindings::register_learner(module);
  module.def("_unexpected_keyword", &flockstep::bindings::unexpected_keyword, pybind11::arg("callee"), pybind11::arg("keyword"),
             pybind11::arg("known"));
  module.def(
      "_nearest_name",
      [](const std::string& name, const std::vector<std::string>& known) {
        return std::string(flockstep::nearest_name(name, std::vector<std::string_view>(known.begin(), known.end())));
      },
      pybind11::arg("name"), pybind11::arg("known"));
  pybind11::dict renamed;
  for (const auto& [former, present] : flockstep::renamed()) renamed[pybind11::str(former)] = present;
  module.attr("_renamed") = renamed;
  flockstep::bindings::document(module);
  flockstep::bindings::refuse_uninitialised_objects(module);
}
