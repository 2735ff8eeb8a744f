#include "planning/way.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <vector>

#include "bodies/body_script.hpp"
#include "collision/sweep.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

// Returns a prism or a box around a body and its margin.
std::vector<Vec3> hull_around(const BodyConfig& body, float margin_m) {
  constexpr int kSides = 12;
  const Vec3 half = 0.5F * Vec3(body.size_m[0], body.size_m[1], body.size_m[2]) + Vec3::Constant(margin_m);
  std::vector<Vec3> points;
  if (body.shape == BodyShape::mesh) {
    const Aabb& box = body.mesh->bounds();
    const Vec3 low = box.min - Vec3::Constant(margin_m), high = box.max + Vec3::Constant(margin_m);
    for (const float z : {low.z(), high.z()}) {
      for (const float x : {low.x(), high.x()}) {
        for (const float y : {low.y(), high.y()}) points.emplace_back(x, y, z);
      }
    }
    return points;
  }
  for (const float z : {-half.z(), half.z()}) {
    if (body.shape == BodyShape::box) {
      for (const float x : {-half.x(), half.x()}) {
        for (const float y : {-half.y(), half.y()}) points.emplace_back(x, y, z);
      }
      continue;
    }
    for (int i = 0; i < kSides; ++i) {
      const float angle = 2.0F * std::numbers::pi_v<float> * static_cast<float>(i) / kSides;
      const float radius = half.x() / std::cos(std::numbers::pi_v<float> / kSides);
      points.emplace_back(radius * std::cos(angle), radius * std::sin(angle), z);
    }
  }
  return points;
}

// Duration and length of a round trip.
struct RoundTrip {
  double time_s, length_m;
};

RoundTrip round_trip(const BodyConfig& body) {
  const BodyMotion& motion = body.motion;
  if (motion.kind == BodyMotionKind::waypoints) {
    const double length = bodies::Route(motion).length();
    return {length / static_cast<double>(motion.speed_mps), length};
  }
  if (motion.kind == BodyMotionKind::velocity) return {0.0, 0.0};  // it stands
  const auto distance = [](const std::array<float, 3>& a, const std::array<float, 3>& b) {
    return static_cast<double>((Vec3(a[0], a[1], a[2]) - Vec3(b[0], b[1], b[2])).norm());
  };
  const double length = motion.kind == BodyMotionKind::slider
                            ? 2.0 * distance(motion.travel_m, {0.0F, 0.0F, 0.0F})
                            : 2.0 * std::numbers::pi * distance(body.position_m, motion.center_m);
  return {static_cast<double>(motion.period_s), length};
}

}  // namespace

bool is_free_way(const World& world, const collision::Hull& hull, std::span<const Vec3> points) {
  for (std::size_t i = 0; i + 1 < points.size(); ++i) {
    const Pose from{.position = points[i]}, to{.position = points[i + 1]};
    if (collision::sweep(prepared(world).obstacles(), hull, from, to).hit) return false;
  }
  return true;
}

bool is_free_body(const World& world, const BodyConfig& given, float margin_m) {
  constexpr double kStep = 0.25;  // m
  constexpr int kMinSteps = 48;   // for turns
  BodyConfig body = given;
  body.motion.phase = 0.0F;
  body.motion.random_phase = false;
  body.motion.speed_spread = 0.0F;
  const bodies::BodyScript script(body);
  const collision::Hull hull(DroneModel(hull_around(body, margin_m)));
  const RoundTrip trip = round_trip(body);
  const int steps = std::max(kMinSteps, static_cast<int>(std::ceil(trip.length_m / kStep)));
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  Pose from = script.at(0.0, {}).pose;
  if (collision::overlaps(obstacles, hull, from)) return false;
  for (int i = 1; i <= steps; ++i) {
    const Pose to = script.at(trip.time_s * i / steps, {}).pose;
    if (collision::sweep(obstacles, hull, from, to).hit) return false;
    from = to;
  }
  return true;
}

}  // namespace flockstep
