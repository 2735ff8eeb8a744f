#include "documents.hpp"

#include <cstdlib>
#include <cstring>
#include <string>
#include <string_view>

namespace flockstep::bindings {
namespace {

namespace py = pybind11;

struct Document {
  std::string_view path;  // "", "function", "Class" or "Class.member"
  std::string_view signature;
  std::string_view text;
};

constexpr Document kDocuments[] = {
#include "documents.inc"  // generated from the stub by documents.py
};

// Returns the C function inside a method object; null if there is none.
PyObject* function_of(PyObject* object) {
  if (PyInstanceMethod_Check(object)) object = PyInstanceMethod_GET_FUNCTION(object);
  return PyCFunction_Check(object) ? object : nullptr;
}

// CPython reads the signature from the beginning of the docstring, up to "--". The text must be allocated with malloc, because
// pybind11 frees it.
void document_function(PyObject* function, std::string_view name, const Document& document) {
  std::string text(name);
  text.append(document.signature).append("\n--\n\n").append(document.text);
  PyMethodDef* const method = reinterpret_cast<PyCFunctionObject*>(function)->m_ml;
  std::free(const_cast<char*>(method->ml_doc));
  char* const copy = static_cast<char*>(std::malloc(text.size() + 1));
  if (copy != nullptr) std::memcpy(copy, text.c_str(), text.size() + 1);
  method->ml_doc = copy;
}

}  // namespace

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
      document_function(function, name, document);
    } else {
      object.attr("__doc__") = py::str(document.text.data(), document.text.size());
    }
  }
}

}  // namespace flockstep::bindings
