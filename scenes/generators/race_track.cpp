// Generates race tracks: closed loops of gates in a hall. Only correctly rounded operations are used and every position is
// rounded to 1 cm, so that a seed gives the same world on every machine.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <sstream>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/world_builder.hpp"
#include "generators/layouts.hpp"
#include "planning/draws.hpp"
#include "planning/navigable.hpp"

namespace flockstep {
namespace {

// m
constexpr double kBar = 0.1;
constexpr double kNearest = 4.5, kFarthest = 12.0;  // from one gate to the next: beyond the miss zone of the next, 3 m
constexpr double kApart = 3.5;                      // between gates that are not neighbours
constexpr double kWallClearance = 1.2, kFloorClearance = 0.5;
constexpr double kWayClearance = 0.8;  // from the corners of other gates to the straight way between neighbours
// Ways may climb by this share of their level length. The cosine of the turn at a gate is at least kSharpest: at most 120
// degrees, so that the way to a gate and the way from it make at most 60 degrees with its direction.
constexpr double kSteepest = 0.4, kSharpest = -0.5;

double distance_to_segment(const Vec3d& point, const Vec3d& a, const Vec3d& b) {
  const Vec3d along = b - a;
  const double t = std::clamp((point - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (point - a - t * along).norm();
}

Vec2d level_way(const Vec3d& from, const Vec3d& to) { return (to - from).head<2>().normalized(); }

class RaceLoop {
 public:
  RaceLoop(const RaceTrackConfig& config, std::uint32_t attempt)
      : config_(config), draws_(Draws::kRaceTrack, config.seed, attempt), count_(static_cast<std::size_t>(config.gates)) {
    const double half_gate = static_cast<double>(config.gate_size_m) / 2.0 + kBar;
    const double wall = half_gate + kWallClearance, floor = half_gate + kFloorClearance;
    low_ = {wall, wall, floor};
    high_ = Vec3d(config.size_m[0], config.size_m[1], config.size_m[2]) - low_;
    from_way_ = 1.5 * half_gate + kWayClearance;
  }

  // Places the gates one after another. Returns false if that fails.
  bool lay_out() {
    while (centers_.size() < count_) {
      if (!place_next()) return false;
    }
    return true;
  }

  std::shared_ptr<const World> world() {
    WorldBuilder builder("race_track/seed-" + std::to_string(config_.seed));
    const std::uint16_t wall = builder.material({"wall", {0.82F, 0.84F, 0.86F}});
    const std::uint16_t first = builder.material({"start", {0.05F, 0.35F, 0.75F}});
    const std::uint16_t others = builder.material({"gate", {0.9F, 0.35F, 0.05F}});
    builder.room(Vec3::Zero(), {config_.size_m[0], config_.size_m[1], config_.size_m[2]}, wall);
    for (std::size_t i = 0; i < count_; ++i) {
      const Vec2d direction = direction_of(i);
      const bool is_ring = draws_.uniform(0.0, 1.0) < static_cast<double>(config_.rings);
      builder.gate({.shape = is_ring ? GateShape::ring : GateShape::square,
                    .center = centers_[i].cast<float>(),
                    .rotation = heading(direction),
                    .size = config_.gate_size_m,
                    .bar = static_cast<float>(kBar),
                    .material = i == 0 ? first : others});
    }
    const Vec2d direction = direction_of(0);
    const Vec3d ahead(direction.x(), direction.y(), 0.0);
    builder.start((centers_[0] - ahead).cast<float>());
    builder.goal((centers_[0] + ahead).cast<float>());
    return builder.build();
  }

  // The straight way from gate to gate, back to the first.
  std::vector<Vec3> lap() const {
    std::vector<Vec3> points;
    for (const Vec3d& center : centers_) points.push_back(center.cast<float>());
    points.push_back(points.front());
    return points;
  }

 private:
  bool place_next() {
    constexpr int kDarts = 200;
    const bool is_last = centers_.size() + 1 == count_;
    for (int i = 0; i < kDarts; ++i) {
      const Vec3d dart = rounded(centers_.empty() ? within(low_, high_) : beside(is_last ? centers_.front() : centers_.back()));
      if (!fits(dart)) continue;
      centers_.push_back(dart);
      if (!is_last || is_closed()) return true;
      centers_.pop_back();
    }
    return false;
  }

  Vec3d within(const Vec3d& low, const Vec3d& high) {
    const double z = draws_.uniform(low.z(), high.z());
    const Vec2d level = draws_.point(low.head<2>(), high.head<2>());
    return {level.x(), level.y(), z};
  }
  Vec3d beside(const Vec3d& gate) {
    const Vec3d reach = Vec3d::Constant(kFarthest);
    return within((gate - reach).cwiseMax(low_), (gate + reach).cwiseMin(high_));
  }
  static Vec3d rounded(const Vec3d& v) { return {centimetres(v.x()), centimetres(v.y()), centimetres(v.z())}; }

  // Returns whether a gate here would fit after the gates so far. Those that remain must be able to reach the first.
  bool fits(const Vec3d& center) const {
    if (centers_.empty()) return true;
    const std::size_t last = centers_.size() - 1;
    if (!is_way(centers_[last], center)) return false;
    if (last > 0 && !is_turn(centers_[last - 1], centers_[last], center)) return false;
    if ((center - centers_[0]).norm() > kFarthest * static_cast<double>(count_ - centers_.size())) return false;
    for (std::size_t i = 0; i < last; ++i) {
      if ((center - centers_[i]).norm() < kApart) return false;
      if (distance_to_segment(centers_[i], centers_[last], center) < from_way_) return false;
      if (distance_to_segment(center, centers_[i], centers_[i + 1]) < from_way_) return false;
    }
    return true;
  }

  // Returns whether the way from the last gate back to the first is free.
  bool is_closed() const {
    const Vec3d &first = centers_.front(), &last = centers_.back();
    if (!is_way(last, first) || !is_turn(centers_[count_ - 2], last, first) || !is_turn(last, first, centers_[1])) return false;
    for (std::size_t i = 1; i + 1 < count_; ++i) {
      if (distance_to_segment(centers_[i], last, first) < from_way_) return false;
    }
    return true;
  }

  static bool is_way(const Vec3d& from, const Vec3d& to) {
    const Vec3d way = to - from;
    const double length = way.norm();
    return length >= kNearest && length <= kFarthest && std::abs(way.z()) <= kSteepest * way.head<2>().norm();
  }
  static bool is_turn(const Vec3d& before, const Vec3d& at, const Vec3d& after) {
    return level_way(before, at).dot(level_way(at, after)) >= kSharpest;
  }

  // The direction in which a gate is passed: halfway between the ways to it and from it, level.
  Vec2d direction_of(std::size_t i) const {
    const Vec3d &before = centers_[(i + count_ - 1) % count_], &after = centers_[(i + 1) % count_];
    return (level_way(before, centers_[i]) + level_way(centers_[i], after)).normalized();
  }
  static Quat heading(const Vec2d& direction) {
    const double w = std::sqrt(std::max(0.0, (1.0 + direction.x()) / 2.0));
    const double z = w > 0.0 ? direction.y() / (2.0 * w) : 1.0;
    return Eigen::Quaterniond(w, 0.0, 0.0, z).normalized().cast<float>();
  }

  const RaceTrackConfig& config_;
  Draws draws_;
  std::size_t count_;
  Vec3d low_, high_;       // box of the gates' centres
  double from_way_ = 0.0;  // m, from the centre of a gate to a way past it
  std::vector<Vec3d> centers_;
};

}  // namespace

void RaceTrackConfig::validate() const { check_fields(*this, "race_track: "); }

std::shared_ptr<const World> race_track(const RaceTrackConfig& config) {
  constexpr std::uint32_t kAttempts = 8192;
  config.validate();
  const collision::Hull hull(DroneModel::load("racer5"));
  const auto lay_out = [&](std::uint32_t attempt) -> std::shared_ptr<const World> {
    RaceLoop track(config, attempt);
    if (!track.lay_out()) return nullptr;
    auto world = track.world();
    return is_free_way(*world, hull, track.lap()) ? world : nullptr;
  };
  if (auto world = first_layout(kAttempts, lay_out)) return world;
  std::ostringstream expected;
  expected << "few enough for a hall of " << config.size_m[0] << " x " << config.size_m[1] << " x " << config.size_m[2] << " m";
  refuse("race_track: gates", expected.str(), config.gates);
}

}  // namespace flockstep
