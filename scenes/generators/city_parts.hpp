// Geometry shared by the houses and streets of a generated city.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>

#include "flockstep/world_builder.hpp"
#include "generators/parts.hpp"

namespace flockstep::streets {

inline constexpr double kPavementHeight = 0.14;  // m, above the road

// The mesh parts of one thing, by material. Each material becomes one object.
class Thing {
 public:
  MeshPart& of(std::uint16_t material) { return parts_[material]; }
  void into(WorldBuilder& builder) const {
    for (const auto& [material, part] : parts_) builder.mesh(part, material);
  }

 private:
  std::map<std::uint16_t, MeshPart> parts_;
};

// A level frame: x along `along`, y to the left of it, z up.
struct Frame {
  Vec3d at;
  Vec2d along;  // unit vector

  Vec3d operator()(double x, double y, double z) const {
    return at + Vec3d(x * along.x() - y * along.y(), x * along.y() + y * along.x(), z);
  }
};

// Adds a quad with corners in the order of add_quad. `first` and `third` are the texture coordinates of a and c.
void add_panel(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, const std::array<double, 2>& first,
               const std::array<double, 2>& third);

// Adds a block given in a frame.
void add_block(MeshPart& part, const Frame& frame, const Vec3d& center, const Vec3d& size, double repeat_m = 1.0);

// Returns the corners of a regular polygon with 8 or 12 sides on the unit circle, counter-clockwise from (1, 0).
std::span<const Vec2d> circle(int sides);

// Adds a surface of revolution about a vertical axis. The profile holds (radius, height) from bottom to top. A radius of 0
// closes the surface.
void add_turned(MeshPart& part, const Vec3d& foot, std::span<const std::array<double, 2>> profile, int sides = 8);

// Adds a wire with a triangular cross-section through the points.
void add_wire(MeshPart& part, std::span<const Vec3d> points, double radius);

// Returns the rotation from the z axis to a unit direction, which must not be straight down.
Quat turned_to(const Vec3d& direction);

}  // namespace flockstep::streets
