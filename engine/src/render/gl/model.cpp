#include "render/gl/model.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numeric>
#include <span>
#include <utility>

#include "trace/masks.hpp"
#include "world/tessellate.hpp"

namespace flockstep::render {
namespace {

constexpr std::size_t kChunkTriangles = 256;

TriangleMesh mesh_of(Primitive primitive, float chord_error) {
  using enum PrimitiveKind;
  const PrimitiveKind kind = primitive.kind;
  Vec3& half = primitive.half_extents;
  // Corners of the triangles lie on a slightly larger shape, so that their middles are no farther from the true one.
  if (kind == cylinder || kind == disc || kind == sphere || kind == capsule) half.x() += 0.5F * chord_error;
  if (kind == sphere || kind == capsule) half.z() += 0.5F * chord_error;
  SceneDescription description;
  description.primitives = {primitive};
  return tessellate(description, chord_error);
}

// Sorts triangles so that neighbours lie close together. Splits them along the longest axis until each part fits into a chunk.
void sort_by_place(std::span<std::uint32_t> order, const std::vector<Vec3>& middles) {
  if (order.size() <= kChunkTriangles) return;
  Eigen::AlignedBox3f box;
  for (const std::uint32_t triangle : order) box.extend(middles[triangle]);
  Eigen::Index axis = 0;
  box.sizes().maxCoeff(&axis);
  // The left part is a whole number of chunks, so only the last chunk on the right is partly filled.
  const std::size_t left = (order.size() + kChunkTriangles - 1) / kChunkTriangles / 2 * kChunkTriangles;
  std::nth_element(order.begin(), order.begin() + static_cast<std::ptrdiff_t>(left), order.end(),
                   [&](std::uint32_t a, std::uint32_t b) { return middles[a][axis] < middles[b][axis]; });
  sort_by_place(order.first(left), middles);
  sort_by_place(order.subspan(left), middles);
}

std::uint32_t add_vertices(const TriangleMesh& mesh, std::vector<GlVertex>& vertices) {
  const auto first = static_cast<std::uint32_t>(vertices.size());
  for (std::size_t i = 0; i < mesh.vertices.size(); ++i) {
    const Vec3& at = mesh.vertices[i];
    vertices.push_back({{at.x(), at.y(), at.z()},
                        mesh.uv.empty() ? std::array{0.0F, 0.0F} : mesh.uv[i],
                        mesh.colors.empty() ? std::array{1.0F, 1.0F, 1.0F} : mesh.colors[i]});
  }
  return first;
}

}  // namespace

std::uint32_t pack_ids(const Surface& surface) {
  return static_cast<std::uint32_t>(surface.semantic) | (static_cast<std::uint32_t>(surface.instance) << 16U);
}

float chord_error_of(PrimitiveKind kind, float radius, float focal_px) {
  const float of_ball = std::min(2e-3F * (1.0F + radius) * std::sqrt(2.0F / focal_px), kCoarsest * radius);
  const bool is_ball = kind == PrimitiveKind::sphere || kind == PrimitiveKind::capsule;
  return std::max(1e-6F, is_ball ? of_ball : 0.125F * of_ball);
}

GlModel::GlModel(const World& world, float focal_px) : textures(world) {
  const Appearance appearance(world);
  for (std::size_t i = 0; i < world.primitives().size(); ++i) {
    const Primitive& primitive = world.primitives()[i];
    if (!is_visible(primitive.visibility)) continue;
    const TriangleMesh mesh = mesh_of(primitive, chord_error_of(primitive.kind, primitive.half_extents.x(), focal_px));
    const std::uint32_t first_vertex = add_vertices(mesh, vertices);
    for (std::size_t k = 0; k < mesh.triangles.size(); ++k) {
      add(mesh, k, first_vertex, {.ids = pack_ids(appearance.primitives[i]), .material = primitive.material});
    }
  }
  const TriangleMesh& mesh = world.triangles();
  const std::vector<float> densities = texels_per_square_metre(world);
  const std::vector<bool> masking = trace::masking_materials(world);
  const std::uint32_t first_vertex = add_vertices(mesh, vertices);
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_visible(mesh.visibility_of(i))) continue;
    const std::uint16_t material = mesh.materials[i];
    Surface surface = appearance.materials[material];
    surface.instance = static_cast<std::uint16_t>(appearance.first_object + mesh.objects[i]);
    add(mesh, i, first_vertex,
        {.ids = pack_ids(surface),
         .material = material,
         .density = densities.empty() ? 0.0F : densities[i],
         .texture = static_cast<std::uint32_t>(surface.texture + 1),
         .cutoff = masking[material] ? 255.0F * world.materials()[material].alpha_cutoff : 0.0F});
    masked |= masking[material];
  }
  make_chunks();
}

GlModel::GlModel(PrimitiveKind kind, float chord_error) : textures(std::span<const Texture>()) {
  Primitive solid{.kind = kind, .half_extents = Vec3::Ones()};
  if (kind == PrimitiveKind::capsule) solid.half_extents.z() = 2.0F;
  const TriangleMesh mesh = mesh_of(solid, chord_error);
  add_vertices(mesh, vertices);
  for (std::size_t k = 0; k < mesh.triangles.size(); ++k) add(mesh, k, 0, {});
  make_chunks();
}

void GlModel::add(const TriangleMesh& mesh, std::size_t triangle, std::uint32_t first_vertex, const GlTriangle& record) {
  std::array<Eigen::Vector3d, 3> at;
  std::array<std::uint32_t, 3> indices{};
  for (std::size_t k = 0; k < 3; ++k) {
    const auto vertex = static_cast<std::size_t>(mesh.triangles[triangle][k]);
    at[k] = mesh.vertices[vertex].cast<double>();
    indices[k] = first_vertex + static_cast<std::uint32_t>(vertex);
  }
  const Eigen::Vector3d across = (at[1] - at[0]).cross(at[2] - at[0]);
  if (!(across.norm() > 0.0)) return;  // a triangle without area is invisible
  const Vec3 normal = across.normalized().cast<float>();
  corners.push_back(indices);
  triangles.push_back(record);
  triangles.back().normal = {normal.x(), normal.y(), normal.z()};
}

void GlModel::make_chunks() {
  const auto corner = [&](std::uint32_t vertex) { return Vec3(vertices[vertex].position.data()); };
  std::vector<Vec3> middles;
  for (const auto& [a, b, c] : corners) middles.emplace_back((corner(a) + corner(b) + corner(c)) / 3.0F);
  std::vector<std::uint32_t> order(triangles.size());
  std::iota(order.begin(), order.end(), 0U);
  sort_by_place(order, middles);
  const auto unsorted = std::pair(std::move(corners), std::move(triangles));
  corners.clear();
  triangles.clear();
  for (std::size_t first = 0; first < order.size(); first += kChunkTriangles) {
    const auto chunk = std::span(order).subspan(first, std::min(kChunkTriangles, order.size() - first));
    Eigen::AlignedBox3f box;
    for (const std::uint32_t triangle : chunk) {
      corners.push_back(unsorted.first[triangle]);
      triangles.push_back(unsorted.second[triangle]);
      for (const std::uint32_t vertex : corners.back()) box.extend(corner(vertex));
    }
    chunks.push_back(
        {box.center(), 0.5F * box.sizes(), static_cast<std::uint32_t>(first), static_cast<std::uint32_t>(chunk.size())});
  }
}

}  // namespace flockstep::render
