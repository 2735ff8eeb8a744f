// Distributes points evenly over surfaces: one point per spacing squared of area, accumulated over all triangles. Triangles are
// visited along a space-filling curve, so that points are also even over many small triangles. Points within a triangle follow
// the triangular van der Corput sequence, which recursively cuts a triangle into four and visits the parts in turn. Source: K.
// Basu, A. B. Owen, "Low discrepancy constructions in the triangle", SIAM Journal on Numerical Analysis 53, 2015.
#include "flockstep/survey.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <sstream>
#include <utility>
#include <vector>

#include "base/in_world.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "prepared/prepared_world.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

ObjectList objects(const World& world) {
  ObjectList list;
  for (const Primitive& primitive : world.primitives()) {
    list.boxes.push_back(bounds(primitive));
    list.materials.push_back(primitive.material);
    list.visibility.push_back(primitive.visibility);
  }
  const TriangleMesh& mesh = world.triangles();
  const std::size_t num_primitives = world.primitives().size();
  for (std::size_t first = 0; first < mesh.triangles.size();) {  // triangles are sorted by object
    Interrupt::poll();
    Eigen::AlignedBox3f box;
    std::int32_t material = mesh.materials[first];
    std::size_t last = first;
    for (; last < mesh.triangles.size() && mesh.objects[last] == mesh.objects[first]; ++last) {
      for (const std::int32_t vertex : mesh.triangles[last]) box.extend(mesh.vertices[static_cast<std::size_t>(vertex)]);
      if (mesh.materials[last] != material) material = -1;
    }
    const Vec3 none = Vec3::Constant(std::numeric_limits<float>::quiet_NaN());
    list.boxes.resize(num_primitives + mesh.objects[first], {none, none});
    list.materials.resize(list.boxes.size(), -1);
    list.boxes.push_back({box.min(), box.max()});
    list.materials.push_back(material);
    first = last;
  }
  list.visibility.resize(list.boxes.size(), Visibility::full);
  for (std::size_t i = 0; i < mesh.visibility.size(); ++i) list.visibility[num_primitives + i] = mesh.visibility[i];
  return list;
}

namespace {

using Corners = std::array<Eigen::Vector3d, 3>;

constexpr double kMaxPoints = 5e7;  // about 1.5 GB

Eigen::Vector3d point_of_sequence(std::uint64_t index, Corners t) {
  for (; index != 0; index /= 4) {  // the middle part, then the three corners; the middle of the middle is the middle
    const Corners halves{(t[1] + t[2]) / 2.0, (t[2] + t[0]) / 2.0, (t[0] + t[1]) / 2.0};
    const std::uint64_t part = index % 4;
    if (part == 0) {
      t = halves;
    } else {
      const Eigen::Vector3d corner = t[part - 1];
      for (std::size_t i = 0; i < 3; ++i) t[i] = i == part - 1 ? corner : Eigen::Vector3d((corner + t[i]) / 2.0);
    }
  }
  return (t[0] + t[1] + t[2]) / 3.0;
}

// Inserts two zeros between the bits of a 21-bit number: one coordinate's part of a Morton code.
std::uint64_t spread_out(std::uint64_t x) {
  x = (x | (x << 32U)) & 0x001F00000000FFFFU;
  x = (x | (x << 16U)) & 0x001F0000FF0000FFU;
  x = (x | (x << 8U)) & 0x100F00F00F00F00FU;
  x = (x | (x << 4U)) & 0x10C30C30C30C30C3U;
  return (x | (x << 2U)) & 0x1249249249249249U;
}

// Returns the triangles ordered along a curve through their centers; the curve fills the cube around the world.
std::vector<std::uint32_t> along_curve(const TriangleMesh& mesh, const Aabb& bounds) {
  const double cells_per_m = 0x1p21 / std::max(1e-6, static_cast<double>((bounds.max - bounds.min).maxCoeff()));
  std::vector<std::pair<std::uint64_t, std::uint32_t>> order;
  order.reserve(mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    Interrupt::poll();
    Eigen::Vector3d middle = -bounds.min.cast<double>();
    for (const std::int32_t vertex : triangle) middle += mesh.vertices[static_cast<std::size_t>(vertex)].cast<double>() / 3.0;
    std::uint64_t code = 0;
    for (int axis = 0; axis < 3; ++axis) {
      const double cell = std::clamp(middle[axis] * cells_per_m, 0.0, 0x1p21 - 1.0);
      code |= spread_out(static_cast<std::uint64_t>(cell)) << static_cast<unsigned>(axis);
    }
    order.emplace_back(code, static_cast<std::uint32_t>(order.size()));
  }
  std::uint32_t compared = 0;
  std::sort(order.begin(), order.end(), [&compared](const auto& a, const auto& b) {
    if (++compared % 1024 == 0) Interrupt::poll();
    return a < b;
  });
  std::vector<std::uint32_t> triangles;
  triangles.reserve(order.size());
  for (const auto& [code, triangle] : order) triangles.push_back(triangle);
  return triangles;
}

// Drops triangles of objects that are not visible.
void drop_hidden(const World& world, TriangleMesh& mesh, std::vector<std::int32_t>& objects) {
  const auto primitives = world.primitives();
  const std::vector<Visibility>& visibility = world.triangles().visibility;
  const auto is_seen = [&](std::int32_t number) {
    const auto object = static_cast<std::size_t>(number);
    if (object < primitives.size()) return is_visible(primitives[object].visibility);
    const std::size_t place = object - primitives.size();
    return place >= visibility.size() || is_visible(visibility[place]);
  };
  std::size_t kept = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_seen(objects[i])) continue;
    mesh.triangles[kept] = mesh.triangles[i];
    mesh.materials[kept] = mesh.materials[i];
    objects[kept++] = objects[i];
  }
  mesh.triangles.resize(kept);
}

