#include "formats/gltf.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstring>
#include <filesystem>
#include <fstream>
#include <initializer_list>
#include <map>
#include <nlohmann/json.hpp>
#include <string>
#include <vector>

#include "base/json_document.hpp"
#include "formats/image.hpp"
#include "refusal.hpp"

namespace flockstep {
namespace {

using Json = nlohmann::json;

constexpr int kByte = 5121, kShort = 5123, kInt = 5125, kFloat = 5126;

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

  std::size_t corner() { return accessor(bytes_of<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}), kFloat, "VEC3", 3); }

  std::string text() {
    json["buffers"] = {{{"byteLength", buffer.size()}, {"uri", "data:application/octet-stream;base64," + base64_of(buffer)}}};
    return json.dump();
  }
};

// A file with one triangle: (0, 0, 0), (1, 0, 0), (0, 1, 0) in file coordinates.
File one_triangle(const Json& node = Json::object()) {
  File file;
  file.mesh({{"attributes", {{"POSITION", file.corner()}}}});
  Json with_mesh = node;
  with_mesh["mesh"] = 0;
  file.node(with_mesh);
  return file;
}

GltfFile parse(const std::string& text, const LoadOptions& options = {}) {
  return parse_gltf(text, "x.gltf", "/nowhere", options);
}
GltfFile parse(File file, const LoadOptions& options = {}) { return parse(file.text(), options); }

std::string gltf_refusal(const std::string& text) {
  return testing::refusal([&] { parse(text); });
}
std::string gltf_refusal(File file) { return gltf_refusal(file.text()); }

// Returns the three corners of a triangle.
std::vector<Vec3> corners(const TriangleMesh& mesh, std::size_t i) {
  std::vector<Vec3> points;
  for (const std::int32_t index : mesh.triangles[i]) points.push_back(mesh.vertices[static_cast<std::size_t>(index)]);
  return points;
}

Vec3 normal(const TriangleMesh& mesh, std::size_t i) {
  const std::vector<Vec3> at = corners(mesh, i);
  return (at[1] - at[0]).cross(at[2] - at[0]).normalized();
}

void expect_near(const Vec3& a, const Vec3& b) { EXPECT_LT((a - b).norm(), 1e-6F) << a.transpose() << " and " << b.transpose(); }

TEST(Gltf, YIsUpInTheFileAndZInTheWorld) {
  const TriangleMesh mesh = parse(one_triangle()).scene.mesh;
  ASSERT_EQ(mesh.triangles.size(), 1U);
  expect_near(corners(mesh, 0)[0], Vec3(0, 0, 0));
  expect_near(corners(mesh, 0)[1], Vec3(1, 0, 0));
  expect_near(corners(mesh, 0)[2], Vec3(0, 0, 1));
  expect_near(normal(mesh, 0), Vec3(0, -1, 0));  // +z in the file
  expect_near(corners(parse(one_triangle(), {.up = UpAxis::z}).scene.mesh, 0)[2], Vec3(0, 1, 0));
  const TriangleMesh placed = parse(one_triangle(), {.scale = 2.0, .origin = Vec3(10, 20, 30)}).scene.mesh;
  expect_near(corners(placed, 0)[0], Vec3(10, 20, 30));
  expect_near(corners(placed, 0)[2], Vec3(10, 20, 32));
}

TEST(Gltf, NodesAreTranslatedTurnedAndScaled) {
  const double half = std::sqrt(0.5);
  // Scale by (2, 3, 1), rotate by 90 degrees about y (x to -z), move by (5, 6, 7): (1, 0, 0) -> (0, 0, -2) -> (5, 6, 5).
  const Json trs = {{"translation", {5, 6, 7}}, {"rotation", {0, half, 0, half}}, {"scale", {2, 3, 1}}};
  const TriangleMesh mesh = parse(one_triangle(trs)).scene.mesh;
  expect_near(corners(mesh, 0)[0], Vec3(5, -7, 6));
  expect_near(corners(mesh, 0)[1], Vec3(5, -5, 6));
  expect_near(corners(mesh, 0)[2], Vec3(5, -7, 9));
  // The same transform as a matrix, column by column.
  const Json matrix = {{"matrix", {0, 0, -2, 0, 0, 3, 0, 0, 1, 0, 0, 0, 5, 6, 7, 1}}};
  const TriangleMesh same = parse(one_triangle(matrix)).scene.mesh;
  for (std::size_t i = 0; i < 3; ++i) expect_near(corners(mesh, 0)[i], corners(same, 0)[i]);
}

TEST(Gltf, NodesArePlacedWithinTheirParents) {
  File file = one_triangle({{"translation", {0, 0, 1}}});
  file.node({{"translation", {10, 0, 0}}, {"scale", {2, 2, 2}}, {"children", {0}}});
  const TriangleMesh mesh = parse(file).scene.mesh;
  expect_near(corners(mesh, 0)[0], Vec3(10, -2, 0));
  expect_near(corners(mesh, 0)[1], Vec3(12, -2, 0));
}

TEST(Gltf, MirroredNodesKeepTheirOutside) {
  const TriangleMesh mesh = parse(one_triangle({{"scale", {-1, 1, 1}}})).scene.mesh;
  expect_near(normal(mesh, 0), Vec3(0, -1, 0));
  const TriangleMesh through = parse(one_triangle({{"scale", {1, 1, -1}}})).scene.mesh;
  expect_near(normal(through, 0), Vec3(0, 1, 0));
}

TEST(Gltf, AMeshOfManyNodesIsAnObjectForEach) {
  File file = one_triangle();
  file.node({{"mesh", 0}, {"translation", {3, 0, 0}}});
  file.node({{"mesh", 0}, {"translation", {6, 0, 0}}});
  const TriangleMesh mesh = parse(file).scene.mesh;
  EXPECT_EQ(mesh.objects, (std::vector<std::uint16_t>{0, 1, 2}));
  expect_near(corners(mesh, 2)[0], Vec3(6, 0, 0));
}

TEST(Gltf, OnlyTheDefaultSceneIsRead) {
  File file = one_triangle();
  file.node({{"mesh", 0}, {"translation", {3, 0, 0}}});
  file.json["scenes"] = {{{"nodes", {0}}}, {{"nodes", {1}}}};
  EXPECT_EQ(parse(file).scene.mesh.triangles.size(), 2U);  // no default scene: all roots
  file.json["scene"] = 1;
  const TriangleMesh mesh = parse(file).scene.mesh;
  ASSERT_EQ(mesh.triangles.size(), 1U);
  expect_near(corners(mesh, 0)[0], Vec3(3, 0, 0));
}

