// ScanMotion: how drones moved during scans and images that take time.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "base/in_world.hpp"
#include "base/pose_access.hpp"
#include "base/pose_path.hpp"
#include "base/require.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::sensors {

class ScanMotion {
 public:
  explicit ScanMotion(std::size_t num_drones)
      : from_(num_drones), to_(num_drones), from_tick_(num_drones), tick_(num_drones, -1) {}

  // Returns the motion up to a reading now. A drone that has been placed since the reading before has not moved.
  PosePath path_of(DroneIndex drone, const Pose& now, std::int64_t tick) const {
    if (tick_[drone] < 0 || tick_[drone] > tick) return {now, now};
    if (tick_[drone] < tick) return {pose(to_[drone]), now, tick - tick_[drone]};
    if (values(now) != to_[drone]) return {now, now};
    return {pose(from_[drone]), now, tick - from_tick_[drone]};  // a second reading
  }
  void add(DroneIndex drone, const Pose& now, std::int64_t tick) {
    const PosePath path = path_of(drone, now, tick);
    from_[drone] = values(path.from);
    to_[drone] = values(now);
    from_tick_[drone] = tick - path.ticks;
    tick_[drone] = tick;
  }
  void forget(DroneIndex drone) { tick_[drone] = -1; }

  void visit(ArrayVisitor& visitor) {
    visitor.array("scan_from", from_);
    visitor.array("scan_to", to_);
    visitor.array("scan_from_tick", from_tick_);
    visitor.array("scan_tick", tick_);
  }
  // Throws std::invalid_argument if restored values cannot be used.
  void check() const {
    for (std::size_t i = 0; i < tick_.size(); ++i) {
      if (tick_[i] < 0) continue;
      require(from_tick_[i] >= 0 && from_tick_[i] <= tick_[i], "snapshot: scan_from_tick", "a number in [0, scan_tick]",
              from_tick_[i]);
      for (const Values& one : {from_[i], to_[i]}) {
        if (!is_in_world(pose(one).position)) refuse("snapshot: scan_from, scan_to", in_world("finite coordinates"), one[0]);
        const float norm = pose(one).rotation.norm();
        require(std::abs(norm - 1.0F) < 1e-2F, "snapshot: scan_from, scan_to", "unit quaternions", norm);
      }
    }
  }

 private:
  using Values = std::array<float, 7>;  // position, quat_wxyz
  static Pose pose(const Values& v) { return load_pose(v.data(), v.data() + 3); }
  static Values values(const Pose& pose) {
    Values v;
    store_pose(v.data(), v.data() + 3, pose);
    return v;
  }

  // (N,) of the newest reading and the one before; tick_ is -1 before the first
  std::vector<Values> from_, to_;
  std::vector<std::int64_t> from_tick_, tick_;
};

}  // namespace flockstep::sensors
