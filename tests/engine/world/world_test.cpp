#include "flockstep/world.hpp"

#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;

SceneDescription valid() {
  SceneDescription description;
  description.primitives = {Primitive{}};
  description.mesh = {{Vec3::Zero(), Vec3::UnitX(), Vec3::UnitY()}, {{0, 1, 2}}, {0}};
  return description;
}

TEST(World, PrimitivesAreOrderedByKindAndOtherwiseAsGiven) {
  SceneDescription description;
  for (const PrimitiveKind kind : {PrimitiveKind::sphere, PrimitiveKind::box, PrimitiveKind::room, PrimitiveKind::box}) {
    description.primitives.push_back(
        Primitive{.kind = kind, .center = Vec3::Constant(static_cast<float>(description.primitives.size()))});
  }
  const World world(description);
  std::vector<float> order;
  for (const Primitive& primitive : world.primitives()) order.push_back(primitive.center.x());
  EXPECT_EQ(order, (std::vector<float>{2, 1, 3, 0}));
}

TEST(World, BoundsHoldEverythingTightly) {
  const Quat turn(Eigen::AngleAxisf(0.9F, Vec3(1, -2, 0.5F).normalized()));
  using enum PrimitiveKind;
  for (const PrimitiveKind kind : {box, cylinder, capsule, plane, disc}) {
    SceneDescription description;
    const float thickness = kind == plane || kind == disc ? 0.0F : 1.2F;
    description.primitives = {
        Primitive{.kind = kind, .center = {1, 2, 3}, .rotation = turn, .half_extents = {0.3F, 0.3F, thickness}}};
    const World world(description);
    Eigen::AlignedBox3f box;  // bounds of the surface, from a fine mesh
    for (const Vec3& vertex : world.mesh(1e-5F).vertices) box.extend(vertex);
    EXPECT_TRUE(world.bounds().min.isApprox(box.min(), 1e-4F)) << world.bounds().min.transpose();
    EXPECT_TRUE(world.bounds().max.isApprox(box.max(), 1e-4F)) << world.bounds().max.transpose();
  }
}

TEST(World, BoundsLeaveOutVerticesThatNothingUses) {
  SceneDescription description;
  description.mesh = {{Vec3::Zero(), Vec3::UnitX(), Vec3::UnitY(), Vec3::Constant(9)}, {{0, 1, 2}}, {}};
  const World world(description);
  EXPECT_EQ(world.bounds().max, Vec3(1, 1, 0));
  EXPECT_EQ(world.triangles().materials, std::vector<std::uint16_t>{0});
  EXPECT_EQ(world.triangles().objects, std::vector<std::uint16_t>{0});
  EXPECT_EQ(world.triangles().vertices.size(), 3U);
}

using Triangles = std::vector<std::array<std::int32_t, 3>>;

TEST(World, TrianglesAreOrderedByObjectEachWithVerticesOfItsOwn) {
  SceneDescription description;
  description.materials = {{"a"}, {"b"}, {"c"}, {"d"}};
  const auto at = [](float x) { return Vec3(x, x * x, 0); };  // no three are collinear
  for (int i = 0; i < 6; ++i) description.mesh.vertices.push_back(at(static_cast<float>(i)));
  description.mesh.triangles = {{5, 3, 1}, {0, 1, 2}, {1, 4, 5}, {2, 1, 3}};
  description.mesh.materials = {0, 1, 2, 3};
  description.mesh.objects = {7, 2, 7, 2};
  const World world(description);
  const TriangleMesh& mesh = world.triangles();
  EXPECT_EQ(mesh.objects, (std::vector<std::uint16_t>{2, 2, 7, 7}));
  EXPECT_EQ(mesh.materials, (std::vector<std::uint16_t>{1, 3, 0, 2}));
  EXPECT_EQ(mesh.triangles, (Triangles{{0, 1, 2}, {2, 1, 3}, {7, 5, 4}, {4, 6, 7}}));
  EXPECT_EQ(mesh.vertices, (std::vector<Vec3>{at(0), at(1), at(2), at(3), at(1), at(3), at(4), at(5)}));

  // A mesh that is already in order is unchanged.
  SceneDescription again;
  again.materials = description.materials;
  again.mesh = mesh;
  const World same(again);
  EXPECT_EQ(same.triangles().objects, mesh.objects);
  EXPECT_EQ(same.triangles().materials, mesh.materials);
  EXPECT_EQ(same.triangles().triangles, mesh.triangles);
  EXPECT_EQ(same.triangles().vertices, mesh.vertices);
}

