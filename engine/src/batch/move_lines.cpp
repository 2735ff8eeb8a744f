#include "batch/move_lines.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <utility>

namespace flockstep {
namespace {

const Vec3 kGap = Vec3::Constant(std::numeric_limits<float>::quiet_NaN());

bool is_gap(const Vec3& row) { return std::isnan(row.x()); }

}  // namespace

void MoveLine::begin(const Vec3& position) {
  make_room();
  const bool is_single = rows_.size() == 1 || (rows_.size() > 1 && is_gap(rows_[rows_.size() - 2]));
  if (is_single) {
    rows_.back() = position;  // a single position is not a piece
  } else {
    if (!rows_.empty()) rows_.push_back(kGap);
    rows_.push_back(position);
  }
  period_ = passed_ = 1;
}

void MoveLine::add(const Vec3& position) {
  if (rows_.empty()) return begin(position);
  if (rows_.back() == position) return;
  if (passed_ < period_) {
    rows_.back() = position;
    ++passed_;
    return;
  }
  make_room();
  if (passed_ < period_) return add(position);  // the rows are fewer now
  rows_.push_back(position);
  passed_ = 1;
}

void MoveLine::clear() {
  rows_.clear();
  period_ = passed_ = 1;
}

void MoveLine::make_room() {
  if (rows_.size() + 2 <= kMaxRows) return;
  auto first = rows_.begin();
  while (static_cast<std::size_t>(rows_.end() - first) > kMaxRows / 2) {
    const auto gap = std::find_if(first, rows_.end(), is_gap);
    if (gap == rows_.end()) break;
    first = gap + 1;
  }
  rows_.erase(rows_.begin(), first);
  if (rows_.size() + 2 > kMaxRows) thin();
}

void MoveLine::thin() {
  const std::size_t count = rows_.size();
  std::size_t kept = 0;
  for (std::size_t row = 0; row < count; ++row) {
    if (row % 2 == 0 || row + 1 == count) rows_[kept++] = rows_[row];
  }
  rows_.resize(kept);
  // The last row was a whole period after the row before it.
  passed_ = count % 2 == 0 ? period_ : 2 * period_;
  period_ *= 2;
}

MoveLines::MoveLines(const State& state, std::size_t drones_per_env, std::size_t num_drones)
    : state_(&state), drones_per_env_(drones_per_env) {
  allocate(flags_, {.num_drones = num_drones});
}

void MoveLines::copy(const MoveLines& smaller) {
  const auto moved = [&](DroneIndex from) {
    return DroneIndex(from / smaller.drones_per_env_ * drones_per_env_ + from % smaller.drones_per_env_);
  };
  for (std::size_t i = 0; i < smaller.flags_.beams_visible.size(); ++i) {
    if (smaller.flags_.beams_visible[i]) flags_.beams_visible[moved(DroneIndex(i))] = 1;
  }
  if (!smaller.is_any_visible()) return;
  lines_.resize(flags_.move_line_visible.size());
  visible_.reserve(lines_.size());
  for (const DroneIndex from : smaller.visible_) {
    const DroneIndex to = moved(from);
    lines_[to] = std::make_unique<Recorded>(*smaller.lines_[from]);
    flags_.move_line_visible[to] = 1;
    visible_.push_back(to);
  }
}

void MoveLines::set_visible(bool visible, std::span<const DroneIndex> drones) {
  FlagArray& flags = flags_.move_line_visible;
  std::vector<std::unique_ptr<Recorded>> made;  // everything that may not fit in memory comes before the first change
  if (visible) {
    lines_.resize(flags.size());
    visible_.reserve(flags.size());
    for (std::size_t i = 0; i < drones.size(); ++i) made.push_back(std::make_unique<Recorded>());
  }
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const DroneIndex drone = drones[i];
    if ((flags[drone] != 0) == visible) continue;
    lines_[drone] = visible ? std::move(made[i]) : nullptr;
    flags[drone] = visible;
    if (visible) begin(drone);
  }
  visible_.clear();
  for (std::size_t i = 0; i < flags.size(); ++i) {
    if (flags[i]) visible_.emplace_back(i);
  }
}

void MoveLines::set_beams_visible(bool visible, std::span<const DroneIndex> drones) {
  for (const DroneIndex drone : drones) flags_.beams_visible[drone] = visible;
}

void MoveLines::begin(DroneIndex drone) {
  if (Recorded* const recorded = this->recorded(drone)) recorded->line.begin(position_of(*state_, drone));
}

void MoveLines::add(DroneIndex drone) {
  if (Recorded* const recorded = this->recorded(drone)) recorded->line.add(position_of(*state_, drone));
}

std::span<const Vec3> MoveLines::rows(DroneIndex drone) const {
  if (!flags_.move_line_visible[drone] || lines_[drone]->world != world_of(drone)) return {};
  return lines_[drone]->line.rows();
}

MoveLines::Recorded* MoveLines::recorded(DroneIndex drone) {
  if (!flags_.move_line_visible[drone]) return nullptr;
  Recorded& recorded = *lines_[drone];
  if (const std::int32_t world = world_of(drone); recorded.world != world) {
    recorded.line.clear();
    recorded.world = world;
  }
  return &recorded;
}

}  // namespace flockstep
