// Parts: pieces that generated worlds are made of, as triangles with uv. Lengths are m, in the world frame; a repetition of a
// texture is 1 m wide unless it says otherwise. Only correctly rounded operations, so that they are the same on every machine.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/world_builder.hpp"
#include "planning/draws.hpp"

namespace flockstep {

void add_triangle(MeshPart& part, std::int32_t a, std::int32_t b, std::int32_t c);

// Returns its index. (s, t): where in a texture.
std::int32_t add_vertex(MeshPart& part, const Vec3d& at, double s, double t);

// Four corners, counter-clockwise seen from outside, the first two along s. A repetition of a texture is repeat_m wide.
void add_quad(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, double repeat_m = 1.0);

// A box, its six sides as quads; along is the unit vector that its own x axis has, level.
void add_block(MeshPart& part, const Vec3d& center, const Vec3d& size, const Vec2d& along = Vec2d::UnitX(),
               double repeat_m = 1.0);

// The side of a trunk from one height to another, hexagonal; no caps: they lie in the ground and in the crown. turn: the unit
// vector towards its first edge.
void add_trunk(MeshPart& part, const Vec2d& at, double low, double high, double low_radius, double high_radius,
               const Vec2d& turn);

// A cone of branches, octagonal, closed below.
void add_cone(MeshPart& part, const Vec2d& at, double low, double high, double radius, const Vec2d& turn);

// A ball of so many steps from pole to equator, squeezed to half sizes, its surface rough by a share.
void add_ball(MeshPart& part, const Vec3d& center, const Vec3d& half, int steps, double rough, Draws& draws);

}  // namespace flockstep
