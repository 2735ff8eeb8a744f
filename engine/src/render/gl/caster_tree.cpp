#include "render/gl/caster_tree.hpp"

#include <algorithm>
#include <cstddef>
#include <span>

#include "trace/masks.hpp"

namespace flockstep::render {
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
