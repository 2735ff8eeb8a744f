#include "render/gl/sun_grid.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <map>
#include <numeric>
#include <span>

#include "render/appearance.hpp"
#include "trace/masks.hpp"

namespace flockstep::render {
namespace {

using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;
using Mat3d = Eigen::Matrix3d;

constexpr double kMinCells = 64.0 * 64.0;
constexpr double kMaxCells = 1024.0 * 1024.0;
constexpr double kCellsPerCaster = 4.0;

// The shadow of a caster in the plane across the sun's direction: all points within `round` of the convex hull of `points`.
// It may be slightly too large.
struct Shadow {
  CasterKind kind;
  std::array<Vec2d, 8> points;
  std::size_t num_points = 0;
  std::array<Vec2d, 3> normals;  // unit, normal to the hull's sides
  std::size_t num_normals = 0;
  double round = 0.0;  // m

  void add_point(const Vec3d& point) { points[num_points++] = point.head<2>(); }
  void add_side(const Vec2d& along) {
    const double length = along.norm();
    if (length > 0.0) normals[num_normals++] = Vec2d(-along.y(), along.x()) / length;
  }
  // Returns the interval that the shadow covers along an axis.
  std::array<double, 2> along(const Vec2d& axis) const {
    double low = std::numeric_limits<double>::infinity();
    double high = -low;
    for (std::size_t i = 0; i < num_points; ++i) {
      low = std::min(low, axis.dot(points[i]));
      high = std::max(high, axis.dot(points[i]));
    }
    return {low - round, high + round};
  }
  // Returns whether the shadow reaches a square: false if a line along one of its sides separates the two.
  bool reaches(const Vec2d& middle, double half) const {
    for (std::size_t i = 0; i < num_normals; ++i) {
      const auto [low, high] = along(normals[i]);
      const double at = normals[i].dot(middle);
      const double reach = half * normals[i].cwiseAbs().sum();
      if (at + reach < low || at - reach > high) return false;
    }
    return true;
  }
};

std::array<float, 4> row(double x, double y, double z, double w) {
  return {static_cast<float>(x), static_cast<float>(y), static_cast<float>(z), static_cast<float>(w)};
}

CasterKind caster_kind_of(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::cylinder:
    case PrimitiveKind::disc:
      return CasterKind::cylinder;
    case PrimitiveKind::sphere:
      return CasterKind::sphere;
    case PrimitiveKind::capsule:
      return CasterKind::capsule;
    case PrimitiveKind::room:
      return CasterKind::room;
    default:
      return CasterKind::box;
  }
}

Mat3d rotation_to_sun(const Primitive& primitive, const Mat3d& to_sun) {
  return to_sun * primitive.rotation.cast<double>().normalized().toRotationMatrix();
}

class Casters {
 public:
  Casters(const Mat3d& to_sun, GlSunGrid& grid) : to_sun_(to_sun), grid_(grid) {}

  void add(const Primitive& primitive) {
    const Mat3d rotation = rotation_to_sun(primitive, to_sun_);
    const Vec3d center = to_sun_ * primitive.center.cast<double>();
    const Vec3d half = primitive.half_extents.cast<double>();
    Shadow shadow{};
    shadow.kind = caster_kind_of(primitive.kind);
    if (shadow.kind == CasterKind::box || shadow.kind == CasterKind::room) {
      for (int i = 0; i < 8; ++i) {
        const Vec3d corner(i % 2 == 0 ? -1.0 : 1.0, i / 2 % 2 == 0 ? -1.0 : 1.0, i / 4 == 0 ? -1.0 : 1.0);
        shadow.add_point(center + rotation * corner.cwiseProduct(half));
      }
      for (Eigen::Index i = 0; i < 3; ++i) shadow.add_side(rotation.col(i).head<2>());
    } else {
      const double straight = shadow.kind == CasterKind::cylinder  ? half.z()
                              : shadow.kind == CasterKind::capsule ? half.z() - half.x()
                                                                   : 0.0;
      shadow.add_point(center + straight * rotation.col(2));
      shadow.add_point(center - straight * rotation.col(2));
      shadow.add_side(straight * rotation.col(2).head<2>());
      shadow.round = half.x();
    }
    push(make_caster(primitive, to_sun_), shadow);
  }

