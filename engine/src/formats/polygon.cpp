#include <algorithm>
#include <limits>
#include <numeric>

#include "base/interrupt.hpp"
#include "formats/mesh_files.hpp"

namespace flockstep {
namespace {

float squared_length(const Vec3& d) { return d.x() * d.x() + d.y() * d.y() + d.z() * d.z(); }

class Polygon {
 public:
  explicit Polygon(std::span<const Vec3> corners) : corners_(corners), left_(corners.size()) {
    std::iota(left_.begin(), left_.end(), std::size_t{0});
    for (std::size_t i = 1; i + 1 < corners.size(); ++i) {
      normal_ += (point(i) - point(0)).cross(point(i + 1) - point(0));  // Newell's sum
    }
  }

  std::vector<CornerTriple> cut_quad() const {
    const bool is_from_first = turn(0, 1, 2) >= 0.0 && turn(0, 2, 3) >= 0.0;
    const bool is_from_second = turn(0, 1, 3) >= 0.0 && turn(1, 2, 3) >= 0.0;
    const bool is_first_shorter = squared_length(corners_[2] - corners_[0]) < squared_length(corners_[3] - corners_[1]);
    if (is_from_first == is_from_second ? is_first_shorter : is_from_first) return {{0, 1, 2}, {0, 2, 3}};
    return {{0, 1, 3}, {1, 2, 3}};
  }

  std::vector<CornerTriple> cut_ears() {
    if (left_.size() > 16) Interrupt::poll();
    find_axes();
    std::vector<CornerTriple> triangles;
    triangles.reserve(left_.size() - 2);
    std::size_t at = 0;
    std::size_t tried = 0;                      // since the last ear
    std::size_t patience = 400 * left_.size();  // tests left, bounds the time for hostile polygons
    while (left_.size() > 3) {
      const std::size_t count = left_.size();
      if (count > 100) Interrupt::poll();
      if (at >= count) at -= count;
      const CornerTriple ear{left_[at], left_[(at + 1) % count], left_[(at + 2) % count]};
      // Polygons that touch or cross themselves may have no ear by the strict tests of the first rounds.
      const std::size_t round = patience > 0 ? tried / count : std::max<std::size_t>(tried / count, 3);
      const auto is_ear = [&] {
        if (const double area = turn(ear[0], ear[1], ear[2]); area <= 0.0) return area == 0.0 || round > 3;
        if (round == 0 && comes_later(ear)) return false;
        if (round > 2) return true;
        --patience;
        return is_empty(ear, round < 2);
      };
      if (!is_ear()) {
        ++at;
        ++tried;
        continue;
      }
      triangles.push_back(ear);
      left_.erase(left_.begin() + static_cast<std::ptrdiff_t>((at + 1) % count));
      tried = 0;
    }
    triangles.push_back({left_[0], left_[1], left_[2]});
    return triangles;
  }

 private:
  Eigen::Vector3d point(std::size_t corner) const { return corners_[corner].cast<double>(); }

  // Returns a positive value if the triangle has the polygon's orientation, 0 if it has no area.
  double turn(std::size_t a, std::size_t b, std::size_t c) const {
    return (point(b) - point(a)).cross(point(c) - point(a)).dot(normal_);
  }

  // Returns whether no other corner lies in the ear. Corners at the ends of the cut do not count, because the two sides of a
  // bridge to a hole touch there.
  bool is_empty(const CornerTriple& ear, bool with_edges) const {
    const auto [a, b, c] = ear;
    const double least = with_edges ? 0.0 : std::numeric_limits<double>::min();
    for (const std::size_t p : left_) {
      const bool is_inside = turn(c, a, p) >= least && turn(a, b, p) >= least && turn(b, c, p) >= least;
      if (is_inside && p != b && corners_[p] != corners_[a] && corners_[p] != corners_[c]) return false;
    }
    return true;
  }

  // Earlier versions read OBJ files with tinyobjloader. It postponed an ear whose first edge runs around the origin against the
  // ear's direction, seen along the axis nearest to the first bend. Keeping that order, with its float32 arithmetic, keeps the
  // triangles of convex polygons unchanged.
  bool comes_later(const CornerTriple& ear) const {
    const auto [u, v] = axes_;
    const Vec3 &a = corners_[ear[0]], &b = corners_[ear[1]], &c = corners_[ear[2]];
    const float bend = (b[u] - a[u]) * (c[v] - b[v]) - (b[v] - a[v]) * (c[u] - b[u]);
    return bend * ((a[u] * b[v] - a[v] * b[u]) * 0.5F) < 0.0F;
  }

  void find_axes() {
    const std::size_t count = corners_.size();
    for (std::size_t i = 0; i < count; ++i) {
      const Vec3& middle = corners_[(i + 1) % count];
      const Vec3 bend = Vec3(middle - corners_[i]).cross(Vec3(corners_[(i + 2) % count] - middle)).cwiseAbs();
      if (!(bend.maxCoeff() > std::numeric_limits<float>::epsilon())) continue;
      axes_ = {bend.x() > bend.y() && bend.x() > bend.z() ? 1 : 0, bend.z() > bend.x() && bend.z() > bend.y() ? 1 : 2};
      return;
    }
  }

  std::span<const Vec3> corners_;
  std::vector<std::size_t> left_;
  Eigen::Vector3d normal_ = Eigen::Vector3d::Zero();
  std::array<int, 2> axes_{1, 2};
};

}  // namespace

std::vector<CornerTriple> cut_polygon(std::span<const Vec3> corners) {
  Polygon polygon(corners);
  return corners.size() == 4 ? polygon.cut_quad() : polygon.cut_ears();
}

}  // namespace flockstep
