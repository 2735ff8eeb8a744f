// Docstrings and signatures of the module at run time.
#pragma once

#include <pybind11/pybind11.h>

#include <string>
#include <string_view>

#include "flockstep/task_words.hpp"

namespace flockstep::bindings {

// Breaks a text into lines that fit into a docstring, each with the indent.
std::string wrapped(std::string_view text, std::string_view indent);

// Returns the words of a task as a docstring, `about` first.
std::string docstring_of(const char* about, const TaskWords& words);

// Sets the docstrings from core.pyi on the module's objects, with signatures that inspect can parse. For configurations, adds the
// fields.
void document(pybind11::module_& module);

}  // namespace flockstep::bindings
