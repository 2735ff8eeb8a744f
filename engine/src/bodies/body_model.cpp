#include "bodies/body_model.hpp"

#include <algorithm>
#include <cmath>
#include <memory>
#include <string>
#include <utility>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

std::string size_text(const std::array<float, 3>& size) {
  return std::to_string(size[0]) + " x " + std::to_string(size[1]) + " x " + std::to_string(size[2]);
}

void check_mesh(const BodyConfig& body) {
  if (body.shape != BodyShape::mesh) {
    return require(body.mesh == nullptr, "body.mesh", "no mesh unless shape is \"mesh\"", "a world");
  }
  require(body.mesh != nullptr, "body.mesh", "a world of triangles for the shape \"mesh\"", "none");
  require_mesh(*body.mesh, "body.mesh");
  require(body.size_m == BodyConfig().size_m, "body.size_m", "1 x 1 x 1 for a mesh, which has its own size",
          size_text(body.size_m));
}

}  // namespace

void BodyMotion::validate() const {
  constexpr double kMinAxis = 1e-6;  // far above subnormal numbers, which count as 0 and turn nothing
  check_fields(*this, "body.motion.");
  const auto is = [this](BodyMotionKind which) { return kind == which; };
  if (is(BodyMotionKind::waypoints)) {
    require(points_m.size() >= 2, "body.motion.points_m", "at least two points for \"waypoints\"", points_m.size());
    for (std::size_t i = 1; i < points_m.size(); ++i) {
      require(points_m[i] != points_m[i - 1], "body.motion.points_m[" + std::to_string(i) + ']',
              "another point than the one before", "the same");
    }
    require(route != BodyRoute::loop || points_m.front() != points_m.back(), "body.motion.points_m",
            "a last point apart from the first with route=\"loop\" (it goes back by itself)", "the same");
  } else {
    require(points_m.empty(), "body.motion.points_m", "no points unless kind is \"waypoints\"", points_m.size());
  }
  if (is(BodyMotionKind::orbit) || is(BodyMotionKind::hinge)) {
    const double length = std::hypot(double{axis[0]}, double{axis[1]}, double{axis[2]});
    require(length >= kMinAxis, "body.motion.axis", "a direction of a length of at least 1e-06", length);
  }
  if (is(BodyMotionKind::random_walk)) {
    for (std::size_t i = 0; i < 3; ++i) {
      require(box_min_m[i] <= box_max_m[i], "body.motion.box_max_m[" + std::to_string(i) + ']',
              "at least box_min_m (" + std::to_string(box_min_m[i]) + ')', box_max_m[i]);
    }
  }
}

void BodyConfig::validate() const {
  check_fields(*this, "body.");
  check_mesh(*this);
  const bool is_round = shape == BodyShape::cylinder || shape == BodyShape::capsule;
  require(!is_round || size_m[0] == size_m[1], "body.size_m", "equal x and y for a cylinder or a capsule", size_text(size_m));
  require(shape != BodyShape::capsule || size_m[2] >= size_m[0], "body.size_m",
          "a z of at least the diameter x for a capsule (its round caps included)", size_text(size_m));
  require(shape != BodyShape::sphere || (size_m[0] == size_m[1] && size_m[1] == size_m[2]), "body.size_m",
          "three equal sizes for a sphere", size_text(size_m));
}

void require_mesh(const World& world, const std::string& field) {
  require(!world.triangles().triangles.empty(), field, "a world with triangles", "a world without any");
  require(world.primitives().empty(), field, "a world of triangles only",
          std::to_string(world.primitives().size()) + " primitives");
  require(world.bodies().empty(), field, "a world without bodies", std::to_string(world.bodies().size()) + " bodies");
}

}  // namespace flockstep

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
