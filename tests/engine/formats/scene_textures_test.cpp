// Textures in scene files.
#include <gtest/gtest.h>

#include <array>
#include <filesystem>
#include <fstream>
#include <string>
#include <vector>

#include "base/json_document.hpp"
#include "formats/image.hpp"
#include "formats/scene_json.hpp"
#include "refusal.hpp"

namespace flockstep {
namespace {

const std::vector<std::uint8_t> kPixels{255, 0, 0, 255, 0, 0, 255, 0};  // red, transparent blue

std::string png() { return encode_png(2, 1, kPixels); }

// Returns a scene with a triangle of the material "wood", which has the given texture.
std::string textured_scene(const std::string& texture, const std::string& mesh = R"(, "uv": [[0, 0], [1, 0], [0.1, 2]])") {
  return R"({"flockstep_scene": 1, "textures": {"planks": )" + texture +
         R"(}, "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}, "red": {"base_color": [1, 0, 0]}},
             "meshes": [{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]], "material": "wood")" +
         mesh + "}]}";
}

std::string base64(const std::string& more = "") { return R"({"png_base64": ")" + base64_of(png()) + '"' + more + '}'; }

std::string texture_refusal(const std::string& text) {
  return testing::refusal([&] { World::from_json(text); });
}

using Uv = std::vector<std::array<float, 2>>;

TEST(SceneTextures, AreReadWithTheirWrapAndTheMeshesUv) {
  const auto world = World::from_json(textured_scene(base64(R"(, "wrap": ["clamp", "mirror"])")));
  ASSERT_EQ(world->textures().size(), 1U);
  const Texture& texture = world->textures()[0];
  EXPECT_EQ(texture.name, "planks");
  EXPECT_EQ(texture.width_px, 2);
  EXPECT_EQ(texture.height_px, 1);
  EXPECT_EQ(texture.rgba, kPixels);
  EXPECT_EQ(texture.wrap, (std::array{TextureWrap::clamp, TextureWrap::mirror}));
  EXPECT_EQ(world->materials()[0].texture, 0);
  EXPECT_FALSE(world->materials()[1].texture);
  EXPECT_EQ(world->triangles().uv, (Uv{{0, 0}, {1, 0}, {0.1F, 2}}));
}

TEST(SceneTextures, MeshesWithoutUvHaveZeros) {
  const std::string corners = R"({"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]])";
  const auto world = World::from_json(R"({"flockstep_scene": 1, "textures": {"planks": )" + base64() +
                                      R"(}, "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}}, "meshes": [)" +
                                      corners + "}, " + corners + R"(, "uv": [[1, 2], [3, 4], [5, 6]]}, )" + corners + "}]}");
  EXPECT_EQ(world->triangles().uv, (Uv{{0, 0}, {0, 0}, {0, 0}, {1, 2}, {3, 4}, {5, 6}, {0, 0}, {0, 0}, {0, 0}}));
  EXPECT_EQ(World::from_json(world->to_json())->content_hash(), world->content_hash());
}

TEST(SceneTextures, ComeBackEqualAndInTheirOrder) {
  SceneDescription description;
  const std::array<TextureWrap, 3> wraps{TextureWrap::repeat, TextureWrap::mirror, TextureWrap::clamp};
  description.materials.clear();
  for (int i = 0; i < 12; ++i) {
    Texture texture{"texture " + std::to_string(11 - i), 3, 2, std::vector<std::uint8_t>(24, static_cast<std::uint8_t>(i))};
    texture.wrap = {wraps[static_cast<std::size_t>(i) % 3], wraps[static_cast<std::size_t>(i) / 3 % 3]};
    description.textures.push_back(texture);
    description.materials.push_back(Material{"material " + std::to_string(i)});
    if (i % 4 != 3) description.materials.back().texture = static_cast<std::uint16_t>(i);
  }
  description.mesh.vertices = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0), Vec3(0, 0, 1)};
  description.mesh.triangles = {{0, 1, 2}, {0, 3, 1}};
  description.mesh.objects = {0, 2};
  description.mesh.uv = {{0.1F, 1.0F / 3.0F}, {-1e-30F, 1e6F}, {0, -0.0F}, {0.3F, 1}};
  const World world(description);
  const auto again = World::from_json(world.to_json());
  EXPECT_EQ(again->content_hash(), world.content_hash());
  EXPECT_EQ(again->to_json(), world.to_json());
  ASSERT_EQ(again->textures().size(), 12U);
  EXPECT_EQ(again->textures()[3].name, "texture 8");
  EXPECT_EQ(again->triangles().uv, world.triangles().uv);
}

