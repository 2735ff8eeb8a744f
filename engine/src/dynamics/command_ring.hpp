// CommandRing: the latest commands of each drone, with the ticks at which they arrive.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/index.hpp"

namespace flockstep::dynamics {

class CommandRing {
 public:
  CommandRing() = default;
  // most: commands that may be under way at once, besides the one that holds. width: numbers of a command.
  CommandRing(std::size_t num_drones, std::size_t most, std::size_t width)
      : size_(most + 2), width_(width), command_(width * size_ * num_drones), arrival_(size_ * num_drones), count_(num_drones) {}

  bool empty() const { return size_ == 0; }
  std::size_t most() const { return empty() ? 0 : size_ - 2; }
  std::size_t size() const { return size_; }  // places of a drone
  // The place of the newest command of a drone that has one.
  std::size_t newest(DroneIndex drone) const { return static_cast<std::size_t>(count_[drone] - 1) % size_; }
  bool has_none(DroneIndex drone) const { return count_[drone] == 0; }
  void clear(DroneIndex drone) { count_[drone] = 0; }
  // Adds a command that takes effect at this tick of the episode.
  void add(DroneIndex drone, const float* command, std::int64_t arrival) {
    const std::size_t at = size_ * drone + static_cast<std::size_t>(count_[drone]++) % size_;
    std::copy_n(command, width_, command_.data() + width_ * at);
    arrival_[at] = arrival;
  }

  // Calls f(command, arrival, its place in the ring) for the command that holds at tick `from`, and for later ones that take
  // effect before tick `to`, in the order in which they were given.
  template <class F>
  void for_each(DroneIndex drone, std::int64_t from, std::int64_t to, const F& f) const {
    const std::int64_t newest = count_[drone] - 1,
                       oldest = std::max<std::int64_t>(count_[drone] - static_cast<std::int64_t>(size_), 0);
    std::int64_t held = newest;
    while (held > oldest && arrival_[place(drone, held)] > from) --held;
    for (std::int64_t i = held; i <= newest; ++i) {
      const std::size_t at = place(drone, i);
      if (i == held || arrival_[at] < to) f(command_.data() + width_ * at, arrival_[at], at - size_ * drone);
    }
  }

  void visit(ArrayVisitor& visitor) {
    visitor.array("ring_command", command_);
    visitor.array("ring_arrival", arrival_);
    visitor.array("ring_count", count_);
  }
  // True if restored numbers can be used.
  bool is_valid() const {
    return std::ranges::all_of(count_, [](std::int64_t count) { return count >= 0 && count < (std::int64_t{1} << 62U); });
  }

 private:
  std::size_t place(DroneIndex drone, std::int64_t i) const { return size_ * drone + static_cast<std::size_t>(i) % size_; }

  std::size_t size_ = 0, width_ = 0;
  std::vector<float> command_;         // (N, size, width)
  std::vector<std::int64_t> arrival_;  // (N, size) ticks of the episode
  std::vector<std::int64_t> count_;    // (N,) commands since the episode began
};

}  // namespace flockstep::dynamics
