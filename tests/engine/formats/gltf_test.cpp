#include "formats/gltf.hpp"

#include "formats/gltf_file.hpp"

namespace flockstep {
namespace {

using namespace gltf;

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
      file.object({{"attributes", {{"POSITION", positions}}}, {"indices", indices}, {"mode", mode}});
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
  file.object({{"attributes", {{"POSITION", positions}}}, {"indices", indices}});
  const GltfFile read = parse(file);
  EXPECT_EQ(read.scene.mesh.triangles.size(), 1U);
  EXPECT_EQ(read.ignored, std::vector<std::string>{"2 triangles without an area"});
}

TEST(Gltf, VerticesMayBeInterleavedAndQuantized) {
  File file;
  const std::size_t positions = file.accessor(bytes_of<float>({0, 0, 0, 9, 1, 0, 0, 9, 0, 1, 0}), kFloat, "VEC3", 3, 16);
  file.object({{"attributes", {{"POSITION", positions}}}});
  expect_near(corners(parse(file).scene.mesh, 0)[2], Vec3(0, 0, 1));

  File quantized;
  quantized.json["extensionsRequired"] = {"KHR_mesh_quantization"};
  const std::size_t whole =
      quantized.accessor(bytes_of<std::int16_t>({0, 0, 0, 0, 32767, 0, 0, 0, 0, -32768, 0, 0}), 5122, "VEC3", 3, 8);
  quantized.json["accessors"][whole]["normalized"] = true;
  quantized.object({{"attributes", {{"POSITION", whole}}}});
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
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: /nodes/8: ... start"));
  File wrong = one_triangle();
  wrong.node({{"extras", {{"marker", "finish"}}}});
  EXPECT_TRUE(names(gltf_refusal(wrong),
                    R"(x.gltf: /nodes/1/extras/marker: ... "start" ... "goal" ... "waypoint" ... "waypoint." ... "finish")"));
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
  EXPECT_TRUE(names(gltf_refusal(file),
                    "x.gltf: /materials/0/extensions/KHR_materials_emissive_strength/emissiveStrength: ... >= 0 ... -1"));
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
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: /materials/1/alphaCutoff: ... >= 0 ... -0.5"));
  file.json["materials"][1]["alphaCutoff"] = "half";
  EXPECT_TRUE(names(gltf_refusal(file), R"(x.gltf: /materials/1/alphaCutoff: ... >= 0 ... "half")"));
  file.json["materials"][1]["alphaMode"] = 1;
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: /materials/1/alphaMode: ... 1"));
}

TEST(Gltf, ColoursOfVertices) {
  File file;
  const std::size_t positions = file.corner();
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
  EXPECT_TRUE(names(gltf_refusal(file), "x.gltf: /accessors/1: ... (3) ... 2"));
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

  EXPECT_TRUE(names(gltf_refusal(one_triangle({{"extras", {{"visual_only", "yes"}}}})),
                    R"(x.gltf: /nodes/0/extras/visual_only: ... "yes")"));
  EXPECT_TRUE(names(gltf_refusal(one_triangle({{"extras", {{"visual_only", true}, {"collision_only", true}}}})),
                    "x.gltf: /nodes/0/extras: ... collision_only"));
}

}  // namespace
}  // namespace flockstep