TEST(SceneTextures, FilesLieBesideTheScene) {
  const std::filesystem::path folder = std::filesystem::path(::testing::TempDir()) / "flockstep_textures";
  std::filesystem::create_directories(folder / "below");
  std::ofstream(folder / "planks.png", std::ios::binary) << png();
  std::ofstream(folder / "hall.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0 0\nvt 1 0\nvt 0 1\nf 1/1 2/2 3/3\n";
  const std::string text = R"({"flockstep_scene": 1, "textures": {"planks": {"file": "planks.png"}},
      "materials": {"wood": {"base_color": [1, 1, 1], "texture": "planks"}}, "meshes": [{"file": "hall.obj", "material": "wood"}]})";
  std::ofstream(folder / "a.json") << text;
  const auto world = World::load(folder / "a.json");
  EXPECT_EQ(world->textures()[0].rgba, kPixels);
  EXPECT_EQ(world->triangles().uv, (Uv{{0, 1}, {1, 1}, {0, 0}}));
  EXPECT_EQ(World::from_json(world->to_json())->content_hash(), world->content_hash());

  const auto refusal = [&](const std::string& file) {
    try {
      parse_scene(textured_scene(R"({"file": ")" + file + "\"}"), "x", folder / "below");
    } catch (const std::invalid_argument& error) {
      return std::string(error.what());
    }
    return std::string("accepted");
  };
  EXPECT_EQ(
      refusal("../planks.png"),
      "x: /textures/planks/file: expected a file in the scene's folder or below it (load with meshes_anywhere=True to allow "
      "others), got \"../planks.png\"");
  const std::string place = (folder / "below/none.png").string();
  EXPECT_EQ(refusal("none.png"), "x: /textures/planks/file: " + place + ": cannot read an image: No such file or directory");
  std::filesystem::remove_all(folder);
}

TEST(SceneTextures, BadOnesAreRefused) {
  EXPECT_EQ(texture_refusal(textured_scene("{}")), R"(scene: /textures/planks: expected either "file" or "png_base64")");
  EXPECT_EQ(texture_refusal(textured_scene(base64(R"(, "file": "x.png")"))),
            R"(scene: /textures/planks: expected either "file" or "png_base64")");
  EXPECT_EQ(texture_refusal(textured_scene(base64(R"(, "wrap": ["clamp"])"))),
            R"(scene: /textures/planks/wrap: expected an array of 2 names (across, down), got ["clamp"])");
  EXPECT_EQ(texture_refusal(textured_scene(base64(R"(, "wrap": ["clamp", "tile"])"))),
            R"(scene: /textures/planks/wrap/1: expected "repeat", "mirror" or "clamp", got "tile")");
  EXPECT_EQ(texture_refusal(textured_scene(base64(R"(, "size": 2)"))),
            "scene: /textures/planks/size: unknown field; expected one of file, png_base64, wrap");
  EXPECT_EQ(texture_refusal(textured_scene(R"({"png_base64": 7})")),
            "scene: /textures/planks/png_base64: expected a PNG file in base64, got 7");
  EXPECT_EQ(texture_refusal(textured_scene(R"({"png_base64": "a-b"})")),
            R"(scene: /textures/planks/png_base64: expected base64, got the character "-")");
  EXPECT_EQ(texture_refusal(textured_scene(R"({"png_base64": "abcd"})")),
            "scene: /textures/planks/png_base64: expected a PNG or JPEG file, got signature 0x69b71d");
  std::string other = textured_scene(base64());
  other.replace(other.find(R"("texture": "planks")"), 19, R"("texture": "stones")");
  EXPECT_EQ(texture_refusal(other), R"(scene: /materials/wood/texture: expected a name listed in /textures, got "stones")");
  EXPECT_EQ(texture_refusal(textured_scene(base64(), R"(, "uv": [[0, 0]])")),
            "scene: /meshes/0/uv: expected one per vertex (3), got 1");
  EXPECT_EQ(texture_refusal(textured_scene(base64(), R"(, "uv": [[0, 0], [0], [0, 0]])")),
            "scene: /meshes/0/uv/1: expected an array of 2 numbers (u, v), got [0]");
  EXPECT_EQ(texture_refusal(textured_scene(base64(), R"(, "uv": [[0, 0], [0, 1], [0, 1e7]])")),
            "scene: /meshes/0/uv/2/1: expected a number within +-1e+06, got 10000000.0");
  SceneDescription twice;
  twice.primitives.emplace_back();
  twice.textures.assign(2, Texture{"a", 1, 1, {0, 0, 0, 0}});
  EXPECT_THROW(World{twice}, std::invalid_argument);
}

}  // namespace
}  // namespace flockstep
