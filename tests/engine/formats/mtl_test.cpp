#include "flockstep/world.hpp"
#include "formats/image.hpp"
#include "formats/mesh_files.hpp"
#include "standard.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using namespace testing;
using Color = std::array<float, 3>;

class Mtl : public ::testing::Test {
 protected:
  Mtl() { std::filesystem::create_directories(folder_ / "below"); }

  std::filesystem::path write(const std::string& name, const std::string& text) const {
    std::ofstream(folder_ / name, std::ios::binary) << text;
    return folder_ / name;
  }

  // Writes an image of 2 x 1 pixels. The red value of the first pixel identifies the image.
  void write_image(const std::string& name, std::uint8_t red) const {
    write(name, encode_png(2, 1, std::vector<std::uint8_t>{red, 0, 0, 255, 0, 0, 0, 255}));
  }

  // Loads a world from an OBJ file with one triangle per material, and a.mtl.
  std::shared_ptr<const World> load(const std::string& mtl, const std::vector<std::string>& materials,
                                    const LoadOptions& options = {}) const {
    write("a.mtl", mtl);
    std::string obj = "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.25 1\nvt 1 0\nvt 0 0.5\n";
    for (const std::string& name : materials) obj += "usemtl " + name + "\nf 1/1 2/2 3/3\n";
    return World::load(write("a.obj", obj), options);
  }

  std::string message_of(const std::string& mtl) const {
    const std::string what = refusal([&] { load(mtl, {"a"}); }), path = (folder_ / "a.mtl").string();
    EXPECT_TRUE(what == "accepted" || what.starts_with(path)) << what;
    return what.starts_with(path) ? what.substr(path.size()) : what;
  }

  const TempFolder folder_;
};

std::vector<std::string> ignored_of(const World& world) { return {world.ignored().begin(), world.ignored().end()}; }

using Ignored = std::vector<std::string>;

TEST_F(Mtl, MaterialsThatFacesHaveAreRead) {
  const auto world = load(
      "# a comment\r\nKd 1 1 1\r\nnewmtl unused\r\nKd 0 1 0\r\nnewmtl red stone \r\n  Kd 0.5 0.25 0\r\nKs 1 1 1\r\nNs 250\r\n"
      "d 1.0\r\nillum 2\r\nnewmtl lamp\r\nKd 1\r\nKe 3 2 1\r\nTr 0\r\nnewmtl plain\r\nnewmtl lamp\r\nKd 0 0 0\r\n",
      {"plain", "lamp", "red stone", "lamp"});
  EXPECT_TRUE(world->ignored().empty());
  ASSERT_EQ(world->materials().size(), 3U);
  EXPECT_EQ(world->materials()[0].name, "plain");
  EXPECT_EQ(world->materials()[0].base_color, Material().base_color);
  EXPECT_EQ(world->materials()[1].name, "lamp");
  EXPECT_EQ(world->materials()[1].base_color, (Color{1, 1, 1}));
  EXPECT_EQ(world->materials()[1].emissive, (Color{3, 2, 1}));
  EXPECT_EQ(world->materials()[2].name, "red stone");
  EXPECT_EQ(world->materials()[2].base_color, (Color{0.5F, 0.25F, 0}));
  EXPECT_EQ(world->materials()[2].emissive, (Color{0, 0, 0}));
  EXPECT_EQ(world->triangles().materials, (std::vector<std::uint16_t>{0, 1, 2, 1}));
  EXPECT_TRUE(world->triangles().uv.empty());
}

TEST_F(Mtl, TexturesAreReadOnceAndTurnedRound) {
  write_image("below/brick.png", 200);
  write_image("a tile.png", 100);
  const auto world = load(
      "newmtl a\nmap_Kd below\\brick.png\nnewmtl b\nKd 0.5 0.5 0.5\nmap_Kd -clamp on below/brick.png\n"
      "newmtl c\nmap_Kd -blendu on ./below/../below/brick.png \nnewmtl d\nKd 0 0 1\nmap_Kd a tile.png\n",
      {"a", "b", "c", "d"});
  EXPECT_TRUE(world->ignored().empty());
  ASSERT_EQ(world->textures().size(), 3U);
  EXPECT_EQ(world->textures()[0].name, "brick.png");
  EXPECT_EQ(world->textures()[1].name, "brick.png 2");
  EXPECT_EQ(world->textures()[1].wrap[0], TextureWrap::clamp);
  EXPECT_EQ(world->textures()[2].name, "a tile.png");
  EXPECT_EQ(world->textures()[2].rgba[0], 100);
  EXPECT_EQ(world->materials()[0].texture, 0);
  EXPECT_EQ(world->materials()[0].base_color, (Color{1, 1, 1}));
  EXPECT_EQ(world->materials()[1].texture, 1);
  EXPECT_EQ(world->materials()[1].base_color, (Color{0.5F, 0.5F, 0.5F}));
  EXPECT_EQ(world->materials()[2].texture, 0);
  EXPECT_EQ(world->materials()[3].texture, 2);
  EXPECT_EQ(world->triangles().uv, (std::vector<std::array<float, 2>>{{0.25F, 0}, {1, 1}, {0, 0.5F}}));
}