  void add(const Vec3& a, const Vec3& b, const Vec3& c, const trace::Masks::Triangle* masked) {
    const Vec3d corner = to_sun_ * a.cast<double>();
    const Vec3d ab = to_sun_ * (b.cast<double>() - a.cast<double>());
    const Vec3d ac = to_sun_ * (c.cast<double>() - a.cast<double>());
    const double area = ab.x() * ac.y() - ab.y() * ac.x();
    // A triangle edge-on to the sun casts no shadow.
    if (std::abs(area) <= 1e-9 * ab.norm() * ac.norm()) return;
    SunCaster caster;
    caster.rows[0] = row(corner.x(), corner.y(), corner.z(), 0.0);
    caster.rows[1] = row(ac.y() / area, -ac.x() / area, -ab.y() / area, ab.x() / area);
    caster.rows[2] = row(ab.z(), ac.z(), 0.0, 0.0);
    if (masked != nullptr) caster.set_mask(*masked);
    Shadow shadow{};
    shadow.kind = CasterKind::triangle;
    for (const Vec3d& point : {corner, Vec3d(corner + ab), Vec3d(corner + ac)}) shadow.add_point(point);
    for (const Vec3d& side : {ab, ac, Vec3d(ac - ab)}) shadow.add_side(side.head<2>());
    push(caster, shadow);
  }

  void finish() {
    if (shadows_.empty()) {
      grid_.starts.assign(kNumLists + 1, 0);
      return;
    }
    lay_out();
    // The same traversal runs twice: first to count the entries of each list, then to fill the lists.
    grid_.starts.assign(std::size_t{grid_.columns} * grid_.rows * kNumLists + 1, 0);
    for (const Shadow& shadow : shadows_) {
      for_each_cell(shadow, [&](std::size_t list) { ++grid_.starts[list + 1]; });
    }
    std::partial_sum(grid_.starts.begin(), grid_.starts.end(), grid_.starts.begin());
    grid_.entries.resize(grid_.starts.back());
    std::vector<std::uint32_t> next = grid_.starts;
    for (std::size_t i = 0; i < shadows_.size(); ++i) {
      for_each_cell(shadows_[i], [&](std::size_t list) { grid_.entries[next[list]++] = static_cast<std::uint32_t>(i); });
    }
  }

 private:
  void push(const SunCaster& caster, const Shadow& shadow) {
    grid_.casters.push_back(caster);
    shadows_.push_back(shadow);
  }

  void lay_out() {
    Vec2d low = Vec2d::Constant(std::numeric_limits<double>::infinity());
    Vec2d high = -low;
    for (const Shadow& shadow : shadows_) {
      const auto x = shadow.along(Vec2d::UnitX());
      const auto y = shadow.along(Vec2d::UnitY());
      low = low.cwiseMin(Vec2d(x[0], y[0]));
      high = high.cwiseMax(Vec2d(x[1], y[1]));
    }
    const Vec2d size = high - low;
    const double cells = std::clamp(kCellsPerCaster * static_cast<double>(shadows_.size()), kMinCells, kMaxCells);
    // Limits the cells along each side to the total number of cells, even if the grid is very thin.
    const double cell = std::max(std::sqrt(size.x() * size.y() / cells), size.maxCoeff() / cells);
    // The margin ensures that rounding of a point, a cell border or a caster loses no caster.
    const double around = std::max(low.cwiseAbs().maxCoeff(), high.cwiseAbs().maxCoeff());
    margin_ = 1e-3 * cell + 1e-6 * around;
    grid_.cell = static_cast<float>(cell);
    grid_.left = static_cast<float>(low.x() - margin_);
    grid_.low = static_cast<float>(low.y() - margin_);
    grid_.columns = static_cast<std::uint32_t>((size.x() + 4.0 * margin_) / cell) + 1;
    grid_.rows = static_cast<std::uint32_t>((size.y() + 4.0 * margin_) / cell) + 1;
  }

  template <class F>
  void for_each_cell(const Shadow& shadow, const F& f) const {
    const auto cell = static_cast<double>(grid_.cell);
    const auto range = [&](const Vec2d& axis, double begin, std::uint32_t count) {
      const auto [low, high] = shadow.along(axis);
      const auto index = [&](double at) {
        return static_cast<std::uint32_t>(std::clamp(std::floor((at - begin) / cell), 0.0, count - 1.0));
      };
      return std::array<std::uint32_t, 2>{index(low - margin_), index(high + margin_)};
    };
    const auto left = static_cast<double>(grid_.left);
    const auto low = static_cast<double>(grid_.low);
    const auto columns = range(Vec2d::UnitX(), left, grid_.columns);
    const auto rows = range(Vec2d::UnitY(), low, grid_.rows);
    for (std::uint32_t y = rows[0]; y <= rows[1]; ++y) {
      for (std::uint32_t x = columns[0]; x <= columns[1]; ++x) {
        const Vec2d middle(left + (x + 0.5) * cell, low + (y + 0.5) * cell);
        if (!shadow.reaches(middle, 0.5 * cell + margin_)) continue;
        f((std::size_t{y} * grid_.columns + x) * kNumLists + (shadow.kind == CasterKind::triangle ? 0 : 1));
      }
    }
  }

