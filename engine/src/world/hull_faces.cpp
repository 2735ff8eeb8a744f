#include "world/hull_faces.hpp"

#include <Eigen/Geometry>
#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <limits>

#include "flockstep/drone_model.hpp"

namespace flockstep {
namespace {

constexpr double kFlat = 1e-6;  // fraction of the hull's size

static_assert(kMaxHullVertices <= 32);
using PointSet = std::uint32_t;  // one bit for each point

// Three points on a plane that has all others below it.
struct Facet {
  Eigen::Vector3d normal;
  double area;  // twice the triangle's
  PointSet points;
};

// Returns the corners of the convex polygon around some points of a plane. The normal points towards the viewer.
std::vector<std::size_t> polygon_around(std::span<const Eigen::Vector3d> points, PointSet set, const Eigen::Vector3d& normal) {
  const Eigen::Vector3d right = normal.unitOrthogonal(), up = normal.cross(right);
  struct Corner {
    double x, y;
    std::size_t number;
  };
  std::vector<Corner> sorted;
  for (std::size_t i = 0; i < points.size(); ++i) {
    if ((set >> i & 1U) != 0) sorted.push_back({right.dot(points[i]), up.dot(points[i]), i});
  }
  std::ranges::sort(sorted, [](const Corner& a, const Corner& b) { return a.x != b.x ? a.x < b.x : a.y < b.y; });
  const auto turns_left = [](const Corner& a, const Corner& b, const Corner& c) {
    return (b.x - a.x) * (c.y - a.y) - (b.y - a.y) * (c.x - a.x) > 0.0;
  };
  std::vector<Corner> around;  // Andrew's monotone chain: the lower side from left to right, then the upper side back
  for (const bool lower : {true, false}) {
    const std::size_t first = around.size();
    for (const Corner& corner : sorted) {
      while (around.size() >= first + 2 && !turns_left(around[around.size() - 2], around.back(), corner)) around.pop_back();
      around.push_back(corner);
    }
    around.pop_back();  // the first one of the other side
    if (lower) std::ranges::reverse(sorted);
  }
  std::vector<std::size_t> corners;
  for (const Corner& corner : around) corners.push_back(corner.number);
  return corners;
}

// tolerance: m, by which points may lie above a face.
std::vector<HullFace> faces_within(std::span<const Eigen::Vector3d> points, double tolerance) {
  std::vector<Facet> facets;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      for (std::size_t k = j + 1; k < points.size(); ++k) {
        const Eigen::Vector3d across = (points[j] - points[i]).cross(points[k] - points[i]);
        const double area = across.norm();
        if (area == 0.0) continue;
        for (const double sign : {1.0, -1.0}) {
          const Eigen::Vector3d normal = sign / area * across;
          const auto is_below = [&](const Eigen::Vector3d& point) { return normal.dot(point - points[i]) <= tolerance; };
          if (std::ranges::all_of(points, is_below)) facets.push_back({normal, area, 1U << i | 1U << j | 1U << k});
        }
      }
    }
  }
  // The largest triangle of a face has the most accurate normal; the others are part of it.
  std::ranges::stable_sort(facets, std::greater<>(), &Facet::area);
  std::vector<HullFace> faces;
  std::vector<PointSet> found;
  for (const Facet& facet : facets) {
    if (std::ranges::any_of(found, [&](PointSet face) { return (facet.points & ~face) == 0; })) continue;
    double offset = -std::numeric_limits<double>::infinity();
    for (const Eigen::Vector3d& point : points) offset = std::max(offset, facet.normal.dot(point));
    PointSet on_face = facet.points;
    for (std::size_t i = 0; i < points.size(); ++i) {
      if (facet.normal.dot(points[i]) >= offset - 2.0 * tolerance) on_face |= 1U << i;
    }
    found.push_back(on_face);
    faces.push_back({facet.normal, offset, polygon_around(points, on_face, facet.normal)});
  }
  return faces;
}

}  // namespace

std::vector<HullFace> hull_faces(std::span<const Vec3> points, std::size_t most) {
  std::vector<Eigen::Vector3d> exact;
  double size = 0.0;
  for (const Vec3& point : points) {
    exact.emplace_back(point.cast<double>());
    size = std::max(size, (exact.back() - exact.front()).norm());
  }
  std::vector<HullFace> faces = faces_within(exact, kFlat * size);
  for (double flat = 2.0 * kFlat; faces.size() > most; flat *= 2.0) faces = faces_within(exact, flat * size);
  return faces;
}

}  // namespace flockstep