TEST(World, TheDirectionOfTheSunIsMadeUnit) {
  const auto sun = [](const std::array<float, 3>& direction) {
    SceneDescription description = valid();
    description.light.sun_direction = direction;
    return World(description).light().sun_direction;
  };
  EXPECT_EQ(sun({0, -4, 3}), (std::array<float, 3>{0, -0.8F, 0.6F}));
  EXPECT_EQ(sun({1e-40F, 0, 0}), (std::array<float, 3>{1, 0, 0}));
  EXPECT_EQ(sun(Light().sun_direction), Light().sun_direction);
  const std::array<float, 3> unit = sun({0.3F, -0.7F, 0.1F});
  EXPECT_EQ(sun(unit), unit);
}

TEST(World, AsManyMaterialsAsHaveASemanticIdBelowThoseOfMarkers) {
  SceneDescription description = valid();
  while (description.materials.size() < 65532) description.materials.push_back({std::to_string(description.materials.size())});
  description.materials.back().semantic = 65532;
  EXPECT_EQ(World(description).materials().size(), 65532U);
}

// Instance ids are 16 bits wide, but only cameras that output them are limited by that.
TEST(World, ObjectsMayBeMoreThanThereAreInstanceIds) {
  SceneDescription description = valid();
  description.mesh.objects = {65535};
  description.markers.start = Vec3::Zero();
  const World world(description);
  EXPECT_EQ(world.triangles().objects, std::vector<std::uint16_t>{65535});
}