  const Mat3d to_sun_;
  GlSunGrid& grid_;
  std::vector<Shadow> shadows_;
  double margin_ = 0.0;  // m
};

}  // namespace

Mat3d sun_rotation(const Light& light) {
  const auto& direction = light.sun_direction;
  const Vec3d sun = Vec3(direction[0], direction[1], direction[2]).cast<double>().normalized();
  Mat3d rotation;
  rotation.row(2) = sun;
  rotation.row(0) = sun.unitOrthogonal();
  rotation.row(1) = sun.cross(Vec3d(rotation.row(0)));
  return rotation;
}

SunCaster make_caster(const Primitive& primitive, const Mat3d& to_sun) {
  const Mat3d rotation = rotation_to_sun(primitive, to_sun);
  const Vec3d center = to_sun * primitive.center.cast<double>();
  SunCaster caster;
  caster.rows[0] = row(center.x(), center.y(), center.z(), static_cast<double>(caster_kind_of(primitive.kind)));
  for (Eigen::Index i = 0; i < 3; ++i) {
    const auto half = static_cast<double>(primitive.half_extents[i]);
    caster.rows[static_cast<std::size_t>(i) + 1] = row(rotation(0, i), rotation(1, i), rotation(2, i), half);
  }
  return caster;
}

SunCaster make_mesh_caster(const Vec3& position, const Mat3& rotation, float radius, const Mat3d& to_sun) {
  const Vec3d center = to_sun * position.cast<double>();
  const Mat3d to_own = to_sun * rotation.cast<double>();
  SunCaster caster;
  caster.rows[0] = row(center.x(), center.y(), center.z(), static_cast<double>(CasterKind::mesh));
  for (Eigen::Index i = 0; i < 3; ++i) {
    caster.rows[static_cast<std::size_t>(i) + 1] = row(to_own(0, i), to_own(1, i), to_own(2, i), 0.0);
  }
  caster.rows[1][3] = radius;
  return caster;
}

void SunCaster::set_mask(const trace::Masks::Triangle& masked) {
  const auto& [first, second, third] = masked.uv;
  rows[0][3] = static_cast<float>(masked.mask + 1);
  rows[2][2] = first[0];
  rows[2][3] = first[1];
  rows[3] = {second[0] - first[0], second[1] - first[1], third[0] - first[0], third[1] - first[1]};
}

// Packs four alphas into each number. Each image starts at a new number.
SunMasks::SunMasks(const trace::Masks& from) {
  std::map<std::size_t, std::uint32_t> first_of;  // index into alphas, by the first alpha of the mask
  for (const trace::Masks::Mask& mask : from.masks()) {
    const auto [first, is_new] = first_of.try_emplace(mask.first, static_cast<std::uint32_t>(alphas.size()));
    const std::size_t count = static_cast<std::size_t>(mask.width) * static_cast<std::size_t>(mask.height);
    const std::span<const std::uint8_t> image = from.alphas().subspan(mask.first, count);
    for (std::size_t i = 0; is_new && i < count; ++i) {
      if (i % 4 == 0) alphas.push_back(0);
      alphas.back() |= static_cast<std::uint32_t>(image[i]) << (8U * static_cast<std::uint32_t>(i % 4));
    }
    SunCaster& caster = masks.emplace_back();
    caster.rows[0] = row(mask.width, mask.height, static_cast<double>(mask.wrap[0]), static_cast<double>(mask.wrap[1]));
    caster.rows[1][2] = mask.cutoff;
    caster.begin_alphas(first->second);
  }
}

