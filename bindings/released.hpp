// Runs work without the interpreter lock, interruptible by Ctrl-C, and reports warnings of a batch.
#pragma once

#include <pybind11/pybind11.h>

#include <optional>
#include <string>

#include "base/interrupt.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep::bindings {

// Issues the batch's pending warnings as RuntimeWarning.
inline void warn(Batch& batch) {
  for (std::string warning = batch.take_warning(); !warning.empty(); warning = batch.take_warning()) {
    if (PyErr_WarnEx(PyExc_RuntimeWarning, warning.c_str(), 1) != 0) throw pybind11::error_already_set();
  }
}

// Raises the exceptions of signal handlers, such as KeyboardInterrupt, to end work that polls. As always in Python, handlers
// run only on the main thread.
inline void raise_signals() {
  const pybind11::gil_scoped_acquire acquire;
  if (PyErr_CheckSignals() != 0) throw pybind11::error_already_set();
}

// Returns the result of f.
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

// Returns the lock of a batch. If another thread is in a call on a served batch, waits for it first, without the interpreter
// lock, which that thread may need.
inline std::optional<BatchLock> lock_in_turn(const Batch& batch) {
  std::optional<BatchLock> lock = BatchLock::try_lock(batch);
  if (!lock && ServedBatch::is_served(batch)) released([&] { lock.emplace(batch); });
  return lock;
}

// Returns the result of f, a short call on the batch that keeps the interpreter lock.
template <class F>
auto in_turn(const Batch& batch, const F& f) {
  const std::optional<BatchLock> lock = lock_in_turn(batch);
  return f();
}

}  // namespace flockstep::bindings