TEST_F(Mtl, EmissionIsMultipliedByTheTextureOfTheColorOrByNone) {
  write_image("a.png", 1);
  write_image("b.png", 2);
  const auto world = load(
      "newmtl same\nKe 1 1 1\nmap_Kd a.png\nmap_Ke a.png\nnewmtl other\nKe 1 1 1\nmap_Kd a.png\nmap_Ke b.png\n"
      "newmtl none\nKe 1 1 1\nmap_Kd a.png\nnewmtl dark\nKe 0 0 0\nmap_Kd a.png\n",
      {"same", "other", "none", "dark"});
  EXPECT_EQ(world->materials()[0].emissive, (Color{1, 1, 1}));
  EXPECT_EQ(world->materials()[1].emissive, (Color{0, 0, 0}));
  EXPECT_EQ(world->materials()[2].emissive, (Color{0, 0, 0}));
  EXPECT_EQ(ignored_of(*world), Ignored{"2 materials' emission by other textures than their colours'"});
}

TEST_F(Mtl, OptionsOfTexturesComeBeforeTheNameAndMayBeShort) {
  write_image("a.png", 1);
  write_image("b -s.png", 2);
  const auto world = load(
      "newmtl a\nmap_Kd -cc on -mm 0 1 -texres 9 -o 0 0 -s 1 -t 1 2 3 -type sphere -clamp off a.png\n"
      "newmtl b\nmap_Kd -clamp on -o 1 a.png\nmap_Kd -imfchan l -bm 2 -boost 1 b -s.png\nnewmtl c\nmap_Kd -o 0 0.5 a.png\n"
      "newmtl d\nKd 0.5\nKd spectral x.rfl\nKd \t0.25 \nTr 1\nd 1\nTr 1\n",
      {"a", "b", "c", "d"});
  EXPECT_EQ(ignored_of(*world), (Ignored{"1 texture's scale or offset", "1 material's colour by a spectrum"}));
  ASSERT_EQ(world->textures().size(), 2U);
  for (const Texture& texture : world->textures()) EXPECT_EQ(texture.wrap[0], TextureWrap::repeat);
  EXPECT_EQ(world->materials()[0].texture, 0);
  EXPECT_EQ(world->materials()[1].texture, 1);
  EXPECT_EQ(world->materials()[2].texture, 0);
  EXPECT_EQ(world->materials()[3].base_color, (Color{0.25F, 0.25F, 0.25F}));
}

TEST_F(Mtl, IgnoredPartsAreNamed) {
  write_image("a.png", 1);
  const auto world = load(
      "newmtl a\nd 0.5\nbump a.png\nnewmtl b\nTr 0.25\nnewmtl c\nmap_d a.png\nnorm a.png\nnewmtl d\nmap_Kd -s 2 2 2 a.png\n"
      "newmtl e\nKd spectral x.rfl 1\nnewmtl f\nmap_Kd gone.png\nKd 1 0 0\nnewmtl g\nmap_Kd ../gone.png\n",
      {"a", "b", "c", "d", "e", "f", "g", "h"});
  EXPECT_EQ(world->materials()[5].base_color, (Color{1, 0, 0}));
  EXPECT_EQ(world->materials()[7].name, "h");
  EXPECT_EQ(world->materials()[7].base_color, Material().base_color);
  EXPECT_EQ(ignored_of(*world),
            (Ignored{"1 missing file (gone.png)", "1 file outside of the folder (../gone.png)",
                     "1 material that no material file defines", "3 materials' transparency", "2 materials' bump maps",
                     "1 texture's scale or offset", "1 material's colour by a spectrum"}));
}

TEST_F(Mtl, AMissingMaterialFileGivesGreyMaterials) {
  const auto world = World::load(write("a.obj", "mtllib gone.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl wood\nf 1 2 3\n"));
  ASSERT_EQ(world->materials().size(), 1U);
  EXPECT_EQ(world->materials()[0].name, "wood");
  EXPECT_EQ(world->materials()[0].base_color, Material().base_color);
  EXPECT_EQ(ignored_of(*world), (Ignored{"1 missing file (gone.mtl)", "1 material that no material file defines"}));
}

