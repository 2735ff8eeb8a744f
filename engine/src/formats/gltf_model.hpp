// A validated glTF 2.0 file: the supported parts, with every index in range.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <filesystem>
#include <map>
#include <memory>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "flockstep/world.hpp"
#include "formats/gltf_extras.hpp"

namespace flockstep {

// Returns true for "start", "goal", "waypoint" and "waypoint." followed by a number.
bool is_gltf_marker(std::string_view name);

// Reads the files that a glTF file references: embedded ones, and ones in its folder.
class GltfFiles {
 public:
  GltfFiles(std::string source, std::filesystem::path folder, MeshFiles files)
      : source_(std::move(source)), folder_(std::move(folder)), files_(files) {}

  // Returns the content of a uri: base64 data: or a relative path. `field` names the uri in messages, `kind` describes the
  // file.
  std::string read(const std::string& uri, const std::string& field, const std::string& kind);

 private:
  std::string source_;
  std::filesystem::path folder_;
  MeshFiles files_;
  std::size_t read_bytes_ = 0;
};

struct GltfView {
  std::size_t buffer, offset, length;
  std::size_t stride;  // bytes; 0: elements are contiguous
};

enum class GltfComponent : std::uint16_t {
  int8 = 5120,
  uint8 = 5121,
  int16 = 5122,
  uint16 = 5123,
  uint32 = 5125,
  float32 = 5126
};
enum class GltfShape : std::uint8_t { scalar, vec2, vec3, vec4, mat2, mat3, mat4 };

struct GltfAccessor {
  GltfComponent component;
  GltfShape shape;
  bool is_normalized = false;
  std::size_t count = 0, offset = 0;
  std::optional<std::size_t> view;  // none: all zero or sparse, not supported

  std::size_t component_bytes() const;
  std::size_t element_bytes() const;
};

struct GltfImage {
  std::string name;
  std::optional<std::size_t> view;  // alternative to uri
  std::string uri;
};

struct GltfTexture {
  std::array<TextureWrap, 2> wrap{TextureWrap::repeat, TextureWrap::repeat};
  std::optional<std::size_t> image;
};

// KHR_texture_transform.
struct GltfTextureTransform {
  std::array<double, 2> offset{0.0, 0.0}, scale{1.0, 1.0};
  double rotation = 0.0;  // rad
};

struct GltfMaterial {
  std::string name;
  int semantic = 0;  // from `extras`, as in a scene file; 0: none
  std::array<double, 4> base_color{1.0, 1.0, 1.0, 1.0};
  std::array<double, 3> emissive{0.0, 0.0, 0.0};
  std::optional<double> alpha_cutoff;  // threshold for the texture's alpha
  bool is_unlit = false;
  std::optional<std::size_t> texture;
  std::uint64_t tex_coord = 0;
  std::optional<GltfTextureTransform> transform;
};

enum class GltfMode : std::uint8_t { triangles = 4, strip = 5, fan = 6 };

struct GltfPrimitive {
  GltfMode mode = GltfMode::triangles;
  std::optional<std::size_t> indices, material;
  std::map<std::string, std::size_t> attributes;  // accessors: POSITION, optionally COLOR_0 and TEXCOORD_n
};

struct GltfNode {
  std::vector<std::size_t> children;
  std::optional<std::size_t> mesh;
  std::optional<std::array<double, 16>> matrix;  // column-major
  std::optional<std::array<double, 3>> translation, scale;
  std::optional<std::array<double, 4>> rotation;  // x, y, z, w
  bool has_sun = false;                           // a directional light
  int semantic = 0;                               // from `extras`; 0: none
  std::string marker;                             // valid for is_gltf_marker(), or empty
  std::optional<bool> visual_only, collision_only;
  GltfNodeExtras extras;
  std::shared_ptr<const BodyConfig> body;  // the node and its descendants are this body; null: they are static
};

struct GltfScene {
  std::string name;
  std::vector<std::size_t> nodes;
  std::optional<GltfSceneExtras> extras;
};

// All indices are in range, and accessors with a view lie within it. Unsupported content (skins, animations, morph targets,
// cameras, most extensions) is dropped.
struct GltfModel {
  std::vector<std::string_view> buffers;  // views of `files`, or of the bytes that the model was read from
  std::vector<std::unique_ptr<const std::string>> files;
  std::vector<GltfView> views;
  std::vector<GltfAccessor> accessors;
  std::vector<GltfImage> images;
  std::vector<GltfTexture> textures;
  std::vector<GltfMaterial> materials;
  std::vector<std::vector<GltfPrimitive>> meshes;
  std::vector<GltfNode> nodes;
  std::vector<GltfScene> scenes;
  std::optional<std::size_t> scene;  // the default scene
  std::vector<std::string> ignored;  // descriptions of ignored content
};

// `bytes` is a .gltf or .glb file, recognized by its first bytes. It must outlive the model.
// Throws std::invalid_argument that names the source, the JSON pointer of the offending field, the expected value and the
// actual one.
GltfModel read_gltf_model(const std::string& bytes, const std::string& source, GltfFiles& files);

}  // namespace flockstep
