// Generates forests: trees and rocks on rolling terrain, all as meshes.
#include <algorithm>
#include <array>
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
#include "generators/layouts.hpp"
#include "generators/noise.hpp"
#include "generators/parts.hpp"
#include "planning/draws.hpp"
#include "planning/way.hpp"

namespace flockstep {
namespace {

class Forest {
  static constexpr double kFromBorder = 3.0;       // m, distance of start and goal from the border
  static constexpr double kMarkerClearance = 1.8;  // m, horizontal gap from start and goal to trunks and rocks
  static constexpr double kMarkerHeight = 1.5;     // m, above the ground
  static constexpr double kSpawnReach = 0.25;      // m, half size of the spawn box
  static constexpr double kTreeGap = 2.4;          // m, gap between trunks if there is room
  static constexpr double kHill = 18.0;            // m, distance between hills
  static constexpr int kTexturePx = 128;
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

  std::vector<Vec3> lane() const {
    std::vector<Vec3> points;
    for (const Vec3d& point : lane_) points.push_back(point.cast<float>());
    return points;
  }

  // Returns nullopt if a tree finds no free place.
  std::optional<WorldBuilder> grown() {
    WorldBuilder builder("forest/seed-" + std::to_string(config_.seed));
    const std::uint16_t ground = ground_material(builder);
    builder.heightfield(terrain(), ground);
    const std::uint16_t bark = textured(builder, "bark", {0.16F, 0.10F, 0.06F}, {0.32F, 0.22F, 0.14F}, 8.0, 2.0, 1);
    const std::uint16_t needles = textured(builder, "needles", {0.015F, 0.05F, 0.02F}, {0.06F, 0.16F, 0.05F}, 12.0, 12.0, 2);
    const std::uint16_t leaves = textured(builder, "leaves", {0.05F, 0.12F, 0.02F}, {0.22F, 0.34F, 0.08F}, 10.0, 10.0, 3);
    const std::uint16_t stone = textured(builder, "rock", {0.16F, 0.16F, 0.15F}, {0.42F, 0.41F, 0.38F}, 5.0, 5.0, 4);
    for (int i = 0; i < config_.trees; ++i) {
      Interrupt::poll();
      const std::optional<Vec2d> at = free_place(kTreeGap);
      if (!at) return std::nullopt;
      draws_.uniform(0.0, 1.0) < 0.7 ? add_conifer(builder, *at, bark, needles) : add_broadleaf(builder, *at, bark, leaves);
    }
    for (int i = 0; i < config_.trees / 6; ++i) {
      const std::optional<Vec2d> at = free_place(1.2);
      if (!at) break;  // rocks are optional
      const double size = draws_.uniform(0.25, 0.8);
      MeshPart part;
      add_ball(part, {at->x(), at->y(), height(*at) + 0.1 * size}, {size, draws_.uniform(0.7, 1.0) * size, 0.7 * size}, 3, 0.12,
               draws_);
      builder.mesh(part, stone);
    }
    Light light;  // late morning
    light.sun_direction = {-0.5F, -0.45F, 0.74F};
    light.sun_color = {1.5F, 1.35F, 1.1F};
    light.sky_ambient = {0.55F, 0.65F, 0.8F};
    light.ground_ambient = {0.22F, 0.2F, 0.16F};
    light.sun_radius_deg = 1.2F;  // as wide as glare makes it look in a camera
    light.sun_glow = 0.6F;
    builder.light(light);
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

  // Grass with bare patches.
  std::uint16_t ground_material(WorldBuilder& builder) const {
    const Noise fine(Draws::kForest, config_.seed, 5), coarse(Draws::kForest, config_.seed, 6);
    const auto color = [&](float s, float t) {
      const double blades = fine.octaves(32.0 * static_cast<double>(s), 32.0 * static_cast<double>(t), 2, 32);
      const double bare = coarse.octaves(4.0 * static_cast<double>(s), 4.0 * static_cast<double>(t), 3, 4);
      const Color grass = mixed(Color{0.05F, 0.10F, 0.02F}, Color{0.20F, 0.27F, 0.07F}, blades);
      return mixed(grass, Color{0.20F, 0.15F, 0.09F}, std::clamp(4.0 * bare - 2.1, 0.0, 0.8));
    };
    const std::uint16_t texture = builder.texture("ground", 2 * kTexturePx, 2 * kTexturePx, color);
    return builder.material({"ground", {1.0F, 1.0F, 1.0F}, 0, texture});
  }

  // Adds a noise material between two colours, with `across` by `down` noise cells.
  std::uint16_t textured(WorldBuilder& builder, const std::string& name, const Color& dark, const Color& bright, double across,
                         double down, std::uint32_t number) const {
    const Noise noise(Draws::kForest, config_.seed, number);
    const int columns = static_cast<int>(across), rows = static_cast<int>(down);
    const auto color = [&](float s, float t) {
      const double period = std::max(columns, rows);
      const double value = 0.5 * (noise.octaves(across * static_cast<double>(s), down * static_cast<double>(t), 1, columns) +
                                  noise.octaves(2.0 * period * static_cast<double>(s), period * static_cast<double>(t), 3,
                                                static_cast<int>(2.0 * period)));
      return mixed(dark, bright, std::clamp(2.0 * value - 0.5, 0.0, 1.0));
    };
    const std::uint16_t texture = builder.texture(name, kTexturePx, kTexturePx, color);
    return builder.material({name, {1.0F, 1.0F, 1.0F}, 0, texture});
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

  void add_conifer(WorldBuilder& builder, const Vec2d& at, std::uint16_t bark, std::uint16_t needles) {
    const double ground = height(at);
    const double tall = draws_.uniform(6.0, 11.0);
    const double radius = 0.014 * tall + draws_.uniform(0.04, 0.1);
    const double reach = std::min(draws_.uniform(0.16, 0.22) * tall, 1.7);
    const double crown = std::max(draws_.uniform(1.6, 2.6), above_lane(at, reach) - ground);  // m, above the ground
    MeshPart trunk, branches;
    add_trunk(trunk, at, ground - 0.5, ground + 0.8 * tall, radius, 0.4 * radius, turn());
    builder.mesh(trunk, bark);
    constexpr int kTiers = 4;
    for (int i = 0; i < kTiers; ++i) {
      const double share = static_cast<double>(i) / kTiers;
      const double low = ground + mixed(crown, tall, share);
      const double high = i + 1 == kTiers ? ground + tall : low + 1.6 * (tall - crown) / kTiers;
      add_cone(branches, at, low, high, reach * (1.0 - 0.75 * share), turn());
    }
    builder.mesh(branches, needles);
  }

  void add_broadleaf(WorldBuilder& builder, const Vec2d& at, std::uint16_t bark, std::uint16_t leaves) {
    const double ground = height(at);
    const double tall = draws_.uniform(5.0, 8.0);
    const double radius = 0.018 * tall + draws_.uniform(0.03, 0.1);
    const Vec2d reach = draws_.point(Vec2d::Constant(1.1), Vec2d::Constant(1.7));
    const double fork = std::max(draws_.uniform(2.0, 2.8), above_lane(at, 1.2 * reach.maxCoeff()) - ground);
    MeshPart trunk, crown;
    add_trunk(trunk, at, ground - 0.5, ground + fork + 1.0, radius, 0.7 * radius, turn());
    builder.mesh(trunk, bark);
    const Vec3d half(reach.x(), reach.y(), std::max(0.5 * (tall - fork), 0.8));
    add_ball(crown, {at.x(), at.y(), ground + fork + 1.1 * half.z()}, half, 4, 0.13, draws_);
    builder.mesh(crown, leaves);
  }

  const ForestConfig& config_;
  Draws draws_;
  Noise hills_;
  Vec2d size_;
  Vec3d start_, goal_;
  std::vector<Vec3d> lane_;
  std::vector<Vec2d> taken_;
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
