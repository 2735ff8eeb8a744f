// LaneGroup: up to kLanes drones, each in a lane of a flock, and how the arrays of the state go to the lanes and back.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "dynamics/flight.hpp"
#include "dynamics/rows.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

// Consecutive drones; none if count is 0.
struct DroneRange {
  DroneIndex first;
  std::size_t count = 0;
};

using LaneFlags = std::array<bool, kLanes>;

class LaneGroup {
 public:
  // Takes the first drones of an ascending list off it: as many as fit. own: drones that no other thread reads or writes
  // meanwhile, the listed ones among them. If own has at least kLanes drones, the lanes are consecutive drones of it, and arrays
  // are copied in one piece; lanes of drones that are not listed are stored unchanged. Otherwise the last drone fills the
  // remaining lanes.
  LaneGroup(std::span<const DroneIndex>& drones, const DroneRange& own);

  DroneIndex operator[](std::size_t lane) const { return drones_[lane]; }
  bool is_listed(std::size_t lane) const { return is_listed_[lane]; }
  bool is_row() const { return is_row_; }  // the lanes are consecutive drones

  void load(const State& state, Flock& flock) const;
  // Stores the given lanes. The others, which must be listed as false, lose what they hold in the flock.
  void store(const LaneFlags& lanes, Flock& flock, State& state) const;
  void store(std::size_t lane, const Flock& flock, State& state) const;
  // Stores the arrays that are never loaded, the accelerations.
  void store_accelerations(std::size_t lane, const Flock& flock, State& state) const;

  // Loads an array that is not part of the flock: (N, kColumns) or (N,).
  template <std::size_t kColumns>
  void load(const std::vector<float>& array, Lanes<kColumns>& lanes) const {
    if (is_row_) return load_rows(array.data() + kColumns * drones_[0], lanes);
    for (std::size_t lane = 0; lane < kLanes; ++lane) load(array, lane, lanes);
  }
  void load(const std::vector<float>& array, Lane& lanes) const {
    if (is_row_) return void(std::copy_n(array.data() + drones_[0], kLanes, lanes.begin()));
    for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] = array[drones_[lane]];
  }

 private:
  template <std::size_t kColumns>
  void load(const std::vector<float>& array, std::size_t lane, Lanes<kColumns>& lanes) const {
    for (std::size_t k = 0; k < kColumns; ++k) lanes[k][lane] = array[kColumns * drones_[lane] + k];
  }
  template <std::size_t kColumns>
  void store(const Lanes<kColumns>& lanes, std::size_t lane, std::vector<float>& array) const {
    for (std::size_t k = 0; k < kColumns; ++k) array[kColumns * drones_[lane] + k] = lanes[k][lane];
  }

  std::array<DroneIndex, kLanes> drones_;
  LaneFlags is_listed_{};
  bool is_row_ = false;
};

}  // namespace flockstep::dynamics
