// Delay: when the readings of a sensor arrive, or that they are lost. Rings: the readings that are under way.
#pragma once

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/arrays.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

namespace flockstep::sensors {

// Returns the ticks after which a reading arrives.
inline std::int64_t ticks_in(double late_s, const ClockConfig& clock) {
  constexpr double kTolerance = 1e-3;  // ticks: rates and latencies are float32
  return std::max<std::int64_t>(static_cast<std::int64_t>(std::ceil(late_s / clock.dt_s() - kTolerance)), 0);
}

// Returns how many readings of a drone its ring holds: the newest one that has arrived, and those under way, which include one in
// each period and one after each step. 0 if readings arrive at once. period: in ticks; 0 means after every step.
template <class Config>
std::size_t ring_size(const Config& config, std::int64_t period, const ClockConfig& clock) {
  const std::int64_t latest = ticks_in(static_cast<double>(config.latency_s) + static_cast<double>(config.jitter_s), clock);
  if (latest == 0 && config.loss == 0.0F) return 0;
  const auto rounded_up = [&](std::int64_t ticks) { return (latest + ticks - 1) / ticks; };
  return static_cast<std::size_t>(1 + rounded_up(clock.substeps()) + (period == 0 ? 0 : rounded_up(period)));
}

class Delay {
 public:
  // label: of the sensor; each label has its own random numbers. Does nothing if readings cannot be older than a step.
  template <class Config>
  Delay(const Config& config, const std::string& label, std::int64_t period, const ClockConfig& clock, std::size_t drones_per_env,
        std::size_t num_drones)
      : latency_s_(static_cast<double>(config.latency_s)),
        jitter_s_(static_cast<double>(config.jitter_s)),
        loss_(config.loss),
        stream_(stream_named("delay of " + label)),
        clock_(clock),
        tick_s_(clock.dt_s()),
        drones_per_env_(drones_per_env),
        ring_size_(ring_size(config, period, clock)),
        size_(std::max<std::size_t>(ring_size_, period > 0 ? 1 : 0)),
        taken_(size_ * num_drones),
        arrival_(size_ * num_drones),
        count_(size_ > 0 ? num_drones : 0) {}

  bool is_none() const { return size_ == 0; }  // readings have no age
  bool is_late() const { return ring_size_ > 0; }
  std::size_t num_rows() const { return taken_.size(); }  // of the rings of all drones
  void forget(DroneIndex drone) {
    if (!is_none()) count_[drone] = 0;
  }
  void forget_all() { std::ranges::fill(count_, std::int64_t{0}); }

  // Adds the reading of a drone that is taken now. Returns its row in a ring; none if it is lost. Of several in the same tick the
  // last one counts.
  std::optional<std::size_t> add(const State& state, DroneIndex drone) {
    const RandomKey key = RandomKey::of(drone, drones_per_env_);
    const std::int64_t tick = state.tick[key.env];
    std::int64_t arrival = tick;
    if (count_[drone] > 0) {
      if (taken_[newest(drone)] == tick) return newest(drone);
      double late_s = latency_s_;
      if (jitter_s_ > 0.0 || loss_ > 0.0F) {
        const auto bits = draw(state, key, stream_, static_cast<std::uint32_t>(tick));
        if (uniform01(bits[0]) < loss_) return std::nullopt;
        late_s += static_cast<double>(uniform01(bits[1])) * jitter_s_;
      }
      arrival += ticks_in(late_s, clock_);
      // If the others are under way, as with readings between steps, the new one takes the place of the last.
      if (arrived(drone, tick) == place(drone, count_[drone])) --count_[drone];
    }
    ++count_[drone];
    taken_[newest(drone)] = tick;
    arrival_[newest(drone)] = arrival;
    return newest(drone);
  }
  // Returns the row of the newest reading that has arrived at this tick; none before the first.
  std::optional<std::size_t> arrived(DroneIndex drone, std::int64_t tick) const {
    if (count_[drone] == 0) return std::nullopt;
    const std::int64_t oldest = std::max<std::int64_t>(count_[drone] - static_cast<std::int64_t>(size_), 0);
    std::int64_t i = count_[drone] - 1;
    while (i > oldest && arrival_[place(drone, i)] > tick) --i;
    return place(drone, i);
  }
  float age_s(std::size_t row, std::int64_t tick) const { return seconds(tick - taken_[row]); }
  float seconds(std::int64_t ticks) const { return static_cast<float>(static_cast<double>(ticks) * tick_s_); }
  // Row of the drone's last reading that was not lost.
  std::size_t newest(DroneIndex drone) const { return place(drone, std::max<std::int64_t>(count_[drone] - 1, 0)); }

