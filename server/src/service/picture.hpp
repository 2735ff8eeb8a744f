// Picture: the colours of a frame. PictureMemory: the memory of pictures that are no longer needed, for the next ones. New memory
// of this size costs more than the copy of the colours into it.
#pragma once

#include <cstddef>
#include <cstdint>
#include <mutex>
#include <utility>
#include <vector>

namespace flockstep::server {

struct Picture {
  std::vector<std::uint8_t> rgb;  // from row to row, from the top
  int width_px = 0, height_px = 0;
};

class PictureMemory {
 public:
  std::vector<std::uint8_t> take() {
    const std::scoped_lock lock(mutex_);
    if (spare_.empty()) return {};
    std::vector<std::uint8_t> memory = std::move(spare_.back());
    spare_.pop_back();
    bytes_ -= memory.capacity();
    return memory;
  }
  void give_back(std::vector<std::uint8_t> memory) {
    constexpr std::size_t kMost = std::size_t{1} << 24;
    const std::scoped_lock lock(mutex_);
    if (bytes_ + memory.capacity() > kMost) return;
    bytes_ += memory.capacity();
    spare_.push_back(std::move(memory));
  }

 private:
  std::mutex mutex_;
  std::vector<std::vector<std::uint8_t>> spare_;
  std::size_t bytes_ = 0;
};

}  // namespace flockstep::server
