#include "formats/scene_json.hpp"

#include <random>

#include "standard.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using namespace testing;

std::string scene(const std::string& fields) { return R"({"flockstep_scene": 1, )" + fields + "}"; }

const std::string kRoom = R"("room": {"min": [0, 0, 0], "max": [4, 6, 2]})";

std::string scene_refusal(const std::string& text) {
  return refusal([&] { parse_scene(text, "x.json", {}); });
}

template <class T>
void expect_same_bits(const T& a, const T& b, const std::string& what) {
  EXPECT_EQ(std::memcmp(&a, &b, sizeof(T)), 0) << what;
}

// The hash is of every byte but the name, which content_hash_test.cpp shows.
void expect_same(const World& a, const World& b) {
  EXPECT_EQ(a.name(), b.name());
  EXPECT_EQ(a.content_hash(), b.content_hash());
}

TEST(SceneJson, ReadsEveryKindOfThing) {
  const SceneDescription read = parse_scene(scene(R"(
      "name": "all of it",
      "materials": {"red": {"base_color": [1, 0, 0.5]}},
      "room": {"min": [0, -1, 0], "max": [4, 5, 2], "material": "red"},
      "pillars": [{"center": [1, 2], "radius": 0.25}, {"center": [1, 3], "radius": 0.5, "z": [0.5, 1.5]}],
      "cylinders": [{"center": [2, 2, 1], "radius": 0.1, "height": 0.6, "quat_wxyz": [0, 1, 0, 0]}],
      "boxes": [{"center": [3, 3, 1], "size": [0.2, 0.4, 0.6], "material": "red"}],
      "spheres": [{"center": [1, 1, 1], "radius": 0.3}],
      "capsules": [{"center": [2, 1, 1], "radius": 0.1, "height": 0.6, "quat_wxyz": [0, 0, 1, 0]},
                   {"center": [2, 1, 1], "radius": 0.25, "height": 0.5, "material": "red"}],
      "planes": [{"center": [2, 3, 1], "size": [0.2, 0.4], "quat_wxyz": [0, 1, 0, 0], "material": "red"}],
      "discs": [{"center": [3, 2, 1], "radius": 0.2, "quat_wxyz": [0, 0, 0, 1]}],
      "meshes": [{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]],
                  "scale": 2, "quat_wxyz": [0.70710678, 0, 0, 0.70710678], "position": [1, 1, 1]}],
      "markers": {"radius": 0.2, "start": [1, 0, 1], "waypoints": [[2, 0, 1]], "goal": [3, 0, 1],
                  "spawn_box": {"min": [0.5, -0.5, 0.5], "max": [1.5, 0.5, 1.5]}})"),
                                            "x.json", {});
  EXPECT_EQ(read.name, "all of it");
  ASSERT_EQ(read.materials.size(), 2U);
  EXPECT_EQ(read.materials[0].name, "red");
  EXPECT_EQ(read.materials[0].base_color, (std::array<float, 3>{1.0F, 0.0F, 0.5F}));
  EXPECT_EQ(read.materials[1].name, "default");

  ASSERT_EQ(read.primitives.size(), 10U);
  const auto expect = [&](std::size_t i, PrimitiveKind kind, const Vec3& center, const Vec3& half, int material) {
    EXPECT_EQ(read.primitives[i].kind, kind) << i;
    EXPECT_TRUE(read.primitives[i].center.isApprox(center)) << i << ": " << read.primitives[i].center.transpose();
    EXPECT_TRUE(read.primitives[i].half_extents.isApprox(half)) << i << ": " << read.primitives[i].half_extents.transpose();
    EXPECT_EQ(read.primitives[i].material, material) << i;
  };
  expect(0, PrimitiveKind::room, {2, 2, 1}, {2, 3, 1}, 0);
  expect(1, PrimitiveKind::cylinder, {1, 2, 1}, {0.25F, 0.25F, 1}, 1);
  expect(2, PrimitiveKind::cylinder, {1, 3, 1}, {0.5F, 0.5F, 0.5F}, 1);
  expect(3, PrimitiveKind::cylinder, {2, 2, 1}, {0.1F, 0.1F, 0.3F}, 1);
  expect(4, PrimitiveKind::box, {3, 3, 1}, {0.1F, 0.2F, 0.3F}, 0);
  expect(5, PrimitiveKind::sphere, {1, 1, 1}, {0.3F, 0.3F, 0.3F}, 1);
  expect(6, PrimitiveKind::capsule, {2, 1, 1}, {0.1F, 0.1F, 0.3F}, 1);
  expect(7, PrimitiveKind::capsule, {2, 1, 1}, {0.25F, 0.25F, 0.25F}, 0);
  expect(8, PrimitiveKind::plane, {2, 3, 1}, {0.1F, 0.2F, 0}, 0);
  expect(9, PrimitiveKind::disc, {3, 2, 1}, {0.2F, 0.2F, 0}, 1);
  EXPECT_EQ(read.primitives[3].rotation.x(), 1.0F);
  EXPECT_EQ(read.primitives[6].rotation.y(), 1.0F);
  EXPECT_EQ(read.primitives[8].rotation.x(), 1.0F);
  EXPECT_EQ(read.primitives[9].rotation.z(), 1.0F);

  // A quarter turn about z takes (2, 0, 0) to (0, 2, 0).
  ASSERT_EQ(read.mesh.vertices.size(), 3U);
  EXPECT_TRUE(read.mesh.vertices[1].isApprox(Vec3(1, 3, 1), 1e-6F)) << read.mesh.vertices[1].transpose();
  EXPECT_TRUE(read.mesh.vertices[2].isApprox(Vec3(-1, 1, 1), 1e-6F)) << read.mesh.vertices[2].transpose();
  EXPECT_EQ(read.mesh.materials, std::vector<std::uint16_t>{1});

  EXPECT_EQ(read.markers.radius, 0.2F);
  EXPECT_EQ(read.markers.start, Vec3(1, 0, 1));
  EXPECT_EQ(read.markers.waypoints, std::vector<Vec3>{Vec3(2, 0, 1)});
  EXPECT_EQ(read.markers.goal, Vec3(3, 0, 1));
  ASSERT_TRUE(read.markers.spawn_box);
  EXPECT_EQ(read.markers.spawn_box->max, Vec3(1.5F, 0.5F, 1.5F));
}

