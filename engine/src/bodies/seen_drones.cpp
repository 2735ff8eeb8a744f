#include "bodies/seen_drones.hpp"

#include <algorithm>
#include <utility>

#include "flockstep/body.hpp"
#include "flockstep/world_builder.hpp"
#include "world/hull_faces.hpp"

namespace flockstep::bodies {
namespace {

constexpr float kHullRounding = 1.00001F;

// Returns the hull of a drone as a grey mesh.
std::shared_ptr<const World> mesh_of_hull(const DroneModel& model) {
  MeshPart part;
  part.vertices.assign(model.hull().begin(), model.hull().end());
  for (const HullFace& face : hull_faces(model.hull(), trace::HullPlanes::kMax)) {
    const auto corner = [&](std::size_t i) { return static_cast<std::int32_t>(face.corners[i]); };
    for (std::size_t i = 2; i < face.corners.size(); ++i) part.triangles.push_back({corner(0), corner(i - 1), corner(i)});
  }
  WorldBuilder builder("hull");
  builder.mesh(part, builder.material({.name = "grey", .base_color = render::kHullColor}));
  return builder.build();
}

BodyConfig body_of(std::shared_ptr<const World> mesh) {
  BodyConfig config;
  config.name = "drone";
  config.shape = BodyShape::mesh;
  config.mesh = std::move(mesh);
  config.semantic = kSemanticDrone;
  return config;
}

}  // namespace

SeenDrones::SeenDrones(const State& state, const DroneModel& model, std::shared_ptr<const World> mesh, bool for_cameras)
    : state_(state), planes_(model.hull()), radius_(kHullRounding * model.radius()), seen_radius_(state.active.size()) {
  if (for_cameras) {
    mesh_.emplace(body_of(mesh != nullptr ? std::move(mesh) : mesh_of_hull(model)));
    radius_ = std::max(radius_, mesh_->radius);
  }
  update();
}

void SeenDrones::update() {
  for (std::size_t i = 0; i < seen_radius_.size(); ++i) update(DroneIndex(i));
}

void SeenDrones::update(DroneIndex drone) { seen_radius_[drone] = state_.active[drone] ? radius_ : -1.0F; }

trace::Bodies SeenDrones::hulls() const {
  return {.position = state_.position.data(),
          .quat_wxyz = state_.quat_wxyz.data(),
          .radius = seen_radius_.data(),
          .common_hull = &planes_,
          .count = seen_radius_.size()};
}

render::VisibleBodies SeenDrones::visible() const {
  trace::Bodies shapes = hulls();
  shapes.common_hull = nullptr;
  shapes.common_mesh = mesh_->mesh;
  return {shapes, &mesh_->surface, kFirstDroneInstance};
}

}  // namespace flockstep::bodies
