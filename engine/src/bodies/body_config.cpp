#include <cmath>
#include <string>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "bodies/mesh_world.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"

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

}  // namespace flockstep