TEST(SceneJson, ReadsMaterialsAndLight) {
  const SceneDescription read = parse_scene(scene(kRoom + R"(,
      "materials": {"first": {"base_color": [1, 0, 0], "semantic": 7}, "second": {"base_color": [0, 1, 0]},
                    "third": {"base_color": [0, 0, 1], "semantic": 65532}, "fourth": {"base_color": [0, 0, 1], "semantic": 1.0}},
      "light": {"sun_direction": [0, 3, -4], "sun_color": [0, 1, 100], "sky_ambient": [1, 2, 3], "ground_ambient": [4, 5, 6],
                "zenith_color": [7, 8, 9], "horizon_color": [0.5, 0.25, 0.125], "gamma": 1})"),
                                            "x.json", {});
  ASSERT_EQ(read.materials.size(), 5U);
  EXPECT_EQ(read.materials[0].semantic, 7);
  EXPECT_EQ(read.materials[1].semantic, 0);
  EXPECT_EQ(read.materials[2].semantic, 65532);
  EXPECT_EQ(read.materials[3].semantic, 1);
  using Color = std::array<float, 3>;
  EXPECT_EQ(read.light.sun_direction, (Color{0.0F, 0.6F, -0.8F}));
  EXPECT_EQ(read.light.sun_color, (Color{0, 1, 100}));
  EXPECT_EQ(read.light.sky_ambient, (Color{1, 2, 3}));
  EXPECT_EQ(read.light.ground_ambient, (Color{4, 5, 6}));
  EXPECT_EQ(read.light.zenith_color, (Color{7, 8, 9}));
  EXPECT_EQ(read.light.horizon_color, (Color{0.5F, 0.25F, 0.125F}));
  EXPECT_EQ(read.light.gamma, 1.0F);
}

TEST(SceneJson, MissingFieldsOfTheLightHaveDefaults) {
  const Light usual;
  expect_same_bits(parse_scene(scene(kRoom), "x.json", {}).light, usual, "no light");
  expect_same_bits(parse_scene(scene(kRoom + R"(, "light": {})"), "x.json", {}).light, usual, "an empty light");
  Light brighter;
  brighter.gamma = 3.5F;
  expect_same_bits(parse_scene(scene(kRoom + R"(, "light": {"gamma": 3.5})"), "x.json", {}).light, brighter, "one field");
}

// The length of the vector does not matter.
TEST(SceneJson, TheDirectionOfTheSunIsNormalised) {
  for (const char* direction : {"[0, 0, 5e-324]", "[0, 0, 1e-300]", "[0, 0, 1e-42]", "[0, 0, 1]", "[0, 0, 1e6]"}) {
    const Light light = parse_scene(scene(kRoom + R"(, "light": {"sun_direction": )" + direction + "}"), "x.json", {}).light;
    EXPECT_EQ(light.sun_direction, (std::array<float, 3>{0, 0, 1})) << direction;
  }
}