TEST(World, BadDescriptionsAreRefusedWithFieldExpectedAndGot) {
  using enum PrimitiveKind;
  const auto solid = [](PrimitiveKind kind, const Vec3& half) { return Primitive{.kind = kind, .half_extents = half}; };
  struct Case {
    std::function<void(SceneDescription&)> spoil;
    std::string message;
  };
  const std::vector<Case> cases{
      {[](auto& d) { d.materials.clear(); }, "materials: ... 1 ... 65532 ... 0"},
      {[](auto& d) {
         while (d.materials.size() < 65533) d.materials.push_back({std::to_string(d.materials.size())});
       },
       "materials: ... 1 ... 65532 ... 65533"},
      {[](auto& d) { d.materials[0].semantic = kSemanticStart; }, "materials[0].semantic: ... 65533 ... 65533"},
      {[](auto& d) { d.materials.push_back({"default"}); }, R"(materials[1].name: ... "default")"},
      {[](auto& d) { d.materials[0].base_color[1] = kNan; }, "materials[0].base_color: ... [0, 1] ... nan"},
      {[](auto& d) { d.primitives[0].center.x() = kNan; }, "primitives[0].center: ... +-1e+06 ... (nan, 0, 0)"},
      {[](auto& d) { d.primitives[0].center.x() = 1e30F; }, "primitives[0].center: ... +-1e+06 ... (1e+30, 0, 0)"},
      {[](auto& d) { d.primitives[0].half_extents.y() = -1; }, "primitives[0].half_extents: ... >= 1e-06 ... (0.5, -1, 0.5)"},
      {[](auto& d) { d.primitives[0].rotation.coeffs().setZero(); }, "primitives[0].rotation: ... norm 0.000000"},
      {[](auto& d) { d.primitives[0].rotation.w() = kNan; }, "primitives[0].rotation: ... nan"},
      {[](auto& d) { d.primitives[0].material = 1; }, "primitives[0].material: ... 1 ... 1"},
      {[&](auto& d) { d.primitives[0] = solid(cylinder, {1, 0.5F, 0.5F}); }, "primitives[0].half_extents: ... (1, 0.5, 0.5)"},
      {[&](auto& d) { d.primitives[0] = solid(sphere, {0.5F, 0.5F, 1}); }, "primitives[0].half_extents: ... (0.5, 0.5, 1)"},
      {[&](auto& d) { d.primitives[0] = solid(capsule, {0.5F, 0.5F, 0.4F}); },
       "primitives[0].half_extents: ... >= ... (0.5, 0.5, 0.4)"},
      {[&](auto& d) { d.primitives[0] = solid(capsule, {0.5F, 0.4F, 1}); },
       "primitives[0].half_extents: ... >= ... (0.5, 0.4, 1)"},
      {[](auto& d) { d.primitives[0].kind = PrimitiveKind::plane; }, "primitives[0].half_extents: ... 0 ... (0.5, 0.5, 0.5)"},
      {[&](auto& d) { d.primitives[0] = solid(plane, {0.5F, 0, 0}); },
       "primitives[0].half_extents: ... >= 1e-06 ... (0.5, 0, 0)"},
      {[&](auto& d) { d.primitives[0] = solid(disc, {0.5F, 0.5F, kNan}); },
       "primitives[0].half_extents: ... +-1e+06 ... (0.5, 0.5, nan)"},
      {[&](auto& d) { d.primitives[0] = solid(disc, {0.5F, 0.5F, 1e-6F}); },
       "primitives[0].half_extents: ... 0 ... (0.5, 0.5, 1e-06)"},
      {[&](auto& d) { d.primitives[0] = solid(disc, {0.5F, 0.4F, 0}); }, "primitives[0].half_extents: ... (0.5, 0.4, 0)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::room;
         d.primitives[0].rotation = Quat(0, 1, 0, 0);
       },
       "primitives[0].rotation: ... (1, 0, 0)"},
      {[](auto& d) { d.primitives.assign(2, Primitive{.kind = PrimitiveKind::room}); }, "primitives: ... room"},
      {[](auto& d) { d.mesh.vertices[2].z() = kNan; }, "mesh.vertices[2]: ... +-1e+06 ... (0, 1, nan)"},
      {[](auto& d) { d.mesh.triangles[0][2] = 3; }, "mesh.triangles[0]: ... [0, 3) ... 3"},
      {[](auto& d) { d.mesh.triangles[0][0] = -1; }, "mesh.triangles[0]: ... [0, 3) ... -1"},
      {[](auto& d) { d.mesh.vertices[2] = Vec3(2, 0, 0); }, "mesh.triangles[0]: ... (0, 0, 0) (1, 0, 0) (2, 0, 0)"},
      {[](auto& d) { d.mesh.materials = {0, 0}; }, "mesh.materials: ... (1) ... 2"},
      {[](auto& d) { d.mesh.objects = {0, 0}; }, "mesh.objects: ... (1) ... 2"},
      {[](auto& d) {
         d.mesh = {};
         d.mesh.objects = {3};
       },
       "mesh.objects: ... (0) ... 1"},
      {[](auto& d) { d.mesh.materials = {7}; }, "mesh.materials[0]: ... 1 ... 7"},
      {[](auto& d) {
         d.primitives.clear();
         d.mesh = {};
       },
       "scene: ... primitive"},
      {[](auto& d) { d.markers.radius = 0; }, "markers.radius: ... 0 ... 0.000000"},
      {[](auto& d) { d.markers.goal = Vec3(0, kNan, 0); }, "markers.goal: ... +-1e+06 ... (0, nan, 0)"},
      {[](auto& d) { d.markers.waypoints = {Vec3::Zero(), Vec3(0, 0, kNan)}; },
       "markers.waypoints[1]: ... +-1e+06 ... (0, 0, nan)"},
      {[](auto& d) { d.markers.spawn_box = Aabb{Vec3::Ones(), Vec3::Zero()}; },
       "markers.spawn_box: ... <= ... (1, 1, 1) and (0, 0, 0)"},
      {[](auto& d) { d.light.sun_direction = {0, 0, 0}; }, "light.sun_direction: ... 0 ... (0, 0, 0)"},
      {[](auto& d) { d.light.sun_direction = {0, kNan, 1}; }, "light.sun_direction[1]: ... +-1e+06 ... nan"},
      {[](auto& d) { d.light.sun_direction = {0, 0, 2e6F}; }, "light.sun_direction[2]: ... +-1e+06 ... 2e+06"},
      {[](auto& d) { d.light.sun_color[0] = -1; }, "light.sun_color[0]: ... [0, 100] ... -1"},
      {[](auto& d) { d.light.sky_ambient[1] = kNan; }, "light.sky_ambient[1]: ... [0, 100] ... nan"},
      {[](auto& d) { d.light.ground_ambient[2] = 101; }, "light.ground_ambient[2]: ... [0, 100] ... 101"},
      {[](auto& d) { d.light.zenith_color[0] = 1e30F; }, "light.zenith_color[0]: ... [0, 100] ... 1e+30"},
      {[](auto& d) { d.light.horizon_color[0] = -0.5F; }, "light.horizon_color[0]: ... [0, 100] ... -0.5"},
      {[](auto& d) { d.light.gamma = 0.5F; }, "light.gamma: ... [1, 4] ... 0.5"},
      {[](auto& d) { d.light.gamma = 5; }, "light.gamma: ... [1, 4] ... 5"},
      {[](auto& d) { d.light.gamma = kNan; }, "light.gamma: ... [1, 4] ... nan"},
  };
  EXPECT_NO_THROW(World{valid()});
  for (const Case& bad : cases) {
    SceneDescription description = valid();
    bad.spoil(description);
    EXPECT_REFUSED(const World world(description), bad.message);
  }
}

