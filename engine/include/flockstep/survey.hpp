// Surveys: what a world can tell of itself, for programs that plan, map or label. Objects are numbered as World::mesh() says: the
// primitives, then the meshes, which are the instance ids of cameras less 1.
#pragma once

#include <array>
#include <cstdint>
#include <optional>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

struct ObjectList {
  std::vector<Aabb> boxes;              // m, world frame, the smallest around each object; NaN where a number has no object
  std::vector<std::int32_t> materials;  // index into World::materials(), -1 where an object has several
  std::vector<Visibility> visibility;   // full where a number has no object
};
FLOCKSTEP_API ObjectList objects(const World& world);

struct PointCloud {
  std::vector<Vec3> points;             // m, world frame
  std::vector<Vec3> normals;            // unit: out of a solid, into a room, of a triangle the side it is counter-clockwise from
  std::vector<std::uint16_t> semantic;  // class of the material, as cameras report it
  std::vector<std::int32_t> objects;
};

// Points spread evenly over all surfaces that are visual, about one for every spacing_m * spacing_m of them, and the same ones
// each time. They lie on World::mesh(spacing_m / 100). Throws std::invalid_argument unless spacing_m is at least 1e-4 and the
// points at most 50,000,000.
FLOCKSTEP_API PointCloud point_cloud(const World& world, float spacing_m);

// Cubes side by side. Cell (i, j, k) has its centre at origin + cell_m * (i + 1/2, j + 1/2, k + 1/2), and the place
// (i * size[1] + j) * size[2] + k in an array.
struct CellGrid {
  Vec3 origin = Vec3::Zero();  // m, world frame, the least corner
  float cell_m = 0.0F;
  std::array<int, 3> size{};  // cells along x, y, z
};

// Both cover a box, the bounds of the world if none is given, from its least corner on, and throw std::invalid_argument unless
// cell_m is in [1e-3, 100], the box lies in the world, and the cells are at most 134,217,728.

// 1 for each cell that touches a surface or has its centre within a solid or outside of the room, else 0. Cells count as a
// thousandth wider than they are, so that a surface between two cells occupies both. Closed meshes are hollow, here as in flight.
struct OccupancyGrid {
  CellGrid grid;
  std::vector<std::uint8_t> occupied;
};
FLOCKSTEP_API OccupancyGrid occupancy(const World& world, float cell_m, const std::optional<Aabb>& box = {});

// How far (m) the centre of each cell is from the nearest surface; 0 within a solid and outside of the room.
struct DistanceGrid {
  CellGrid grid;
  std::vector<float> distance_m;
};
FLOCKSTEP_API DistanceGrid distance(const World& world, float cell_m, const std::optional<Aabb>& box = {});

}  // namespace flockstep
