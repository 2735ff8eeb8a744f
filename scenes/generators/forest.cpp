// Generates forests: trees and rocks on rolling terrain, all as meshes.
#include <algorithm>
#include <cmath>
#include <cstdint>
#include <optional>
#include <sstream>
#include <string>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/world_builder.hpp"
#include "generators/forest_surfaces.hpp"
#include "generators/layouts.hpp"
#include "generators/noise.hpp"
#include "generators/parts.hpp"
#include "planning/draws.hpp"
#include "planning/navigable.hpp"

namespace flockstep {
namespace {

class Forest {
  static constexpr double kFromBorder = 3.0;       // m, distance of start and goal from the border
  static constexpr double kMarkerClearance = 1.8;  // m, horizontal gap from start and goal to trunks and rocks
  static constexpr double kMarkerHeight = 1.5;     // m, above the ground
  static constexpr double kSpawnReach = 0.25;      // m, half size of the spawn box
  static constexpr double kTreeGap = 2.4;          // m, gap between trunks if there is room
  static constexpr double kHill = 18.0;            // m, distance between hills
  // Flight lane, in m. Trunks keep kLaneHalfWidth away and branches stay kLaneHeadroom above it. kLaneSwing is its sideways
  // swing and kLaneBend the length of a bend.
  static constexpr double kLaneHalfWidth = 0.9, kLaneHeadroom = 0.5, kLaneStep = 0.5, kLaneSwing = 6.0, kLaneBend = 12.0;

 public:
  Forest(const ForestConfig& config, std::uint32_t attempt)
      : config_(config),
        draws_(Draws::kForest, config.seed, attempt),
        hills_(Draws::kForest, config.seed, 16 * attempt),
        size_(static_cast<double>(config.size_m[0]), static_cast<double>(config.size_m[1])) {
    start_ = marker(kFromBorder);
    goal_ = marker(size_.x() - kFromBorder);
    lay_lane();
  }

  std::vector<Vec3> lane() const { return rounded(lane_); }

  // Returns nullopt if a tree finds no free place.
  std::optional<WorldBuilder> grown() {
    WorldBuilder builder("forest/seed-" + std::to_string(config_.seed));
    ForestSurfaces surfaces(builder, config_.seed);
    parts_.clear();
    shades_.clear();
    for (int i = 0; i < config_.trees; ++i) {
      Interrupt::poll();
      const std::optional<Vec2d> at = free_place(kTreeGap);
      if (!at) return std::nullopt;
      draws_.uniform(0.0, 1.0) < 0.7 ? add_conifer(*at, surfaces.conifer()) : add_broadleaf(*at, surfaces.broadleaf());
    }
    for (int i = 0; i < config_.trees / 6; ++i) {
      const std::optional<Vec2d> at = free_place(1.2);
      if (!at) break;  // rocks are optional
      const double size = draws_.uniform(0.25, 0.8);
      MeshPart part;
      const Vec3d center(at->x(), at->y(), height(*at) + 0.1 * size), half(size, draws_.uniform(0.7, 1.0) * size, 0.7 * size);
      add_ball(part, center, half, 3, 0.12, draws_);
      surfaces.color_rock(part, center, half);
      parts_.emplace_back(std::move(part), surfaces.rock_material());
    }
    builder.mesh(ForestSurfaces::ground(terrain(), shades_), surfaces.ground_material());
    for (const auto& [part, material] : parts_) builder.mesh(part, material);
    builder.light(ForestSurfaces::light());
    builder.start(start_.cast<float>());
    builder.goal(goal_.cast<float>());
    const Vec3d reach = Vec3d::Constant(kSpawnReach);
    builder.spawn_box({(start_ - reach).cast<float>(), (start_ + reach).cast<float>()});
    return builder;
  }

 private:
  double height(const Vec2d& at) const {
    return static_cast<double>(config_.relief_m) * hills_.octaves(at.x() / kHill, at.y() / kHill, 3);
  }

  Vec3d marker(double x) {
    const double y = draws_.uniform(0.25 * size_.y(), 0.75 * size_.y());
    return {x, y, height({x, y}) + kMarkerHeight};
  }

  // Lays a winding lane from start to goal, at their height above the ground.
  void lay_lane() {
    const Noise sideways(Draws::kForest, config_.seed, 7 + static_cast<std::uint32_t>(draws_.below(1 << 20)));
    const Vec2d from = start_.head<2>(), way = goal_.head<2>() - from;
    const int steps = static_cast<int>(std::ceil(way.norm() / kLaneStep));
    for (int i = 0; i <= steps; ++i) {
      const double share = static_cast<double>(i) / steps;
      Vec2d at = from + share * way;
      const double room = std::min(1.0, 4.0 * std::min(share, 1.0 - share));  // no swing at the ends
      at.y() += kLaneSwing * room * (2.0 * sideways.at(at.x() / kLaneBend, 0.5) - 1.0);
      at.y() = std::clamp(at.y(), kFromBorder, size_.y() - kFromBorder);
      lane_.emplace_back(at.x(), at.y(), height(at) + kMarkerHeight);
    }
  }

  double from_lane(const Vec2d& at) const {
    double least = 1e9;
    for (const Vec3d& point : lane_) least = std::min(least, (point.head<2>() - at).norm());
    return least;
  }

  // Returns the lowest height for branches that lets a drone in the lane pass below.
  double above_lane(const Vec2d& at, double reach) const {
    double most = -1e9;
    for (const Vec3d& point : lane_) {
      if ((point.head<2>() - at).norm() < reach + kLaneHalfWidth) most = std::max(most, point.z() + kLaneHeadroom);
    }
    return most;
  }

