#include "bodies/body_model.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <utility>

#include "prepared/prepared_world.hpp"

namespace flockstep::bodies {
namespace {

PrimitiveKind kind_of(BodyShape shape) {
  switch (shape) {
    case BodyShape::cylinder:
      return PrimitiveKind::cylinder;
    case BodyShape::sphere:
      return PrimitiveKind::sphere;
    case BodyShape::capsule:
      return PrimitiveKind::capsule;
    default:
      return PrimitiveKind::box;
  }
}

Primitive solid_of(const BodyConfig& config) {
  Primitive solid;
  solid.kind = kind_of(config.shape);
  for (int axis = 0; axis < 3; ++axis) solid.half_extents[axis] = 0.5F * config.size_m[static_cast<std::size_t>(axis)];
  solid.visibility = config.visibility;
  return solid;
}

float radius_of(const Primitive& solid) {
  constexpr float kRounding = 1.00001F;
  const Vec3& half = solid.half_extents;
  switch (solid.kind) {
    case PrimitiveKind::cylinder:
      return kRounding * std::hypot(half.x(), half.z());
    case PrimitiveKind::sphere:
      return kRounding * half.x();
    case PrimitiveKind::capsule:
      return kRounding * half.z();
    default:
      return kRounding * half.norm();
  }
}

float radius_of(const Aabb& box) {
  constexpr float kWider = 1.00001F;
  return kWider * box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs()).norm();
}

BodyConfig validated(const BodyConfig& config) {
  config.validate();
  return config;
}

}  // namespace

BodyModel::BodyModel(const BodyConfig& given)
    : config(validated(given)),
      script(config),
      solid(solid_of(config)),
      radius(radius_of(solid)),
      surface{config.color, config.semantic == 0 ? kSemanticBody : static_cast<std::uint16_t>(config.semantic)} {
  if (!config.mesh) return;
  const PreparedWorld& made = prepared(*config.mesh);
  mesh = &made.scene();
  mesh->prepare_tiles(config.mesh->triangles());
  parts = &made.corners();
  radius = radius_of(config.mesh->bounds());
  surface.mesh = &config.mesh;
  surface.shading = &made.shading(true);
}

Models models_of(const World& world) {
  if (world.original() != nullptr) return models_of(*world.original());
  if (world.bodies().empty()) return {};
  return prepared(world).bodies().get<std::vector<BodyModel>>(
      [&world] { return std::make_shared<const std::vector<BodyModel>>(world.bodies().begin(), world.bodies().end()); });
}

}  // namespace flockstep::bodies
