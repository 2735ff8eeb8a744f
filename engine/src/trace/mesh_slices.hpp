// Traces fans against triangles. A fan's rays share origin and plane, so they can hit only a slice of the world: a picture in
// two dimensions.
//
// The tree is walked once for the whole fan, past boxes that the plane, the range or the fan's sector do not intersect. The plane
// cuts the triangles of a leaf, sixteen at once, into segments. In the plane, a segment covers an interval of angles; a table
// leads to the rays in it, and each of these is tested against the segment.
//
// A ray's result has the same bits on every target and beside any other rays of a fan in the same frame. It depends only on the
// frame, the origin, the ray and the triangles:
// - Each corner is rounded into the fan's frame on its own, so triangles that share a corner still share it afterwards. Corners
//   are above the plane or not, so an edge is cut for both of its triangles or for neither. Both get the same bits for the
//   point of the cut, and a ray passes it on the same side. Therefore no ray slips between triangles that share an edge.
// - The distance is computed from the segment's nearer end, so a hit ahead does not seem to be behind, however near it is.
// - A box is skipped only if no ray can hit its triangles, or only beyond its current hit. It is widened by more than the
//   rounding error of a hit.
// - Of hits at the same distance, the triangle with the lowest number wins.
// - A triangle in the fan's plane is not above it, and its neighbours are hit in its place.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "trace/mesh_tree.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// Rays in a plane. It belongs to the sensor and is computed once.
struct Fan {
  static constexpr std::size_t kMaxCells = 512;

  Mat3 to_sensor;                                    // rotation, from the fan's frame; the third axis is the plane's normal
  float between_rad = 0.0F;                          // mean angle between neighbouring rays; 0 for a single one
  std::size_t count = 0;                             // number of rays, at most kMaxRays
  alignas(64) float x[kMaxRays + kRayPadding] = {};  // directions in the fan's frame, by their angle from the negative first axis
  alignas(64) float y[kMaxRays + kRayPadding] = {};
  alignas(64) std::int32_t ray[kMaxRays + kRayPadding] = {};  // their numbers in the sensor's order
  // The angles are divided into cells; from `begin_rad`, there are `per_rad` of them in a radian. The rays from first[cell] to
  // first[cell + 1] lie in a cell. The rays of an even fan lie at the beginnings of the cells, one in each.
  bool is_even = false;
  float begin_rad = 0.0F, per_rad = 0.0F;
  std::size_t cells = 0;
  std::uint16_t first[kMaxCells + 1] = {};
  // The sector of the rays: in front of one of the edges, or of both if it is narrower than a half turn. The edges are normals
  // in the fan's frame.
  enum class Sector : std::uint8_t { narrow, wide, full } sector = Sector::full;
  float edge[2][2] = {};
};

// Returns true if the unit directions lie in a plane, as those of a fan must.
bool are_in_plane(std::span<const Eigen::Vector3d> directions);

// Returns the fan of 1 to kMaxRays directions in a plane. mounting: rotation from their frame to the sensor's. In a plane of two
// axes, the fan's frame is made of these. In any other plane it depends on all directions.
Fan make_fan(std::span<const Eigen::Vector3d> directions, const Eigen::Matrix3d& mounting);

// The ways to walk the tree. They give the same bits.
enum class SliceWalk : std::uint8_t {
  automatic,  // listed for few leaves, else ordered
  listed,     // collects the leaves, then cuts them
  ordered     // nearest first, past boxes that no ray hits before its hit
};

// Keeps hits that are nearer than the bundle's t_hit. A hit gets the element first_element + its triangle. rays: all of the
// fan's; their directions are not read. Returns true if scans near this one are faster with SliceWalk::ordered. Call under
// FlushDenormals.
bool trace_mesh_slice(const MeshTree& tree, std::int32_t first_element, const Fan& fan, RayBundle& rays,
                      SliceWalk walk = SliceWalk::automatic);

}  // namespace flockstep::trace
