// ServedBatch: a batch that several threads call, such as those of a server, and what they have to know of its growth.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <span>

#include "flockstep/batch.hpp"
#include "flockstep/export.hpp"

namespace flockstep {

// The slot that spawn() would give to one more drone.
struct NextSlot {
  EnvIndex env;    // the slot's env; E or more: a new env
  bool renumbers;  // other drones would have other indices
};

// While it exists, a call of the batch while another thread is in one waits for it; BatchLock makes several calls as one. Threads
// wait in the order of their calls, so a thread that steps in a loop lets the others in between.
class FLOCKSTEP_API ServedBatch {
 public:
  // before_long_call, if given, is called with the batch locked, at the start of each call that may take long and changes the
  // state: step, reset, fly, move, sense, capture, restore, spawn, and set_lidar or set_camera if they move the arrays. It may
  // call the batch; neither such calls nor those within a BatchLock call it again.
  explicit ServedBatch(Batch& batch, std::function<void()> before_long_call = {});
  ~ServedBatch();
  ServedBatch(const ServedBatch&) = delete;
  ServedBatch& operator=(const ServedBatch&) = delete;

  void end();                                 // ends the sharing now; threads that wait still get their turns
  static bool is_served(const Batch& batch);  // true while there is such an object

  // --- growth: spawn() may enlarge a batch without a task, and set_lidar() and set_camera() may change the shapes of its
  // arrays. References to its arrays and configurations then end, unless their memory() is kept.
  static std::int64_t generation(const Batch& batch);  // number of times that the arrays have moved
  static std::shared_ptr<const void> memory(
      const Batch& batch);  // keeps the current arrays alive; after a growth they change no more
  // Returns the next slot of the batch, or of an env if one is given. Throws std::invalid_argument as spawn() does.
  static NextSlot next_slot(const Batch& batch, std::span<const std::int64_t> env = {});
  // From now on, when the arrays move, `run` is called with a function that it must call once. It may hold a lock that all
  // readers of the arrays hold.
  static void run_moves_with(Batch& batch, std::function<void(const std::function<void()>&)> run);

 private:
  Batch* batch_;  // null after end()
};

}  // namespace flockstep
