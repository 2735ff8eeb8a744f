// Builds glTF files.
#pragma once

#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>

#include "base/json_document.hpp"
#include "formats/gltf.hpp"
#include "formats/image.hpp"
#include "standard.hpp"

namespace flockstep::gltf {

using namespace testing;
using Json = nlohmann::json;

inline constexpr int kByte = 5121, kShort = 5123, kInt = 5125, kFloat = 5126;

template <class T>
std::string bytes_of(std::initializer_list<T> values) {
  std::string bytes(values.size() * sizeof(T), '\0');
  std::memcpy(bytes.data(), std::data(values), bytes.size());
  return bytes;
}

// Builds a glTF file with one buffer and a view per accessor.
struct File {
  Json json = {{"asset", {{"version", "2.0"}}}};
  std::string buffer;

  std::size_t view(const std::string& bytes, int stride = 0) {
    Json view = {{"buffer", 0}, {"byteOffset", buffer.size()}, {"byteLength", bytes.size()}};
    if (stride != 0) view["byteStride"] = stride;
    buffer += bytes;
    json["bufferViews"].push_back(view);
    return json["bufferViews"].size() - 1;
  }

  std::size_t accessor(const std::string& bytes, int component, const std::string& type, std::size_t count, int stride = 0) {
    json["accessors"].push_back(
        {{"bufferView", view(bytes, stride)}, {"componentType", component}, {"type", type}, {"count", count}});
    return json["accessors"].size() - 1;
  }

  // Adds a mesh with one primitive and returns its index.
  std::size_t mesh(const Json& primitive) {
    json["meshes"].push_back({{"primitives", {primitive}}});
    return json["meshes"].size() - 1;
  }

  std::size_t node(const Json& node) {
    json["nodes"].push_back(node);
    return json["nodes"].size() - 1;
  }

  // Adds a mesh with one primitive and a node that shows it.
  void object(const Json& primitive) { node({{"mesh", mesh(primitive)}}); }

  std::size_t corner() { return accessor(bytes_of<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}), kFloat, "VEC3", 3); }

  std::string text() {
    json["buffers"] = {{{"byteLength", buffer.size()}, {"uri", "data:application/octet-stream;base64," + base64_of(buffer)}}};
    return json.dump();
  }
};

// A file with one triangle: (0, 0, 0), (1, 0, 0), (0, 1, 0) in file coordinates.
inline File one_triangle(const Json& node = Json::object()) {
  File file;
  file.mesh({{"attributes", {{"POSITION", file.corner()}}}});
  Json with_mesh = node;
  with_mesh["mesh"] = 0;
  file.node(with_mesh);
  return file;
}

inline GltfFile parse(const std::string& text, const LoadOptions& options = {}) {
  return parse_gltf(text, "x.gltf", "/nowhere", options);
}
inline GltfFile parse(File file, const LoadOptions& options = {}) { return parse(file.text(), options); }

inline std::string gltf_refusal(const std::string& text) {
  return refusal([&] { parse(text); });
}
inline std::string gltf_refusal(File file) { return gltf_refusal(file.text()); }

// Returns the three corners of a triangle.
inline std::vector<Vec3> corners(const TriangleMesh& mesh, std::size_t i) {
  std::vector<Vec3> points;
  for (const std::int32_t index : mesh.triangles[i]) points.push_back(mesh.vertices[static_cast<std::size_t>(index)]);
  return points;
}

inline Vec3 normal(const TriangleMesh& mesh, std::size_t i) {
  const std::vector<Vec3> at = corners(mesh, i);
  return (at[1] - at[0]).cross(at[2] - at[0]).normalized();
}

inline void expect_near(const Vec3& a, const Vec3& b) {
  EXPECT_LT((a - b).norm(), 1e-6F) << a.transpose() << " and " << b.transpose();
}

// A 1 m square with uv. Its material has an image of 2 x 1 pixels: red, blue.
struct Textured : File {
  Textured() {
    const std::size_t positions = corner();
    const std::size_t uv = accessor(bytes_of<float>({0, 0, 1, 0, 0, 1}), kFloat, "VEC2", 3);
    const std::size_t other = accessor(bytes_of<std::uint16_t>({65535, 0, 0, 0, 0, 65535}), kShort, "VEC2", 3);
    json["accessors"][other]["normalized"] = true;
    object({{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", uv}, {"TEXCOORD_1", other}}}, {"material", 0}});
    const std::vector<std::uint8_t> pixels{255, 0, 0, 255, 0, 0, 255, 255};
    const std::size_t image = view(encode_png(2, 1, pixels));
    json["images"] = {{{"bufferView", image}, {"mimeType", "image/png"}, {"name", "stripes"}},
                      {{"uri", "data:image/png;base64," + base64_of(encode_png(1, 2, pixels))}}};
    json["textures"] = {{{"source", 0}}, {{"source", 0}, {"sampler", 0}}, {{"source", 1}}, {{"source", 0}}};
    json["samplers"] = {{{"wrapS", 33071}, {"wrapT", 33648}}};
    set(0, {{"index", 0}});
  }
  void set(std::size_t material, const Json& texture) {
    json["materials"][material]["pbrMetallicRoughness"]["baseColorTexture"] = texture;
  }
};

using Uv = std::vector<std::array<float, 2>>;

inline void expect_near(const Uv& a, const Uv& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_NEAR(a[i][0], b[i][0], 1e-6) << i;
    EXPECT_NEAR(a[i][1], b[i][1], 1e-6) << i;
  }
}

// ---------------------------------------------------------------------------------------------------------------- .glb

inline std::string number(std::size_t value) { return bytes_of<std::uint32_t>({static_cast<std::uint32_t>(value)}); }

}  // namespace flockstep::gltf