TEST(World, LoadNamesTheInvalidFile) {
  EXPECT_REFUSED(World::load("no-such.json"), "no-such.json: cannot read a scene file: No such file or directory");
  EXPECT_REFUSED(World::load("no-such.obj"), "no-such.obj: cannot read an OBJ file: No such file or directory");
  EXPECT_REFUSED(World::load("scene.stl"), R"(scene.stl: ... ".stl")");
  EXPECT_REFUSED(World::load(::testing::TempDir()), ::testing::TempDir());
  const TempFolder folder;
  std::filesystem::create_directory(folder / "a.json");
  EXPECT_REFUSED(World::load(folder / "a.json"), (folder / "a.json").string() + ": cannot read a scene file");
}

TEST(World, SavesAndLoads) {
  const TempFolder folder;
  const World world(valid());
  world.save(folder / "a.json");
  EXPECT_EQ(World::load(folder / "a.json")->to_json(), world.to_json());
  EXPECT_THROW(world.save("/no-such-folder/a.json"), std::invalid_argument);
}

TEST(World, AFileIsReplacedAsAWholeOrNotAtAll) {
  const TempFolder folder;
  std::filesystem::create_directories(folder / "sub");
  const World world(valid());
  world.save(folder / "sub" / "a.json");
  std::filesystem::create_symlink(folder / "sub" / "a.json", folder / "link.json");
  world.save(folder / "link.json");
  EXPECT_TRUE(std::filesystem::is_symlink(folder / "link.json"));
  EXPECT_THROW(world.save(folder / "sub"), std::invalid_argument);
  EXPECT_THROW(world.save("/dev/full"), std::invalid_argument);
  EXPECT_FALSE(std::filesystem::is_regular_file("/dev/full"));
  std::size_t count = 0;
  for (const auto& entry : std::filesystem::recursive_directory_iterator(folder)) count += entry.exists() ? 1 : 0;
  EXPECT_EQ(count, 3U);  // no temporary files remain
}

TEST(World, LoadsABareMesh) {
  const TempFolder folder;
  const std::filesystem::path path = folder / "flockstep_world_test.obj";
  std::ofstream(path) << "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n";
  const auto world = World::load(path);
  EXPECT_EQ(world->name(), "flockstep_world_test");
  EXPECT_EQ(world->bounds().max, Vec3(1, 2, 0));

  std::ofstream(path) << "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n";
  EXPECT_REFUSED(World::load(path), path.string() + ": ... triangle");
}

}  // namespace
}  // namespace flockstep