TEST(SceneJson, DefaultsAreNotWritten) {
  const auto world =
      World::from_json(scene(kRoom + R"(, "materials": {"a": {"base_color": [0, 0, 0]}}, "light": {"gamma": 2.2})"));
  EXPECT_EQ(world->to_json().find("light"), std::string::npos);
  EXPECT_EQ(world->to_json().find("semantic"), std::string::npos);

  const auto other = World::from_json(scene(
      kRoom +
      R"(, "materials": {"a": {"base_color": [0, 0, 0], "semantic": 9}}, "light": {"gamma": 1.8, "sun_color": [0, 1, 2]})"));
  EXPECT_NE(other->to_json().find(R"("a":{"base_color":[0.0,0.0,0.0],"semantic":9})"), std::string::npos) << other->to_json();
  EXPECT_NE(other->to_json().find(R"("light": {"sun_color":[0.0,1.0,2.0],"gamma":1.8})"), std::string::npos) << other->to_json();
}

TEST(SceneJson, EachMeshIsAnObjectAndStaysOne) {
  const auto world = World::from_json(scene(R"(
      "materials": {"a": {"base_color": [0, 0, 0]}, "b": {"base_color": [1, 1, 1]}},
      "meshes": [{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0], [1, 1, 0]], "triangles": [[0, 1, 2], [1, 3, 2]], "material": "b"},
                 {"vertices": [], "triangles": [], "material": "a"},
                 {"vertices": [[9, 9, 9], [0, 0, 1], [1, 0, 1], [0, 1, 1]], "triangles": [[3, 1, 2], [1, 2, 3]],
                  "material": ["a", "b"]}])"));
  EXPECT_EQ(world->triangles().objects, (std::vector<std::uint16_t>{0, 0, 2, 2}));
  const auto written = world->to_json();
  EXPECT_NE(written.find(R"("meshes": [
    {"vertices":[[0.0,0.0,0.0],[1.0,0.0,0.0],[0.0,1.0,0.0],[1.0,1.0,0.0]],"triangles":[[0,1,2],[1,3,2]],"material":"b"},
    {"vertices":[],"triangles":[],"material":[]},
    {"vertices":[[0.0,0.0,1.0],[1.0,0.0,1.0],[0.0,1.0,1.0]],"triangles":[[2,0,1],[0,1,2]],"material":["a","b"]}
  ])"),
            std::string::npos)
      << written;
  expect_same(*world, *World::from_json(written));
}

TEST(SceneJson, NothingButAVersionAndASolidIsNeeded) {
  const SceneDescription read = parse_scene(scene(R"("spheres": [{"center": [0, 0, 0], "radius": 1}])"), "x.json", {});
  EXPECT_EQ(read.name, "unnamed");
  EXPECT_FALSE(read.markers.start);
  EXPECT_FALSE(read.markers.goal);
}

TEST(SceneJson, QuaternionsNearUnitAreNormalised) {
  const auto rotation = [](const std::string& wxyz) {
    return parse_scene(scene(R"("boxes": [{"center": [0, 0, 0], "size": [1, 1, 1], "quat_wxyz": )" + wxyz + "}]"), "x.json", {})
        .primitives[0]
        .rotation;
  };
  EXPECT_EQ(rotation("[1.0009, 0, 0, 0]").w(), 1.0F);
  EXPECT_NEAR(rotation("[0.6, 0.8004, 0, 0]").norm(), 1.0F, 1e-7F);
}