  Heightfield terrain() const {
    Heightfield field;
    field.columns = static_cast<int>(size_.x()) + 1;
    field.rows = static_cast<int>(size_.y()) + 1;
    for (int row = 0; row < field.rows; ++row) {
      for (int column = 0; column < field.columns; ++column) {
        field.heights.push_back(static_cast<float>(height({static_cast<double>(column), static_cast<double>(row)})));
      }
    }
    return field;
  }

  // Draws random places until one is free. The gap shrinks after repeated misses.
  std::optional<Vec2d> free_place(double gap) {
    for (; gap > 0.9; gap *= 0.9) {
      for (int i = 0; i < 60; ++i) {
        const Vec2d at = draws_.point(Vec2d::Constant(0.8), size_ - Vec2d::Constant(0.8));
        const bool is_in_the_way = from_lane(at) < kLaneHalfWidth || (at - start_.head<2>()).norm() < kMarkerClearance ||
                                   (at - goal_.head<2>()).norm() < kMarkerClearance;
        const auto is_near = [&](const Vec2d& other) { return (at - other).norm() < gap; };
        if (is_in_the_way || std::any_of(taken_.begin(), taken_.end(), is_near)) continue;
        taken_.push_back(at);
        return at;
      }
    }
    return std::nullopt;
  }

  Vec2d turn() {
    for (;;) {
      const Vec2d way = draws_.point(Vec2d::Constant(-1.0), Vec2d::Constant(1.0));
      if (way.norm() > 0.1) return way.normalized();
    }
  }

  void add_conifer(const Vec2d& at, const ForestSurfaces::Tree& tree) {
    const double ground = height(at);
    const double tall = draws_.uniform(6.0, 11.0);
    const double radius = 0.014 * tall + draws_.uniform(0.04, 0.1);
    const double reach = std::min(draws_.uniform(0.16, 0.22) * tall, 1.7);
    const double crown = std::max(draws_.uniform(1.6, 2.6), above_lane(at, reach) - ground);  // m, above the ground
    MeshPart trunk, branches;
    add_trunk(trunk, at, ground - 0.5, ground + 0.8 * tall, radius, 0.4 * radius, turn());
    ForestSurfaces::color_trunk(trunk, tree);
    parts_.emplace_back(std::move(trunk), tree.bark);
    constexpr int kTiers = 4;
    for (int i = 0; i < kTiers; ++i) {
      const double share = static_cast<double>(i) / kTiers;
      const double low = ground + mixed(crown, tall, share);
      const double high = i + 1 == kTiers ? ground + tall : low + 1.6 * (tall - crown) / kTiers;
      add_cone(branches, at, low, high, reach * (1.0 - 0.75 * share), turn());
      ForestSurfaces::color_tier(branches, tree, share);
    }
    parts_.emplace_back(std::move(branches), tree.crown);
    shades_.push_back({at, 1.3 * reach});
  }

  void add_broadleaf(const Vec2d& at, const ForestSurfaces::Tree& tree) {
    const double ground = height(at);
    const double tall = draws_.uniform(5.0, 8.0);
    const double radius = 0.018 * tall + draws_.uniform(0.03, 0.1);
    const Vec2d reach = draws_.point(Vec2d::Constant(1.1), Vec2d::Constant(1.7));
    const double fork = std::max(draws_.uniform(2.0, 2.8), above_lane(at, 1.2 * reach.maxCoeff()) - ground);
    MeshPart trunk, crown;
    add_trunk(trunk, at, ground - 0.5, ground + fork + 1.0, radius, 0.7 * radius, turn());
    ForestSurfaces::color_trunk(trunk, tree);
    parts_.emplace_back(std::move(trunk), tree.bark);
    const Vec3d half(reach.x(), reach.y(), std::max(0.5 * (tall - fork), 0.8));
    const Vec3d center(at.x(), at.y(), ground + fork + 1.1 * half.z());
    add_ball(crown, center, half, 4, 0.13, draws_);
    ForestSurfaces::color_crown(crown, tree, center, half);
    parts_.emplace_back(std::move(crown), tree.crown);
    shades_.push_back({at, 0.8 * reach.maxCoeff()});
  }

  const ForestConfig& config_;
  Draws draws_;
  Noise hills_;
  Vec2d size_;
  Vec3d start_, goal_;
  std::vector<Vec3d> lane_;
  std::vector<Vec2d> taken_;
  std::vector<std::pair<MeshPart, std::uint16_t>> parts_;  // with their materials
  std::vector<ForestSurfaces::Shade> shades_;
};

}  // namespace

void ForestConfig::validate() const { check_fields(*this, "forest: "); }

std::shared_ptr<const World> forest(const ForestConfig& config) {
  constexpr std::uint32_t kAttempts = 16;
  config.validate();
  const collision::Hull hull(DroneModel::quadrotor650());
  const auto grow = [&](std::uint32_t attempt) -> std::shared_ptr<const World> {
    Forest forest(config, attempt);
    const std::optional<WorldBuilder> grown = forest.grown();
    if (!grown) return nullptr;
    auto world = grown->build();
    return is_free_way(*world, hull, forest.lane()) ? world : nullptr;
  };
  if (auto world = first_layout(kAttempts, grow)) return world;
  std::ostringstream expected;
  expected << "few enough for a free path through " << config.size_m[0] << " x " << config.size_m[1] << " m";
  refuse("forest: trees", expected.str(), config.trees);
}

}  // namespace flockstep
