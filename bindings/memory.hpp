// The memory of a batch's arrays, as an object that views keep alive.
#pragma once

#include <pybind11/pybind11.h>

#include <memory>

#include "flockstep/batch.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep::bindings {

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
