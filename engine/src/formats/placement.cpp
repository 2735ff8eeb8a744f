#include "formats/placement.hpp"

#include <array>
#include <cmath>

#include "base/in_world.hpp"
#include "base/require.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

bool is_y_up(const LoadOptions& options, UpAxis usual) {
  return (options.up == UpAxis::of_format ? usual : options.up) == UpAxis::y;
}

}  // namespace

void check_placement(const LoadOptions& options) {
  constexpr double kMaxScale = 1e6;
  require(options.scale >= 1.0 / kMaxScale && options.scale <= kMaxScale, "scale", "a number in [1e-06, 1e+06]", options.scale);
  for (const float value : options.origin) {
    require(std::abs(value) <= static_cast<float>(kMaxCoordinate), "origin", in_world("finite coordinates"), value);
  }
}

Eigen::Affine3d placement(const LoadOptions& options, UpAxis usual) {
  Eigen::Affine3d place = Eigen::Affine3d::Identity();
  if (is_y_up(options, usual)) place.linear() << 1, 0, 0, 0, 0, -1, 0, 1, 0;
  place.linear() *= options.scale;
  place.translation() = options.origin.cast<double>();
  return place;
}

bool moves(const LoadOptions& options) {
  return options.scale != 1.0 || !options.origin.isZero(0.0F) || is_y_up(options, UpAxis::z);
}

namespace {

std::shared_ptr<const World> scaled(const World& mesh, double scale) {
  SceneDescription description;
  description.name = mesh.name();
  description.materials.assign(mesh.materials().begin(), mesh.materials().end());
  description.textures.assign(mesh.textures().begin(), mesh.textures().end());
  description.mesh = mesh.triangles();
  for (Vec3& vertex : description.mesh.vertices) vertex = (scale * vertex.cast<double>()).cast<float>();
  return std::make_shared<const World>(std::move(description));
}

}  // namespace

void place_body(BodyConfig& body, const Eigen::Affine3d& place, double scale) {
  const auto assign = [](std::array<float, 3>& values, const Eigen::Vector3d& v) { Vec3::Map(values.data()) = v.cast<float>(); };
  const auto vector = [](const std::array<float, 3>& v) -> Eigen::Vector3d { return Vec3::Map(v.data()).cast<double>(); };
  const auto move = [&](std::array<float, 3>& point) { assign(point, place * vector(point)); };
  const auto turn = [&](std::array<float, 3>& way) { assign(way, place.linear() * vector(way)); };
  const auto size = [&](float& value) { value = static_cast<float>(static_cast<double>(value) * scale); };
  const Eigen::Matrix3d rotation = place.linear() / scale;
  if (body.shape != BodyShape::mesh) {
    for (float& value : body.size_m) size(value);
  } else if (scale != 1.0) {
    body.mesh = scaled(*body.mesh, scale);
  }
  move(body.position_m);
  const auto [w, x, y, z] = body.quat_wxyz;
  if (!rotation.isIdentity(0.0)) {
    const Eigen::Quaterniond turned = Eigen::Quaterniond(rotation) * Eigen::Quaterniond(w, x, y, z);
    const Quat unit = unit_quaternion({turned.w(), turned.x(), turned.y(), turned.z()});
    body.quat_wxyz = {unit.w(), unit.x(), unit.y(), unit.z()};
  }
  BodyMotion& motion = body.motion;
  turn(motion.velocity_mps);
  for (std::array<float, 3>& point : motion.points_m) move(point);
  size(motion.speed_mps);
  size(motion.corner_radius_m);
  move(motion.center_m);
  assign(motion.axis, rotation * vector(motion.axis));
  turn(motion.travel_m);
  const Eigen::Vector3d a = place * vector(motion.box_min_m), b = place * vector(motion.box_max_m);
  assign(motion.box_min_m, a.cwiseMin(b));
  assign(motion.box_max_m, a.cwiseMax(b));
}

SceneDescription placed(SceneDescription description, const LoadOptions& options) {
  const Eigen::Affine3d place = placement(options, UpAxis::z);
  const bool is_turned = is_y_up(options, UpAxis::z);
  const auto point = [&](const Vec3& p) -> Vec3 { return (place * p.cast<double>()).cast<float>(); };
  const auto size = [&](float value) { return static_cast<float>(value * options.scale); };
  const Eigen::Quaterniond upright(Eigen::Matrix3d(place.linear() / options.scale));
  for (Primitive& primitive : description.primitives) {
    primitive.center = point(primitive.center);
    for (float& half : primitive.half_extents) half = size(half);
    if (!is_turned || primitive.kind == PrimitiveKind::sphere) continue;
    if (primitive.kind == PrimitiveKind::room) {  // rooms stay axis-aligned
      std::swap(primitive.half_extents.y(), primitive.half_extents.z());
    } else {
      const Eigen::Quaterniond rotation = upright * primitive.rotation.cast<double>();
      primitive.rotation = unit_quaternion({rotation.w(), rotation.x(), rotation.y(), rotation.z()});
    }
  }
  for (Gate& gate : description.gates) {
    gate.center = point(gate.center);
    gate.size = size(gate.size);
    gate.bar = size(gate.bar);
    if (!is_turned) continue;
    const Eigen::Quaterniond rotation = upright * gate.rotation.cast<double>();
    gate.rotation = unit_quaternion({rotation.w(), rotation.x(), rotation.y(), rotation.z()});
  }
  for (BodyConfig& body : description.bodies) place_body(body, place, options.scale);
  for (Vec3& vertex : description.mesh.vertices) vertex = point(vertex);
  Markers& markers = description.markers;
  markers.radius = size(markers.radius);
  for (std::optional<Vec3>* const marker : {&markers.start, &markers.goal}) {
    if (*marker) *marker = point(**marker);
  }
  for (Vec3& waypoint : markers.waypoints) waypoint = point(waypoint);
  if (markers.spawn_box) {
    const Vec3 a = point(markers.spawn_box->min), b = point(markers.spawn_box->max);
    markers.spawn_box = Aabb{a.cwiseMin(b), a.cwiseMax(b)};
  }
  if (is_turned) {
    auto& sun = description.light.sun_direction;
    sun = {sun[0], -sun[2], sun[1]};
  }
  return description;
}

}  // namespace flockstep
