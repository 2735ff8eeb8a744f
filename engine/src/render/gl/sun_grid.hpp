// GlSunGrid: what may hide the sun from a point, by where the point is as the sun sees it.
//
// The sun is infinitely far: across its direction lies a grid, and each of its cells lists what casts a shadow there. A point is
// in shadow if something in its cell's list lies above it. So shadows are exact, and cost the few tests of one cell.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep::render {

// A plane is a box, a disc a cylinder of no thickness.
enum class CasterKind : std::uint8_t { triangle, box, cylinder, sphere, capsule, room };

// Each cell has two: one of its triangles, and one of its solids.
inline constexpr std::size_t kNumLists = 2;

// A caster of shadows as the shaders read it, in the sun's frame (z towards it); each row is a vec4.
// A triangle: a corner; two rows of the matrix that takes what is across the sun's direction to barycentric coordinates; how
// much higher the other two corners are; and if it has a mask, that one's number plus 1 beside the corner, then the first
// corner's place in the texture and how far away from it those of the others are. A mask: the texture's size and how it wraps;
// and the upper and the lower half of where its alphas begin, and the cutoff. A solid: its centre and its kind; and the rows of
// the rotation into its own frame, each with the half extent along that axis.
struct SunCaster {
  std::array<std::array<float, 4>, 4> rows{};

  // Of a mask: moves its alphas.
  void begin_alphas(std::uint32_t by) {
    const std::uint32_t first = (static_cast<std::uint32_t>(rows[1][0]) << 16U | static_cast<std::uint32_t>(rows[1][1])) + by;
    rows[1][0] = static_cast<float>(first >> 16U);
    rows[1][1] = static_cast<float>(first & 0xFFFFU);
  }
};

struct GlSunGrid {
  explicit GlSunGrid(const World& world);

  Mat3 to_sun;              // rotation, world frame to the sun's
  float left = 0, low = 0;  // m, where the grid begins across the sun's direction
  float cell = 1;           // m
  std::uint32_t columns = 1, rows = 1;
  std::vector<std::uint32_t> starts;   // of each list of each cell, and one more at the end: where its entries begin
  std::vector<std::uint32_t> entries;  // into casters
  std::vector<SunCaster> casters;
  std::vector<SunCaster> masks;
  std::vector<std::uint32_t> alphas;  // of their textures, row by row; four to a number, from the lowest byte on
};

}  // namespace flockstep::render
