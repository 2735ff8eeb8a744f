// The class Batch, whose members several files add.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>
#include <string>

#include "flockstep/batch.hpp"

namespace flockstep::bindings {

// Releases the interpreter lock, because deleting a batch waits for its threads.
struct Released {
  void operator()(Batch* batch) const {
    const pybind11::gil_scoped_release release;
    std::default_delete<Batch>()(batch);
  }
};

using BatchClass = pybind11::class_<Batch, std::unique_ptr<Batch, Released>>;

// Each adds members of Batch, and the classes that they return.
void add_bodies(pybind11::module_& module, BatchClass& cls);
void add_cameras(pybind11::module_& module, BatchClass& cls);
void add_lidars(pybind11::module_& module, BatchClass& cls);
void add_task(BatchClass& cls);
void add_terms(pybind11::module_& module, BatchClass& cls);

inline pybind11::ssize_t num_drones(const Batch& batch) { return batch.config().num_drones(); }
inline pybind11::ssize_t num_envs(const Batch& batch) { return batch.config().num_envs; }
inline std::string counted(std::int64_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

}  // namespace flockstep::bindings
