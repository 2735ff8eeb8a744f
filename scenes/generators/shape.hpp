// Shape: one piece of furniture under construction, made of blocks, cushions and turned parts in a local frame.
#pragma once

#include <span>

#include "flockstep/world_builder.hpp"
#include "generators/swatches.hpp"
#include "planning/draws.hpp"

namespace flockstep::indoors {

// The pose of a piece: its frame's origin on the floor, and the horizontal unit vector of its y axis. z is up.
struct Spot {
  Vec2d at = Vec2d::Zero();
  Vec2d facing = Vec2d::UnitY();
  double floor = 0.0;  // m, height of the floor
};

// Lengths are in m, in the frame of the piece. Light in rooms has no main direction, therefore shading is baked in: it depends
// on the direction of a face, and lower parts and undersides are darker.
class Shape {
 public:
  explicit Shape(const Spot& spot) : spot_(spot) {}

  void block(const Vec3d& center, const Vec3d& size, Swatch swatch);
  // Same block with a different swatch on top.
  void block(const Vec3d& center, const Vec3d& size, Swatch swatch, Swatch top);
  // A block with bevelled edges.
  void cushion(const Vec3d& center, const Vec3d& size, double bevel, Swatch swatch);
  // A surface of revolution about a vertical axis. The profile holds points (radius, z) from the bottom up and is closed at
  // both ends. `sides` is 8 or 16.
  void turned(const Vec2d& at, std::span<const Vec2d> profile, Swatch swatch, int sides = 8);
  // A square rod between two points.
  void rod(const Vec3d& from, const Vec3d& to, double width, Swatch swatch);
  // A rectangle without thickness. It is visible from the side on which its corners run counter-clockwise, lower two first.
  void sheet(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, Swatch swatch);
  // A drooping leaf without thickness. It grows outwards from a point along a horizontal unit vector.
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

// Returns the corners of a regular 16-gon on the unit circle, counter-clockwise from +x.
const std::array<Vec2d, 16>& circle();

}  // namespace flockstep::indoors