TEST(SceneJson, BadScenesAreRefusedWithFieldExpectedAndGot) {
  const std::vector<std::array<std::string, 2>> texts{
      {"[]", "x.json: ... object ... []"},
      {"{" + kRoom + "}", R"(x.json: ... "flockstep_scene")"},
      {R"({"other_scene": 1, )" + kRoom + "}", R"(x.json: /other_scene: ... "flockstep_scene")"},
      {R"({"flockstep_scene": 2})", "x.json: /flockstep_scene: ... 1 ... 2"},
      {R"({"flockstep_scene": 2, "fog": {}})", "x.json: /flockstep_scene: ... 1 ... 2"},
      {R"({"flockstep_scene": 0})", "x.json: /flockstep_scene: ... 1 ... 0"},
      {R"({"flockstep_scene": "1"})", R"(x.json: /flockstep_scene: ... 1 ... "1")"},
      {R"({"flockstep_scene": 1})", "x.json: ... cylinders"},
  };
  for (const auto& [text, message] : texts) EXPECT_TRUE(names(scene_refusal(text), message)) << text;
  const std::vector<std::array<std::string, 2>> cases{
      {R"("boxes": [])", "... cylinders"},
      {R"("rooms": {})", "/rooms: unknown field ... room?"},
      {kRoom + R"(, "pillars": [{"center": [1, 1], "raduis": 1}])", "/pillars/0/raduis: unknown field ... radius?"},
      {kRoom + R"(, "markers": {"a/b~c": 1})", "/markers/a~1b~0c: unknown field"},
      {kRoom + ", " + kRoom, R"(... "room")"},
      {R"("name": 3)", "/name: ... 3"},
      {kRoom + R"(, "pillars": [{"center": [1, 1]}])", R"(/pillars/0: ... "radius")"},
      {kRoom + R"(, "pillars": [{"center": [1, 1], "radius": 1}, {"center": [1, 1], "radius": -1}])",
       "/pillars/1/radius: ... 0 ... -1"},
      {R"("spheres": [{"center": [1, 1, 1], "radius": 0}])", "/spheres/0/radius: ... 0 ... 0"},
      {R"("spheres": [{"center": [1, 1, 1], "radius": 1e-30}])", "/spheres/0/radius: ... [1e-06, 1000000] ... 1e-30"},
      {R"("spheres": [{"center": [1, 1, 1], "radius": "1"}])", R"(/spheres/0/radius: ... "1")"},
      {R"("spheres": [{"center": [1, true, 1], "radius": 1}])", "/spheres/0/center/1: ... number"},
      {R"("spheres": [{"center": [1, 1, 1e39], "radius": 1}])", "/spheres/0/center/2: ... +-1e+06 ... 1e+39"},
      {R"("spheres": [{"center": [1, 1], "radius": 1}])", "/spheres/0/center: ... 3 ... [1,1]"},
      {kRoom + R"(, "pillars": [{"center": [1, 1, 1], "radius": 1}])", "/pillars/0/center: ... 2 ... [1,1,1]"},
      {R"("boxes": {"center": [1, 1, 1], "size": [1, 1, 1]})", R"(/boxes: ... {"center":[1,1,1],"size":[1,1,1]})"},
      {R"("boxes": [3])", "/boxes/0: ... 3"},
      {R"("boxes": [{"center": [1, 1, 1], "size": [1, 0, 1]}])", "/boxes/0/size/1: ... 0 ... 0"},
      {R"("cylinders": [{"center": [1, 1, 1], "radius": 1, "height": -2}])", "/cylinders/0/height: ... 0 ... -2"},
      {R"("capsules": [{"center": [1, 1, 1], "radius": 1, "height": 1.9}])", "/capsules/0/height: ... >= ... 1.9"},
      {R"("capsules": [{"center": [1, 1, 1], "radius": 1}])", R"(/capsules/0: ... "height")"},
      {R"("capsules": [{"center": [1, 1, 1], "radius": 0, "height": 1}])", "/capsules/0/radius: ... 0 ... 0"},
      {R"("planes": [{"center": [1, 1, 1], "size": [1, 1, 1]}])", "/planes/0/size: ... 2 ... [1,1,1]"},
      {R"("planes": [{"center": [1, 1, 1], "size": 2}])", "/planes/0/size: ... 2 ... 2"},
      {R"("planes": [{"center": [1, 1, 1], "size": [1, 0]}])", "/planes/0/size/1: ... 0 ... 0"},
      {R"("planes": [{"center": [1, 1, 1], "size": [1, 1], "thickness": 0.1}])", "/planes/0/thickness: unknown field"},
      {R"("discs": [{"center": [1, 1, 1], "radius": 0}])", "/discs/0/radius: ... 0 ... 0"},
      {R"("discs": [{"center": [1, 1, 1], "radius": 1, "height": 1}])", "/discs/0/height: unknown field"},
      {R"("discs": [{"center": [1, 1, 1], "radius": 1, "quat_wxyz": [0, 0, 0, 0]}])", "/discs/0/quat_wxyz: ... 1 ... [0,0,0,0]"},
      {R"("room": {"min": [0, 0, 0], "max": [1, -1, 1]})", R"(/room: ... {"max":[1,-1,1],"min":[0,0,0]})"},
      {R"("pillars": [{"center": [1, 1], "radius": 1}])", R"(/pillars/0: ... "z")"},
      {R"("pillars": [{"center": [1, 1], "radius": 1, "z": [2, 1]}])", "/pillars/0/z: ... [2,1]"},
      {R"("boxes": [{"center": [1, 1, 1], "size": [1, 1, 1], "quat_wxyz": [0, 0, 0, 0]}])",
       "/boxes/0/quat_wxyz: ... 1 ... [0,0,0,0]"},
      {R"("boxes": [{"center": [1, 1, 1], "size": [1, 1, 1], "quat_wxyz": [1.01, 0, 0, 0]}])",
       "/boxes/0/quat_wxyz: ... 1 ... [1.01,0,0,0]"},
      {R"("boxes": [{"center": [1, 1, 1], "size": [1, 1, 1], "quat_wxyz": [1, 0, 0]}])", "/boxes/0/quat_wxyz: ... 4 ... [1,0,0]"},
      {R"("room": {"min": [0, 0, 0], "max": [1, 1, 1], "material": "red"})", R"(/room/material: ... "red")"},
      {R"("room": {"min": [0, 0, 0], "max": [1, 1, 1], "material": 0})", "/room/material: ... 0"},
      {R"("materials": {"a/b": {"base_color": [0, 2, 0]}})", "/materials/a~1b/base_color/1: ... [0, 1] ... 2"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "class": 1}})", "/materials/a/class: unknown field"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "alpha_cutoff": 1.5}})", "/materials/a/alpha_cutoff: ... [0, 1] ... 1.5"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "alpha_cutoff": "MASK"}})", R"(/materials/a/alpha_cutoff: ... "MASK")"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "semantic": 0}})", "/materials/a/semantic: ... [1, 65532] ... 0"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "semantic": -1}})", "/materials/a/semantic: ... [1, 65532] ... -1"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "semantic": 65533}})", "/materials/a/semantic: ... [1, 65532] ... 65533"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "semantic": 1.5}})", "/materials/a/semantic: ... [1, 65532] ... 1.5"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "semantic": "wall"}})",
       R"(/materials/a/semantic: ... [1, 65532] ... "wall")"},
      {R"("materials": {"a": {"base_color": [0, 0, 0], "semantic": true}})", "/materials/a/semantic: ... [1, 65532]"},
      {R"("materials": [])", "/materials: ... object ... []"},
      {R"("meshes": [{"vertices": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,3]]}])",
       "/meshes/0/triangles/0/2: ... [0, 3) ... 3"},
      {R"("meshes": [{"vertices": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,-1]]}])",
       "/meshes/0/triangles/0/2: ... [0, 3) ... -1"},
      {R"("meshes": [{"vertices": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,1.5]]}])",
       "/meshes/0/triangles/0/2: ... [0, 3) ... 1.5"},
      {R"("meshes": [{"vertices": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2,0]]}])",
       "/meshes/0/triangles/0: ... 3 ... [0,1,2,0]"},
      {R"("meshes": [{"vertices": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2],[0,1,1]]}])",
       "/meshes/0/triangles/1: ... triangle"},
      {R"("meshes": [{"vertices": [[0,0,0],[0.1,0.1,0.1],[0.3,0.3,0.3]], "triangles": [[0,1,2]]}])",
       "/meshes/0/triangles/0: ... triangle"},
      {R"("meshes": [{"scale": 1}])", R"(/meshes/0: ... "file" ... "vertices" ... "triangles")"},
      {R"("meshes": [{"vertices": []}])", R"(/meshes/0: ... "triangles")"},
      {R"("meshes": [{"uv": []}])", R"(/meshes/0: ... "vertices")"},
      {R"("meshes": [{"file": "a.obj", "vertices": []}])", R"(/meshes/0: ... "file" ... "vertices" ... "triangles")"},
      {R"("meshes": [{"file": "no-such.obj"}])",
       "/meshes/0/file: no-such.obj: cannot read an OBJ file: No such file or directory"},
      {R"("meshes": [{"vertices": [[0,0,0],[1e6,0,0],[0,1,0]], "triangles": [[0,1,2]], "scale": 2}])", "/meshes/0: ... +-1e+06"},
      {R"("materials": {"a": {"base_color": [0,0,0]}},
                "meshes": [{"vertices": [[0,0,0],[1,0,0],[0,1,0]], "triangles": [[0,1,2]], "material": ["a", "a"]}])",
       "/meshes/0/material: ... (1) ... 2"},
      {kRoom + R"(, "light": [1, 1, 1])", "/light: ... [1,1,1]"},
      {kRoom + R"(, "light": {"sun": [1, 1, 1]})", "/light/sun: unknown field"},
      {kRoom + R"(, "light": {"sun_direction": [0, -0.0, 0.0]})", "/light/sun_direction: ... 0 ... [0,-0.0,0.0]"},
      {kRoom + R"(, "light": {"sun_direction": [0, 1]})", "/light/sun_direction: ... 3 ... [0,1]"},
      {kRoom + R"(, "light": {"sun_direction": [0, 0, 2e6]})", "/light/sun_direction/2: ... +-1e+06 ... 2000000.0"},
      {kRoom + R"(, "light": {"sun_color": [1, -0.1, 1]})", "/light/sun_color/1: ... [0, 100] ... -0.1"},
      {kRoom + R"(, "light": {"sky_ambient": [1, 1, 100.1]})", "/light/sky_ambient/2: ... [0, 100] ... 100.1"},
      {kRoom + R"(, "light": {"ground_ambient": [1, 1, "1"]})", R"(/light/ground_ambient/2: ... "1")"},
      {kRoom + R"(, "light": {"zenith_color": 1})", "/light/zenith_color: ... 3 ... 1"},
      {kRoom + R"(, "light": {"horizon_color": [1, 1, 1, 1]})", "/light/horizon_color: ... 3 ... [1,1,1,1]"},
      {kRoom + R"(, "light": {"gamma": 0.99})", "/light/gamma: ... [1, 4] ... 0.99"},
      {kRoom + R"(, "light": {"gamma": 4.01})", "/light/gamma: ... [1, 4] ... 4.01"},
      {kRoom + R"(, "light": {"gamma": null})", "/light/gamma: ... number"},
      {kRoom + R"(, "markers": {"start": [1, 2, null]})", "/markers/start/2: ... number"},
      {kRoom + R"(, "markers": {"waypoints": 3})", "/markers/waypoints: ... 3"},
      {kRoom + R"(, "markers": {"spawn_box": {"min": [1, 1, 1], "max": [2, 2, 0]}})",
       R"(/markers/spawn_box: ... <= ... {"max":[2,2,0],"min":[1,1,1]})"},
  };
  for (const auto& [fields, message] : cases) EXPECT_TRUE(names(scene_refusal(scene(fields)), "x.json: " + message)) << fields;
  const std::string message = scene_refusal(scene(R"("name": [)" + std::string(200, '1') + "]"));
  EXPECT_TRUE(names(message, "x.json: /name: ... ["));
  EXPECT_LT(message.size(), 150U) << message;
}

