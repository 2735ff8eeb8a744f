#include "collision/corners.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <vector>

namespace flockstep::collision {

Corners::Corners(const TriangleMesh& mesh) {
  std::vector<bool> is_used(mesh.vertices.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_solid(mesh.visibility_of(i))) continue;
    for (const std::int32_t index : mesh.triangles[i]) is_used[static_cast<std::size_t>(index)] = true;
  }
  // Objects do not share vertices, so the same corner may occur several times.
  std::vector<std::array<float, 3>> corners;
  for (std::size_t i = 0; i < is_used.size(); ++i) {
    if (is_used[i]) corners.push_back({mesh.vertices[i].x(), mesh.vertices[i].y(), mesh.vertices[i].z()});
  }
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
  // Float32 decides which corners may be the farthest, double precision which one is.
  constexpr std::size_t kBlock = 256;
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

}  // namespace flockstep::collision