TEST(Gltf, TrianglesComeAsListsStripsAndFans) {
  for (const int component : {kByte, kShort, kInt}) {
    for (const auto& [mode, expected] : std::map<int, std::vector<std::array<std::int32_t, 3>>>{
             {4, {{0, 1, 2}}}, {5, {{0, 1, 2}, {1, 3, 2}}}, {6, {{1, 2, 0}, {2, 3, 0}}}}) {
      File file;
      const std::size_t positions = file.accessor(bytes_of<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 1, 2, 0}), kFloat, "VEC3", 4);
      const std::size_t count = mode == 4 ? 3 : 4;
      const std::string numbers = component == kByte    ? bytes_of<std::uint8_t>({0, 1, 2, 3})
                                  : component == kShort ? bytes_of<std::uint16_t>({0, 1, 2, 3})
                                                        : bytes_of<std::uint32_t>({0, 1, 2, 3});
      const std::size_t indices = file.accessor(numbers, component, "SCALAR", count);
      file.mesh({{"attributes", {{"POSITION", positions}}}, {"indices", indices}, {"mode", mode}});
      file.node({{"mesh", 0}});
      EXPECT_EQ(parse(file).scene.mesh.triangles, expected) << mode;
      if (mode == 4) continue;
      file.json["meshes"][0]["primitives"][0].erase("indices");
      EXPECT_EQ(parse(file).scene.mesh.triangles, expected) << mode;
    }
  }
}

TEST(Gltf, PointsAndLinesAreIgnored) {
  File file = one_triangle();
  for (const int mode : {0, 1, 2, 3})
    file.json["meshes"][0]["primitives"].push_back({{"attributes", {{"POSITION", 0}}}, {"mode", mode}});
  const GltfFile read = parse(file);
  EXPECT_EQ(read.scene.mesh.triangles.size(), 1U);
  EXPECT_EQ(read.ignored, std::vector<std::string>{"4 mesh primitives of points or lines"});
}

TEST(Gltf, TrianglesWithoutAnAreaAreDropped) {
  File file;
  const std::size_t positions = file.accessor(bytes_of<float>({0, 0, 0, 1, 0, 0, 0, 1, 0, 2, 0, 0}), kFloat, "VEC3", 4);
  const std::size_t indices = file.accessor(bytes_of<std::uint8_t>({0, 1, 2, 0, 1, 3, 1, 1, 2}), kByte, "SCALAR", 9);
  file.mesh({{"attributes", {{"POSITION", positions}}}, {"indices", indices}});
  file.node({{"mesh", 0}});
  const GltfFile read = parse(file);
  EXPECT_EQ(read.scene.mesh.triangles.size(), 1U);
  EXPECT_EQ(read.ignored, std::vector<std::string>{"2 triangles without an area"});
}

TEST(Gltf, VerticesMayBeInterleavedAndQuantized) {
  File file;
  const std::size_t positions = file.accessor(bytes_of<float>({0, 0, 0, 9, 1, 0, 0, 9, 0, 1, 0}), kFloat, "VEC3", 3, 16);
  file.mesh({{"attributes", {{"POSITION", positions}}}});
  file.node({{"mesh", 0}});
  expect_near(corners(parse(file).scene.mesh, 0)[2], Vec3(0, 0, 1));

  File quantized;
  quantized.json["extensionsRequired"] = {"KHR_mesh_quantization"};
  const std::size_t whole =
      quantized.accessor(bytes_of<std::int16_t>({0, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 0, 0}), 5122, "VEC3", 3, 8);
  quantized.json["accessors"][whole]["normalized"] = true;
  quantized.mesh({{"attributes", {{"POSITION", whole}}}});
  quantized.node({{"mesh", 0}});
  const TriangleMesh mesh = parse(quantized).scene.mesh;
  expect_near(corners(mesh, 0)[1], Vec3(1, 0, 0));
  expect_near(corners(mesh, 0)[2], Vec3(0, 0, -1));
  quantized.json["accessors"][whole].erase("normalized");
  expect_near(corners(parse(quantized).scene.mesh, 0)[1], Vec3(32767, 0, 0));
}

// ------------------------------------------------------------------------------------------------------------- materials

TEST(Gltf, MaterialsHaveColoursNamesAndClasses) {
  File file = one_triangle();
  file.json["materials"] = {
      {{"name", "red"}, {"pbrMetallicRoughness", {{"baseColorFactor", {1, 0.5, 0.25, 1}}}}},
      Json::object(),
      {{"name", "red"}, {"extras", {{"semantic", 7}}}, {"extensions", {{"KHR_materials_unlit", Json::object()}}}}};
  auto& primitives = file.json["meshes"][0]["primitives"];
  primitives.push_back(primitives[0]);
  primitives[0]["material"] = 2;
  const SceneDescription scene = parse(file).scene;
  ASSERT_EQ(scene.materials.size(), 4U);
  EXPECT_EQ(scene.materials[0].name, "red");
  EXPECT_EQ(scene.materials[1].name, "material 1");
  EXPECT_EQ(scene.materials[2].name, "red 2");
  EXPECT_EQ(scene.materials[3].name, "default");
  EXPECT_EQ(scene.materials[0].base_color, (std::array<float, 3>{1.0F, 0.5F, 0.25F}));
  EXPECT_EQ(scene.materials[3].base_color, (std::array<float, 3>{1.0F, 1.0F, 1.0F}));
  EXPECT_EQ(scene.materials[2].semantic, 7);
  EXPECT_EQ(scene.mesh.materials, (std::vector<std::uint16_t>{2, 3}));
}