// The visible surfaces of a world as triangles.
struct Surfaces {
  Surfaces(const World& world, float chord_error_m) : mesh(world.mesh(chord_error_m, &objects)) {
    drop_hidden(world, mesh, objects);
  }

  Corners corners(std::size_t triangle) const {
    Corners at;
    for (std::size_t i = 0; i < 3; ++i)
      at[i] = mesh.vertices[static_cast<std::size_t>(mesh.triangles[triangle][i])].cast<double>();
    return at;
  }

  std::vector<std::int32_t> objects;  // object of each triangle
  TriangleMesh mesh;
};

// Along the normal.
Eigen::Vector3d twice_area(const Corners& t) { return (t[1] - t[0]).cross(t[2] - t[0]); }

double square(float spacing_m) { return static_cast<double>(spacing_m) * static_cast<double>(spacing_m); }

void require_few_points(const Surfaces& surfaces, float spacing_m) {
  double points = 0.0;
  for (std::size_t i = 0; i < surfaces.mesh.triangles.size(); ++i) {
    Interrupt::poll();
    points += 0.5 * twice_area(surfaces.corners(i)).norm() / square(spacing_m);
  }
  if (points <= kMaxPoints) return;
  std::ostringstream got;
  got << spacing_m << " m, which makes " << points;
  refuse("spacing_m", "a number that makes at most 50,000,000 points", got.str());
}

}  // namespace

PointCloud point_cloud(const World& world, float spacing_m) {
  require(spacing_m >= 1e-4F && is_in_world(spacing_m), "spacing_m", "a number in [1e-04, 1e+06]", spacing_m);
  constexpr float kCoarse = 1e6F;  // few triangles, whose area is a little too small
  require_few_points(Surfaces(world, kCoarse), spacing_m);
  const Surfaces surfaces(world, spacing_m / 100.0F);
  require_few_points(surfaces, spacing_m);

  PointCloud cloud;
  const double per_point = square(spacing_m);
  double passed = 0.5;  // area in points; starts half a point in, to be centred
  for (const std::uint32_t i : along_curve(surfaces.mesh, world.bounds())) {
    Interrupt::poll();
    const Corners at = surfaces.corners(i);
    const Eigen::Vector3d across = twice_area(at);
    const double area = 0.5 * across.norm();
    passed += area / per_point;
    const double whole = std::floor(passed);
    passed -= whole;
    for (std::uint64_t k = 0; k < static_cast<std::uint64_t>(whole); ++k) {
      if (k % 1024 == 1023) Interrupt::poll();
      cloud.points.emplace_back(point_of_sequence(k, at).cast<float>());
      cloud.normals.emplace_back((across / (2.0 * area)).cast<float>());
      cloud.semantic.push_back(world.semantic(surfaces.mesh.materials[i]));
      cloud.objects.push_back(surfaces.objects[i]);
    }
  }
  return cloud;
}

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

NearestSurfaces nearest(const World& world, std::span<const float> points) {
  require(points.size() % 3 == 0, "points", "rows of 3 numbers", std::to_string(points.size()) + " numbers");
  for (std::size_t i = 0; i < points.size(); ++i) {
    if (is_in_world(points[i])) continue;
    refuse("points", in_world("finite coordinates"), std::to_string(points[i]) + " in row " + std::to_string(i / 3));
  }
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  const std::vector<std::int32_t>& objects = prepared(world).solid_objects();
  NearestSurfaces found;
  for (std::size_t i = 0; i < points.size(); i += 3) {
    if (i % 3072 == 0) Interrupt::poll();
    const Vec3 point(points[i], points[i + 1], points[i + 2]);
    // A search tests all shapes within its first radius. A world has something solid, and no two points are farther apart than
    // the last radius.
    collision::NearestPoint at;
    for (float within = 1.0F; at.element == collision::NearestPoint::kNone && within < 32.0F * kMaxCoordinate; within *= 8.0F) {
      at = obstacles.nearest(point, within);
    }
    found.points.push_back(at.point);
    found.distance_m.push_back(at.distance);
    found.objects.push_back(at.element == collision::NearestPoint::kNone ? -1 : objects[at.element]);
  }
  return found;
}

}  // namespace flockstep
