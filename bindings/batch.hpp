// The class Batch, whose members several files add.
#pragma once

#include <pybind11/pybind11.h>

#include <cstdint>
#include <memory>
#include <string>

#include "base/require.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/served_batch.hpp"

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
// Adds the configurations of all sensors, and the arrays of those that have no class of their own.
void add_sensors(BatchClass& cls);
void add_gradient(BatchClass& cls);
void add_task(BatchClass& cls);
void add_terms(pybind11::module_& module, BatchClass& cls);

// Lists the sensors of a batch: ", a LiDAR of 32 rays, an IMU".
std::string describe_sensors(const BatchConfig& config);

inline pybind11::ssize_t num_drones(const Batch& batch) { return batch.config().num_drones(); }
inline pybind11::ssize_t num_envs(const Batch& batch) { return batch.config().num_envs; }

// Returns a number of Python's as the index of a drone.
inline DroneIndex drone_at(const Batch& batch, std::int64_t index) {
  const std::int64_t end = num_drones(batch);
  require(index >= 0 && index < end, "index", "an integer in [0, " + std::to_string(end) + ")", index);
  return DroneIndex(index);
}

inline std::string counted(std::int64_t count, const std::string& noun) {
  return std::to_string(count) + " " + noun + (count == 1 ? "" : "s");
}

// The memory of a batch's arrays, as an object that views keep alive.
// The batch itself if it has a task: its arrays never move. Otherwise they may move while views of them exist.
inline pybind11::object memory_of(const pybind11::object& owner) {
  using Memory = std::shared_ptr<const void>;
  const auto& batch = owner.cast<const Batch&>();
  if (batch.task() != nullptr) return owner;
  auto memory = std::make_unique<Memory>(ServedBatch::memory(batch));
  pybind11::capsule capsule(memory.get(), [](void* held) { delete static_cast<Memory*>(held); });
  static_cast<void>(memory.release());
  return capsule;
}

}  // namespace flockstep::bindings