  void visit(ArrayVisitor& visitor) {
    if (is_none()) return;
    visitor.array("reading_tick", taken_);
    visitor.array("reading_arrival", arrival_);
    visitor.array("reading_count", count_);
  }
  // Throws std::invalid_argument if restored numbers cannot be used.
  void check() const {
    for (const auto& values : {std::span(taken_), std::span(arrival_), std::span(count_)}) {
      for (const std::int64_t value : values) {
        require(value >= 0 && value < (std::int64_t{1} << 62U), "snapshot: reading_count", "numbers in [0, 2^62)", value);
      }
    }
  }

 private:
  std::size_t place(DroneIndex drone, std::int64_t i) const { return size_ * drone + static_cast<std::size_t>(i) % size_; }

  double latency_s_, jitter_s_;
  float loss_;
  Stream stream_;
  ClockConfig clock_;
  double tick_s_;
  std::size_t drones_per_env_;
  std::size_t ring_size_;              // readings in the ring of a drone; 0 without rings
  std::size_t size_;                   // readings of a drone whose times are kept
  std::vector<std::int64_t> taken_;    // (N, size) ticks of the episode
  std::vector<std::int64_t> arrival_;  // (N, size) ticks of the episode
  std::vector<std::int64_t> count_;    // (N,) readings since the episode began
};

// Rings of what a sensor measures, unlike its ages and settings: rows of a Delay for each drone.
template <HasFields Arrays>
class Rings {
 public:
  // published: the arrays of a sensor, a row for each drone.
  void allocate(const Arrays& published, std::size_t num_drones, std::size_t num_rows) {
    num_drones_ = num_drones;
    for_each_reading([&](const auto& entry, auto& ring) {
      const auto& of_drones = published.*entry.member;
      if (num_drones > 0) ring.resize(of_drones.size() / num_drones * num_rows);
    });
  }
  Arrays& arrays() { return rings_; }
  const Arrays& arrays() const { return rings_; }
  void put(const Arrays& from, DroneIndex drone, std::size_t row) {
    for_each_reading([&](const auto& entry, auto& ring) {
      const auto& values = from.*entry.member;
      const std::size_t width = values.size() / num_drones_;
      std::copy_n(values.data() + drone * width, width, ring.data() + row * width);
    });
  }
  void get(std::size_t row, Arrays& to, DroneIndex drone) {
    for_each_reading([&](const auto& entry, auto& ring) {
      auto& values = to.*entry.member;
      const std::size_t width = values.size() / num_drones_;
      std::copy_n(ring.data() + row * width, width, values.data() + drone * width);
    });
  }
  void visit(ArrayVisitor& visitor) {
    for_each_reading([&](const auto& entry, auto& ring) { visitor.array(entry.name, ring); });
  }

 private:
  // Calls f(entry, array of the rings).
  template <class F>
  void for_each_reading(const F& f) {
    for_each_listed(rings_, [&](const auto& entry, auto& ring) {
      if constexpr (requires { entry.member == &Arrays::age_s; }) {
        if (entry.member == &Arrays::age_s) return;
      }
      if (std::string_view(entry.info.writer) == kFields<Arrays>.template get<0>().info.writer) f(entry, ring);
    });
  }

  Arrays rings_;
  std::size_t num_drones_ = 0;
};

}  // namespace flockstep::sensors