TEST(Gltf, ANodesClassGoesForAllBelowIt) {
  File file = one_triangle();
  file.json["materials"] = {{{"name", "wood"}, {"extras", {{"semantic", 7}}}}};
  file.json["meshes"][0]["primitives"][0]["material"] = 0;
  file.node({{"extras", {{"semantic", 9}}}, {"children", {2, 3}}});
  file.node({{"mesh", 0}, {"translation", {2, 0, 0}}});
  file.node({{"mesh", 0}, {"translation", {4, 0, 0}}, {"extras", {{"semantic", 11.0}}}});
  const SceneDescription scene = parse(file).scene;
  std::vector<int> classes;
  for (const std::uint16_t material : scene.mesh.materials) classes.push_back(scene.materials[material].semantic);
  EXPECT_EQ(classes, (std::vector<int>{7, 9, 11}));
  EXPECT_EQ(scene.materials[1].name, "wood 2");
}

// A 1 m square with uv. Its material has an image of 2 x 1 pixels: red, blue.
struct Textured : File {
  Textured() {
    const std::size_t positions = accessor(bytes_of<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}), kFloat, "VEC3", 3);
    const std::size_t uv = accessor(bytes_of<float>({0, 0, 1, 0, 0, 1}), kFloat, "VEC2", 3);
    const std::size_t other = accessor(bytes_of<std::uint16_t>({65535, 0, 0, 0, 0, 65535}), kShort, "VEC2", 3);
    json["accessors"][other]["normalized"] = true;
    mesh({{"attributes", {{"POSITION", positions}, {"TEXCOORD_0", uv}, {"TEXCOORD_1", other}}}, {"material", 0}});
    node({{"mesh", 0}});
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

void expect_near(const Uv& a, const Uv& b) {
  ASSERT_EQ(a.size(), b.size());
  for (std::size_t i = 0; i < a.size(); ++i) {
    EXPECT_NEAR(a[i][0], b[i][0], 1e-6) << i;
    EXPECT_NEAR(a[i][1], b[i][1], 1e-6) << i;
  }
}

TEST(Gltf, TexturesAreDecodedOnce) {
  Textured file;
  file.set(1, {{"index", 3}});
  file.set(2, {{"index", 1}});
  file.set(3, {{"index", 2}});
  const SceneDescription scene = parse(file).scene;
  ASSERT_EQ(scene.textures.size(), 3U);
  EXPECT_EQ(scene.materials[0].texture, 0);
  EXPECT_EQ(scene.materials[1].texture, 0);
  EXPECT_EQ(scene.materials[2].texture, 1);
  EXPECT_EQ(scene.materials[3].texture, 2);
  EXPECT_EQ(scene.textures[0].name, "stripes");
  EXPECT_EQ(scene.textures[1].name, "stripes 2");
  EXPECT_EQ(scene.textures[2].name, "image 1");
  EXPECT_EQ(scene.textures[0].wrap, (std::array{TextureWrap::repeat, TextureWrap::repeat}));
  EXPECT_EQ(scene.textures[1].wrap, (std::array{TextureWrap::clamp, TextureWrap::mirror}));
  EXPECT_EQ(scene.textures[0].width_px, 2);
  EXPECT_EQ(scene.textures[2].height_px, 2);
  EXPECT_EQ(scene.textures[0].rgba, (std::vector<std::uint8_t>{255, 0, 0, 255, 0, 0, 255, 255}));
  expect_near(scene.mesh.uv, {{0, 0}, {1, 0}, {0, 1}});
}

TEST(Gltf, AMaterialChoosesItsCoordinates) {
  Textured file;
  file.set(0, {{"index", 0}, {"texCoord", 1}});
  expect_near(parse(file).scene.mesh.uv, {{1, 0}, {0, 0}, {0, 1}});
  file.set(0, {{"index", 0}, {"extensions", {{"KHR_texture_transform", {{"texCoord", 1}}}}}});
  expect_near(parse(file).scene.mesh.uv, {{1, 0}, {0, 0}, {0, 1}});
  file.set(0, {{"index", 0}, {"texCoord", 2}});
  expect_near(parse(file).scene.mesh.uv, {{0, 0}, {0, 0}, {0, 0}});
}

TEST(Gltf, CoordinatesAreScaledTurnedAndMoved) {
  Textured file;
  const double angle = 0.3;
  const auto c = static_cast<float>(std::cos(angle)), s = static_cast<float>(std::sin(angle));
  file.set(0, {{"index", 0},
               {"extensions", {{"KHR_texture_transform", {{"offset", {0.5, 2}}, {"rotation", angle}, {"scale", {2, 3}}}}}}});
  expect_near(parse(file).scene.mesh.uv, {{0.5F, 2}, {0.5F + 2 * c, 2 - 2 * s}, {0.5F + 3 * s, 2 + 3 * c}});
}

TEST(Gltf, BadImagesAreRefused) {
  Textured file;
  file.json["images"][0] = {{"uri", "data:image/png;base64,AAAA"}};
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /images/0: expected a PNG or JPEG file, got signature 0x000000");
  file.json["images"][0] = {{"uri", "data:image/png;base64,A*AA"}};
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /images/0/uri: expected base64, got the character \"*\"");
  file.json["images"][0] = {{"uri", "data:image/png,AAAA"}};
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /images/0/uri: expected a data: URI in base64, got \"data:image/png,\"");
  file.json["images"][0] = {{"uri", "missing.png"}};
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /images/0/uri: /nowhere/missing.png: cannot read an image: No such file or directory");
  file.json["images"][0] = {{"bufferView", 99}};
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /images/0/bufferView: expected an index of /bufferViews (which has 4), got 99");
}

// ---------------------------------------------------------------------------------------------------------- other features

TEST(Gltf, MarkersAreNodesByNameOrExtras) {
  File file = one_triangle();
  file.node({{"name", "start"}, {"translation", {1, 2, 3}}});
  file.node({{"name", "waypoint.10"}, {"translation", {10, 0, 0}}});
  file.node({{"name", "waypoint.2"}, {"translation", {2, 0, 0}}});
  file.node({{"name", "anything"}, {"extras", {{"marker", "waypoint"}}}, {"translation", {5, 0, 0}}});
  file.node({{"name", "goal"}, {"mesh", 0}});  // an object with that name
  file.node({{"extras", {{"marker", "goal"}}}, {"mesh", 0}, {"translation", {7, 0, 0}}});
  file.node({{"name", "waypoint.x"}});
  const Markers markers = parse(file).scene.markers;
  EXPECT_EQ(markers.start, Vec3(1, -3, 2));
  EXPECT_EQ(markers.goal, Vec3(7, 0, 0));
  EXPECT_EQ(markers.waypoints, (std::vector<Vec3>{Vec3(5, 0, 0), Vec3(2, 0, 0), Vec3(10, 0, 0)}));
  file.node({{"name", "start"}});
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /nodes/8: expected one start, got a second");
  File wrong = one_triangle();
  wrong.node({{"extras", {{"marker", "finish"}}}});
  EXPECT_EQ(
      gltf_refusal(wrong),
      "x.gltf: /nodes/1/extras/marker: expected \"start\", \"goal\", \"waypoint\" or \"waypoint.\" and a number, got \"finish\"");
}

