// LateCommands: which commands the drones of a window flew, and when, if their commands may be late or lost.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/index.hpp"
#include "flockstep/state.hpp"
#include "tasks/flight_gradient.hpp"

namespace flockstep::learning {

class LateCommands {
 public:
  static constexpr std::int32_t kBefore = -1;

  // Part of a step in which a drone flew one command: from a tick of the step to the next stretch.
  struct Stretch {
    std::int64_t from;
    std::int32_t sent;  // step of the window that sent it; kBefore: an earlier one
    std::array<float, 4> command;
  };

  // Listens to the fleet as long as it lives.
  LateCommands(dynamics::Fleet& fleet, const State& state, std::size_t num_drones) : fleet_(fleet), drones_(num_drones) {
    for (OfDrone& drone : drones_) drone.sent.resize(fleet.commands.size(), kBefore);
    fleet.on_sent = [this, &state](DroneIndex drone, bool is_sent) { note(state, drone, is_sent); };
  }
  ~LateCommands() { fleet_.on_sent = nullptr; }
  LateCommands(const LateCommands&) = delete;
  LateCommands& operator=(const LateCommands&) = delete;

  // Call it before each step, and after the last one.
  void begin_step() {
    ++step_;
    for (OfDrone& drone : drones_) drone.begins.push_back(drone.stretches.size());
  }

  // Calls f(tick, share, stretch) for the parts of the ticks of a step, of equal length, in which a drone flew one command; not
  // at all if it did not fly.
  template <class F>
  void for_each_part(DroneIndex drone, std::size_t step, std::size_t ticks, const F& f) const {
    const OfDrone& of = drones_[drone];
    const auto substeps = static_cast<double>(fleet_.clock.substeps()), length = substeps / static_cast<double>(ticks);
    for (std::size_t i = of.begins[step]; i < of.begins[step + 1]; ++i) {
      const auto from = static_cast<double>(of.stretches[i].from);
      const auto to = i + 1 < of.begins[step + 1] ? static_cast<double>(of.stretches[i + 1].from) : substeps;
      for (auto tick = static_cast<std::size_t>(from / length); tick < ticks; ++tick) {
        const double begin = length * static_cast<double>(tick), end = std::min(to, begin + length);
        if (end > std::max(from, begin)) f(tick, static_cast<float>((end - std::max(from, begin)) / length), of.stretches[i]);
        if (end >= to) break;
      }
    }
  }

 private:
  struct OfDrone {
    std::vector<std::int32_t> sent;   // for each place of the ring, as in Stretch
    std::vector<Stretch> stretches;   // of all steps
    std::vector<std::size_t> begins;  // index of each step's first one
  };

  // Of the commands that have arrived, the newest one flies. The controller sees it in its next tick.
  void note(const State& state, DroneIndex drone, bool is_sent) {
    OfDrone& of = drones_[drone];
    if (is_sent) of.sent[fleet_.commands.newest(drone)] = step_;
    const std::int64_t now = state.tick[fleet_.env_of(drone)], period = fleet_.clock.control_ticks();
    const std::int64_t ticks = fleet_.clock.substeps();
    const auto add = [&](const float* command, std::int64_t arrival, std::size_t place) {
      const std::int64_t from = (std::max(arrival - now, std::int64_t{0}) + period - 1) / period * period;
      if (from >= ticks) return;
      while (of.stretches.size() > of.begins.back() && of.stretches.back().from >= from) of.stretches.pop_back();
      Stretch& stretch = of.stretches.emplace_back(Stretch{from, of.sent[place], {}});
      std::copy_n(command, stretch.command.size(), stretch.command.begin());
    };
    fleet_.commands.for_each(drone, now, now + ticks, add);
  }

  dynamics::Fleet& fleet_;
  std::vector<OfDrone> drones_;
  std::int32_t step_ = -1;
};

}  // namespace flockstep::learning
