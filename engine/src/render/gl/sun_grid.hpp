// GlSunGrid: the casters that may hide the sun from a point, found by the position of the point seen from the sun.
//
// The sun is infinitely far away. The grid lies across its direction, and each cell lists the casters whose shadows reach it.
// A point is in shadow if a caster in its cell's list lies above it. Shadows are therefore exact and cost only the few tests
// of one cell.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "trace/masks.hpp"

namespace flockstep::render {

// A plane counts as a box, and a disc as a cylinder without thickness. Only bodies are meshes.
enum class CasterKind : std::uint8_t { triangle, box, cylinder, sphere, capsule, room, mesh };

// Each cell has a list of triangles and a list of solids.
inline constexpr std::size_t kNumLists = 2;

// A shadow caster in the layout of the shaders, in the sun's frame (z towards the sun); each row is a vec4.
// Triangle: a corner; two rows of the matrix that maps coordinates across the sun's direction to barycentric coordinates; the
// heights of the other two corners above the first. With a mask, also the number of the mask plus 1 (beside the corner), the
// texture coordinates of the first corner, and the offsets of the other two from them.
// Mask: the size of the texture and how it wraps; the upper and the lower half of the index of its first alpha, and the
// cutoff.
// Solid: its centre and its kind; the rows of the rotation into its own frame, each with the half extent along that axis.
// Mesh: as a solid, but instead of half extents the radius of its ball, and the upper and the lower half of the index of its
// first CasterNode.
struct SunCaster {
  std::array<std::array<float, 4>, 4> rows{};

  // Sets the mask of a triangle.
  void set_mask(const trace::Masks::Triangle& masked);
  // Adds an offset to the index of the first alpha of a mask.
  void begin_alphas(std::uint32_t by) {
    const std::uint32_t first = (static_cast<std::uint32_t>(rows[1][0]) << 16U | static_cast<std::uint32_t>(rows[1][1])) + by;
    rows[1][0] = static_cast<float>(first >> 16U);
    rows[1][1] = static_cast<float>(first & 0xFFFFU);
  }
  // Sets the first node of a mesh.
  void begin_nodes(std::uint32_t first) {
    rows[2][3] = static_cast<float>(first >> 16U);
    rows[3][3] = static_cast<float>(first & 0xFFFFU);
  }
};

// The masks of triangles that cast shadows.
struct SunMasks {
  SunMasks() = default;
  explicit SunMasks(const trace::Masks& from);

  std::vector<SunCaster> masks;
  std::vector<std::uint32_t> alphas;  // of the mask textures, row by row; four per number, from the lowest byte on
};

// Returns the rotation from the world frame to the sun's frame.
Eigen::Matrix3d sun_rotation(const Light& light);

// Returns the caster of a primitive. to_sun: see sun_rotation().
SunCaster make_caster(const Primitive& primitive, const Eigen::Matrix3d& to_sun);
// Returns the caster of a mesh body, without its nodes.
SunCaster make_mesh_caster(const Vec3& position, const Mat3& rotation, float radius, const Eigen::Matrix3d& to_sun);

struct GlSunGrid {
  explicit GlSunGrid(const World& world);

  Mat3 to_sun;              // rotation, world frame to sun frame
  float left = 0, low = 0;  // m, origin of the grid across the sun's direction
  float cell = 1;           // m
  std::uint32_t columns = 1, rows = 1;
  std::vector<std::uint32_t> starts;   // first entry of each list of each cell, then the end of the last list
  std::vector<std::uint32_t> entries;  // indices into casters
  std::vector<SunCaster> casters;
  SunMasks masks;
};

// GlCasterTree: the triangles of a mesh body that may hide the sun, in the body's frame, as a tree of boxes.
//
// A body may turn between any two frames, so nothing here depends on its pose. For each visible point in the shadow of the
// body's ball, the shader walks the tree along the direction to the sun.
// A box of the tree in the layout of the shaders. The nodes below it follow it.
struct CasterNode {
  std::array<float, 3> low;  // m
  std::uint32_t next;        // first node that is not below this one
  std::array<float, 3> high;
  std::uint32_t triangles;  // their number and, from bit 3 on, the index of the first; 0 for a node with nodes below it
};

struct GlCasterTree {
  explicit GlCasterTree(const World& world);

  std::vector<CasterNode> nodes;  // the root is the first; none if no triangle is visible
  // In the order of the nodes; each row is a vec4. A corner; the offset of the second corner from it; that of the third, which
  // begins at the end of the second row. The other fields are those of a triangle in GlSunGrid.
  std::vector<SunCaster> triangles;
  SunMasks masks;
};

}  // namespace flockstep::render
