#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "base/in_world.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "flockstep/survey.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

constexpr double kMaxGridCells = 1 << 27;
constexpr double kWider = 1e-3;      // fraction of a cell by which its edge is enlarged
constexpr double kUncovered = 1e-4;  // fraction of a cell: a smaller excess of the box gets no extra cell

CellGrid grid_over(const World& world, float cell_m, const std::optional<Aabb>& given) {
  require(cell_m >= 1e-3F && cell_m <= 100.0F, "cell_m", "a number in [0.001, 100]", cell_m);
  const Aabb box = given.value_or(world.bounds());
  require(is_in_world(box.min) && is_in_world(box.max), "box", in_world("finite coordinates"), "a coordinate that is not");
  require((box.min.array() <= box.max.array()).all(), "box", "min <= max along each axis", "min > max");
  const double cell = static_cast<double>(cell_m);
  const Eigen::Array3d cells = ((box.max.cast<double>() - box.min.cast<double>()).array() / cell - kUncovered).ceil().max(1.0);
  if (!(cells.prod() <= kMaxGridCells)) {
    std::ostringstream got;
    got << cell_m << " m, which makes " << cells.x() << " x " << cells.y() << " x " << cells.z();
    refuse("cell_m", "a number that makes at most 134,217,728 cells", got.str());
  }
  const Eigen::Array3i size = cells.cast<int>();
  return {box.min, cell_m, {size.x(), size.y(), size.z()}};
}

std::size_t number_of_cells(const CellGrid& grid) {
  return static_cast<std::size_t>(grid.size[0]) * static_cast<std::size_t>(grid.size[1]) * static_cast<std::size_t>(grid.size[2]);
}

std::size_t place_of(const CellGrid& grid, const Eigen::Array3i& cell) {
  const auto at = [](int i) { return static_cast<std::size_t>(i); };
  return (at(cell.x()) * at(grid.size[1]) + at(cell.y())) * at(grid.size[2]) + at(cell.z());
}

// Returns the center of a cube of cells.
Vec3 middle_of(const CellGrid& grid, const Eigen::Array3i& first, int side) {
  const Eigen::Array3d cells = first.cast<double>() + 0.5 * side;
  return (grid.origin.cast<double>().array() + static_cast<double>(grid.cell_m) * cells).cast<float>();
}

// Returns an upper bound (m) of the float32 rounding error of coordinates in the grid.
double rounding(const CellGrid& grid) {
  const Vec3 end = middle_of(grid, {grid.size[0], grid.size[1], grid.size[2]}, 0);
  return 0x1p-22 * static_cast<double>(std::max(grid.origin.cwiseAbs().maxCoeff(), end.cwiseAbs().maxCoeff()));
}

DroneModel cube(float half) {
  std::vector<Vec3> corners;
  for (const float x : {-half, half}) {
    for (const float y : {-half, half}) {
      for (const float z : {-half, half}) corners.emplace_back(x, y, z);
    }
  }
  return DroneModel(std::move(corners));
}

// Fills occupied cells by recursive subdivision of cubes. It stops at cubes without obstacles.
class Occupier {
 public:
  Occupier(const World& world, OccupancyGrid& out)
      : obstacles_(prepared(world).obstacles()),
        out_(out),
        widening_(0.5 * kWider * static_cast<double>(out.grid.cell_m) + rounding(out.grid)),
        hull_(cube(static_cast<float>(0.5 * static_cast<double>(out.grid.cell_m) + widening_))) {}

  void fill(const Eigen::Array3i& first, int side) {
    Interrupt::poll();
    const CellGrid& grid = out_.grid;
    if ((first >= Eigen::Array3i(grid.size[0], grid.size[1], grid.size[2])).any()) return;
    const Vec3 middle = middle_of(grid, first, side);
    const double half = 0.5 * side * static_cast<double>(grid.cell_m) + widening_;
    const auto reach = static_cast<float>(half * std::sqrt(3.0));
    const float distance = obstacles_.distance(middle, reach);
    if (distance >= reach) return;
    if (side > 1) {
      for (int part = 0; part < 8; ++part) fill(first + side / 2 * Eigen::Array3i(part & 1, part >> 1 & 1, part >> 2), side / 2);
      return;
    }
    // The inscribed ball decides most cells, including all deep inside a solid. There, a hull test would search for a way out.
    const bool is_occupied =
        static_cast<double>(distance) <= half || collision::overlaps(obstacles_, hull_, Pose{.position = middle});
    out_.occupied[place_of(grid, first)] = is_occupied ? 1 : 0;
  }

 private:
  const collision::Obstacles& obstacles_;
  OccupancyGrid& out_;
  double widening_;  // m, added on each side of a cell
  collision::Hull hull_;
};

}  // namespace

OccupancyGrid occupancy(const World& world, float cell_m, const std::optional<Aabb>& box) {
  OccupancyGrid out{grid_over(world, cell_m, box), {}};
  out.occupied.assign(number_of_cells(out.grid), 0);
  int side = 1;
  while (side < std::max({out.grid.size[0], out.grid.size[1], out.grid.size[2]})) side *= 2;
  Occupier(world, out).fill(Eigen::Array3i::Zero(), side);
  return out;
}

DistanceGrid distance(const World& world, float cell_m, const std::optional<Aabb>& box) {
  DistanceGrid out{grid_over(world, cell_m, box), {}};
  const CellGrid& grid = out.grid;
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  out.distance_m.reserve(number_of_cells(grid));
  // The distance changes by at most a cell between neighbours, which limits each search.
  const auto step = static_cast<float>(1.001 * static_cast<double>(grid.cell_m) + 4.0 * rounding(grid));
  for (int i = 0; i < grid.size[0]; ++i) {
    for (int j = 0; j < grid.size[1]; ++j) {
      for (int k = 0; k < grid.size[2]; ++k) {
        Interrupt::poll();
        float most = 8.0F * static_cast<float>(kMaxCoordinate);
        if (k > 0) {
          most = out.distance_m.back() + step;
        } else if (j > 0) {
          most = out.distance_m[place_of(grid, {i, j - 1, 0})] + step;
        } else if (i > 0) {
          most = out.distance_m[place_of(grid, {i - 1, 0, 0})] + step;
        }
        out.distance_m.push_back(obstacles.distance(middle_of(grid, {i, j, k}, 1), most));
      }
    }
  }
  return out;
}

}  // namespace flockstep
