#include "flockstep/world_builder.hpp"

#include <utility>

#include "base/require.hpp"
#include "base/srgb.hpp"
#include "world/scene_description.hpp"
#include "world/tessellate.hpp"

namespace flockstep {
namespace {

std::uint16_t numbered(std::size_t count, std::size_t most, const char* what) {
  require(count < most, what, "at most " + std::to_string(most) + " of them", count + 1);
  return static_cast<std::uint16_t>(count);
}

}  // namespace

WorldBuilder::WorldBuilder(std::string name) {
  scene_.name = std::move(name);
  scene_.materials.clear();
}

std::uint16_t WorldBuilder::texture(Texture texture) {
  const std::uint16_t number = numbered(scene_.textures.size(), kMaxTextures, "textures");
  scene_.textures.push_back(std::move(texture));
  return number;
}

std::uint16_t WorldBuilder::texture(const std::string& name, int width_px, int height_px, const ColorAt& color) {
  for (const int side : {width_px, height_px}) {
    require(side >= 1 && side <= kMaxTexturePx, "texture", "1 to " + std::to_string(kMaxTexturePx) + " pixels to a side", side);
  }
  Texture made{.name = name, .width_px = width_px, .height_px = height_px};
  made.rgba.reserve(std::size_t{4} * static_cast<std::size_t>(width_px) * static_cast<std::size_t>(height_px));
  for (int row = 0; row < height_px; ++row) {
    for (int column = 0; column < width_px; ++column) {
      const float s = (static_cast<float>(column) + 0.5F) / static_cast<float>(width_px);
      const float t = (static_cast<float>(row) + 0.5F) / static_cast<float>(height_px);
      for (const float value : color(s, t)) made.rgba.push_back(linear_to_srgb(value));
      made.rgba.push_back(255);
    }
  }
  return texture(std::move(made));
}

std::uint16_t WorldBuilder::material(Material material) {
  const std::uint16_t number = numbered(scene_.materials.size(), kMaxMaterials, "materials");
  scene_.materials.push_back(std::move(material));
  return number;
}

void WorldBuilder::add(PrimitiveKind kind, const Vec3& center, const Vec3& half, std::uint16_t material, const Quat& rotation,
                       Visibility visibility) {
  scene_.primitives.push_back({kind, center, rotation, half, material, visibility});
}

void WorldBuilder::room(const Vec3& min, const Vec3& max, std::uint16_t material) {
  add(PrimitiveKind::room, 0.5F * (min + max), 0.5F * (max - min), material, Quat::Identity(), Visibility::full);
}

void WorldBuilder::box(const Vec3& center, const Vec3& size, std::uint16_t material, const Quat& rotation,
                       Visibility visibility) {
  add(PrimitiveKind::box, center, 0.5F * size, material, rotation, visibility);
}

void WorldBuilder::cylinder(const Vec3& center, float radius, float height, std::uint16_t material, const Quat& rotation,
                            Visibility visibility) {
  add(PrimitiveKind::cylinder, center, {radius, radius, 0.5F * height}, material, rotation, visibility);
}

void WorldBuilder::capsule(const Vec3& center, float radius, float height, std::uint16_t material, const Quat& rotation,
                           Visibility visibility) {
  add(PrimitiveKind::capsule, center, {radius, radius, 0.5F * height}, material, rotation, visibility);
}

void WorldBuilder::sphere(const Vec3& center, float radius, std::uint16_t material, Visibility visibility) {
  add(PrimitiveKind::sphere, center, Vec3::Constant(radius), material, Quat::Identity(), visibility);
}

void WorldBuilder::plane(const Vec3& center, const Eigen::Vector2f& size, std::uint16_t material, const Quat& rotation,
                         Visibility visibility) {
  add(PrimitiveKind::plane, center, {0.5F * size.x(), 0.5F * size.y(), 0.0F}, material, rotation, visibility);
}

void WorldBuilder::disc(const Vec3& center, float radius, std::uint16_t material, const Quat& rotation, Visibility visibility) {
  add(PrimitiveKind::disc, center, {radius, radius, 0.0F}, material, rotation, visibility);
}

void WorldBuilder::mesh(const MeshPart& part, std::uint16_t material, Visibility visibility) {
  require(part.uv.empty() || part.uv.size() == part.vertices.size(), "uv",
          "one per vertex (" + std::to_string(part.vertices.size()) + "), or none", part.uv.size());
  require(part.colors.empty() || part.colors.size() == part.vertices.size(), "colors",
          "one per vertex (" + std::to_string(part.vertices.size()) + "), or none", part.colors.size());
  require(objects_ < kMaxObjects - 1, "meshes", "at most 65535 of them", objects_);
  const auto count = static_cast<std::int32_t>(part.vertices.size());
  for (const auto& triangle : part.triangles) {
    for (const std::int32_t index : triangle) {
      require(index >= 0 && index < count, "triangles", "vertex indices in [0, " + std::to_string(count) + ')', index);
    }
  }
  TriangleMesh& mesh = scene_.mesh;
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  mesh.vertices.insert(mesh.vertices.end(), part.vertices.begin(), part.vertices.end());
  mesh.uv.insert(mesh.uv.end(), part.uv.begin(), part.uv.end());
  mesh.uv.resize(mesh.vertices.size());
  append_colors(part.colors, part.vertices.size(), mesh);
  for (auto triangle : part.triangles) {
    for (std::int32_t& index : triangle) index += first;
    mesh.triangles.push_back(triangle);
  }
  mesh.materials.insert(mesh.materials.end(), part.triangles.size(), material);
  mesh.objects.insert(mesh.objects.end(), part.triangles.size(), objects_);
  mesh.visibility.resize(objects_, Visibility::full);
  mesh.visibility.push_back(visibility);
  ++objects_;
}

MeshPart grid_of(const Heightfield& field) {
  const auto& [corner, cell, columns, rows, heights, texture_m] = field;
  MeshPart part;
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const float x = corner.x() + cell * static_cast<float>(column);
      const float y = corner.y() + cell * static_cast<float>(row);
      part.vertices.emplace_back(x, y, heights[part.vertices.size()]);
      part.uv.push_back({x / texture_m, -y / texture_m});
      if (row == 0 || column == 0) continue;
      const auto here = static_cast<std::int32_t>(part.vertices.size()) - 1;
      const std::int32_t left = here - 1, below = here - columns;
      part.triangles.push_back({left - columns, below, here});
      part.triangles.push_back({left - columns, here, left});
    }
  }
  return part;
}

void WorldBuilder::heightfield(const Heightfield& field, std::uint16_t material, Visibility visibility) {
  const auto& [corner, cell, columns, rows, heights, texture_m] = field;
  require(columns >= 2 && columns <= 32768, "heightfield: columns", "an integer in [2, 32768]", columns);
  require(rows >= 2 && rows <= 32768, "heightfield: rows", "an integer in [2, 32768]", rows);
  require(heights.size() == static_cast<std::size_t>(columns) * static_cast<std::size_t>(rows), "heightfield: heights",
          std::to_string(rows) + " x " + std::to_string(columns) + " of them", heights.size());
  require(cell > 0.0F, "heightfield: cell_m", "a number > 0", cell);
  require(texture_m > 0.0F, "heightfield: texture_m", "a number > 0", texture_m);
  mesh(grid_of(field), material, visibility);
}

std::shared_ptr<const World> WorldBuilder::build() const {
  SceneDescription scene = scene_;
  if (scene.materials.empty()) scene.materials.push_back(Material{"default"});
  return std::make_shared<const World>(std::move(scene));
}

}  // namespace flockstep
