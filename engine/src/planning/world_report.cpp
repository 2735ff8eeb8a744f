#include "flockstep/world_report.hpp"

#include <algorithm>
#include <array>
#include <cstdint>
#include <numeric>
#include <stdexcept>
#include <utility>
#include <vector>

#include "base/interrupt.hpp"
#include "planning/navigable.hpp"

namespace flockstep {
namespace {

// Returns for each vertex the first vertex in coordinate order with the same position.
std::vector<std::uint32_t> welded(const std::vector<Vec3>& vertices) {
  std::vector<std::uint32_t> order(vertices.size());
  std::iota(order.begin(), order.end(), 0U);
  std::sort(order.begin(), order.end(), [&](std::uint32_t a, std::uint32_t b) {
    return std::lexicographical_compare(vertices[a].data(), vertices[a].data() + 3, vertices[b].data(), vertices[b].data() + 3);
  });
  std::vector<std::uint32_t> first(vertices.size());
  for (std::size_t i = 0; i < order.size(); ++i) {
    const bool is_same = i > 0 && vertices[order[i]] == vertices[order[i - 1]];
    first[order[i]] = is_same ? first[order[i - 1]] : order[i];
  }
  return first;
}

void count_edges(const TriangleMesh& mesh, WorldReport& report) {
  const std::vector<std::uint32_t> vertex = welded(mesh.vertices);
  Interrupt::poll();
  std::vector<std::array<std::uint32_t, 2>> edges;
  edges.reserve(3 * mesh.triangles.size());
  for (const auto& triangle : mesh.triangles) {
    for (std::size_t i = 0; i < 3; ++i) {
      const std::uint32_t a = vertex[static_cast<std::size_t>(triangle[i])];
      const std::uint32_t b = vertex[static_cast<std::size_t>(triangle[(i + 1) % 3])];
      edges.push_back({std::min(a, b), std::max(a, b)});
    }
  }
  std::sort(edges.begin(), edges.end());
  Interrupt::poll();
  for (auto first = edges.begin(); first != edges.end();) {
    const auto last = std::find_if(first, edges.end(), [&](const auto& edge) { return edge != *first; });
    report.open_edges += last - first == 1 ? 1U : 0U;
    report.crowded_edges += last - first > 2 ? 1U : 0U;
    first = last;
  }
}

}  // namespace

WorldReport check(const World& world, const DroneModel& drone) {
  WorldReport report;
  const TriangleMesh& mesh = world.triangles();
  report.triangles = mesh.triangles.size();
  for (std::size_t i = 0; i < mesh.objects.size(); ++i)
    report.objects += i == 0 || mesh.objects[i] != mesh.objects[i - 1] ? 1U : 0U;
  report.objects += world.primitives().size();
  count_edges(mesh, report);
  for (const Texture& texture : world.textures()) report.texture_bytes += texture.rgba.size();
  try {
    require_navigable(world, drone);
  } catch (const std::invalid_argument& error) {
    report.not_navigable = error.what();
  }
  return report;
}

}  // namespace flockstep
