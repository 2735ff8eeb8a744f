// Distributes points evenly over surfaces: one point per spacing squared of area, accumulated over all triangles. Triangles are
// visited along a space-filling curve, so that points are also even over many small triangles. Points within a triangle follow
// the triangular van der Corput sequence, which recursively cuts a triangle into four and visits the parts in turn. Source: K.
// Basu, A. B. Owen, "Low discrepancy constructions in the triangle", SIAM Journal on Numerical Analysis 53, 2015.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <sstream>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "flockstep/survey.hpp"

namespace flockstep {
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

  std::vector<std::int32_t> objects;  // of the triangles
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

}  // namespace flockstep