TEST(Gltf, ADirectionalLightIsTheSun) {
  File file = one_triangle();
  file.json["extensions"]["KHR_lights_punctual"]["lights"] = {{{"type", "point"}}, {{"type", "directional"}}};
  const auto light = [](int number) { return Json{{"KHR_lights_punctual", {{"light", number}}}}; };
  file.node({{"extensions", light(0)}});
  const double half = std::sqrt(0.5);  // rotated by 90 degrees about x: z becomes -y, so it shines upwards
  file.node({{"extensions", light(1)}, {"rotation", {half, 0, 0, half}}});
  const GltfFile read = parse(file);
  const auto& sun = read.scene.light.sun_direction;
  expect_near(Vec3(sun[0], sun[1], sun[2]), Vec3(0, 0, -1));
  EXPECT_EQ(read.ignored, std::vector<std::string>{"1 light that is not directional"});
}

using Triple = std::array<float, 3>;

TEST(Gltf, EmissionIsReadWhereItIsOfTheBaseColoursTexture) {
  File file = one_triangle();
  file.json["extensionsRequired"] = {"KHR_materials_emissive_strength", "KHR_materials_unlit"};
  const std::vector<std::uint8_t> pixel{1, 2, 3, 255};
  const Json image = {{"uri", "data:image/png;base64," + base64_of(encode_png(1, 1, pixel))}};
  file.json["images"] = Json::array({image});
  file.json["textures"] = {{{"source", 0}}, {{"source", 0}}};
  const Json surface = {{"baseColorTexture", {{"index", 0}}}, {"baseColorFactor", {0.5, 0.25, 1, 1}}};
  const Json strong = {{"KHR_materials_emissive_strength", {{"emissiveStrength", 400}}}};
  const Json unlit = {{"KHR_materials_unlit", Json::object()}};
  file.json["materials"] = {
      {{"emissiveFactor", {0.5, 0.25, 0}}, {"extensions", strong}},
      {{"emissiveFactor", {0, 0.5, 0}}, {"emissiveTexture", {{"index", 0}}}, {"pbrMetallicRoughness", surface}},
      {{"emissiveFactor", {0, 0.5, 0}}, {"emissiveTexture", {{"index", 1}}}, {"pbrMetallicRoughness", surface}},
      {{"emissiveFactor", {0, 0.5, 0}}, {"pbrMetallicRoughness", surface}},
      {{"emissiveTexture", {{"index", 1}}}},  // factor 0
      {{"emissiveFactor", {1, 1, 1}}, {"pbrMetallicRoughness", surface}, {"extensions", unlit}}};
  const GltfFile read = parse(file);
  const auto& materials = read.scene.materials;
  EXPECT_EQ(materials[0].emissive, (Triple{100, 100, 0}));
  EXPECT_EQ(materials[1].emissive, (Triple{0, 0.5F, 0}));
  for (const std::size_t none : {2U, 3U, 4U}) EXPECT_EQ(materials[none].emissive, Triple{}) << none;
  EXPECT_EQ(materials[5].emissive, (Triple{0.5F, 0.25F, 1}));
  EXPECT_EQ(materials[5].base_color, Triple{});
  EXPECT_EQ(materials[5].texture, 0);
  EXPECT_EQ(read.ignored, std::vector<std::string>{"2 materials' emission by other textures than their base colours'"});
  file.json["materials"][0]["extensions"]["KHR_materials_emissive_strength"]["emissiveStrength"] = -1;
  EXPECT_EQ(gltf_refusal(file),
            "x.gltf: /materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength: expected a number >= 0, got -1");
}

TEST(Gltf, MasksHaveACutoffOfTheTexturesAlpha) {
  File file = one_triangle();
  const auto with_alpha = [](double alpha) { return Json{{"baseColorFactor", {1, 1, 1, alpha}}}; };
  file.json["materials"] = {{{"alphaMode", "MASK"}},
                            {{"alphaMode", "MASK"}, {"alphaCutoff", 0.25}},
                            {{"alphaMode", "MASK"}, {"alphaCutoff", 0.25}, {"pbrMetallicRoughness", with_alpha(0.5)}},
                            {{"alphaMode", "MASK"}, {"pbrMetallicRoughness", with_alpha(0.5)}},
                            {{"alphaMode", "MASK"}, {"alphaCutoff", 0}, {"pbrMetallicRoughness", with_alpha(0)}},
                            {{"alphaMode", "OPAQUE"}, {"alphaCutoff", 0.25}},
                            {{"alphaCutoff", 0.25}},
                            {{"alphaMode", "MASK"}, {"alphaCutoff", 0.5}, {"pbrMetallicRoughness", with_alpha(0.25)}},
                            {{"alphaMode", "MASK"}, {"alphaCutoff", 2}}};
  const auto primitive = file.json["meshes"][0]["primitives"][0];
  auto& primitives = file.json["meshes"][0]["primitives"] = Json::array();
  for (std::size_t i = 0; i < 9; ++i) {
    primitives.push_back(primitive);
    primitives.back()["material"] = i;
  }
  const GltfFile read = parse(file);
  const SceneDescription& scene = read.scene;
  const std::vector<float> expected{0.5F, 0.25F, 0.5F, 1, 0, 0, 0, 0, 0};
  ASSERT_EQ(scene.materials.size(), 9U);
  for (std::size_t i = 0; i < 9; ++i) EXPECT_EQ(scene.materials[i].alpha_cutoff, expected[i]) << i;
  EXPECT_EQ(read.ignored, std::vector<std::string>{"2 materials' masks that hide all of them"});
  file.json["materials"][1]["alphaCutoff"] = -0.5;
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /materials/1/alphaCutoff: expected a number >= 0, got -0.5");
  file.json["materials"][1]["alphaCutoff"] = "half";
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /materials/1/alphaCutoff: expected a number >= 0, got \"half\"");
  file.json["materials"][1]["alphaMode"] = 1;
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /materials/1/alphaMode: expected a string, got 1");
}

