#include "formats/mesh_files.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <utility>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "formats/image.hpp"
#include "formats/placement.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

// Without a material, the base colour must not change the vertex colours.
Material default_material(const TriangleMesh& mesh) {
  Material material{"default"};
  if (!mesh.colors.empty()) material.base_color = {1.0F, 1.0F, 1.0F};
  return material;
}

void drop_flat(TriangleMesh& mesh, const std::string& source, std::vector<std::string>& ignored) {
  std::size_t kept = 0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (i % 4096 == 0) Interrupt::poll();
    const auto corner = [&](std::size_t k) { return mesh.vertices[static_cast<std::size_t>(mesh.triangles[i][k])]; };
    if (is_degenerate(corner(0), corner(1), corner(2))) continue;
    mesh.triangles[kept] = mesh.triangles[i];
    if (!mesh.materials.empty()) mesh.materials[kept] = mesh.materials[i];
    if (!mesh.objects.empty()) mesh.objects[kept] = mesh.objects[i];
    ++kept;
  }
  const std::size_t dropped = mesh.triangles.size() - kept;
  if (dropped == 0) return;
  ignored.push_back(words_of_flat(dropped));
  require(kept > 0, source, "at least one triangle with an area", "none");
  mesh.triangles.resize(kept);
  if (!mesh.materials.empty()) mesh.materials.resize(kept);
  if (!mesh.objects.empty()) mesh.objects.resize(kept);
}

SceneDescription finished(SceneDescription scene, const std::filesystem::path& path, const LoadOptions& options,
                          std::vector<std::string>& ignored) {
  if (moves(options)) scene = placed(std::move(scene), options);
  drop_flat(scene.mesh, path.string(), ignored);
  return scene;
}

}  // namespace

SceneDescription load_obj_scene(const std::filesystem::path& path, const LoadOptions& options,
                                std::vector<std::string>& ignored) {
  SceneDescription scene;
  scene.name = path.stem().string();
  scene.materials.clear();
  ObjMaterials materials(scene, path.parent_path(), options.files);
  std::vector<std::uint16_t> numbers;
  std::size_t pixels_left = kMaxScenePixels;
  std::optional<std::uint16_t> unnamed;
  ObjMesh read = load_obj(path, [&](const ObjNames& names) {
    const auto default_number = [&] { return *(unnamed = materials.add(Material{"default"}, path.string())); };
    numbers = materials.numbers(names, path, default_number, pixels_left);
    return std::any_of(numbers.begin(), numbers.end(), [&](auto number) { return scene.materials[number].texture.has_value(); });
  });
  for (std::uint16_t& material : read.mesh.materials) material = numbers[material];
  if (unnamed) scene.materials[*unnamed].base_color = default_material(read.mesh).base_color;
  scene.mesh = std::move(read.mesh);
  ignored = materials.ignored();
  ignored.insert(ignored.end(), read.ignored.begin(), read.ignored.end());
  return finished(std::move(scene), path, options, ignored);
}

SceneDescription load_ply_scene(const std::filesystem::path& path, const LoadOptions& options,
                                std::vector<std::string>& ignored) {
  SceneDescription scene;
  scene.name = path.stem().string();
  PlyMesh read = load_ply(path);
  scene.materials = {default_material(read.mesh)};
  scene.mesh = std::move(read.mesh);
  ignored = std::move(read.ignored);
  return finished(std::move(scene), path, options, ignored);
}

}  // namespace flockstep
