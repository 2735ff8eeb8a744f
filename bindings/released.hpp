// Work without the interpreter lock, which Ctrl-C ends, and the warnings that a batch leaves.
#pragma once

#include <pybind11/pybind11.h>

#include <string>

#include "base/interrupt.hpp"
#include "flockstep/batch.hpp"

namespace flockstep::bindings {

// Passes on what the batch has to say, as a RuntimeWarning.
inline void warn(Batch& batch) {
  for (std::string warning = batch.take_warning(); !warning.empty(); warning = batch.take_warning()) {
    if (PyErr_WarnEx(PyExc_RuntimeWarning, warning.c_str(), 1) != 0) throw pybind11::error_already_set();
  }
}

// What a signal's handler raises, such as KeyboardInterrupt, ends work that polls. On the main thread alone, as in all of Python.
inline void raise_signals() {
  const pybind11::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() != 0) throw pybind11::error_already_set();
}

// Returns what f does.
template <class F>
auto released(const F& f) {
  const pybind11::gil_scoped_release release;
  const Interrupt interrupt(raise_signals);
  return f();
}

template <class F>
void released(Batch& batch, const F& f) {
  released(f);
  warn(batch);
}

}  // namespace flockstep::bindings
