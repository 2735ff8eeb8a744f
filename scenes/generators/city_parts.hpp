// Pieces that the houses and the streets of a generated city share.
#pragma once

#include <array>
#include <cstdint>
#include <map>
#include <span>

#include "flockstep/world_builder.hpp"
#include "generators/parts.hpp"

namespace flockstep::streets {

inline constexpr double kPavementHeight = 0.14;  // m above the road

// One thing, by its materials: of each it becomes one object.
class Thing {
 public:
  MeshPart& of(std::uint16_t material) { return parts_[material]; }
  void into(WorldBuilder& builder) const {
    for (const auto& [material, part] : parts_) builder.mesh(part, material);
  }

 private:
  std::map<std::uint16_t, MeshPart> parts_;
};

// A level frame: x along, y to the left of it, z up.
struct Frame {
  Vec3d at;
  Vec2d along;  // unit

  Vec3d operator()(double x, double y, double z) const {
    return at + Vec3d(x * along.x() - y * along.y(), x * along.y() + y * along.x(), z);
  }
};

// Four corners as of add_quad, and where in a texture the first and the third of them lie.
void add_panel(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, const std::array<double, 2>& first,
               const std::array<double, 2>& third);

// A block placed in a frame.
void add_block(MeshPart& part, const Frame& frame, const Vec3d& center, const Vec3d& size, double repeat_m = 1.0);

// Corners of a regular polygon of 8 or 12 sides around the origin, counter-clockwise from (1, 0).
std::span<const Vec2d> circle(int sides);

// Turned about an upright axis: (radius, height) from below to above, as seen from outside. A radius of 0 closes it.
void add_turned(MeshPart& part, const Vec3d& foot, std::span<const std::array<double, 2>> profile, int sides = 8);

// A wire from point to point, three-sided.
void add_wire(MeshPart& part, std::span<const Vec3d> points, double radius);

// What turns the z axis towards a direction of length 1, which is not straight down.
Quat turned_to(const Vec3d& direction);

}  // namespace flockstep::streets
