// MoveLines: the recorded paths of the drones whose move lines are visible.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/index.hpp"
#include "flockstep/move_line.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

// The path of one drone, as rows of positions in m, oldest first. A row of NaN separates two pieces. The last row is always the
// newest position.
class MoveLine {
 public:
  // If a line needs more rows, its oldest pieces are discarded. A line of one piece loses every other row instead, and then
  // records half as often.
  static constexpr std::size_t kMaxRows = 4096;

  MoveLine() { rows_.reserve(kMaxRows); }
  void begin(const Vec3& position);  // begins a piece
  void add(const Vec3& position);    // adds a position to the last piece, unless the drone has not moved
  void clear();
  std::span<const Vec3> rows() const { return rows_; }

 private:
  void make_room();  // for two rows
  void thin();

  std::vector<Vec3> rows_;
  std::size_t period_ = 1;  // motions from one kept row to the next
  std::size_t passed_ = 1;  // motions from the row before the last one to the last one; period_: the last row is kept
};

class MoveLines {
 public:
  MoveLines(const State& state, std::size_t drones_per_env, std::size_t num_drones);  // the state must outlive this object

  const MoveLineState& flags() const { return flags_; }
  bool is_any_visible() const { return !visible_.empty(); }
  const std::vector<DroneIndex>& visible() const { return visible_; }  // ascending

  // Copies the lines and flags of a smaller batch. Drone m of env e keeps both numbers.
  void copy(const MoveLines& smaller);
  // Making a line visible records the drone's position; making it invisible discards the line.
  void set_visible(bool visible, std::span<const DroneIndex> drones);
  void set_beams_visible(bool visible, std::span<const DroneIndex> drones);
  // The next two functions record the drone's position, if its line is visible. A drone that has come into another world begins
  // a new line.
  void begin(DroneIndex drone);  // the drone was placed: begins a piece
  void add(DroneIndex drone);    // the drone has moved
  // The rows of a line; none if it is invisible, or was recorded in another world than the current one.
  std::span<const Vec3> rows(DroneIndex drone) const;

 private:
  struct Recorded {
    MoveLine line;
    std::int32_t world = 0;  // State::world_index
  };
  std::int32_t world_of(DroneIndex drone) const { return state_->world_index[drone / drones_per_env_]; }
  Recorded* recorded(DroneIndex drone);  // in the current world; null if invisible

  const State* state_;
  std::size_t drones_per_env_;
  MoveLineState flags_;
  std::vector<std::unique_ptr<Recorded>> lines_;  // (N,) null if invisible; empty until one is visible
  std::vector<DroneIndex> visible_;
};

}  // namespace flockstep
