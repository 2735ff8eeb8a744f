#include "render/appearance.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

namespace flockstep::render {

SunDisc::SunDisc(const Light& light) {
  const float largest = std::max({light.sun_color[0], light.sun_color[1], light.sun_color[2]});
  shows = largest > 0.0F && (light.sun_radius_deg > 0.0F || light.sun_glow > 0.0F);
  if (!shows) return;
  for (std::size_t c = 0; c < 3; ++c) color[c] = light.sun_color[c] / largest;
  glow = light.sun_glow;
  if (light.sun_radius_deg == 0.0F) return;
  const double chord = 2.0 * std::sin(static_cast<double>(light.sun_radius_deg) * std::numbers::pi / 360.0);
  edge = static_cast<float>(chord * chord);
  steepness = static_cast<float>(1.0 / (0.19 * chord * chord));
}

Appearance::Appearance(const World& world) {
  for (std::size_t i = 0; i < world.materials().size(); ++i) {
    const Material& material = world.materials()[i];
    const std::int32_t texture = material.texture ? std::int32_t{*material.texture} : -1;
    materials.push_back({material.base_color, world.semantic(i), 0, texture, material.emissive});
  }
  std::uint16_t instance = 0;
  for (const Primitive& primitive : world.primitives()) {
    primitives.push_back(materials[primitive.material]);
    primitives.back().instance = ++instance;
  }
  first_object = ++instance;
  for (const std::uint16_t object : world.triangles().objects) {
    instance = std::max(instance, static_cast<std::uint16_t>(first_object + object));
  }
  if (world.triangles().triangles.empty()) --instance;
  const Markers& places = world.markers();
  if (places.start) markers.push_back({*places.start, {kStartColor, kSemanticStart, ++instance}});
  for (const Vec3& waypoint : places.waypoints) markers.push_back({waypoint, {kWaypointColor, kSemanticWaypoint, ++instance}});
  if (places.goal) markers.push_back({*places.goal, {kGoalColor, kSemanticGoal, ++instance}});
}

std::optional<Aabb> shading_room(const World& world) {
  if (world.primitives().empty() || world.primitives()[0].kind != PrimitiveKind::room) return std::nullopt;
  const Primitive& given = world.primitives()[0];
  const Aabb room{given.center - given.half_extents, given.center + given.half_extents};
  // Rounding may place geometry at a wall slightly beyond it.
  const float rounding = 1e-5F * (1.0F + room.min.cwiseAbs().cwiseMax(room.max.cwiseAbs()).maxCoeff());
  const auto holds = [&](const Vec3& low, const Vec3& high) {
    return (low.array() >= room.min.array() - rounding).all() && (high.array() <= room.max.array() + rounding).all();
  };
  bool all = holds(world.bounds().min, world.bounds().max);
  const Vec3 radius = Vec3::Constant(world.markers().radius);
  const auto see = [&](const Vec3& place) { all &= holds(place - radius, place + radius); };
  if (world.markers().start) see(*world.markers().start);
  for (const Vec3& waypoint : world.markers().waypoints) see(waypoint);
  if (world.markers().goal) see(*world.markers().goal);
  return all ? std::nullopt : std::optional(room);
}

}  // namespace flockstep::render