TEST_F(Mtl, NamesOfFilesMayHaveSpacesAndBeSeveral) {
  write("my own.mtl", "newmtl a\nKd 1 0 0\n");
  write("own.mtl", "newmtl a\nKd 0 1 0\nnewmtl b\nKd 0 1 0\n");
  const std::string rest = "\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\nusemtl b\nf 3 2 1\n";
  auto world = World::load(write("a.obj", "mtllib my own.mtl" + rest));
  EXPECT_EQ(world->materials()[0].base_color, (Color{1, 0, 0}));
  EXPECT_EQ(ignored_of(*world), Ignored{"1 material that no material file defines"});
  world = World::load(write("a.obj", "mtllib own.mtl gone.mtl\nmtllib my own.mtl" + rest));
  EXPECT_EQ(world->materials()[0].base_color, (Color{0, 1, 0}));  // from the first file that has it
  EXPECT_EQ(ignored_of(*world), Ignored{"1 missing file (gone.mtl)"});
}

TEST_F(Mtl, FilesOutsideAreReadIfAllowed) {
  write("a.mtl", "newmtl a\nKd 1 0 0\n");
  const auto path = write("below/a.obj", "mtllib ../a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nusemtl a\nf 1 2 3\n");
  EXPECT_EQ(World::load(path)->materials()[0].base_color, Material().base_color);
  EXPECT_EQ(World::load(path, {.files = MeshFiles::anywhere})->materials()[0].base_color, (Color{1, 0, 0}));
}

TEST_F(Mtl, BadFilesAreRefusedWithTheLine) {
  const std::string begin = "newmtl a\n";
  EXPECT_TRUE(names(message_of(begin + "Kd 1 x 0\n"), R"(:2: ... [0, 1] ... "Kd 1 x 0")"));
  EXPECT_TRUE(names(message_of(begin + "Kd 1 0\n"), R"(:2: ... [0, 1] ... "Kd 1 0")"));
  EXPECT_TRUE(names(message_of(begin + "Kd\n"), R"(:2: ... [0, 1] ... "Kd")"));
  EXPECT_TRUE(names(message_of(begin + "Kd 1 0 1.5\n"), R"(:2: ... [0, 1] ... "Kd 1 0 1.5")"));
  EXPECT_TRUE(names(message_of(begin + "Ke 1 -1 1\n"), R"(:2: ... [0, 100] ... "Ke 1 -1 1")"));
  EXPECT_TRUE(names(message_of(begin + "\nd nan\n"), R"(:3: ... "d nan")"));
  EXPECT_TRUE(names(message_of(begin + "Tr\n"), R"(:2: ... "Tr")"));
  EXPECT_EQ(message_of(begin + "d -halo 0.5\nKd +1 0 0\nmap_Kd\nmap_d -s\nKe 1e2 0 0\nunknown \xFF\n"), "accepted");
  std::string many;
  for (int i = 0; i < 65533; ++i) many += begin;
  EXPECT_TRUE(names(message_of(many), ":65533: ... 65532"));
  write("bad.png", "no image");
  EXPECT_REFUSED(load("newmtl a\nmap_Kd bad.png\n", {"a"}), "bad.png: ... JPEG");
}

TEST_F(Mtl, PlacesAndDropsTrianglesAsGltfDoes) {
  const std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\nv 2 0 0\nf 1 2 4\nf 1 2 3\n";
  const auto world = World::load(write("a.obj", obj), {.scale = 2.0, .origin = Vec3(1, 2, 3), .up = UpAxis::y});
  EXPECT_EQ(ignored_of(*world), Ignored{"1 triangle without an area"});
  EXPECT_EQ(world->triangles().triangles.size(), 1U);
  EXPECT_EQ(world->triangles().vertices, (std::vector<Vec3>{{1, 2, 3}, {3, 2, 3}, {1, 2, 5}}));
  EXPECT_EQ(world->materials()[0].name, "default");
  EXPECT_EQ(world->name(), "a");
}

TEST_F(Mtl, ColorsOfVerticesShowOnWhite) {
  const auto world = World::load(write("a.obj", "v 0 0 0 1 0 0\nv 1 0 0 0 1 0\nv 0 1 0 0 0 1\nf 1 2 3\n"));
  EXPECT_EQ(world->materials()[0].base_color, (Color{1, 1, 1}));
  EXPECT_EQ(world->triangles().colors, (std::vector<Color>{{1, 0, 0}, {0, 1, 0}, {0, 0, 1}}));
}

