// Work of a batch without the interpreter lock, and the warnings it leaves.
#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "flockstep/batch.hpp"

namespace flockstep::bindings {

// Passes on what the batch has to say, as a RuntimeWarning.
inline void warn(Batch& batch) {
  const std::string warning = batch.take_warning();
  if (!warning.empty() && PyErr_WarnEx(PyExc_RuntimeWarning, warning.c_str(), 1) != 0) throw pybind11::error_already_set();
}

template <class F>
void released(Batch& batch, const F& f) {
  {
    const pybind11::gil_scoped_release release;
    f();
  }
  warn(batch);
}

}  // namespace flockstep::bindings
