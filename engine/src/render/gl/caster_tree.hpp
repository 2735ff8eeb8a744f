// GlCasterTree: the triangles of a mesh body that may hide the sun, in the body's frame, as a tree of boxes.
//
// A body may turn between any two frames, so nothing here depends on its pose. For each visible point in the shadow of the
// body's ball, the shader walks the tree along the direction to the sun.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "flockstep/world.hpp"
#include "render/gl/sun_grid.hpp"

namespace flockstep::render {

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
