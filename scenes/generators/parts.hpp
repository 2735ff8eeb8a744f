// Triangle mesh building blocks with uv coordinates for generated worlds. Lengths are in m, in the world frame. A texture
// repeats every metre unless stated otherwise. Only correctly rounded operations are used, so results are identical on every
// machine.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/world_builder.hpp"
#include "planning/draws.hpp"

namespace flockstep {

void add_triangle(MeshPart& part, std::int32_t a, std::int32_t b, std::int32_t c);

// Adds a vertex with texture coordinates (s, t) and returns its index.
std::int32_t add_vertex(MeshPart& part, const Vec3d& at, double s, double t);

// Adds a quad. Its corners run counter-clockwise seen from outside, and s runs from a to b. The texture repeats every repeat_m.
void add_quad(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, double repeat_m = 1.0);

// Adds a box of six quads. `along` is the horizontal unit vector of its x axis.
void add_block(MeshPart& part, const Vec3d& center, const Vec3d& size, const Vec2d& along = Vec2d::UnitX(),
               double repeat_m = 1.0);

// Adds the hexagonal side of a trunk without caps, because its ends are hidden in the ground and in the crown. `turn` is the
// unit vector towards its first edge.
void add_trunk(MeshPart& part, const Vec2d& at, double low, double high, double low_radius, double high_radius,
               const Vec2d& turn);

// Adds an octagonal cone of branches with a closed base.
void add_cone(MeshPart& part, const Vec2d& at, double low, double high, double radius, const Vec2d& turn);

// Adds a ball with `steps` steps from pole to equator, scaled to the half sizes. `rough` is the relative roughness of its
// surface.
void add_ball(MeshPart& part, const Vec3d& center, const Vec3d& half, int steps, double rough, Draws& draws);

}  // namespace flockstep
