// Workers: the threads of one batch, in an arena of their own, each with its scratch.
#pragma once

#include <oneapi/tbb/blocked_range.h>
#include <oneapi/tbb/parallel_for.h>
#include <oneapi/tbb/task_arena.h>

#include <cstdint>
#include <memory>
#include <vector>

#include "render/raycast_renderer.hpp"
#include "sensors/lidar.hpp"
#include "task/green_blob.hpp"
#include "trace/handover.hpp"
#include "trace/scene.hpp"

namespace swiftlet {

// What one thread needs while it steps a block; made once.
struct Scratch {
  sensors::ScanScratch scan;
  render::RaycastScratch raycast;
  task::GreenBlobScratch green;
  std::vector<std::uint32_t> drones;  // those of the block that a stage is about
  bool changed_world = false;         // a reset moved a drone to another world

  explicit Scratch(std::size_t block_size) { drones.reserve(block_size); }
};

class Workers {
 public:
  Workers(int num_threads, std::size_t block_size) : arena_(num_threads) {
    for (int i = 0; i < num_threads; ++i) scratch_.push_back(std::make_unique<Scratch>(block_size));
  }

  int num_threads() const { return static_cast<int>(scratch_.size()); }
  std::vector<std::unique_ptr<Scratch>>& scratch() { return scratch_; }

  // Calls f on the calling thread; what it does in parallel, it does on these threads.
  template <class F>
  void within(const F& f) {
    arena_.execute(f);
  }

  // Calls f(index, Scratch&) for every index in [0, count), in no particular order.
  template <class F>
  void run(std::size_t count, const F& f) {
    if (count <= 1 || num_threads() == 1) {  // not worth, or not able, to wake anyone
      const trace::FlushDenormals flush;
      for (std::size_t i = 0; i < count; ++i) f(i, *scratch_[0]);
      return;
    }
    static const char forked = 0;  // static: before a task has acquired it, it may read nothing of this frame
    const char joined = 0;
    handover::release(&forked);
    arena_.execute([&] {
      tbb::parallel_for(
          tbb::blocked_range<std::size_t>(0, count, 1),
          [&](const tbb::blocked_range<std::size_t>& range) {
            handover::acquire(&forked);
            const trace::FlushDenormals flush;
            Scratch& scratch = *scratch_[static_cast<std::size_t>(tbb::this_task_arena::current_thread_index())];
            for (std::size_t i = range.begin(); i != range.end(); ++i) f(i, scratch);
            handover::release(&joined);
          },
          tbb::simple_partitioner());
    });
    handover::acquire(&joined);
  }

 private:
  tbb::task_arena arena_;
  std::vector<std::unique_ptr<Scratch>> scratch_;
};

}  // namespace swiftlet