TEST(SceneJson, MoreMeshesThanNumbersAreRefused) {
  std::string meshes = "0";
  for (int i = 1; i < 65536; ++i) meshes += ",0";
  EXPECT_TRUE(names(scene_refusal(scene(R"("meshes": [)" + meshes + ",0]")), "x.json: /meshes: ... 65536 ... 65537"));
  EXPECT_TRUE(names(scene_refusal(scene(R"("meshes": [)" + meshes + "]")), "x.json: /meshes/0: ... 0"));
}

TEST(SceneJson, InvalidJsonIsRefusedWithThePlace) {
  const auto expect_starts = [](const std::string& text, const std::string& start) {
    EXPECT_EQ(scene_refusal(text).rfind(start, 0), 0U) << scene_refusal(text);
  };
  expect_starts("", "x.json: not valid JSON: parse error at line 1, column 1");
  expect_starts("{\"flockstep_scene\": 1,\n \"room\": {\"min\": [0, 0",
                "x.json: not valid JSON: parse error at line 2, column 23");
  expect_starts("{\"flockstep_scene\": NaN}", "x.json: not valid JSON: parse error at line 1, column 21");
  expect_starts("{\"flockstep_scene\": Infinity}", "x.json: not valid JSON: parse error at line 1, column 21");
  expect_starts("{\"flockstep_scene\": 1e999}", "x.json: not valid JSON: number overflow");
}

