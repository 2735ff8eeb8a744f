#include "generators/shape.hpp"

#include <algorithm>
#include <cmath>
#include <vector>

#include "generators/noise.hpp"
#include "generators/parts.hpp"

namespace flockstep::indoors {

const std::array<Vec2d, 16>& circle() {
  static const std::array<Vec2d, 16> kCorners = [] {
    const double d = std::sqrt(0.5), c = std::sqrt(0.5 + 0.5 * d),
                 s = std::sqrt(0.5 - 0.5 * d);  // cosines and sine of 45 and 22.5 degrees
    std::array<Vec2d, 16> corners;
    const std::array<Vec2d, 4> quarter{Vec2d(1, 0), Vec2d(c, s), Vec2d(d, d), Vec2d(s, c)};
    for (std::size_t i = 0; i < 16; ++i) {
      Vec2d at = quarter[i % 4];
      for (std::size_t turn = 0; turn < i / 4; ++turn) at = Vec2d(-at.y(), at.x());
      corners[i] = at;
    }
    return corners;
  }();
  return kCorners;
}

Vec3d Shape::turned_to_world(const Vec3d& local) const {
  const Vec2d& y = spot_.facing;
  return {y.y() * local.x() + y.x() * local.y(), -y.x() * local.x() + y.y() * local.y(), local.z()};
}

Vec3d Shape::in_world(const Vec3d& local) const {
  return Vec3d(spot_.at.x(), spot_.at.y(), spot_.floor) + turned_to_world(local);
}

double Shape::shade(const Vec3d& at, const Vec3d& normal) const {
  const Vec3d n = turned_to_world(normal);
  const double side = 0.80 - 0.10 * n.x() - 0.06 * n.y();
  const double tilt = n.z() > 0.0 ? mixed(side, 1.0, n.z()) : mixed(side, 0.5, -n.z());
  return tilt * (n.z() > 0.9 ? 1.0 : mixed(0.62, 1.0, std::clamp(at.z() / 0.8, 0.0, 1.0)));
}

std::int32_t Shape::vertex(const Vec3d& at, const Vec3d& normal, Swatch color) {
  const SwatchArea where = area(color);
  constexpr double kDarkest = 0.2;  // darkest shade of the swatches
  const double share = std::clamp((1.0 - shade(at, normal)) / (1.0 - kDarkest), 0.0, 1.0);
  return add_vertex(part_, in_world(at), where.from[0], mixed(where.from[1], where.to[1], share));
}

void Shape::face(const std::array<Vec3d, 4>& corners, const Vec3d& normal, Swatch swatch) {
  std::array<std::int32_t, 4> ids{};
  if (static_cast<int>(swatch) < kSwatchColors) {
    for (std::size_t i = 0; i < 4; ++i) ids[i] = vertex(corners[i], normal, swatch);
  } else {
    const SwatchArea where = area(swatch);
    const double wide = (corners[1] - corners[0]).norm(), high = (corners[3] - corners[0]).norm();
    double across = 1.0, down = 1.0;
    const bool is_lying = wide >= high || where.width_m == 0.0;  // the grain runs along the longer side
    if (where.width_m > 0.0) {
      const double tall = where.width_m * (where.to[1] - where.from[1]) / (where.to[0] - where.from[0]);
      across = std::min(1.0, std::max(wide, high) / where.width_m);
      down = std::min(1.0, std::min(wide, high) / tall);
    }
    const std::array<Vec2d, 4> shares{Vec2d(0, 1), Vec2d(1, 1), Vec2d(1, 0), Vec2d(0, 0)};
    for (std::size_t i = 0; i < 4; ++i) {
      const Vec2d share = is_lying ? shares[i] : Vec2d(shares[i].y(), shares[i].x());
      ids[i] = add_vertex(part_, in_world(corners[i]), mixed(where.from[0], where.to[0], across * share.x()),
                          mixed(where.from[1], where.to[1], down * share.y()));
    }
  }
  add_triangle(part_, ids[0], ids[1], ids[2]);
  add_triangle(part_, ids[0], ids[2], ids[3]);
}

void Shape::block(const Vec3d& center, const Vec3d& size, Swatch swatch) { block(center, size, swatch, swatch); }

void Shape::block(const Vec3d& center, const Vec3d& size, Swatch swatch, Swatch top) {
  const Vec3d half = 0.5 * size;
  const auto side = [&](const Vec3d& out, const Vec3d& across, const Vec3d& up, Swatch shown) {
    const Vec3d at = center + out.cwiseProduct(half), a = across.cwiseProduct(half), b = up.cwiseProduct(half);
    face({at - a - b, at + a - b, at + a + b, at - a + b}, out, shown);
  };
  const Vec3d x = Vec3d::UnitX(), y = Vec3d::UnitY(), z = Vec3d::UnitZ();
  side(x, y, z, swatch);
  side(-x, -y, z, swatch);
  side(y, -x, z, swatch);
  side(-y, x, z, swatch);
  side(z, x, y, top);
  if (center.z() - half.z() > 0.01) side(-z, -x, y, swatch);  // bottoms on the floor are never visible
}

void Shape::outwards(std::int32_t a, std::int32_t b, std::int32_t c, const Vec3d& middle) {
  const auto at = [&](std::int32_t i) -> Vec3d { return part_.vertices[static_cast<std::size_t>(i)].cast<double>(); };
  const Vec3d normal = (at(b) - at(a)).cross(at(c) - at(a));
  normal.dot(at(a) + at(b) + at(c) - 3.0 * in_world(middle)) >= 0.0 ? add_triangle(part_, a, b, c) : add_triangle(part_, a, c, b);
}

void Shape::cushion(const Vec3d& center, const Vec3d& size, double bevel, Swatch swatch) {
  // Each corner of the block is cut off. It becomes one point on each of its three faces.
  std::array<std::array<std::int32_t, 3>, 8> ids{};
  const Vec3d half = 0.5 * size;
  for (std::size_t corner = 0; corner < 8; ++corner) {
    const Vec3d sign((corner & 1U) != 0 ? 1.0 : -1.0, (corner & 2U) != 0 ? 1.0 : -1.0, (corner & 4U) != 0 ? 1.0 : -1.0);
    for (int axis = 0; axis < 3; ++axis) {
      Vec3d reach = half - Vec3d::Constant(bevel), normal = Vec3d::Zero();
      reach[axis] = half[axis];
      normal[axis] = sign[axis];
      ids[corner][static_cast<std::size_t>(axis)] = vertex(center + sign.cwiseProduct(reach), normal, swatch);
    }
  }
  const auto quad = [&](std::int32_t a, std::int32_t b, std::int32_t c, std::int32_t d) {
    outwards(a, b, c, center);
    outwards(a, c, d, center);
  };
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const std::size_t own = std::size_t{1} << axis, u = std::size_t{1} << ((axis + 1) % 3),
                      v = std::size_t{1} << ((axis + 2) % 3);
    for (const std::size_t side : {std::size_t{0}, own}) {
      quad(ids[side][axis], ids[side + u][axis], ids[side + u + v][axis], ids[side + v][axis]);
    }
    // The edges along this axis, between the faces of the other two.
    const std::size_t first = (axis + 1) % 3, second = (axis + 2) % 3;
    for (const std::size_t edge : {std::size_t{0}, u, v, u + v}) {
      quad(ids[edge][first], ids[edge + own][first], ids[edge + own][second], ids[edge][second]);
    }
  }
  for (const auto& corner : ids) outwards(corner[0], corner[1], corner[2], center);
}

