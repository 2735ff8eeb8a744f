// LaneGroup: up to kLanes drones, one in each lane of a flock. Copies the arrays of the state to the lanes and back.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <span>
#include <vector>

#include "dynamics/flight.hpp"
#include "flockstep/index.hpp"
#include "flockstep/state.hpp"

namespace flockstep::dynamics {

inline Vec3 vec3(const std::vector<float>& values, DroneIndex drone) { return Vec3::Map(values.data() + 3 * drone); }
inline Vec3 vec3(const Lanes<3>& lanes, std::size_t lane) { return {lanes[0][lane], lanes[1][lane], lanes[2][lane]}; }

inline void set(const Vec3& v, std::size_t lane, Lanes<3>& lanes) {
  for (int axis = 0; axis < 3; ++axis) lanes[static_cast<std::size_t>(axis)][lane] = v[axis];
}

inline void set(const Quat& q, std::size_t lane, Lanes<4>& lanes) {
  lanes[0][lane] = q.w();
  lanes[1][lane] = q.x();
  lanes[2][lane] = q.y();
  lanes[3][lane] = q.z();
}

// Copy the numbers of kLanes consecutive drones between arrays and lanes. rows: (kLanes, 3) or (kLanes, 4), for lanes of rotors
// the first four.
void load_rows(const float* rows, Lanes<3>& lanes);
void load_rows4(const float* rows, Lane* lanes);
void store_rows(const Lanes<3>& lanes, float* rows);
void store_rows4(const Lane* lanes, float* rows);
template <std::size_t kColumns>
void load_rows(const float* rows, Lanes<kColumns>& lanes) {
  static_assert(kColumns == 4 || kColumns == kMaxRotors);
  load_rows4(rows, lanes.data());
}
template <std::size_t kColumns>
void store_rows(const Lanes<kColumns>& lanes, float* rows) {
  static_assert(kColumns == 4 || kColumns == kMaxRotors);
  store_rows4(lanes.data(), rows);
}

// Sets position to origin + travelled, and remainder to the rounding error of that sum. Clears is_good outside the world.
void update_position(Flock& flock);

// A range of consecutive drones; empty if count is 0.
struct DroneRange {
  DroneIndex first;
  std::size_t count = 0;
};

using LaneFlags = std::array<bool, kLanes>;

class LaneGroup {
 public:
  // Takes as many drones as fit from the front of an ascending list, and removes them from it. own: a range that holds the
  // listed drones and that no other thread reads or writes meanwhile. If it has at least kLanes drones, the lanes are
  // consecutive drones of it, and arrays are copied in one piece; drones that are not listed are stored unchanged. Otherwise
  // the last drone fills the remaining lanes. num_rotors: columns of the arrays of rotors, which Lanes<kMaxRotors> hold.
  LaneGroup(std::span<const DroneIndex>& drones, const DroneRange& own, std::size_t num_rotors = kMinRotors);

  DroneIndex operator[](std::size_t lane) const { return drones_[lane]; }
  bool is_listed(std::size_t lane) const { return is_listed_[lane]; }
  bool is_row() const { return is_row_; }  // the lanes are consecutive drones

  void load(const State& state, Flock& flock) const;
  // Stores the lanes whose flag is true. The values of the other lanes in the flock may be lost.
  void store(const LaneFlags& lanes, Flock& flock, State& state) const;
  void store(std::size_t lane, const Flock& flock, State& state) const;
  // Stores the accelerations, the only arrays that are never loaded.
  void store_accelerations(std::size_t lane, const Flock& flock, State& state) const;

  // Loads an array that is not part of the flock: (N, kColumns) or (N,).
  template <std::size_t kColumns>
  void load(const std::vector<float>& array, Lanes<kColumns>& lanes) const {
    if (is_row_ && is_vectorised(lanes)) return load_rows(array.data() + columns_of(lanes) * drones_[0], lanes);
    for (std::size_t lane = 0; lane < kLanes; ++lane) load(array, lane, lanes);
  }
  void load(const std::vector<float>& array, Lane& lanes) const {
    if (is_row_) return void(std::copy_n(array.data() + drones_[0], kLanes, lanes.begin()));
    for (std::size_t lane = 0; lane < kLanes; ++lane) lanes[lane] = array[drones_[lane]];
  }

 private:
  template <std::size_t kColumns>
  void load(const std::vector<float>& array, std::size_t lane, Lanes<kColumns>& lanes) const {
    const std::size_t columns = columns_of(lanes);
    for (std::size_t k = 0; k < columns; ++k) lanes[k][lane] = array[columns * drones_[lane] + k];
  }
  template <std::size_t kColumns>
  void store(const Lanes<kColumns>& lanes, std::size_t lane, std::vector<float>& array) const {
    const std::size_t columns = columns_of(lanes);
    for (std::size_t k = 0; k < columns; ++k) array[columns * drones_[lane] + k] = lanes[k][lane];
  }

  // Columns of the array that these lanes hold.
  template <std::size_t kColumns>
  std::size_t columns_of(const Lanes<kColumns>&) const {
    return kColumns == kMaxRotors ? num_rotors_ : kColumns;
  }

  // True if load_rows() and store_rows() handle these lanes.
  template <std::size_t kColumns>
  bool is_vectorised(const Lanes<kColumns>& lanes) const {
    return kColumns != kMaxRotors || columns_of(lanes) == 4;
  }
  // Stores all lanes, which are consecutive drones.
  template <std::size_t kColumns>
  void store_row(const Lanes<kColumns>& lanes, std::vector<float>& array) const {
    if (is_vectorised(lanes)) return store_rows(lanes, array.data() + columns_of(lanes) * drones_[0]);
    for (std::size_t lane = 0; lane < kLanes; ++lane) store(lanes, lane, array);
  }

  std::array<DroneIndex, kLanes> drones_;
  LaneFlags is_listed_{};
  bool is_row_ = false;
  std::size_t num_rotors_;
};

}  // namespace flockstep::dynamics
