// Shape: a piece of furniture as it is put together, in a frame of its own, from blocks, cushions and turned parts.
#pragma once

#include <span>

#include "flockstep/world_builder.hpp"
#include "generators/swatches.hpp"
#include "planning/draws.hpp"

namespace flockstep::indoors {

// Where a piece stands: its frame's origin on the floor, and the unit vector, level, that its y axis has. z is up.
struct Spot {
  Vec2d at = Vec2d::Zero();
  Vec2d facing = Vec2d::UnitY();
  double floor = 0.0;  // m
};

// Lengths are m, in the frame of the piece. Colours are shaded as the piece stands: sides by the way they face, lower parts and
// undersides darker, for light in rooms comes from nowhere in particular.
class Shape {
 public:
  explicit Shape(const Spot& spot) : spot_(spot) {}

  void block(const Vec3d& center, const Vec3d& size, Swatch swatch);
  // The same with its top in a swatch of its own.
  void block(const Vec3d& center, const Vec3d& size, Swatch swatch, Swatch top);
  // A block with bevelled edges.
  void cushion(const Vec3d& center, const Vec3d& size, double bevel, Swatch swatch);
  // Turned around an upright axis: points (radius, z) from the bottom up, closed at both ends. The sides are so many: 8 or 16.
  void turned(const Vec2d& at, std::span<const Vec2d> profile, Swatch swatch, int sides = 8);
  // A square rod from point to point.
  void rod(const Vec3d& from, const Vec3d& to, double width, Swatch swatch);
  // A rectangle of no thickness, seen from where its corners run counter-clockwise, the lower two first.
  void sheet(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, Swatch swatch);
  // A leaf of no thickness that grows from a point outwards along a unit vector, level, and droops.
  void blade(const Vec3d& from, const Vec2d& along, double reach, double rise, double width, Swatch swatch);

  const MeshPart& part() const { return part_; }

 private:
  Vec3d in_world(const Vec3d& local) const;
  Vec3d turned_to_world(const Vec3d& local) const;
  double shade(const Vec3d& at, const Vec3d& normal) const;
  std::int32_t vertex(const Vec3d& at, const Vec3d& normal, Swatch color);
  void face(const std::array<Vec3d, 4>& corners, const Vec3d& normal, Swatch swatch);
  void outwards(std::int32_t a, std::int32_t b, std::int32_t c, const Vec3d& middle);

  Spot spot_;
  MeshPart part_;
};

// The corners of a regular polygon of 16 corners on the unit circle, counter-clockwise from +x.
const std::array<Vec2d, 16>& circle();

}  // namespace flockstep::indoors