void Shape::turned(const Vec2d& at, std::span<const Vec2d> profile, Swatch swatch, int sides) {
  const auto count = static_cast<std::size_t>(sides);
  const std::size_t stride = 16 / count;
  const auto ring = [&](const Vec2d& point, const Vec2d& slope) {  // slope: normal of the profile, (outwards, up)
    std::vector<std::int32_t> ids;
    for (std::size_t i = 0; i < count; ++i) {
      const Vec2d way = circle()[i * stride];
      ids.push_back(vertex({at.x() + point.x() * way.x(), at.y() + point.x() * way.y(), point.y()},
                           {slope.x() * way.x(), slope.x() * way.y(), slope.y()}, swatch));
    }
    return ids;
  };
  const auto cap = [&](const Vec2d& point, double up) {
    const std::vector<std::int32_t> rim = ring(point, {0.0, up});
    const std::int32_t middle = vertex({at.x(), at.y(), point.y()}, {0.0, 0.0, up}, swatch);
    for (std::size_t i = 0; i < count; ++i) {
      const std::int32_t a = rim[i], b = rim[(i + 1) % count];
      up > 0.0 ? add_triangle(part_, a, b, middle) : add_triangle(part_, b, a, middle);
    }
  };
  for (std::size_t k = 0; k + 1 < profile.size(); ++k) {
    const Vec2d along = (profile[k + 1] - profile[k]).normalized();
    const Vec2d slope(along.y(), -along.x());
    const std::vector<std::int32_t> below = ring(profile[k], slope), above = ring(profile[k + 1], slope);
    for (std::size_t i = 0; i < count; ++i) {
      const std::size_t next = (i + 1) % count;
      add_triangle(part_, below[i], below[next], above[next]);
      add_triangle(part_, below[i], above[next], above[i]);
    }
  }
  if (profile.front().y() > 0.01) cap(profile.front(), -1.0);
  cap(profile.back(), 1.0);
}