TEST(Gltf, ColoursOfVertices) {
  File file;
  const std::size_t positions = file.accessor(bytes_of<float>({0, 0, 0, 1, 0, 0, 0, 1, 0}), kFloat, "VEC3", 3);
  const std::size_t floats = file.accessor(bytes_of<float>({1, 0.5, 0, 0, 0, 2, 1, 1, 1}), kFloat, "VEC3", 3);
  const std::size_t bytes =
      file.accessor(bytes_of<std::uint8_t>({255, 0, 51, 9, 0, 0, 0, 9, 255, 255, 255, 9}), kByte, "VEC4", 3, 4);
  file.json["accessors"][bytes]["normalized"] = true;
  file.mesh({{"attributes", {{"POSITION", positions}}}});
  auto& primitives = file.json["meshes"][0]["primitives"];
  primitives.push_back({{"attributes", {{"POSITION", positions}, {"COLOR_0", floats}}}});
  primitives.push_back({{"attributes", {{"POSITION", positions}, {"COLOR_0", bytes}}}});
  primitives.push_back(Json(primitives[0]));
  file.node({{"mesh", 0}});
  const std::vector<Triple> colors = parse(file).scene.mesh.colors;
  ASSERT_EQ(colors.size(), 12U);
  EXPECT_EQ((std::vector<Triple>(colors.begin(), colors.begin() + 9)),
            (std::vector<Triple>{
                {1, 1, 1}, {1, 1, 1}, {1, 1, 1}, {1, 0.5F, 0}, {0, 0, 1}, {1, 1, 1}, {1, 0, 0.2F}, {0, 0, 0}, {1, 1, 1}}));
  EXPECT_EQ(colors[11], (Triple{1, 1, 1}));
  file.json["accessors"][floats]["count"] = 2;
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /accessors/1: expected as many colours as positions (3), got 2");
}

TEST(Gltf, NodesMayBeVisualOrCollisionOnly) {
  const auto visibility_of = [](const std::vector<Json>& nodes) {
    File file = one_triangle();
    file.json["nodes"] = nodes;
    file.json["nodes"].push_back({{"mesh", 0}});
    file.json["scenes"] = {{{"nodes", {0, nodes.size()}}}};
    file.json["scene"] = 0;
    const GltfFile read = parse(file);
    EXPECT_TRUE(read.ignored.empty());
    return read.scene.mesh.visibility;
  };
  using All = std::vector<Visibility>;
  constexpr Visibility kFull = Visibility::full, kVisual = Visibility::visual, kSolid = Visibility::solid;
  const Json shown = {{"visual_only", true}}, hit = {{"collision_only", 1}};
  EXPECT_EQ(visibility_of({{{"mesh", 0}}}), (All{kFull, kFull}));
  EXPECT_EQ(visibility_of({{{"mesh", 0}, {"extras", shown}}}), (All{kVisual, kFull}));
  EXPECT_EQ(visibility_of({{{"mesh", 0}, {"extras", hit}}}), (All{kSolid, kFull}));
  EXPECT_EQ(visibility_of({{{"mesh", 0}, {"extras", {{"collision_only", 0}, {"visual_only", false}}}}}), (All{kFull, kFull}));
  for (const char* const name : {"UCX_a", "UBX_a", "USP_a", "UCP_a", "a-colonly", "a-convcolonly"}) {
    EXPECT_EQ(visibility_of({{{"mesh", 0}, {"name", name}}}), (All{kSolid, kFull}));
    EXPECT_EQ(visibility_of({{{"mesh", 0}, {"name", name}, {"extras", {{"collision_only", false}}}}}), (All{kFull, kFull}));
  }
  for (const char* const name : {"ucx_a", "aUCX_", "a-col", "-colonly.001"}) {
    EXPECT_EQ(visibility_of({{{"mesh", 0}, {"name", name}}}), (All{kFull, kFull}));
  }
  // The extras apply to all descendants, until one of them overrides them.
  EXPECT_EQ(visibility_of({{{"children", {1, 2}}, {"extras", hit}},
                           {{"mesh", 0}, {"extras", shown}},
                           {{"mesh", 0}, {"children", {3}}},
                           {{"mesh", 0}, {"children", {4}}, {"extras", {{"collision_only", false}}}},
                           {{"mesh", 0}}}),
            (All{kVisual, kSolid, kFull, kFull, kFull}));

  EXPECT_EQ(gltf_refusal(one_triangle({{"extras", {{"visual_only", "yes"}}}})),
            "x.gltf: /nodes/0/extras/visual_only: expected true or false, got \"yes\"");
  EXPECT_EQ(gltf_refusal(one_triangle({{"extras", {{"visual_only", true}, {"collision_only", true}}}})),
            "x.gltf: /nodes/0/extras: expected one of visual_only and collision_only to be true, got both");
}

TEST(Gltf, IgnoredPartsAreNamed) {
  File file = one_triangle({{"skin", 0}});
  file.json["animations"] = {Json::object(), Json::object()};
  file.json["skins"] = {Json::object()};
  file.json["cameras"] = {Json::object()};
  file.json["materials"] = {{{"alphaMode", "BLEND"},
                             {"normalTexture", {{"index", 0}}},
                             {"occlusionTexture", {{"index", 0}}},
                             {"emissiveFactor", {0, 0, 0}}},
                            {{"emissiveFactor", {0, 0.5, 0}}, {"emissiveTexture", {{"index", 0}}}}};
  file.json["meshes"][0]["primitives"][0]["targets"] = {{{"POSITION", 0}}};
  file.json["extensionsUsed"] = {"KHR_materials_unlit", "KHR_materials_clearcoat"};
  EXPECT_EQ(
      parse(file).ignored,
      (std::vector<std::string>{"extension KHR_materials_clearcoat", "2 animations", "1 skin", "1 camera",
                                "1 mesh primitive's morph targets", "1 material's transparency", "1 material's normal map",
                                "1 material's occlusion", "1 material's emission by another texture than its base colour's"}));
  file.json["extensionsRequired"] = {"KHR_draco_mesh_compression"};
  EXPECT_EQ(gltf_refusal(file),
            "x.gltf: /extensionsRequired/0: expected only supported extensions (KHR_texture_transform, "
            "KHR_materials_unlit, KHR_materials_emissive_strength, KHR_lights_punctual, KHR_mesh_quantization), got "
            "\"KHR_draco_mesh_compression\"");
}

