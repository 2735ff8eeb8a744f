#include "collision/corners.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

namespace flockstep::collision {

Corners::Corners(const TriangleMesh& mesh, std::span<const std::array<std::int32_t, 3>> triangles) {
  std::vector<std::array<float, 3>> corners;
  for (const auto& triangle : triangles) {
    for (const std::int32_t index : triangle) {
      const Vec3& corner = mesh.vertices[static_cast<std::size_t>(index)];
      corners.push_back({corner.x(), corner.y(), corner.z()});
    }
  }
  take(std::move(corners));
}

Corners::Corners(std::span<const Vec3> points) {
  std::vector<std::array<float, 3>> corners;
  for (const Vec3& point : points) corners.push_back({point.x(), point.y(), point.z()});
  take(std::move(corners));
}

void Corners::take(std::vector<std::array<float, 3>> corners) {
  std::ranges::sort(corners);
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  for (const auto& [x, y, z] : corners) {
    x_.push_back(x);
    y_.push_back(y);
    z_.push_back(z);
    radius_ = std::max(radius_, corner(x_.size() - 1).norm());
  }
}

Vec3d Corners::support(const Vec3d& direction) const {
  constexpr std::size_t kListThreshold = 32, kBlock = 256;
  if (x_.size() <= kListThreshold) {
    std::array<double, kListThreshold> distances;
    for (std::size_t i = 0; i < x_.size(); ++i) distances[i] = corner(i).dot(direction);
    std::size_t best = 0;
    for (std::size_t i = 1; i < x_.size(); ++i) best = distances[i] > distances[best] ? i : best;
    return corner(best);
  }
  // Float32 decides which corners may be the farthest, double precision which one is.
  const double length = direction.norm();
  const Vec3 along = (length > 0.0 ? Vec3d(direction / length) : direction).cast<float>();
  const float doubt = 1e-6F * static_cast<float>(radius_);  // more than the rounding errors of two sums
  std::array<float, kBlock> distances;
  float most = -std::numeric_limits<float>::infinity();
  double farthest = -std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  for (std::size_t first = 0; first < x_.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, x_.size() - first);
    float most_here = -std::numeric_limits<float>::infinity();
    for (std::size_t i = 0; i < count; ++i) {
      distances[i] = x_[first + i] * along.x() + y_[first + i] * along.y() + z_[first + i] * along.z();
    }
    for (std::size_t i = 0; i < count; ++i) most_here = std::max(most_here, distances[i]);
    if (most_here < most - doubt) continue;
    most = std::max(most, most_here);
    for (std::size_t i = 0; i < count; ++i) {
      if (distances[i] < most - doubt) continue;
      if (const double distance = corner(first + i).dot(direction); distance > farthest) {
        farthest = distance;
        best = first + i;
      }
    }
  }
  return corner(best);
}

std::vector<Corners> corners_of_objects(const TriangleMesh& mesh) {
  std::vector<Corners> corners;
  const std::span triangles(mesh.triangles);
  for (std::size_t first = 0; first < triangles.size();) {  // sorted by object
    std::size_t end = first + 1;
    while (end < triangles.size() && mesh.objects[end] == mesh.objects[first]) ++end;
    if (is_solid(mesh.visibility_of(first))) corners.emplace_back(mesh, triangles.subspan(first, end - first));
    first = end;
  }
  return corners;
}

}  // namespace flockstep::collision
