#include "documents.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>
#include <utility>

namespace flockstep::bindings {
namespace {

namespace py = pybind11;

struct Document {
  std::string_view path;  // "", "function", "Class" or "Class.member"
  std::string_view signature;
  std::string_view text;
};

constexpr Document kDocuments[] = {
#include "documents.inc"  // generated from core.pyi by documents.py
};

// Returns the C function inside a method object; null if there is none.
PyObject* function_of(PyObject* object) {
  if (PyInstanceMethod_Check(object)) object = PyInstanceMethod_GET_FUNCTION(object);
  return PyCFunction_Check(object) ? object : nullptr;
}

// CPython reads the signature from the beginning of the docstring, up to "--". The text must be allocated with malloc, because
// pybind11 frees it.
void document_function(PyObject* function, std::string_view name, std::string_view signature, std::string_view about) {
  std::string text(name);
  text.append(signature).append("\n--\n\n").append(about);
  PyMethodDef* const method = reinterpret_cast<PyCFunctionObject*>(function)->m_ml;
  std::free(const_cast<char*>(method->ml_doc));
  char* const copy = static_cast<char*>(std::malloc(text.size() + 1));
  if (copy != nullptr) std::memcpy(copy, text.c_str(), text.size() + 1);
  method->ml_doc = copy;
}

// Returns the descriptions of the fields of a configuration, which may be none of the module's classes, or of the arguments of a
// class.
py::object fields_of(const py::module_& module, std::string_view kind, const std::string& config) {
  const py::dict changes = module.attr("_changes");
  if (kind == "Changes" && changes.contains(config)) return changes[config.c_str()];
  const py::dict arguments = module.attr("_arguments");
  if (arguments.contains(config)) return arguments[config.c_str()];
  const py::dict others = module.attr("_other_fields");
  return others.contains(config) ? others[config.c_str()] : py::object(module.attr(config.c_str()).attr("_fields"));
}

// Returns the section "Parameters" of a docstring for some fields, or further entries of it. A required one has no default.
std::string parameters(const py::object& fields, bool is_first_required, bool is_begun = false) {
  std::string text = is_begun ? "" : "\n\nParameters\n----------";
  for (const py::handle field : fields) {
    const char* const what = std::exchange(is_first_required, false) ? "about" : "doc";
    text += '\n' + std::string(py::str(field["name"])) + '\n' + wrapped(std::string(py::str(field[what])), "    ");
  }
  return text;
}

// Returns fields as arguments of a signature: "fields" are keywords with their defaults, "changes" are None by default,
// "arguments" may also be positional, and the first is required.
std::string arguments(const py::object& fields, std::string_view kind, bool begins_keywords) {
  std::string text = begins_keywords ? "*" : "";
  for (const py::handle field : fields) {
    const bool is_required = kind == "Arguments" && text.empty();
    text += (text.empty() ? "" : ", ") + std::string(py::str(field["name"]));
    if (!is_required) text += '=' + (kind == "Changes" ? std::string("None") : std::string(py::str(field["default"])));
  }
  return text;
}

// Replaces "**Fields_A", "**Changes_A" or "**Arguments_A", which stand for the fields of the configuration A. The docstring of a
// function with such arguments lists them.
void insert_fields(std::string& signature, std::string& text, const py::module_& module) {
  const std::size_t start = signature.find("**"), name = signature.find('_', start);
  if (start == std::string::npos || name == std::string::npos) return;
  const std::size_t end = signature.find_first_of(",)", start);
  const std::string kind = signature.substr(start + 2, name - start - 2);
  if (kind != "Fields" && kind != "Changes" && kind != "Arguments") return;
  const py::object fields = fields_of(module, kind, signature.substr(name + 1, end - name - 1));
  const bool begins_keywords = kind != "Arguments" && signature.find("*,") > start;
  signature.replace(start, end - start, arguments(fields, kind, begins_keywords));
  if (kind == "Arguments") text += parameters(fields, true);
}

// Adds the fields of a configuration to its docstring, and its constructor's signature.
void document_fields(const py::handle& config) {
  const py::object fields = config.attr("_fields");
  config.attr("__doc__") = std::string(py::str(config.attr("__doc__"))) + parameters(fields, false);
  const py::object init = config.attr("__dict__")["__init__"];
  const std::string signature = "(self, " + arguments(fields, "Fields", true) + ')';
  document_function(function_of(init.ptr()), "__init__", signature, "The class documents the arguments.");
  if (!config.attr("__dict__").contains("preset")) return;
  const py::object preset = config.attr("__dict__")["preset"].attr("__func__");
  const std::string doc = py::str(preset.attr("__doc__")), end = "\n\n";  // of pybind11's signature, if core.pyi has none
  if (!doc.starts_with("preset(")) return;
  document_function(function_of(preset.ptr()), "preset", "(product)", doc.substr(doc.find(end) + end.size()));
}

}  // namespace

std::string wrapped(std::string_view text, std::string_view indent) {
  constexpr std::size_t kWidth = 112;  // columns of a class's docstring, in lines of 120
  std::string lines(indent);
  std::size_t used = 0;
  for (std::size_t at = 0; at < text.size();) {
    const std::size_t end = std::min(text.find(' ', at), text.size());
    if (used > 0 && used + 1 + (end - at) > kWidth) {
      (lines += '\n') += indent;
      used = 0;
    }
    if (used > 0) lines += ' ';
    lines += text.substr(at, end - at);
    used += (used > 0 ? 1 : 0) + end - at;
    at = end + 1;
  }
  return lines;
}

std::string docstring_of(const char* about, const TaskWords& words) {
  std::string text = about;
  const auto add = [&](const std::string& paragraph) { text += "\n\n" + wrapped(paragraph, ""); };
  const auto add_list = [&](const std::string& paragraph, const std::vector<TaskPart>& parts) {
    add(paragraph);
    text += '\n';
    for (const TaskPart& part : parts) {
      text += "\n- " + wrapped(std::string(part.name) + ": " + std::string(part.about), "  ").substr(2);
    }
  };
  add(words.about);
  add("**Start**: " + std::string(words.start));
  add("**Action**: " + std::string(words.action));
  add_list("**Observation**: " + std::string(words.observed), words.observation);
  add_list("**Reward**: The sum of these terms:", words.reward);
  add("**End**: " + std::string(words.end));
  return text;
}

void document(py::module_& module) {
  for (const Document& document : kDocuments) {
    if (document.path.empty()) {
      module.doc() = py::str(document.text.data(), document.text.size());
      continue;
    }
    const std::size_t dot = document.path.find('.');
    const py::object owner = dot == std::string_view::npos
                                 ? py::object(module)
                                 : py::object(module.attr(std::string(document.path.substr(0, dot)).c_str()));
    const std::string name(dot == std::string_view::npos ? document.path : document.path.substr(dot + 1));
    const py::object dict = owner.attr("__dict__");
    if (!dict.contains(name)) continue;  // a test reports these
    py::object object = dict[name.c_str()];
    if (py::hasattr(object, "__func__")) object = object.attr("__func__");  // static method
    if (PyObject* const function = function_of(object.ptr())) {
      std::string signature(document.signature), text(document.text);
      insert_fields(signature, text, module);
      document_function(function, name, signature, text);
    } else {
      object.attr("__doc__") = py::str(document.text.data(), document.text.size());
    }
  }
  for (const auto& [name, fields] : py::dict(module.attr("_arguments"))) {
    const py::object cls = module.attr(name);
    cls.attr("__doc__") =
        std::string(py::str(cls.attr("__doc__"))) + parameters(py::reinterpret_borrow<py::object>(fields), false, true);
  }
  for (const auto& [name, item] : py::dict(module.attr("__dict__"))) {
    if (py::isinstance<py::type>(item) && py::hasattr(item, "_fields")) document_fields(item);
  }
}

}  // namespace flockstep::bindings
