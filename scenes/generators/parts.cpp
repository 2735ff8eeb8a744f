#include "generators/parts.hpp"

#include <array>
#include <cmath>
#include <map>

namespace flockstep {
namespace {

// Returns the corners of a regular hexagon or octagon. The first corner lies along the unit vector `first`.
std::vector<Vec2d> polygon(int sides, const Vec2d& first) {
  const double h = std::sqrt(0.75), d = std::sqrt(0.5);
  const std::vector<Vec2d> hexagon{{1, 0}, {0.5, h}, {-0.5, h}, {-1, 0}, {-0.5, -h}, {0.5, -h}};
  const std::vector<Vec2d> octagon{{1, 0}, {d, d}, {0, 1}, {-d, d}, {-1, 0}, {-d, -d}, {0, -1}, {d, -d}};
  std::vector<Vec2d> corners = sides == 6 ? hexagon : octagon;
  for (Vec2d& corner : corners) {
    corner = {first.x() * corner.x() - first.y() * corner.y(), first.y() * corner.x() + first.x() * corner.y()};
  }
  return corners;
}

}  // namespace

void add_triangle(MeshPart& part, std::int32_t a, std::int32_t b, std::int32_t c) { part.triangles.push_back({a, b, c}); }

std::int32_t add_vertex(MeshPart& part, const Vec3d& at, double s, double t) {
  part.vertices.push_back(at.cast<float>());
  part.uv.push_back({static_cast<float>(s), static_cast<float>(t)});
  return static_cast<std::int32_t>(part.vertices.size()) - 1;
}

void add_quad(MeshPart& part, const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, double repeat_m) {
  const double across = (b - a).norm() / repeat_m, up = (d - a).norm() / repeat_m;
  const std::int32_t first = add_vertex(part, a, 0.0, up);
  add_vertex(part, b, across, up);
  add_vertex(part, c, across, 0.0);
  add_vertex(part, d, 0.0, 0.0);
  add_triangle(part, first, first + 1, first + 2);
  add_triangle(part, first, first + 2, first + 3);
}

void add_block(MeshPart& part, const Vec3d& center, const Vec3d& size, const Vec2d& along, double repeat_m) {
  const Vec3d x = 0.5 * size.x() * Vec3d(along.x(), along.y(), 0.0);
  const Vec3d y = 0.5 * size.y() * Vec3d(-along.y(), along.x(), 0.0);
  const Vec3d z(0.0, 0.0, 0.5 * size.z());
  const auto quad = [&](const Vec3d& out, const Vec3d& across, const Vec3d& up) {  // out is parallel to across x up
    const Vec3d side = center + out;
    add_quad(part, side - across - up, side + across - up, side + across + up, side - across + up, repeat_m);
  };
  quad(x, y, z);
  quad(-x, -y, z);
  quad(y, -x, z);
  quad(-y, x, z);
  quad(z, x, y);
  quad(-z, -x, y);
}

void add_trunk(MeshPart& part, const Vec2d& at, double low, double high, double low_radius, double high_radius,
               const Vec2d& turn) {
  const std::vector<Vec2d> ring = polygon(6, turn);
  std::vector<std::int32_t> bottom, top;
  for (std::size_t i = 0; i <= ring.size(); ++i) {
    const Vec2d& way = ring[i % ring.size()];
    const Vec2d below = at + low_radius * way, above = at + high_radius * way;
    const double s = static_cast<double>(i) / 3.0;
    bottom.push_back(add_vertex(part, {below.x(), below.y(), low}, s, 0.0));
    top.push_back(add_vertex(part, {above.x(), above.y(), high}, s, high - low));
  }
  for (std::size_t i = 0; i + 1 < bottom.size(); ++i) {
    add_triangle(part, bottom[i], bottom[i + 1], top[i + 1]);
    add_triangle(part, bottom[i], top[i + 1], top[i]);
  }
}

void add_cone(MeshPart& part, const Vec2d& at, double low, double high, double radius, const Vec2d& turn) {
  const std::vector<Vec2d> ring = polygon(8, turn);
  const double side = (ring[1] - ring[0]).norm() * radius;
  const double slant = Vec2d(high - low, 0.9239 * radius).norm();  // from the middle of an edge
  const std::int32_t middle = add_vertex(part, {at.x(), at.y(), low + 0.25 * radius}, 4.0 * side, -radius);
  std::vector<std::int32_t> rim;
  for (std::size_t i = 0; i <= ring.size(); ++i) {
    const Vec2d edge = at + radius * ring[i % ring.size()];
    rim.push_back(add_vertex(part, {edge.x(), edge.y(), low}, static_cast<double>(i) * side, 0.0));
  }
  for (std::size_t i = 0; i < ring.size(); ++i) {
    const std::int32_t tip = add_vertex(part, {at.x(), at.y(), high}, (static_cast<double>(i) + 0.5) * side, slant);
    add_triangle(part, rim[i], rim[i + 1], tip);
    add_triangle(part, rim[i + 1], rim[i], middle);
  }
}

void add_ball(MeshPart& part, const Vec3d& center, const Vec3d& half, int steps, double rough, Draws& draws) {
  std::map<std::array<int, 3>, std::int32_t> corners;
  const auto corner = [&](int i, int j, int k) {
    const auto [found, is_new] = corners.try_emplace({i, j, k});
    if (is_new) {
      const Vec3d way = Vec3d(i, j, k).normalized() * (1.0 + rough * draws.uniform(-1.0, 1.0));
      const Vec3d at = center + half.cwiseProduct(way);
      found->second = add_vertex(part, at, at.x() + 0.3 * at.z(), at.y() + 0.7 * at.z());
    }
    return found->second;
  };
  for (const int x : {1, -1}) {
    for (const int y : {1, -1}) {
      for (const int z : {1, -1}) {
        const auto add = [&](const std::array<int, 3>& a, const std::array<int, 3>& b, const std::array<int, 3>& c) {
          const std::int32_t p = corner(x * a[0], y * a[1], z * a[2]);
          const std::int32_t q = corner(x * b[0], y * b[1], z * b[2]);
          const std::int32_t r = corner(x * c[0], y * c[1], z * c[2]);
          x * y * z > 0 ? add_triangle(part, p, q, r) : add_triangle(part, p, r, q);
        };
        for (int i = 0; i < steps; ++i) {
          for (int j = 0; i + j < steps; ++j) {
            const int k = steps - i - j;
            add({i, j, k}, {i + 1, j, k - 1}, {i, j + 1, k - 1});
            if (k > 1) add({i + 1, j, k - 1}, {i + 1, j + 1, k - 2}, {i, j + 1, k - 1});
          }
        }
      }
    }
  }
}

}  // namespace flockstep