GlSunGrid::GlSunGrid(const World& world) {
  const Mat3d rotation = sun_rotation(world.light());
  to_sun = rotation.cast<float>();
  Casters all(rotation, *this);
  const bool has_shading_room = shading_room(world).has_value();
  for (const Primitive& primitive : world.primitives()) {
    const bool casts = primitive.kind != PrimitiveKind::room || has_shading_room;
    if (casts && is_visible(primitive.visibility)) all.add(primitive);
  }
  const TriangleMesh& mesh = world.triangles();
  const trace::Masks seen_through(world);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.visibility_of(i))) continue;
    const auto corner = [&](std::size_t k) -> const Vec3& {
      return mesh.vertices[static_cast<std::size_t>(mesh.triangles[i][k])];
    };
    all.add(corner(0), corner(1), corner(2), seen_through.find(i));
  }
  all.finish();
  masks = SunMasks(seen_through);
}

namespace {

constexpr std::size_t kLeafTriangles = 4;  // at most 7

struct CasterTriangle {
  Vec3 low, high;  // m, of its bounding box
  SunCaster caster;
};

// margin: m, by which boxes are wider than their triangles.
CasterNode node_around(std::span<const CasterTriangle> triangles, float margin) {
  Vec3 low = triangles[0].low;
  Vec3 high = triangles[0].high;
  for (const CasterTriangle& triangle : triangles) {
    low = low.cwiseMin(triangle.low);
    high = high.cwiseMax(triangle.high);
  }
  low.array() -= margin;
  high.array() += margin;
  return {{low.x(), low.y(), low.z()}, 0, {high.x(), high.y(), high.z()}, 0};
}

// Appends the nodes of these triangles. Splits the triangles along the longest axis of their centres.
void add_nodes(std::span<CasterTriangle> triangles, std::size_t first, float margin, std::vector<CasterNode>& nodes) {
  const std::size_t node = nodes.size();
  nodes.push_back(node_around(triangles, margin));
  if (triangles.size() <= kLeafTriangles) {
    nodes[node].triangles = static_cast<std::uint32_t>(first << 3U | triangles.size());
  } else {
    Eigen::AlignedBox3f centres;
    for (const CasterTriangle& triangle : triangles) centres.extend(Vec3(0.5F * (triangle.low + triangle.high)));
    Eigen::Index axis = 0;
    centres.sizes().maxCoeff(&axis);
    const std::size_t half = triangles.size() / 2;
    std::nth_element(triangles.begin(), triangles.begin() + static_cast<std::ptrdiff_t>(half), triangles.end(),
                     [&](const CasterTriangle& a, const CasterTriangle& b) {
                       return a.low[axis] + a.high[axis] < b.low[axis] + b.high[axis];
                     });
    add_nodes(triangles.first(half), first, margin, nodes);
    add_nodes(triangles.subspan(half), first + half, margin, nodes);
  }
  nodes[node].next = static_cast<std::uint32_t>(nodes.size());
}

CasterTriangle caster_triangle_of(const Vec3& a, const Vec3& b, const Vec3& c, const trace::Masks::Triangle* masked) {
  const Vec3 ab = b - a;
  const Vec3 ac = c - a;
  CasterTriangle triangle{a.cwiseMin(b).cwiseMin(c), a.cwiseMax(b).cwiseMax(c), {}};
  auto& rows = triangle.caster.rows;
  rows[0] = {a.x(), a.y(), a.z(), 0.0F};
  rows[1] = {ab.x(), ab.y(), ab.z(), ac.x()};
  rows[2] = {ac.y(), ac.z(), 0.0F, 0.0F};
  if (masked != nullptr) triangle.caster.set_mask(*masked);
  return triangle;
}

}  // namespace

GlCasterTree::GlCasterTree(const World& world) {
  const TriangleMesh& mesh = world.triangles();
  const trace::Masks seen_through(world);
  std::vector<CasterTriangle> all;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.visibility_of(i))) continue;
    const auto corner = [&](std::size_t k) -> const Vec3& {
      return mesh.vertices[static_cast<std::size_t>(mesh.triangles[i][k])];
    };
    all.push_back(caster_triangle_of(corner(0), corner(1), corner(2), seen_through.find(i)));
  }
  // Wider than the rounding errors of the test that skips a box. Rays begin within the ball around the mesh.
  const float margin = 1e-5F * world.bounds().min.cwiseAbs().cwiseMax(world.bounds().max.cwiseAbs()).maxCoeff();
  if (!all.empty()) add_nodes(all, 0, margin, nodes);
  for (const CasterTriangle& triangle : all) triangles.push_back(triangle.caster);
  masks = SunMasks(seen_through);
}

}  // namespace flockstep::render
