// glTF files with mistakes, files from other tools, and files as worlds.
#include "formats/gltf_file.hpp"

namespace flockstep {
namespace {

using namespace gltf;

TEST(Gltf, BadImagesAreRefused) {
  Textured file;
  file.json["images"][0] = {{"uri", "data:image/png;base64,AAAA"}};
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: /images/0: ... signature 0x000000"));
  file.json["images"][0] = {{"uri", "data:image/png;base64,A*AA"}};
  EXPECT_TRUE(names(gltf_refusal(file), R"(x.gltf: /images/0/uri: expected base64, got the character "*")"));
  file.json["images"][0] = {{"uri", "data:image/png,AAAA"}};
  EXPECT_TRUE(names(gltf_refusal(file), R"(x.gltf: /images/0/uri: ... base64 ... "data:image/png,")"));
  file.json["images"][0] = {{"uri", "missing.png"}};
  EXPECT_EQ(gltf_refusal(file), "x.gltf: /images/0/uri: /nowhere/missing.png: cannot read an image: No such file or directory");
  file.json["images"][0] = {{"bufferView", 99}};
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: /images/0/bufferView: ... (which has 4) ... 99"));
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
  EXPECT_TRUE(names(gltf_refusal(file), R"(x.gltf: /extensionsRequired/0: ... "KHR_draco_mesh_compression")"));
}

// ----------------------------------------------------------------------------------------------------------- refusals

// Returns the message for a single change to a valid file.
std::string spoilt(const std::string& pointer, const Json& value) {
  File file = one_triangle();
  file.text();
  file.json[Json::json_pointer(pointer)] = value;
  return gltf_refusal(file.json.dump());
}

TEST(Gltf, MistakesAreRefusedWithTheirPlace) {
  EXPECT_TRUE(names(gltf_refusal("{}"), R"(x.gltf: ... "asset")"));
  EXPECT_TRUE(names(gltf_refusal("[]"), "x.gltf: ... object ... []"));
  EXPECT_TRUE(names(gltf_refusal(""), "x.gltf: not valid JSON: "));
  EXPECT_TRUE(names(spoilt("/asset/version", "1.0"), R"(x.gltf: /asset/version: ... 2 ... "1.0")"));
  EXPECT_TRUE(names(spoilt("/asset/minVersion", "2.1"), R"(x.gltf: /asset/minVersion: ... 2.0 ... "2.1")"));
  EXPECT_TRUE(names(spoilt("/nodes/0/mesh", 1), "x.gltf: /nodes/0/mesh: ... (which has 1) ... 1"));
  EXPECT_TRUE(names(spoilt("/nodes/0/mesh", "0"), R"(x.gltf: /nodes/0/mesh: ... (which has 1) ... "0")"));
  EXPECT_TRUE(names(spoilt("/nodes/0/mesh", 0.5), "x.gltf: /nodes/0/mesh: ... (which has 1) ... 0.5"));
  EXPECT_TRUE(names(spoilt("/nodes/0/mesh", -1), "x.gltf: /nodes/0/mesh: ... (which has 1) ... -1"));
  EXPECT_TRUE(names(spoilt("/nodes", Json::object()), "x.gltf: /nodes: ... array ... {}"));
  EXPECT_TRUE(names(spoilt("/nodes/0", 3), "x.gltf: /nodes/0: ... 3"));
  EXPECT_TRUE(names(spoilt("/nodes/0/matrix", Json::array({1})), "x.gltf: /nodes/0/matrix: ... 16 ... [1]"));
  EXPECT_TRUE(names(spoilt("/nodes/0/scale", {1, "x", 1}), R"(x.gltf: /nodes/0/scale/1: ... +-1e+30 ... "x")"));
  EXPECT_TRUE(names(spoilt("/nodes/0/rotation", {0, 0, 0, 2}), "x.gltf: /nodes/0/rotation: ... 1 ... 2"));
  EXPECT_TRUE(names(spoilt("/nodes/0/matrix", {1, 0, 0, 1, 0, 1, 0, 0, 0, 0, 1, 0, 0, 0, 0, 1}),
                    "x.gltf: /nodes/0/matrix: ... 0 ... 0 ... 0 ... 1"));
  EXPECT_TRUE(names(spoilt("/nodes/0/translation", {1e7, 0, 0}), "x.gltf: /accessors/0: ... +-1e+06 ... (1e+07, 0, 0)"));
  EXPECT_TRUE(
      names(spoilt("/nodes/0/extras", {{"semantic", 65533}}), "x.gltf: /nodes/0/extras/semantic: ... [1, 65532] ... 65533"));
  EXPECT_TRUE(names(spoilt("/nodes/0/children", Json::array({0})), "x.gltf: ... triangle"));  // no root node
  EXPECT_TRUE(names(spoilt("/meshes/0/primitives", 1), "x.gltf: /meshes/0/primitives: ... 1"));
  EXPECT_TRUE(names(spoilt("/meshes/0/primitives/0/mode", 7), "x.gltf: /meshes/0/primitives/0/mode: ... [0, 6] ... 7"));
  EXPECT_TRUE(names(spoilt("/meshes/0/primitives/0/attributes", Json::object()),
                    R"(x.gltf: /meshes/0/primitives/0/attributes: ... "POSITION")"));
  EXPECT_TRUE(names(spoilt("/meshes/0/primitives/0/attributes/POSITION", 5),
                    "x.gltf: /meshes/0/primitives/0/attributes/POSITION: ... (which has 1) ... 5"));
  EXPECT_TRUE(names(spoilt("/meshes/0/primitives/0/indices", 0), "x.gltf: /accessors/0: ... unsigned"));
  EXPECT_TRUE(names(spoilt("/accessors/0/type", "VEC4"), "x.gltf: /accessors/0: ... 36 ... one that ends at byte 48"));
  EXPECT_TRUE(names(spoilt("/accessors/0/type", "VEC2"), "x.gltf: /accessors/0: ... VEC3"));
  EXPECT_TRUE(
      names(spoilt("/accessors/0/type", "VEC5"), R"(x.gltf: /accessors/0/type: ... VEC2 ... VEC3 ... VEC4 ... MAT2 ... "VEC5")"));
  EXPECT_TRUE(names(spoilt("/accessors/0/componentType", 5124), "x.gltf: /accessors/0/componentType: ... 5124"));
  EXPECT_TRUE(names(spoilt("/accessors/0/count", 2), "x.gltf: /accessors/0: ... 2"));
  EXPECT_TRUE(names(spoilt("/accessors/0/count", 4), "x.gltf: /accessors/0: ... 36 ... one that ends at byte 48"));
  EXPECT_TRUE(names(spoilt("/accessors/0/count", 2147483648U), "x.gltf: /accessors/0: ... 36 ... 25769803776"));
  EXPECT_TRUE(names(spoilt("/accessors/0/count", 1e300), "x.gltf: /accessors/0/count: ... [1, 2147483648] ... 1e+300"));
  EXPECT_TRUE(names(spoilt("/accessors/0/byteOffset", 4), "x.gltf: /accessors/0: ... 36 ... one that ends at byte 40"));
  EXPECT_TRUE(names(spoilt("/accessors/0/sparse", Json::object()), "x.gltf: /accessors/0: ... bufferView"));
  EXPECT_TRUE(names(spoilt("/bufferViews/0/byteLength", 37), "x.gltf: /bufferViews/0: ... 36 ... bytes 0 to 37"));
  EXPECT_TRUE(names(spoilt("/bufferViews/0/byteStride", 6), "x.gltf: /bufferViews/0/byteStride: ... 4 ... 6"));
  EXPECT_TRUE(names(spoilt("/bufferViews/0/byteStride", 256), "x.gltf: /bufferViews/0/byteStride: ... [4, 252] ... 256"));
  EXPECT_TRUE(names(spoilt("/buffers/0/byteLength", 37), "x.gltf: /buffers/0: ... 37 ... 36"));
  EXPECT_TRUE(names(spoilt("/buffers/0/byteLength", 1ULL << 40U),
                    "x.gltf: /buffers/0/byteLength: ... [1, 1073741824] ... 1099511627776"));
  EXPECT_TRUE(names(spoilt("/buffers/0", {{"byteLength", 36}}), R"(x.gltf: /buffers/0: ... "uri")"));
  EXPECT_TRUE(names(spoilt("/scene", 0), "x.gltf: /scene: ... (which has 0) ... 0"));
  EXPECT_TRUE(names(spoilt("/materials", Json::array({{{"pbrMetallicRoughness", {{"baseColorFactor", {1, 1, 2, 1}}}}}})),
                    "x.gltf: /materials/0/pbrMetallicRoughness/baseColorFactor/2: ... [0, 1] ... 2"));
}

TEST(Gltf, FilesBesideItAreReadAndOthersAreNot) {
  EXPECT_TRUE(names(spoilt("/buffers/0/uri", "../x.bin"), R"(x.gltf: /buffers/0/uri: ... "../x.bin")"));
  EXPECT_TRUE(names(spoilt("/buffers/0/uri", "%2e%2e/x.bin"), "x.gltf: /buffers/0/uri: ... folder"));
  EXPECT_TRUE(names(spoilt("/buffers/0/uri", "/etc/passwd"), "x.gltf: /buffers/0/uri: ... folder"));
  EXPECT_TRUE(names(spoilt("/buffers/0/uri", "https://x.y/z"), R"(x.gltf: /buffers/0/uri: ... "https://x.y/z")"));
  EXPECT_TRUE(names(spoilt("/buffers/0/uri", ""), R"(x.gltf: /buffers/0/uri: ... "")"));

  const TempFolder folder;
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
}

TEST(Gltf, CirclesAndSharedNodesAreRefused) {
  File circle = one_triangle({{"children", {1}}});
  circle.node({{"children", {0}}});
  circle.json["scenes"] = {{{"nodes", {0}}}};
  circle.json["scene"] = 0;
  EXPECT_TRUE(names(gltf_refusal(circle), "x.gltf: /nodes/0: ... parent"));
  File shared = one_triangle();
  shared.node({{"children", {0}}});
  shared.node({{"children", {0}}});
  EXPECT_TRUE(names(gltf_refusal(shared), "x.gltf: /nodes/0: ... parent"));
}

TEST(Gltf, DepthIsBoundedInJsonAndFreeInNodes) {
  File file = one_triangle();
  for (int i = 1; i < 20000; ++i) file.node({{"children", {i - 1}}});
  EXPECT_EQ(parse(file).scene.mesh.triangles.size(), 1U);
  std::string deep = file.text();
  deep.pop_back();
  deep += ", \"extras\": " + std::string(100000, '[') + std::string(100000, ']') + "}";
  EXPECT_TRUE(names(gltf_refusal(deep), "x.gltf: ... 32"));
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
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: ... 33554432"));
  File many = one_triangle();
  many.mesh({{"attributes", {{"POSITION", 0}}}, {"mode", 1}});
  for (int i = 0; i < 65536; ++i) many.node({{"mesh", 1}});
  EXPECT_TRUE(names(gltf_refusal(many), "x.gltf: /nodes/65536: ... 65536"));
}

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
  EXPECT_TRUE(names(gltf_refusal(other), "x.gltf: ... 2 ... version 1"));
  other = glb;
  other[16] = 'j';
  EXPECT_TRUE(names(gltf_refusal(other), "x.gltf: ... first"));
  other = glb;
  other[15] = 0x7f;
  EXPECT_TRUE(names(gltf_refusal(other), "x.gltf: ... chunks"));
}

TEST(Gltf, TruncatedTextIsRefused) {
  const std::string text = Textured().text();
  for (std::size_t size = 0; size < text.size(); ++size) EXPECT_NE(gltf_refusal(text.substr(0, size)), "accepted") << size;
  EXPECT_EQ(gltf_refusal(text), "accepted");
}

// --------------------------------------------------------------------------------------------------------- in a World

TEST(Gltf, AWorldReportsIgnoredParts) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "a.gltf";
  File file = one_triangle();
  file.json["animations"] = {Json::object()};
  std::ofstream(path) << file.text();
  const auto world = World::load(path, {.scale = 2.0});
  EXPECT_EQ(world->bounds().max, Vec3(2, 0, 2));
  ASSERT_EQ(world->ignored().size(), 1U);
  EXPECT_EQ(world->ignored()[0], "1 animation");
}

TEST(LoadOptions, OtherFormatsArePlacedToo) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "a.json";
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
