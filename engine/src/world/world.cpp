#include "flockstep/world.hpp"

#include <mutex>
#include <stdexcept>
#include <string>
#include <utility>

#include "base/platform.hpp"
#include "base/require.hpp"
#include "world/content_hash.hpp"
#include "world/gltf.hpp"
#include "world/gltf_writer.hpp"
#include "world/mesh_scene.hpp"
#include "world/placement.hpp"
#include "world/scene_description.hpp"
#include "world/scene_json.hpp"
#include "world/tessellate.hpp"
#include "world/text_file.hpp"

namespace flockstep {
namespace {

constexpr const char* kSceneFile = "a scene file";
constexpr const char* kGltfFile = "a glTF file";

Aabb bounds_of(const SceneDescription& description) {
  Eigen::AlignedBox3f box;
  for (const Primitive& primitive : description.primitives) {
    const Aabb part = bounds(primitive);
    box.extend(part.min).extend(part.max);
  }
  for (const Vec3& vertex : description.mesh.vertices) box.extend(vertex);
  return Aabb{box.min(), box.max()};
}

// Refusals name the file.
std::shared_ptr<const World> made_from(SceneDescription description, const std::filesystem::path& path,
                                       std::vector<std::string> ignored = {}) {
  try {
    return std::make_shared<const World>(std::move(description), std::move(ignored));
  } catch (const std::invalid_argument& error) {
    throw std::invalid_argument(path.string() + ": " + error.what());
  }
}

}  // namespace

std::shared_ptr<const World> World::load(const std::filesystem::path& path, const LoadOptions& options) {
  check_placement(options);
  const std::string extension = extension_of(path);
  if (extension == ".json") {
    std::vector<std::string> ignored;
    SceneDescription scene =
        parse_scene(read_text_file(path, kSceneFile), path.string(), path.parent_path(), options.files, &ignored);
    if (moves(options)) return made_from(placed(std::move(scene), options), path, std::move(ignored));
    return std::make_shared<const World>(std::move(scene), std::move(ignored));
  }
  if (extension == ".gltf" || extension == ".glb") {
    GltfFile file = load_gltf(path, options);
    return made_from(std::move(file.scene), path, std::move(file.ignored));
  }
  if (extension == ".obj" || extension == ".ply") {
    std::vector<std::string> ignored;
    SceneDescription scene =
        extension == ".obj" ? load_obj_scene(path, options, ignored) : load_ply_scene(path, options, ignored);
    return made_from(std::move(scene), path, std::move(ignored));
  }
  refuse(path.string(), "a file ending in .json, .gltf, .glb, .obj or .ply", '"' + extension + '"');
}

std::shared_ptr<const World> World::from_json(const std::string& text, const std::filesystem::path& base_dir, MeshFiles files) {
  std::vector<std::string> ignored;
  SceneDescription scene = parse_scene(text, "scene", base_dir, files, &ignored);
  return std::make_shared<const World>(std::move(scene), std::move(ignored));
}

World::World(SceneDescription description, std::vector<std::string> ignored)
    : description_(canonical(std::move(description))), ignored_(std::move(ignored)), bounds_(bounds_of(description_)) {
  if (description_.mesh.triangles.size() >= kManyTriangles) give_back_freed_memory();  // of the file and its readers, too
}

World::World(std::shared_ptr<const World> world, const Look& look)
    : original_(world->original_ ? world->original_ : world), ignored_(world->ignored_), bounds_(world->bounds_) {
  description_.name = world->name();
  description_.materials = world->description_.materials;
  description_.markers = world->markers();
  description_.light = look.light;
  check_light(description_.light);
  apply_tint(look.tint, description_.materials);
}

template <class F>
auto World::described(const F& f) const {
  if (!original_) return f(description_);
  SceneDescription whole = description_;
  whole.textures = shape().textures;
  whole.primitives = shape().primitives;
  whole.mesh = shape().mesh;
  return f(whole);
}

std::uint16_t World::semantic(std::size_t material) const {
  const std::uint16_t given = materials()[material].semantic;
  return given != 0 ? given : static_cast<std::uint16_t>(material + 1);
}

std::string World::to_json() const {
  return described([](const SceneDescription& scene) { return write_scene(scene); });
}

void World::save(const std::filesystem::path& path) const {
  const std::string extension = extension_of(path);
  if (extension == ".json") return write_text_file(path, kSceneFile, to_json());
  if (extension == ".glb" || extension == ".gltf") {
    const GltfForm form = extension == ".glb" ? GltfForm::binary : GltfForm::text;
    const auto written = [&](const SceneDescription& scene) { return write_gltf(scene, form, path.string()); };
    return write_text_file(path, kGltfFile, described(written));
  }
  refuse(path.string(), "a file ending in .json, .glb or .gltf", '"' + extension + '"');
}

TriangleMesh World::mesh(float chord_error_m, std::vector<std::int32_t>* all_objects) const {
  return described([&](const SceneDescription& scene) { return tessellate(scene, chord_error_m, all_objects); });
}

std::shared_ptr<const World> World::with_markers(Markers markers) const {
  check_markers(markers);  // before the copy, which may be large
  SceneDescription description = described([](const SceneDescription& scene) { return scene; });
  description.markers = std::move(markers);
  return std::make_shared<const World>(std::move(description), ignored_);
}

std::uint64_t World::content_hash() const {
  std::call_once(hashed_, [this] {
    content_hash_ = described([](const SceneDescription& scene) { return flockstep::content_hash(scene); });
  });
  return content_hash_;
}

}  // namespace flockstep
