// Surveys: the geometry of a world, for programs that plan, map or label. Objects have the numbers of World::mesh(): the
// primitives, then the meshes. These numbers are the cameras' instance ids minus 1.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// The objects of a world, by their numbers.
struct ObjectList {
  std::vector<Aabb> boxes;              // m, world frame, smallest box around each object; NaN for an unused number
  std::vector<std::int32_t> materials;  // index into World::materials(); -1 if an object has several
  std::vector<Visibility> visibility;   // full for an unused number
};
// Returns boxes, materials and roles of all objects.
FLOCKSTEP_API ObjectList objects(const World& world);

// Points on surfaces; all arrays have one entry per point.
struct PointCloud {
  std::vector<Vec3> points;   // m, world frame
  std::vector<Vec3> normals;  // unit, out of a solid, into a room; of a triangle: the side where it is counter-clockwise
  std::vector<std::uint16_t> semantic;  // semantic id of the material, as in camera images
  std::vector<std::int32_t> objects;    // number of the object
};

// Returns points spread evenly over all visible surfaces, about one for each spacing_m * spacing_m of area. The result is
// deterministic. The points lie on World::mesh(spacing_m / 100). Throws std::invalid_argument unless spacing_m is at least 1e-4
// and there are at most 50,000,000 points.
FLOCKSTEP_API PointCloud point_cloud(const World& world, float spacing_m);

// A grid of cubic cells. Cell (i, j, k) has its centre at origin + cell_m * (i + 1/2, j + 1/2, k + 1/2), and the array index (i
// * size[1] + j) * size[2] + k.
struct CellGrid {
  Vec3 origin = Vec3::Zero();  // m, world frame, minimum corner
  float cell_m = 0.0F;         // m, edge of a cell
  std::array<int, 3> size{};   // cells along x, y, z
};

// occupancy() and distance() cover a box from its minimum corner on; the default is the bounds of the world. Both throw
// std::invalid_argument unless cell_m is in [1e-3, 100], the box is inside the world and there are at most 134,217,728 cells.

// 1 for each cell that touches a surface, or whose centre is inside a solid or outside the room; 0 for all others. For this
// test, cells are enlarged by a thousandth, so that a surface between two cells occupies both. Closed meshes are hollow, as in
// collision checks.
struct OccupancyGrid {
  CellGrid grid;                       // position and size
  std::vector<std::uint8_t> occupied;  // 0 or 1 per cell
};
// Returns which cells of a box are occupied.
FLOCKSTEP_API OccupancyGrid occupancy(const World& world, float cell_m, const std::optional<Aabb>& box = {});

// Distance (m) from the centre of each cell to the nearest surface; 0 inside a solid and outside the room.
struct DistanceGrid {
  CellGrid grid;                  // position and size
  std::vector<float> distance_m;  // m per cell
};
// Returns the distance of each cell of a box to the nearest surface.
FLOCKSTEP_API DistanceGrid distance(const World& world, float cell_m, const std::optional<Aabb>& box = {});

// The surface points that are nearest to K points.
struct NearestSurfaces {
  std::vector<Vec3> points;           // (K,) m, world frame; the point itself inside a solid and outside the room
  std::vector<float> distance_m;      // (K,) m to it
  std::vector<std::int32_t> objects;  // (K,) number of the object
};
// Returns the nearest surfaces that drones hit. points (K, 3) m. The distances are exact up to rounding. Throws
// std::invalid_argument if a point is outside the world (kMaxCoordinate).
FLOCKSTEP_API NearestSurfaces nearest(const World& world, std::span<const float> points);

}  // namespace flockstep
