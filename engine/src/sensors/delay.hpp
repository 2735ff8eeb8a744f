// Delay: the latest readings of a sensor of each drone, with the ticks at which they were taken. It publishes those that have
// arrived, and their age.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string_view>
#include <tuple>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"

namespace flockstep::sensors {

// Returns the ticks after which readings arrive.
inline std::int64_t latency_in_ticks(float latency_s, const ClockConfig& clock) {
  constexpr double kTolerance = 1e-3;  // ticks: rates and latencies are float32
  return std::max<std::int64_t>(static_cast<std::int64_t>(std::ceil(static_cast<double>(latency_s) / clock.dt_s() - kTolerance)),
                                0);
}

// Returns how many readings may be under way at once, which include one in each tick of the period and one after each step.
inline std::size_t readings_under_way(std::int64_t latency, std::int64_t period, const ClockConfig& clock) {
  if (latency == 0) return 0;
  const std::int64_t by_period = period == 0 ? 0 : latency / period + 1;
  return static_cast<std::size_t>(by_period + latency / clock.substeps() + 3);
}

template <HasFields Arrays>
class Delay {
 public:
  // latency, period: in ticks; 0 means after every step. Does nothing if readings cannot be older than a step.
  Delay(std::int64_t latency, std::int64_t period, const ClockConfig& clock, ArraySizes sizes)
      : is_none_(latency == 0 && period == 0),
        latency_(latency),
        dt_s_(clock.dt_s()),
        size_(std::max<std::size_t>(readings_under_way(latency, period, clock), 1)) {
    if (is_none_) return;
    taken_.resize(size_ * sizes.num_drones);
    count_.resize(sizes.num_drones);
    if (latency == 0) return;
    sizes.num_drones *= size_;
    allocate(ring_, sizes);
    for_each_listed(ring_, [](const auto& entry, auto& values) {
      if (!is_reading(entry)) values = {};
    });
  }

  bool is_none() const { return is_none_; }  // readings have no age
  bool is_late() const { return latency_ > 0; }
  void forget(DroneIndex drone) {
    if (!is_none()) count_[drone] = 0;
  }
  void forget_all() { std::ranges::fill(count_, std::int64_t{0}); }

  // Adds the reading of a drone that was taken at this tick. Of several in the same tick the last one counts.
  void add(DroneIndex drone, std::int64_t tick, const Arrays& from) {
    if (count_[drone] == 0 || taken_[place(drone, count_[drone] - 1)] != tick) ++count_[drone];
    const std::size_t to = place(drone, count_[drone] - 1);
    taken_[to] = tick;
    if (is_late()) copy_row(from, drone, ring_, to);
  }
  // Publishes the newest reading that has arrived at this tick.
  void publish(DroneIndex drone, std::int64_t tick, Arrays& to) const {
    if (count_[drone] == 0) return;
    const std::int64_t newest = count_[drone] - 1,
                       oldest = std::max<std::int64_t>(count_[drone] - static_cast<std::int64_t>(size_), 0);
    std::int64_t arrived = newest;
    while (arrived > oldest && taken_[place(drone, arrived)] + latency_ > tick) --arrived;
    const std::size_t from = place(drone, arrived);
    if (is_late()) copy_row(ring_, from, to, drone);
    to.age_s[drone] = static_cast<float>(static_cast<double>(tick - taken_[from]) * dt_s_);
  }

  void visit(ArrayVisitor& visitor) {
    if (is_none()) return;
    for_each_listed(ring_, [&](const auto& entry, auto& values) {
      if (is_late() && is_reading(entry)) visitor.array(entry.name, values);
    });
    visitor.array("reading_tick", taken_);
    visitor.array("reading_count", count_);
  }
  // True if restored numbers can be used.
  bool is_valid() const {
    const auto is_count = [](std::int64_t value) { return value >= 0 && value < (std::int64_t{1} << 62U); };
    return std::ranges::all_of(count_, is_count) && std::ranges::all_of(taken_, is_count);
  }

 private:
  // True for arrays that the sensor measures, unlike its age and settings.
  template <class Entry>
  static bool is_reading(const Entry& entry) {
    if constexpr (requires { entry.member == &Arrays::age_s; }) {
      if (entry.member == &Arrays::age_s) return false;
    }
    return std::string_view(entry.info.writer) == std::get<0>(kFields<Arrays>).info.writer;
  }
  std::size_t place(DroneIndex drone, std::int64_t i) const { return size_ * drone + static_cast<std::size_t>(i) % size_; }
  // Rows of `ring_` and of published arrays have the same width.
  void copy_row(const Arrays& from, std::size_t from_row, Arrays& to, std::size_t to_row) const {
    for_each_listed(to, [&](const auto& entry, auto& values) {
      if (!is_reading(entry)) return;
      const auto& source = from.*entry.member;
      const std::size_t width = (ring_.*entry.member).size() / taken_.size();
      std::copy_n(source.data() + from_row * width, width, values.data() + to_row * width);
    });
  }

  bool is_none_;
  std::int64_t latency_;             // ticks
  double dt_s_;                      // s, length of a tick
  std::size_t size_;                 // readings in the ring of a drone
  Arrays ring_;                      // (N size, ...)
  std::vector<std::int64_t> taken_;  // (N, size) ticks of the episode
  std::vector<std::int64_t> count_;  // (N,) readings since the episode began
};

}  // namespace flockstep::sensors