void Shape::rod(const Vec3d& from, const Vec3d& to, double width, Swatch swatch) {
  const Vec3d along = (to - from).normalized();
  const Vec3d aside = along.cross(std::abs(along.z()) > 0.9 ? Vec3d::UnitX() : Vec3d::UnitZ()).normalized();
  const Vec3d u = 0.5 * width * aside, v = 0.5 * width * along.cross(aside);
  face({from - u - v, from + u - v, to + u - v, to - u - v}, -v.normalized(), swatch);
  face({from + u + v, from - u + v, to - u + v, to + u + v}, v.normalized(), swatch);
  face({from - u + v, from - u - v, to - u - v, to - u + v}, -u.normalized(), swatch);
  face({from + u - v, from + u + v, to + u + v, to + u - v}, u.normalized(), swatch);
}

void Shape::sheet(const Vec3d& a, const Vec3d& b, const Vec3d& c, const Vec3d& d, Swatch swatch) {
  face({a, b, c, d}, (b - a).cross(d - a).normalized(), swatch);
}

void Shape::blade(const Vec3d& from, const Vec2d& along, double reach, double rise, double width, Swatch swatch) {
  const Vec3d out(along.x(), along.y(), 0.0), aside(-along.y(), along.x(), 0.0), up = Vec3d::UnitZ();
  const std::array<Vec3d, 4> spine{from, from + 0.35 * reach * out + 0.75 * rise * up, from + 0.75 * reach * out + rise * up,
                                   from + reach * out + 0.8 * rise * up};
  const std::array<double, 4> widths{0.15 * width, 0.9 * width, width, 0.0};
  const std::array<double, 4> lights{-0.6, 0.2, 0.9, 0.5};  // dark on the inside, bright where light falls
  std::array<std::array<std::int32_t, 2>, 4> ids{};
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec3d half = 0.5 * widths[i] * aside, normal(0.0, 0.0, lights[i]);
    ids[i] = {vertex(spine[i] - half, normal, swatch), vertex(spine[i] + half, normal, swatch)};
  }
  for (std::size_t i = 0; i < 3; ++i) {
    add_triangle(part_, ids[i][0], ids[i + 1][0], ids[i][1]);
    if (i < 2) add_triangle(part_, ids[i + 1][0], ids[i + 1][1], ids[i][1]);
  }
}

}  // namespace flockstep::indoors
