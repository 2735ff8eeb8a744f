// Places: the occupied rectangles of a floor and the lane kept free for the drone.
#pragma once

#include <algorithm>
#include <utility>
#include <vector>

#include "planning/draws.hpp"

namespace flockstep::indoors {

struct Rect {
  Vec2d low = Vec2d::Zero(), high = Vec2d::Zero();

  Vec2d size() const { return high - low; }
  Vec2d center() const { return 0.5 * (low + high); }
  double area() const { return size().x() * size().y(); }
  Rect grown(double by) const { return {low - Vec2d::Constant(by), high + Vec2d::Constant(by)}; }
  bool contains(const Rect& other) const {
    return (other.low.array() >= low.array()).all() && (other.high.array() <= high.array()).all();
  }
  bool overlaps(const Rect& other) const {
    return (other.low.array() < high.array()).all() && (other.high.array() > low.array()).all();
  }
  double distance(const Vec2d& point) const { return (point - point.cwiseMax(low).cwiseMin(high)).norm(); }
};

class Places {
 public:
  // Sets the corners of the lane. Objects keep from_lane m away from the lane and from_ends m away from its two ends.
  void keep_off(std::vector<Vec2d> lane, double from_lane, double from_ends) {
    lane_ = std::move(lane);
    from_lane_ = from_lane;
    from_ends_ = from_ends;
  }

  void add(const Rect& rect) { taken_.push_back(rect); }

  bool is_taken(const Rect& rect) const {
    return std::any_of(taken_.begin(), taken_.end(), [&](const Rect& other) { return other.overlaps(rect); });
  }

  bool is_off_lane(const Rect& rect) const {
    constexpr double kStep = 0.1;  // m
    if (rect.distance(lane_.front()) < from_ends_ || rect.distance(lane_.back()) < from_ends_) return false;
    for (std::size_t i = 0; i + 1 < lane_.size(); ++i) {
      const Vec2d way = lane_[i + 1] - lane_[i];
      if (!rect.grown(from_lane_).overlaps({lane_[i].cwiseMin(lane_[i + 1]), lane_[i].cwiseMax(lane_[i + 1])})) continue;
      const int steps = 1 + static_cast<int>(way.norm() / kStep);
      for (int k = 0; k <= steps; ++k) {
        if (rect.distance(lane_[i] + static_cast<double>(k) / steps * way) < from_lane_) return false;
      }
    }
    return true;
  }

  // Occupies a rectangle if it is free, clear of the lane and inside `within`.
  bool take(const Rect& rect, const Rect& within) {
    if (!within.contains(rect) || is_taken(rect) || !is_off_lane(rect)) return false;
    add(rect);
    return true;
  }

 private:
  std::vector<Vec2d> lane_;
  double from_lane_ = 0.0, from_ends_ = 0.0;
  std::vector<Rect> taken_;
};

}  // namespace flockstep::indoors