class MtlInScene : public Mtl {
 protected:
  std::shared_ptr<const World> scene(const std::string& text) const {
    return World::load(write("scene.json", R"({"flockstep_scene": 1, )" + text + "}"));
  }
  static constexpr const char* kObj =
      "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nvt 0.5 1\ng a\nusemtl wood\nf 1/1 2/1 3/1\ng b\nusemtl stone\nf 3 2 1\n";
};

TEST_F(MtlInScene, AMeshHasTheMaterialsOfItsFile) {
  write("below/a.mtl", "newmtl wood\nKd 1 0 0\nnewmtl stone\nmap_Kd ../stone.png\n");
  write_image("stone.png", 7);
  write("below/a.obj", kObj);
  const auto world = scene(R"("meshes": [{"file": "below/a.obj"}, {"file": "below/a.obj", "position": [0, 0, 1]}])");
  EXPECT_TRUE(world->ignored().empty());
  ASSERT_EQ(world->materials().size(), 2U);
  EXPECT_EQ(world->materials()[0].base_color, (Color{1, 0, 0}));
  EXPECT_EQ(world->textures().size(), 1U);
  EXPECT_EQ(world->triangles().materials, (std::vector<std::uint16_t>{0, 1, 0, 1}));
  EXPECT_EQ(world->triangles().objects, (std::vector<std::uint16_t>{0, 0, 1, 1}));
  EXPECT_EQ(world->triangles().uv[0], (std::array{0.5F, 0.0F}));
}

TEST_F(MtlInScene, MaterialsOfTheSceneComeFirst) {
  write("a.mtl", "newmtl wood\nKd 1 0 0\nnewmtl stone\nKd 0 1 0\n");
  write("a.obj", kObj);
  write("below/a.mtl", "newmtl wood\nKd 0 0 1\nnewmtl stone\nKd 0 0 1\n");
  write("below/a.obj", kObj);
  const std::string materials = R"("materials": {"wood": {"base_color": [0, 0, 0], "semantic": 9}}, )";
  auto world =
      scene(materials + R"("meshes": [{"file": "a.obj"}, {"file": "below/a.obj"}, {"file": "a.obj", "material": "wood"}])");
  ASSERT_EQ(world->materials().size(), 3U);
  EXPECT_EQ(world->materials()[0].semantic, 9);
  EXPECT_EQ(world->materials()[0].base_color, (Color{0, 0, 0}));
  EXPECT_EQ(world->materials()[1].name, "stone");
  EXPECT_EQ(world->materials()[2].name, "stone 2");
  EXPECT_EQ(world->materials()[2].base_color, (Color{0, 0, 1}));
  EXPECT_EQ(world->triangles().materials, (std::vector<std::uint16_t>{0, 1, 0, 2, 0, 0}));
}

TEST_F(MtlInScene, TheDefaultMaterialStaysTheScenes) {
  write("a.mtl", "newmtl default\nKd 1 0 0\n");
  write("a.obj", "mtllib a.mtl\nv 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\nusemtl default\nf 3 2 1\n");
  const auto world =
      scene(R"("meshes": [{"file": "a.obj"}, {"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]]}])");
  ASSERT_EQ(world->materials().size(), 2U);
  EXPECT_EQ(world->materials()[0].name, "default");
  EXPECT_EQ(world->materials()[0].base_color, Material().base_color);
  EXPECT_EQ(world->materials()[1].name, "default 2");
  EXPECT_EQ(world->triangles().materials, (std::vector<std::uint16_t>{0, 1, 0}));
}

TEST_F(MtlInScene, IgnoredPartsAreNamed) {
  write("a.obj", std::string(kObj) + "l 1 2\n");
  EXPECT_EQ(ignored_of(*scene(R"("meshes": [{"file": "a.obj"}])")),
            (Ignored{"1 missing file (a.mtl)", "2 materials that no material file defines", "1 line or point of a.obj"}));
  write("a.mtl", "newmtl wood\nKd 2 0 0\n");
  EXPECT_THROW(scene(R"("meshes": [{"file": "a.obj"}])"), std::invalid_argument);
  EXPECT_EQ(
      ignored_of(*scene(R"("materials": {"a": {"base_color": [1, 1, 1]}}, "meshes": [{"file": "a.obj", "material": "a"}])")),
      Ignored{"1 line or point of a.obj"});
}

}  // namespace
}  // namespace flockstep
