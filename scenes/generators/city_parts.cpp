#include "generators/city_parts.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <vector>

namespace flockstep::streets {

void add_panel(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, const std::array<double, 2>& first,
               const std::array<double, 2>& third) {
  const std::int32_t corner = add_vertex(part, a, first[0], first[1]);
  add_vertex(part, b, third[0], first[1]);
  add_vertex(part, c, third[0], third[1]);
  add_vertex(part, d, first[0], third[1]);
  add_triangle(part, corner, corner + 1, corner + 2);
  add_triangle(part, corner, corner + 2, corner + 3);
}

void add_block(MeshPart& part, const Frame& frame, const Vec3d& center, const Vec3d& size, double repeat_m) {
  add_block(part, frame(center.x(), center.y(), center.z()), size, frame.along, repeat_m);
}

std::span<const Vec2d> circle(int sides) {
  static const double h = std::sqrt(0.75), d = std::sqrt(0.5);
  static const std::array<Vec2d, 8> kEight{{{1, 0}, {d, d}, {0, 1}, {-d, d}, {-1, 0}, {-d, -d}, {0, -1}, {d, -d}}};
  static const std::array<Vec2d, 12> kTwelve{
      {{1, 0}, {h, 0.5}, {0.5, h}, {0, 1}, {-0.5, h}, {-h, 0.5}, {-1, 0}, {-h, -0.5}, {-0.5, -h}, {0, -1}, {0.5, -h}, {h, -0.5}}};
  if (sides == 8) return kEight;
  return kTwelve;
}

void add_turned(MeshPart& part, const Vec3d& foot, std::span<const std::array<double, 2>> profile, int sides) {
  const std::span<const Vec2d> ring = circle(sides);
  std::vector<std::int32_t> below, above;
  for (std::size_t level = 0; level < profile.size(); ++level) {
    const auto [radius, height] = profile[level];
    below = above;
    above.clear();
    for (std::size_t i = 0; i <= ring.size(); ++i) {
      const Vec2d at = radius * ring[i % ring.size()];
      above.push_back(add_vertex(part, foot + Vec3d(at.x(), at.y(), height), static_cast<double>(i) / sides, -height));
    }
    if (level == 0) continue;
    const double radius_below = profile[level - 1][0];
    for (std::size_t i = 0; i < ring.size(); ++i) {
      if (radius_below > 0.0) add_triangle(part, below[i], below[i + 1], above[i + 1]);
      if (radius > 0.0) add_triangle(part, below[i], above[i + 1], above[i]);
    }
  }
}

void add_wire(MeshPart& part, std::span<const Vec3d> points, double radius) {
  std::vector<std::int32_t> before, here;
  for (std::size_t i = 0; i < points.size(); ++i) {
    const Vec3d way = (points[std::min(i + 1, points.size() - 1)] - points[i == 0 ? 0 : i - 1]).normalized();
    const Vec3d left = Vec3d(-way.y(), way.x(), 0.0).normalized(), up = way.cross(left);
    before = here;
    here = {add_vertex(part, points[i] + radius * up, 0.0, 0.0),
            add_vertex(part, points[i] + radius * (std::sqrt(0.75) * left - 0.5 * up), 0.0, 0.0),
            add_vertex(part, points[i] + radius * (-std::sqrt(0.75) * left - 0.5 * up), 0.0, 0.0)};
    if (i == 0) continue;
    for (std::size_t k = 0; k < 3; ++k) {
      add_triangle(part, before[k], here[k], here[(k + 1) % 3]);
      add_triangle(part, before[k], here[(k + 1) % 3], before[(k + 1) % 3]);
    }
  }
}

Quat turned_to(const Vec3d& direction) {
  return Quat(static_cast<float>(1.0 + direction.z()), static_cast<float>(-direction.y()), static_cast<float>(direction.x()),
              0.0F)
      .normalized();
}

}  // namespace flockstep::streets
