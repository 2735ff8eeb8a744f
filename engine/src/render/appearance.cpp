#include "render/appearance.hpp"

#include <algorithm>

namespace flockstep::render {

Appearance::Appearance(const World& world) : marker_radius(world.markers().radius), light(world.light()) {
  for (std::size_t i = 0; i < world.materials().size(); ++i) {
    const Material& material = world.materials()[i];
    const std::int32_t texture = material.texture ? std::int32_t{*material.texture} : -1;
    materials.push_back({material.base_color, world.semantic(i), 0, texture});
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

}  // namespace flockstep::render
