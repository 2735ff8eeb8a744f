#include "formats/polygon.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numeric>

#include "base/interrupt.hpp"

namespace flockstep {
namespace {

// The order in which tinyobjloader cut ears, which earlier versions read OBJ files with: worlds keep their triangles. An ear
// whose first edge runs round the origin against the direction of the ear comes later, seen along the axis that the first bend
// of the polygon is nearest to.
class EarOrder {
 public:
  explicit EarOrder(std::span<const Vec3> corners) : corners_(corners) {
    const std::size_t count = corners.size();
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3& middle = corners[(i + 1) % count];
      const Vec3 bend = Vec3(middle - corners[i]).cross(Vec3(corners[(i + 2) % count] - middle)).cwiseAbs();
      if (!(bend.maxCoeff() > std::numeric_limits<float>::epsilon())) continue;
      axes_ = {bend.x() > bend.y() && bend.x() > bend.z() ? 1 : 0, bend.z() > bend.x() && bend.z() > bend.y() ? 1 : 2};
      break;
    }
  }

  bool comes_later(const PolygonCutter::Triangle& ear) const {
    const auto [u, v] = axes_;
    const Vec3 &a = corners_[ear[0]], &b = corners_[ear[1]], &c = corners_[ear[2]];
    const float bend = (b[u] - a[u]) * (c[v] - b[v]) - (b[v] - a[v]) * (c[u] - b[u]);
    return bend * ((a[u] * b[v] - a[v] * b[u]) * 0.5F) < 0.0F;
  }

 private:
  std::span<const Vec3> corners_;
  std::array<int, 2> axes_{1, 2};
};

}  // namespace

// Positive if the triangle turns as the polygon does, 0 if it has no area.
double PolygonCutter::turn(std::size_t a, std::size_t b, std::size_t c) const {
  return (points_[b] - points_[a]).cross(points_[c] - points_[a]).dot(normal_);
}

// Corners that lie where the cut begins or ends do not count: the two boundaries of a hole that a bridge joins touch there.
bool PolygonCutter::is_empty(const Triangle& ear, bool with_edges) const {
  const auto [a, b, c] = ear;
  const double least = with_edges ? 0.0 : std::numeric_limits<double>::min();
  for (const std::size_t p : left_) {
    const bool is_inside = turn(c, a, p) >= least && turn(a, b, p) >= least && turn(b, c, p) >= least;
    if (is_inside && p != b && points_[p] != points_[a] && points_[p] != points_[c]) return false;
  }
  return true;
}

std::span<const PolygonCutter::Triangle> PolygonCutter::cut(std::span<const Vec3> corners) {
  triangles_.clear();
  points_.clear();
  for (const Vec3& corner : corners) points_.push_back(corner.cast<double>());
  normal_.setZero();  // Newell's
  for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
    normal_ += (points_[i] - points_[0]).cross(points_[i + 1] - points_[0]);
  }
  if (corners.size() == 4) {
    const auto squared = [](const Vec3& d) { return d.x() * d.x() + d.y() * d.y() + d.z() * d.z(); };
    const bool is_from_first = turn(0, 1, 2) >= 0.0 && turn(0, 2, 3) >= 0.0;
    const bool is_from_second = turn(0, 1, 3) >= 0.0 && turn(1, 2, 3) >= 0.0;
    const bool is_first_shorter = squared(corners[2] - corners[0]) < squared(corners[3] - corners[1]);
    if (is_from_first == is_from_second ? is_first_shorter : is_from_first) {
      triangles_ = {{0, 1, 2}, {0, 2, 3}};
    } else {
      triangles_ = {{0, 1, 3}, {1, 2, 3}};
    }
    return triangles_;
  }

  left_.resize(corners.size());
  std::iota(left_.begin(), left_.end(), std::size_t{0});
  const EarOrder order(corners);
  std::size_t at = 0;
  std::size_t tried = 0;                        // since the last ear
  std::size_t patience = 400 * corners.size();  // tests left, for the time that hostile polygons take
  while (left_.size() > 3) {
    const std::size_t count = left_.size();
    if (count > 100) Interrupt::poll();
    if (at >= count) at -= count;
    const Triangle ear{left_[at], left_[(at + 1) % count], left_[(at + 2) % count]};
    // A polygon that touches or crosses itself may have no ear in the first rounds.
    const std::size_t round = patience > 0 ? tried / count : std::max<std::size_t>(tried / count, 3);
    const auto is_ear = [&] {
      if (const double area = turn(ear[0], ear[1], ear[2]); area <= 0.0) return area == 0.0 || round > 3;
      if (round == 0 && order.comes_later(ear)) return false;
      if (round > 2) return true;
      --patience;
      return is_empty(ear, round < 2);
    };
    if (!is_ear()) {
      ++at;
      ++tried;
      continue;
    }
    triangles_.push_back(ear);
    left_.erase(left_.begin() + static_cast<std::ptrdiff_t>((at + 1) % count));
    tried = 0;
  }
  triangles_.push_back({left_[0], left_[1], left_[2]});
  return triangles_;
}

}  // namespace flockstep