// ----------------------------------------------------------------------------------------------------------- refusals

// Returns the message for a single change to a valid file.
std::string refusal(const std::string& pointer, const Json& value) {
  File file = one_triangle();
  file.text();
  file.json[Json::json_pointer(pointer)] = value;
  return gltf_refusal(file.json.dump());
}

TEST(Gltf, MistakesAreRefusedWithTheirPlace) {
  EXPECT_EQ(gltf_refusal("{}"), "x.gltf: expected a field \"asset\", found none");
  EXPECT_EQ(gltf_refusal("[]"), "x.gltf: expected an object, got []");
  EXPECT_EQ(gltf_refusal("").rfind("x.gltf: not valid JSON: ", 0), 0U);
  EXPECT_EQ(refusal("/asset/version", "1.0"), "x.gltf: /asset/version: expected glTF 2, got \"1.0\"");
  EXPECT_EQ(refusal("/asset/minVersion", "2.1"), "x.gltf: /asset/minVersion: expected glTF 2.0, got \"2.1\"");
  EXPECT_EQ(refusal("/nodes/0/mesh", 1), "x.gltf: /nodes/0/mesh: expected an index of /meshes (which has 1), got 1");
  EXPECT_EQ(refusal("/nodes/0/mesh", "0"), "x.gltf: /nodes/0/mesh: expected an index of /meshes (which has 1), got \"0\"");
  EXPECT_EQ(refusal("/nodes/0/mesh", 0.5), "x.gltf: /nodes/0/mesh: expected an index of /meshes (which has 1), got 0.5");
  EXPECT_EQ(refusal("/nodes/0/mesh", -1), "x.gltf: /nodes/0/mesh: expected an index of /meshes (which has 1), got -1");
  EXPECT_EQ(refusal("/nodes", Json::object()), "x.gltf: /nodes: expected an array, got {}");
  EXPECT_EQ(refusal("/nodes/0", 3), "x.gltf: /nodes/0: expected an object, got 3");
  EXPECT_EQ(refusal("/nodes/0/matrix", Json::array({1})), "x.gltf: /nodes/0/matrix: expected an array of 16 numbers, got [1]");
  EXPECT_EQ(refusal("/nodes/0/scale", {1, "x", 1}), "x.gltf: /nodes/0/scale/1: expected a number within +-1e+30, got \"x\"");
  EXPECT_EQ(refusal("/nodes/0/rotation", {0, 0, 0, 2}), "x.gltf: /nodes/0/rotation: expected a quaternion of norm 1, got 2");
  EXPECT_EQ(refusal("/nodes/0/matrix", {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}),
            "x.gltf: /nodes/0/matrix: expected 0, 0, 0, 1 as the last row, got another");
  EXPECT_EQ(refusal("/nodes/0/translation", {1e7, 0, 0}),
            "x.gltf: /accessors/0: expected finite positions that come to lie within +-1e+06 m, got (1e+07, 0, 0)");
  EXPECT_EQ(refusal("/nodes/0/extras", {{"semantic", 65533}}),
            "x.gltf: /nodes/0/extras/semantic: expected an integer in [1, 65532], got 65533");
  EXPECT_EQ(refusal("/nodes/0/children", Json::array({0})),
            "x.gltf: expected at least one triangle with an area, got none");  // no root node
  EXPECT_EQ(refusal("/meshes/0/primitives", 1), "x.gltf: /meshes/0/primitives: expected an array, got 1");
  EXPECT_EQ(refusal("/meshes/0/primitives/0/mode", 7),
            "x.gltf: /meshes/0/primitives/0/mode: expected an integer in [0, 6], got 7");
  EXPECT_EQ(refusal("/meshes/0/primitives/0/attributes", Json::object()),
            "x.gltf: /meshes/0/primitives/0/attributes: expected a field \"POSITION\", found none");
  EXPECT_EQ(refusal("/meshes/0/primitives/0/attributes/POSITION", 5),
            "x.gltf: /meshes/0/primitives/0/attributes/POSITION: expected an index of /accessors (which has 1), got 5");
  EXPECT_EQ(refusal("/meshes/0/primitives/0/indices", 0),
            "x.gltf: /accessors/0: expected unsigned integers as indices, got others");
  EXPECT_EQ(refusal("/accessors/0/type", "VEC4"),
            "x.gltf: /accessors/0: expected an accessor within its buffer view of 36 bytes, got one that ends at byte 48");
  EXPECT_EQ(refusal("/accessors/0/type", "VEC2"), "x.gltf: /accessors/0: expected VEC3 positions, got others");
  EXPECT_EQ(refusal("/accessors/0/type", "VEC5"),
            "x.gltf: /accessors/0/type: expected SCALAR, VEC2, VEC3, VEC4, MAT2, MAT3 or MAT4, got \"VEC5\"");
  EXPECT_EQ(refusal("/accessors/0/componentType", 5124),
            "x.gltf: /accessors/0/componentType: expected a component type of glTF, got 5124");
  EXPECT_EQ(refusal("/accessors/0/count", 2), "x.gltf: /accessors/0: expected three corners for each triangle, got 2");
  EXPECT_EQ(refusal("/accessors/0/count", 4),
            "x.gltf: /accessors/0: expected an accessor within its buffer view of 36 bytes, got one that ends at byte 48");
  EXPECT_EQ(
      refusal("/accessors/0/count", 2147483648U),
      "x.gltf: /accessors/0: expected an accessor within its buffer view of 36 bytes, got one that ends at byte 25769803776");
  EXPECT_EQ(refusal("/accessors/0/count", 1e300),
            "x.gltf: /accessors/0/count: expected an integer in [1, 2147483648], got 1e+300");
  EXPECT_EQ(refusal("/accessors/0/byteOffset", 4),
            "x.gltf: /accessors/0: expected an accessor within its buffer view of 36 bytes, got one that ends at byte 40");
  EXPECT_EQ(refusal("/accessors/0/sparse", Json::object()),
            "x.gltf: /accessors/0: expected an accessor with a bufferView, and not sparse, got another");
  EXPECT_EQ(refusal("/bufferViews/0/byteLength", 37),
            "x.gltf: /bufferViews/0: expected a buffer view within its buffer of 36 bytes, got bytes 0 to 37");
  EXPECT_EQ(refusal("/bufferViews/0/byteStride", 6), "x.gltf: /bufferViews/0/byteStride: expected a multiple of 4, got 6");
  EXPECT_EQ(refusal("/bufferViews/0/byteStride", 256),
            "x.gltf: /bufferViews/0/byteStride: expected an integer in [4, 252], got 256");
  EXPECT_EQ(refusal("/buffers/0/byteLength", 37), "x.gltf: /buffers/0: expected 37 bytes, as byteLength says, got 36");
  EXPECT_EQ(refusal("/buffers/0/byteLength", 1ULL << 40U),
            "x.gltf: /buffers/0/byteLength: expected an integer in [1, 1073741824], got 1099511627776");
  EXPECT_EQ(refusal("/buffers/0", {{"byteLength", 36}}), "x.gltf: /buffers/0: expected a field \"uri\", found none");
  EXPECT_EQ(refusal("/scene", 0), "x.gltf: /scene: expected an index of /scenes (which has 0), got 0");
  EXPECT_EQ(refusal("/materials", Json::array({{{"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 2, 1}}}}}})),
            "x.gltf: /materials/0/pbrMetallicRoughness/baseColorFactor/2: expected a number in [0, 1], got 2");
}

TEST(Gltf, FilesBesideItAreReadAndOthersAreNot) {
  EXPECT_EQ(
      refusal("/buffers/0/uri", "../x.bin"),
      "x.gltf: /buffers/0/uri: expected a file in the folder of x.gltf or below it (load with meshes_anywhere=True to allow "
      "others), got \"../x.bin\"");
  EXPECT_EQ(refusal("/buffers/0/uri", "%2e%2e/x.bin").find("x.gltf: /buffers/0/uri: expected a file in the folder of x.gltf"),
            0U);
  EXPECT_EQ(refusal("/buffers/0/uri", "/etc/passwd").find("x.gltf: /buffers/0/uri: expected a file in the folder of x.gltf"), 0U);
  EXPECT_EQ(refusal("/buffers/0/uri", "https://x.y/z"),
            "x.gltf: /buffers/0/uri: expected a data: URI or the path of a file, got \"https://x.y/z\"");
  EXPECT_EQ(refusal("/buffers/0/uri", ""), "x.gltf: /buffers/0/uri: expected a data: URI or the path of a file, got \"\"");

  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "flockstep_gltf_test";
  std::filesystem::create_directories(folder / "parts");
  File file = one_triangle();
  file.text();
  std::ofstream(folder / "a b.bin", std::ios::binary) << file.buffer << "and more";
  for (const auto& [place, uri] :
       std::map<std::string, std::string>{{"one.gltf", "a%20b.bin"}, {"parts/two.gltf", "../a b.bin"}}) {
    file.json["buffers"][0]["uri"] = uri;
    std::ofstream(folder / place) << file.json.dump();
  }
  EXPECT_EQ(World::load(folder / "one.gltf")->triangles().triangles.size(), 1U);
  EXPECT_EQ(World::load(folder / "one.gltf")->name(), "one");
  EXPECT_THROW(World::load(folder / "parts/two.gltf"), std::invalid_argument);
  EXPECT_EQ(World::load(folder / "parts/two.gltf", {.files = MeshFiles::anywhere})->triangles().triangles.size(), 1U);
  std::filesystem::remove_all(folder);
}

TEST(Gltf, CirclesAndSharedNodesAreRefused) {
  File circle = one_triangle({{"children", {1}}});
  circle.node({{"children", {0}}});
  circle.json["scenes"] = {{{"nodes", {0}}}};
  circle.json["scene"] = 0;
  EXPECT_EQ(gltf_refusal(circle), "x.gltf: /nodes/0: expected a node with one parent, got one with two, or that contains itself");
  File shared = one_triangle();
  shared.node({{"children", {0}}});
  shared.node({{"children", {0}}});
  EXPECT_EQ(gltf_refusal(shared), "x.gltf: /nodes/0: expected a node with one parent, got one with two, or that contains itself");
}

TEST(Gltf, DepthIsBoundedInJsonAndFreeInNodes) {
  File file = one_triangle();
  for (int i = 1; i < 20000; ++i) file.node({{"children", {i - 1}}});
  EXPECT_EQ(parse(file).scene.mesh.triangles.size(), 1U);
  std::string deep = file.text();
  deep.pop_back();
  deep += ", \"extras\": " + std::string(100000, '[') + std::string(100000, ']') + "}";
  EXPECT_EQ(gltf_refusal(deep), "x.gltf: expected at most 32 levels of arrays and objects, got more");
}

TEST(Gltf, InstancesAreBounded) {
  File file;
  std::string indices;
  for (int i = 0; i < 3 * 4096; ++i) indices += static_cast<char>(i % 3);
  const std::size_t positions = file.corner();
  file.mesh({{"attributes", {{"POSITION", positions}}}, {"indices", file.accessor(indices, kByte, "SCALAR", 3 * 4096)}});
  for (int i = 0; i < 3; ++i) file.node({{"mesh", 0}});
  EXPECT_EQ(parse(file).scene.mesh.triangles.size(), 3U * 4096U);
  auto& primitives = file.json["meshes"][0]["primitives"];
  for (int i = 1; i < 4096; ++i) primitives.push_back(primitives[0]);
  EXPECT_EQ(gltf_refusal(file), "x.gltf: expected at most 33554432 triangles, got more");
  File many = one_triangle();
  many.mesh({{"attributes", {{"POSITION", 0}}}, {"mode", 1}});
  for (int i = 0; i < 65536; ++i) many.node({{"mesh", 1}});
  EXPECT_EQ(gltf_refusal(many), "x.gltf: /nodes/65536: expected at most 65536 nodes with a mesh, got more");
}

// ---------------------------------------------------------------------------------------------------------------- .glb

std::string number(std::size_t value) { return bytes_of<std::uint32_t>({static_cast<std::uint32_t>(value)}); }

std::string glb_of(File file) {
  file.json["buffers"] = {{{"byteLength", file.buffer.size()}}};
  std::string json = file.json.dump();
  json.resize((json.size() + 3) / 4 * 4, ' ');
  std::string chunk = file.buffer;
  chunk.resize((chunk.size() + 3) / 4 * 4, '\0');
  const std::string chunks = number(json.size()) + "JSON" + json + number(chunk.size()) + std::string("BIN\0", 4) + chunk;
  return "glTF" + number(2) + number(12 + chunks.size()) + chunks;
}

TEST(Gltf, IncompleteBinaryFilesAreRefused) {
  const std::string glb = glb_of(Textured());
  EXPECT_EQ(parse(glb).scene.textures.size(), 1U);
  for (std::size_t size = 0; size < glb.size(); ++size) EXPECT_NE(gltf_refusal(glb.substr(0, size)), "accepted") << size;
  EXPECT_NE(gltf_refusal(glb + '\0'), "accepted");
  std::string other = glb;
  other[4] = 1;
  EXPECT_EQ(gltf_refusal(other), "x.gltf: expected glTF 2, got version 1");
  other = glb;
  other[16] = 'j';
  EXPECT_EQ(gltf_refusal(other), "x.gltf: expected a first chunk of JSON, got another");
  other = glb;
  other[15] = 0x7f;
  EXPECT_EQ(gltf_refusal(other).rfind("x.gltf: expected chunks within the file, got one of ", 0), 0U);
}

TEST(Gltf, TruncatedTextIsRefused) {
  const std::string text = Textured().text();
  for (std::size_t size = 0; size < text.size(); ++size) EXPECT_NE(gltf_refusal(text.substr(0, size)), "accepted") << size;
  EXPECT_EQ(gltf_refusal(text), "accepted");
}

// --------------------------------------------------------------------------------------------------------- in a World

TEST(Gltf, AWorldReportsIgnoredParts) {
  const std::filesystem::path path = std::filesystem::path(::testing::TempDir()) / "flockstep_gltf_world.gltf";
  File file = one_triangle();
  file.json["animations"] = {Json::object()};
  std::ofstream(path) << file.text();
  const auto world = World::load(path, {.scale = 2.0});
  EXPECT_EQ(world->bounds().max, Vec3(2, 0, 2));
  ASSERT_EQ(world->ignored().size(), 1U);
  EXPECT_EQ(world->ignored()[0], "1 animation");
  std::filesystem::remove(path);
}

TEST(LoadOptions, OtherFormatsArePlacedToo) {
  const std::filesystem::path path = std::filesystem::path(::testing::TempDir()) / "flockstep_placed.json";
  std::ofstream(path) << R"({"flockstep_scene": 1, "room": {"min": [0, 0, 0], "max": [4, 6, 2]},
    "boxes": [{"center": [1, 2, 1], "size": [1, 2, 1]}], "spheres": [{"center": [3, 3, 1], "radius": 0.5}],
    "meshes": [{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]]}],
    "markers": {"start": [1, 2, 1], "spawn_box": {"min": [0, 1, 0], "max": [1, 3, 1]}}, "light": {"sun_direction": [0, 1, 0]}})";
  const auto as_it_is = World::load(path);
  const auto same = World::load(path, {.scale = 1.0, .up = UpAxis::z});
  EXPECT_EQ(as_it_is->content_hash(), same->content_hash());
  const auto turned = World::load(path, {.scale = 2.0, .origin = Vec3(0, 0, 1), .up = UpAxis::y});
  EXPECT_EQ(turned->bounds().min, Vec3(0, -4, 1));
  EXPECT_EQ(turned->bounds().max, Vec3(8, 0, 13));
  EXPECT_EQ(turned->markers().start, Vec3(2, -2, 5));
  EXPECT_EQ(turned->markers().spawn_box->min, Vec3(0, -2, 3));
  EXPECT_EQ(turned->markers().spawn_box->max, Vec3(2, 0, 7));
  EXPECT_EQ(turned->markers().radius, 0.5F);
  expect_near(Vec3(turned->light().sun_direction.data()), Vec3(0, 0, 1));
  for (const LoadOptions& wrong :
       {LoadOptions{.scale = 0.0}, LoadOptions{.scale = NAN}, LoadOptions{.origin = Vec3(0, NAN, 0)}}) {
    EXPECT_THROW(World::load(path, wrong), std::invalid_argument);
  }
  std::filesystem::remove(path);
}

// -------------------------------------------------------------------------------------------------- files from other tools

const std::filesystem::path kModels = "/usr/share/assimp/models/glTF2";  // from Debian's package assimp-testmodels

TEST(GltfModels, EveryFileIsReadOrRefusedClearly) {
  if (!std::filesystem::exists(kModels)) GTEST_SKIP() << "Debian's package assimp-testmodels is not installed";
  // Counted by a separate program from the accessors of each mesh that a node shows, minus degenerate triangles.
  const std::map<std::string, std::size_t> expected{{"2CylinderEngine.glb", 121496 - 11160},
                                                    {"BoxTextured.glb", 12},
                                                    {"boxTexcoords.gltf", 12},
                                                    {"AnimatedMorphCube.gltf", 12},
                                                    {"simple_skin.gltf", 8},
                                                    {"TextureTransformTest.gltf", 24},
                                                    {"Cameras.gltf", 2},
                                                    {"Mesh_PrimitiveMode_04.gltf", 2},
                                                    {"Mesh_PrimitiveMode_05.gltf", 2},
                                                    {"Mesh_PrimitiveMode_06.gltf", 2},
                                                    {"ClearCoatTest.gltf", 37116}};
  std::size_t read = 0, refused = 0, known = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(kModels)) {
    const std::string extension = entry.path().extension();
    if (!entry.is_regular_file() || (extension != ".gltf" && extension != ".glb")) continue;
    SCOPED_TRACE(entry.path());
    try {
      const auto world = World::load(entry.path());
      ++read;
      const auto found = expected.find(entry.path().filename());
      if (found == expected.end()) continue;
      EXPECT_EQ(world->triangles().triangles.size(), found->second);
      ++known;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(std::string(error.what()).rfind(entry.path().string() + ": ", 0), 0U) << error.what();
      ++refused;
    }
  }
  EXPECT_GE(read, 20U);
  EXPECT_GE(refused, 10U);
  EXPECT_GE(known, expected.size());
}

}  // namespace
}  // namespace flockstep
