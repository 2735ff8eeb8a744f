#include "generators/movers.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <utility>

#include "base/interrupt.hpp"
#include "generators/layouts.hpp"
#include "planning/navigable.hpp"

namespace flockstep {
namespace {

constexpr float kStartRoom = 1.0F;  // m, around the box in which drones start
constexpr float kSpeedSpread = 0.3F;
constexpr std::uint32_t kAttempts = 1U << 20U;  // separates the draws from those of the layout

Vec3 vector_of(const std::array<float, 3>& v) { return {v[0], v[1], v[2]}; }

// Points that the middle of a body passes, at the ends of straight legs.
std::vector<Vec3> legs_of(const BodyConfig& body) {
  const Vec3 position = vector_of(body.position_m);
  if (body.motion.kind == BodyMotionKind::slider) return {position, position + vector_of(body.motion.travel_m)};
  if (body.motion.kind != BodyMotionKind::waypoints) return {position, position};  // it turns within its own reach
  std::vector<Vec3> points;
  for (const auto& point : body.motion.points_m) points.push_back(vector_of(point));
  if (body.motion.route == BodyRoute::loop) points.push_back(points.front());
  return points;
}

bool keeps_off(const std::vector<Vec3>& points, const Aabb& box, float room) {
  constexpr float kStep = 0.25F;  // m
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const Vec3 way = points[i + 1] - points[i];
    const int steps = std::max(1, static_cast<int>(std::ceil(way.norm() / kStep)));
    for (int k = 0; k <= steps; ++k) {
      const Vec3 point = points[i] + way * (static_cast<float>(k) / static_cast<float>(steps));
      const Vec3 outside = (box.min - point).cwiseMax(point - box.max).cwiseMax(Vec3::Zero());
      if (outside.head<2>().norm() < room) return false;  // bodies may be as high as the room
    }
  }
  return true;
}

}  // namespace

Movers::Movers(const World& world, std::uint32_t purpose, std::uint64_t seed, std::uint32_t attempt)
    : world_(world), draws_(purpose, seed, kAttempts + attempt) {}

bool Movers::add(BodyConfig body, float lift_m, float margin_m) {
  const Vec3 half = body.mesh ? Vec3(body.mesh->bounds().min.cwiseAbs().cwiseMax(body.mesh->bounds().max.cwiseAbs()))
                              : Vec3(0.5F * vector_of(body.size_m));
  const float reach = half.head<2>().norm() + kStartRoom;
  if (world_.markers().spawn_box && !keeps_off(legs_of(body), *world_.markers().spawn_box, reach)) return false;
  BodyConfig lifted = body;
  lifted.position_m[2] += lift_m;
  for (auto& point : lifted.motion.points_m) point[2] += lift_m;
  if (!is_free_body(world_, lifted, margin_m)) return false;
  body.motion.random_phase = true;
  body.motion.speed_spread = kSpeedSpread;
  bodies_.push_back(std::move(body));
  return true;
}

void Movers::add_on_lines(const std::vector<BodyConfig>& kinds, int count, const Lines& lines) {
  constexpr int kDarts = 300;
  for (int i = 0; i < count; ++i) {
    Interrupt::poll();
    const BodyConfig& kind = kinds[static_cast<std::size_t>(i) % kinds.size()];
    bool is_added = false;
    for (int dart = 0; dart < kDarts && !is_added; ++dart) is_added = add_on_line(kind, lines);
    if (!is_added) return;
  }
}

bool Movers::add_on_line(BodyConfig body, const Lines& lines) {
  const auto rounded = [](double x, double y, float z) {
    return std::array<float, 3>{static_cast<float>(centimetres(x)), static_cast<float>(centimetres(y)), z};
  };
  const float z = body.position_m[2];
  const Vec2d from = draws_.point(lines.area.min.head<2>().cast<double>(), lines.area.max.head<2>().cast<double>());
  const double length = draws_.uniform(lines.least_m, lines.most_m);
  Vec2d way(1.0, 0.0);
  if (lines.is_aligned) {
    if (draws_.below(2) == 0) {
      way = Vec2d(0.0, 1.0);
      const float half = std::numbers::sqrt2_v<float> / 2.0F;
      body.quat_wxyz = {half, 0.0F, 0.0F, half};
    }
  } else {
    do {
      way = draws_.point(Vec2d(-1.0, -1.0), Vec2d(1.0, 1.0));
    } while (way.norm() < 0.1 || way.norm() > 1.0);
    way.normalize();
  }
  const Vec2d to = from + length * way;
  const double speed = draws_.uniform(lines.least_mps, lines.most_mps);
  const bool slides = draws_.below(2) == 0 && lines.slides;
  body.position_m = rounded(from.x(), from.y(), z);
  if (slides) {
    body.motion.kind = BodyMotionKind::slider;
    const Vec3 travel = vector_of(rounded(to.x(), to.y(), z)) - vector_of(body.position_m);
    body.motion.travel_m = {travel.x(), travel.y(), 0.0F};
    body.motion.period_s = static_cast<float>(centimetres(2.0 * length / speed));
  } else {
    body.motion.kind = BodyMotionKind::waypoints;
    body.motion.route = BodyRoute::back_and_forth;
    body.motion.points_m = {body.position_m, rounded(to.x(), to.y(), z)};
    body.motion.speed_mps = static_cast<float>(centimetres(speed));
  }
  return add(std::move(body), lines.lift_m);
}

}  // namespace flockstep
