// Refuses masked arrays of NumPy.
#pragma once

#include <pybind11/numpy.h>
#include <pybind11/pybind11.h>

#include <string>

namespace flockstep::bindings {

// Throws ValueError for a masked array: its mask would be lost.
inline void refuse_masked(const pybind11::handle& value, const std::string& field) {
  PyTypeObject* const array = pybind11::detail::npy_api::get().PyArray_Type_;
  if (Py_TYPE(value.ptr()) == array || PyObject_TypeCheck(value.ptr(), array) == 0) return;
  if (!pybind11::isinstance(value, pybind11::module_::import("numpy").attr("ma").attr("MaskedArray"))) return;
  throw pybind11::value_error(field + ": expected an array without a mask, got a masked array: call filled() first");
}

}  // namespace flockstep::bindings