// Every prefix of a scene file is an error, never a crash or a world.
TEST(SceneJson, TruncatedAnywhereIsRefused) {
  const std::string whole = scene(kRoom + R"(, "pillars": [{"center": [1.5, 1], "radius": 0.25}])");
  for (std::size_t length = 0; length < whole.size(); ++length) {
    EXPECT_TRUE(names(scene_refusal(whole.substr(0, length)), "x.json: not valid JSON: parse error at line 1"));
  }
  EXPECT_EQ(scene_refusal(whole), "accepted");
}

TEST(SceneJson, NestingIsBounded) {
  for (const std::size_t depth : {33U, 100000U}) {
    const std::string open(depth, '[');
    EXPECT_TRUE(names(scene_refusal(open), "x.json: ... 32"));
    EXPECT_TRUE(names(scene_refusal(scene(R"("name": )" + open + std::string(depth, ']'))), "x.json: ... 32"));
  }
  EXPECT_TRUE(names(scene_refusal(scene(R"("name": )" + std::string(31, '[') + std::string(31, ']'))),
                    "x.json: /name: ... " + std::string(31, '[') + std::string(29, ']') + "..."));
}

TEST(SceneJson, MessagesAreShortForLongInput) {
  const std::string euros = [] {
    std::string text;
    for (int i = 0; i < 100000; ++i) text += "\u20ac";
    return text;
  }();
  EXPECT_EQ(scene_refusal(scene(R"("room": ")" + euros + '"')),
            "x.json: /room: expected an object, got \"" + euros.substr(0, 57) + "...");
  std::string list = "[1";
  for (int i = 0; i < 100000; ++i) list += ",{\"a\":[]}";
  EXPECT_LT(scene_refusal(scene(R"("room": )" + list + ']')).size(), 200U);
  EXPECT_LT(scene_refusal(scene('"' + euros + R"(": 1)")).size(), 500U);
  EXPECT_LT(scene_refusal('"' + euros).size(), 500U);
}

TEST(SceneJson, ManyThingsAndManyNames) {
  constexpr int kCount = 65000;  // takes a second; with linear searches it takes half a minute
  std::string materials;
  std::string spheres;
  std::string unknown;
  for (int i = 0; i < kCount; ++i) {
    const std::string name = "\"material " + std::to_string(kCount - i) + '"';
    materials += (i == 0 ? "" : ",") + name + R"(:{"base_color":[0,0,1]})";
    spheres += (i == 0 ? "" : ",") + (R"({"center":[0,0,0],"radius":1,"material":)" + name) + '}';
    unknown += (i == 0 ? "\"" : ",\"") + std::to_string(i) + "\":0";
  }
  const std::string text = scene(R"("materials":{)" + materials + R"(},"spheres":[)" + spheres + ']');
  const World world(parse_scene(text, "x.json", {}));
  ASSERT_EQ(world.materials().size(), std::size_t{kCount});
  EXPECT_EQ(world.materials().front().name, "material 65000");
  EXPECT_EQ(world.primitives().back().material, kCount - 1);
  expect_same(world, *World::from_json(world.to_json()));
  EXPECT_TRUE(names(scene_refusal(scene(unknown)), "unknown field; expected one of"));
}

TEST(SceneJson, TheLargestAndTheSmallestComeBack) {
  const char* const scenes[] = {
      R"("pillars": [{"center": [0, 0], "radius": 1, "z": [-1e6, 1e6]}])",
      R"("boxes": [{"center": [1e6, 1e6, 1e6], "size": [2e6, 2e6, 2e-6]}])",
      R"("planes": [{"center": [1e6, 1e6, 1e6], "size": [2e6, 2e-6]}])",
      R"("capsules": [{"center": [-1e6, 0, 0], "radius": 1e6, "height": 2e6}])",
      R"("cylinders": [{"center": [-1e6, 0, 0], "radius": 1e-6, "height": 2e-6}])",
      R"("spheres": [{"center": [-1e6, 0, 0], "radius": 1e6}])",
      R"("room": {"min": [-999999.97, -1e6, -1e6], "max": [1e6, 999999.9375, 1e6]})",
  };
  for (const char* const fields : scenes) {
    const auto world = World::from_json(scene(fields));
    const auto again = World::from_json(world->to_json());
    expect_same(*world, *again);
    EXPECT_EQ(world->to_json(), again->to_json());
  }
}

TEST(SceneJson, RoundTripKeepsEveryBit) {
  std::mt19937 random(1);
  const auto draw = [&random](float low, float high) { return std::uniform_real_distribution<float>(low, high)(random); };
  for (int round = 0; round < 50; ++round) {
    SceneDescription description;
    description.name = "round \"" + std::to_string(round) + "\" / \\ \n ü";
    description.materials = {
        {"a", {draw(0, 1), draw(0, 1), draw(0, 1)}}, {"b/~", {0.1F, 0.2F, 0.3F}, 65532}, {"unused", {1, 1, 1}, 1}};
    const float magnitude = std::pow(10.0F, draw(-3, 5));
    const auto point = [&] {
      return Vec3(draw(-magnitude, magnitude), draw(-magnitude, magnitude), draw(-magnitude, magnitude));
    };
    const auto size = [&] { return draw(1e-5F, 1.0F) * std::pow(10.0F, draw(-1, 3)); };
    using enum PrimitiveKind;
    for (const PrimitiveKind kind : {sphere, box, cylinder, disc, capsule, room, plane, box, capsule, cylinder, disc, plane}) {
      Primitive primitive{.kind = kind, .center = point(), .half_extents = Vec3(size(), size(), size())};
      Vec3& half = primitive.half_extents;
      if (kind != room && kind != sphere) primitive.rotation = Quat::UnitRandom();
      if (kind != room && kind != box && kind != plane) half.y() = half.x();
      if (kind == sphere) half.z() = half.x();
      if (kind == capsule) half.z() = round % 2 == 0 ? half.x() : half.x() + half.z();
      if (kind == plane || kind == disc) half.z() = 0.0F;
      primitive.material = static_cast<std::uint16_t>(random() % 2);
      description.primitives.push_back(primitive);
    }
    for (std::int32_t i = 0; i < 9; ++i) description.mesh.vertices.push_back(point());
    description.mesh.triangles = {{0, 1, 2}, {3, 4, 5}, {0, 4, 7}};  // vertices 6 and 8 are unused
    description.mesh.materials = {0, static_cast<std::uint16_t>(round % 2), 0};
    if (round % 5 != 0) {
      for (int i = 0; i < 3; ++i) description.mesh.objects.push_back(static_cast<std::uint16_t>(random() % 4));
    }
    if (round % 4 != 0) {
      const float length = std::pow(10.0F, draw(-30, 5));
      Light& light = description.light;
      light.sun_direction = {draw(-length, length), draw(-length, length), draw(-length, length)};
      for (auto* color :
           {&light.sun_color, &light.sky_ambient, &light.ground_ambient, &light.zenith_color, &light.horizon_color}) {
        *color = {draw(0, 100), draw(0, 1), draw(0, 1)};
      }
      light.gamma = draw(1, 4);
    }
    if (round % 3 != 0) {
      description.markers =
          Markers{size(), point(), {point(), point()}, point(), Aabb{Vec3::Constant(-1.1F), Vec3::Constant(0.7F)}};
    }
    const World world(description);
    const auto again = World::from_json(world.to_json());
    expect_same(world, *again);
    EXPECT_TRUE(world.to_json() == again->to_json());
  }
}

TEST(SceneJson, ShippedScenesRoundTrip) {
  int count = 0;
  for (const auto& entry : std::filesystem::directory_iterator(std::filesystem::path(FLOCKSTEP_SCENES) / "playground")) {
    const auto world = World::load(entry.path());
    expect_same(*world, *World::from_json(world->to_json()));
    EXPECT_EQ(world->name(), "playground/" + entry.path().stem().string());
    ++count;
  }
  EXPECT_EQ(count, 11);
}

TEST(SceneJson, SolidsAreVisibleOrSolidOrBoth) {
  const auto read = [](const std::string& flags) {
    const std::string ball = R"("center": [0, 0, 0], "radius": 1)";
    return parse_scene(scene(R"("spheres": [{)" + ball + flags + R"(}], "boxes": [{"center": [0, 0, 0], "size": [1, 1, 1]}],
      "meshes": [{"vertices": [[0, 0, 0], [1, 0, 0], [0, 1, 0]], "triangles": [[0, 1, 2]])" +
                             flags + "}]"),
                       "x.json", {});
  };
  const auto expect = [&](const std::string& flags, Visibility visibility) {
    const SceneDescription description = read(flags);
    EXPECT_EQ(description.primitives[0].visibility, Visibility::full) << flags;
    EXPECT_EQ(description.primitives[1].visibility, visibility) << flags;
    EXPECT_EQ(description.mesh.visibility, std::vector<Visibility>{visibility}) << flags;
    const World world(description);
    EXPECT_EQ(World::from_json(world.to_json())->content_hash(), world.content_hash()) << flags;
  };
  expect("", Visibility::full);
  expect(R"(, "visible": true, "solid": true)", Visibility::full);
  expect(R"(, "visible": false)", Visibility::solid);
  expect(R"(, "solid": false)", Visibility::visual);
  EXPECT_TRUE(names(scene_refusal(scene(R"("spheres": [{"center": [0, 0, 0], "radius": 1, "solid": 0}])")),
                    "x.json: /spheres/0/solid: ... 0"));
  EXPECT_TRUE(names(scene_refusal(scene(R"("spheres": [{"center": [0, 0, 0], "radius": 1, "solid": false, "visible": false}])")),
                    R"(x.json: /spheres/0: ... "visible" ... "solid")"));
}

TEST(SceneJson, MeshFilesAreFoundBesideTheScene) {
  const TempFolder folder;
  std::ofstream(folder / "a.obj") << "v 0 0 0\nv 1 0 0\nv 0 1 0\nf 1 2 3\n";
  std::ofstream(folder / "flat.obj") << "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n";
  std::ofstream(folder / "a.json") << scene(R"("meshes": [{"file": "a.obj", "position": [0, 0, 5]}])");
  EXPECT_EQ(World::load(folder / "a.json")->bounds().max, Vec3(1, 1, 5));

  std::ofstream(folder / "b.json") << scene(R"("meshes": [{"file": "flat.obj"}])");
  EXPECT_REFUSED(World::load(folder / "b.json"), (folder / "b.json").string() + ": /meshes/0/file: ... triangle ... (triangle 0");
}

}  // namespace
}  // namespace flockstep
