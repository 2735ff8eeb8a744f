#include "planning/navigable.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <numeric>
#include <stdexcept>
#include <string>
#include <utility>
#include <vector>

#include "base/in_world.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "bodies/body_script.hpp"
#include "collision/sweep.hpp"
#include "flockstep/world_report.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

std::string field(const World& world, const std::string& place) { return "world \"" + world.name() + "\": " + place; }

bool has_room(const World& world) {
  return !world.primitives().empty() && world.primitives().front().kind == PrimitiveKind::room;
}

// Returns the space for markers: the bounds of the world, without an upper end if there is no room.
Aabb marked_space(const World& world) {
  Aabb box = world.bounds();
  if (!has_room(world)) box.max.z() = static_cast<float>(kMaxCoordinate);
  return box;
}

std::vector<Vec3> corners_of(const Aabb& box) {
  std::vector<Vec3> corners;
  for (const float z : {box.min.z(), box.max.z()}) {
    for (const float x : {box.min.x(), box.max.x()}) {
      for (const float y : {box.min.y(), box.max.y()}) corners.emplace_back(x, y, z);
    }
  }
  return corners;
}

void require_inside(const World& world, const Aabb& box, const std::string& place, const Vec3& point) {
  if ((point.array() >= box.min.array()).all() && (point.array() <= box.max.array()).all()) return;
  refuse(field(world, place), "a point within the world, " + coordinates(box.min) + " to " + coordinates(box.max),
         coordinates(point));
}

}  // namespace

void require_free(const World& world, const DroneModel& drone, const std::string& place, const Vec3& point) {
  require_inside(world, open_space(world), place, point);
  if (!collision::overlaps(prepared(world).obstacles(), collision::Hull(drone), Pose{.position = point})) return;
  refuse(field(world, place), "room for the drone", coordinates(point) + ", where it touches an obstacle");
}

Aabb open_space(const World& world) {
  if (has_room(world)) return world.bounds();
  constexpr auto kEnd = static_cast<float>(kMaxCoordinate);
  return {.min = Vec3::Constant(-kEnd), .max = Vec3::Constant(kEnd)};
}

void require_navigable(const World& world, const DroneModel& drone) {
  const Markers& markers = world.markers();
  for (const auto& [marker, name] : {std::pair{&markers.start, "markers.start"}, std::pair{&markers.goal, "markers.goal"}}) {
    if (*marker) continue;
    throw std::invalid_argument(field(world, name) +
                                ": expected a point, found none (world.with_drawn_markers(seed) draws them)");
  }
  const Aabb space = marked_space(world);
  const auto require_marker = [&](const std::string& place, const Vec3& point) { require_inside(world, space, place, point); };
  require_marker("markers.start", *markers.start);
  require_free(world, drone, "markers.start", *markers.start);
  for (std::size_t i = 0; i < markers.waypoints.size(); ++i) {
    require_marker("markers.waypoints[" + std::to_string(i) + ']', markers.waypoints[i]);
  }
  require_marker("markers.goal", *markers.goal);
  if (!markers.spawn_box) return;
  for (const Vec3& point : corners_of(*markers.spawn_box)) {
    require_marker("markers.spawn_box", point);
    require_free(world, drone, "markers.spawn_box", point);
  }
}

namespace {

// Returns a prism or a box around a body and its margin.
std::vector<Vec3> hull_around(const BodyConfig& body, float margin_m) {
  constexpr int kSides = 12;
  const Vec3 margin = Vec3::Constant(margin_m), half = 0.5F * Vec3(body.size_m[0], body.size_m[1], body.size_m[2]);
  if (body.shape == BodyShape::mesh || body.shape == BodyShape::box) {
    const Aabb box = body.shape == BodyShape::mesh ? body.mesh->bounds() : Aabb{-half, half};
    return corners_of({box.min - margin, box.max + margin});
  }
  std::vector<Vec3> points;
  const Vec3 reach = half + margin;
  for (const float z : {-reach.z(), reach.z()}) {
    for (int i = 0; i < kSides; ++i) {
      const float angle = 2.0F * std::numbers::pi_v<float> * static_cast<float>(i) / kSides;
      const float radius = reach.x() / std::cos(std::numbers::pi_v<float> / kSides);
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

namespace {

// Returns for each vertex the first vertex in coordinate order with the same position.
std::vector<std::uint32_t> welded(const std::vector<Vec3>& vertices) {
  std::vector<std::uint32_t> order(vertices.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::lexicographical_compare(vertices[a].data(), vertices[a].data() + 3, vertices[b].data(), vertices[b].data() + 3);
  });
  std::vector<std::uint32_t> first(vertices.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_same = i > 0 && vertices[order[i]] == vertices[order[i - 1]];
    first[order[i]] = is_same ? first[order[i - 1]] : order[i];
  }
  return first;
}

void count_edges(const TriangleMesh& mesh, WorldReport& report) {
  const std::vector<std::uint32_t> vertex = welded(mesh.vertices);
  Interrupt::poll();
  std::vector<std::array<std::uint32_t, 2>> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = vertex[static_cast<std::size_t>(triangle[i])];
      const std::uint32_t b = vertex[static_cast<std::size_t>(triangle[(i + 1) % 3])];
      edges.push_back({std::min(a, b), std::max(a, b)});
    }
  }
  std::sort(edges.begin(), edges.end());
  Interrupt::poll();
  for (auto first = edges.begin(); first != edges.end();) {
    const auto last = std::find_if(first, edges.end(), [&](const auto& edge) { return edge != *first; });
    report.open_edges += last - first == 1 ? 1U : 0U;
    report.crowded_edges += last - first > 2 ? 1U : 0U;
    first = last;
  }
}

}  // namespace

WorldReport check(const World& world, const DroneModel& drone) {
  WorldReport report;
  const TriangleMesh& mesh = world.triangles();
  report.triangles = mesh.triangles.size();
  for (std::size_t i = 0; i < mesh.objects.size(); ++i)
    report.objects += i == 0 || mesh.objects[i] != mesh.objects[i - 1] ? 1U : 0U;
  report.objects += world.primitives().size();
  count_edges(mesh, report);
  for (const Texture& texture : world.textures()) report.texture_bytes += texture.rgba.size();
  try {
    require_navigable(world, drone);
  } catch (const std::invalid_argument& error) {
    report.not_navigable = error.what();
  }
  return report;
}

}  // namespace flockstep
