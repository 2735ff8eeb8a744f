#include "swiftlet/world.hpp"

#include <gtest/gtest.h>

#include <filesystem>
#include <fstream>
#include <functional>
#include <limits>
#include <string>
#include <thread>
#include <vector>

#include "trace/scene.hpp"

namespace swiftlet {
namespace {

constexpr float kNan = std::numeric_limits<float>::quiet_NaN();

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
    Eigen::AlignedBox3f box;  // of the surface, from a fine mesh of it
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
}

TEST(World, BadDescriptionsAreRefusedWithTheFieldWhatWasExpectedAndWhatCame) {
  struct Case {
    std::function<void(SceneDescription&)> spoil;
    std::string message;
  };
  const std::vector<Case> cases{
      {[](auto& d) { d.materials.clear(); }, "materials: expected 1 to 65535 of them, got 0"},
      {[](auto& d) { d.materials.push_back({"default"}); }, "materials[1].name: expected a name of its own, got \"default\""},
      {[](auto& d) { d.materials[0].base_color[1] = kNan; }, "materials[0].base_color: expected numbers in [0, 1], got nan"},
      {[](auto& d) { d.primitives[0].center.x() = kNan; },
       "primitives[0].center: expected coordinates within +-1e+06 m, got (nan, 0, 0)"},
      {[](auto& d) { d.primitives[0].center.x() = 1e30F; },
       "primitives[0].center: expected coordinates within +-1e+06 m, got (1e+30, 0, 0)"},
      {[](auto& d) { d.primitives[0].half_extents.y() = -1; },
       "primitives[0].half_extents: expected sizes >= 1e-06 m, got (0.5, -1, 0.5)"},
      {[](auto& d) { d.primitives[0].rotation.coeffs().setZero(); },
       "primitives[0].rotation: expected a unit quaternion, got norm 0.000000"},
      {[](auto& d) { d.primitives[0].rotation.w() = kNan; }, "primitives[0].rotation: expected a unit quaternion, got norm nan"},
      {[](auto& d) { d.primitives[0].material = 1; }, "primitives[0].material: expected an index below 1, got 1"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::cylinder;
         d.primitives[0].half_extents.x() = 1;
       },
       "primitives[0].half_extents: expected (radius, radius, half height), got (1, 0.5, 0.5)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::sphere;
         d.primitives[0].half_extents.z() = 1;
       },
       "primitives[0].half_extents: expected (radius, radius, radius), got (0.5, 0.5, 1)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::capsule;
         d.primitives[0].half_extents.z() = 0.4F;
       },
       "primitives[0].half_extents: expected (radius, radius, half height >= radius), got (0.5, 0.5, 0.4)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::capsule;
         d.primitives[0].half_extents = Vec3(0.5F, 0.4F, 1);
       },
       "primitives[0].half_extents: expected (radius, radius, half height >= radius), got (0.5, 0.4, 1)"},
      {[](auto& d) { d.primitives[0].kind = PrimitiveKind::plane; },
       "primitives[0].half_extents: expected thickness 0, got (0.5, 0.5, 0.5)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::plane;
         d.primitives[0].half_extents = Vec3(0.5F, 0, 0);
       },
       "primitives[0].half_extents: expected sizes >= 1e-06 m, got (0.5, 0, 0)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::disc;
         d.primitives[0].half_extents.z() = kNan;
       },
       "primitives[0].half_extents: expected coordinates within +-1e+06 m, got (0.5, 0.5, nan)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::disc;
         d.primitives[0].half_extents.z() = 1e-6F;
       },
       "primitives[0].half_extents: expected thickness 0, got (0.5, 0.5, 1e-06)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::disc;
         d.primitives[0].half_extents = Vec3(0.5F, 0.4F, 0);
       },
       "primitives[0].half_extents: expected (radius, radius, half height), got (0.5, 0.4, 0)"},
      {[](auto& d) {
         d.primitives[0].kind = PrimitiveKind::room;
         d.primitives[0].rotation = Quat(0, 1, 0, 0);
       },
       "primitives[0].rotation: expected the identity for a room, got (1, 0, 0)"},
      {[](auto& d) { d.primitives.assign(2, Primitive{.kind = PrimitiveKind::room}); },
       "primitives: expected at most one room, got several"},
      {[](auto& d) { d.mesh.vertices[2].z() = kNan; },
       "mesh.vertices[2]: expected coordinates within +-1e+06 m, got (0, 1, nan)"},
      {[](auto& d) { d.mesh.triangles[0][2] = 3; }, "mesh.triangles[0]: expected vertex indices in [0, 3), got 3"},
      {[](auto& d) { d.mesh.triangles[0][0] = -1; }, "mesh.triangles[0]: expected vertex indices in [0, 3), got -1"},
      {[](auto& d) { d.mesh.vertices[2] = Vec3(2, 0, 0); },
       "mesh.triangles[0]: expected a triangle with an area, got (0, 0, 0) (1, 0, 0) (2, 0, 0)"},
      {[](auto& d) { d.mesh.materials = {0, 0}; }, "mesh.materials: expected one per triangle (1), got 2"},
      {[](auto& d) { d.mesh.materials = {7}; }, "mesh.materials[0]: expected an index below 1, got 7"},
      {[](auto& d) {
         d.primitives.clear();
         d.mesh = {};
       },
       "scene: expected at least one primitive or triangle, got an empty scene"},
      {[](auto& d) { d.markers.radius = 0; }, "markers.radius: expected a number > 0, got 0.000000"},
      {[](auto& d) { d.markers.goal = Vec3(0, kNan, 0); },
       "markers.goal: expected coordinates within +-1e+06 m, got (0, nan, 0)"},
      {[](auto& d) { d.markers.waypoints = {Vec3::Zero(), Vec3(0, 0, kNan)}; },
       "markers.waypoints[1]: expected coordinates within +-1e+06 m, got (0, 0, nan)"},
      {[](auto& d) { d.markers.spawn_box = Aabb{Vec3::Ones(), Vec3::Zero()}; },
       "markers.spawn_box: expected min <= max, got (1, 1, 1) and (0, 0, 0)"},
  };
  EXPECT_NO_THROW(World{valid()});
  for (const Case& bad : cases) {
    SceneDescription description = valid();
    bad.spoil(description);
    try {
      const World world(description);
      ADD_FAILURE() << "accepted: " << bad.message;
    } catch (const std::invalid_argument& error) {
      EXPECT_EQ(error.what(), bad.message);
    }
  }
}

std::string load_message(const std::filesystem::path& path) {
  try {
    World::load(path);
  } catch (const std::invalid_argument& error) {
    return error.what();
  }
  return "accepted";
}

TEST(World, LoadNamesTheFileThatIsWrong) {
  EXPECT_EQ(load_message("no-such.json"), "no-such.json: cannot read a scene file: No such file or directory");
  EXPECT_EQ(load_message("no-such.obj"), "no-such.obj: cannot read an OBJ file: No such file or directory");
  EXPECT_EQ(load_message("scene.stl"), "scene.stl: expected a file ending in .json or .obj, got \".stl\"");
  EXPECT_EQ(load_message(testing::TempDir()).rfind(testing::TempDir(), 0), 0U);
  const std::filesystem::path folder = std::filesystem::path(testing::TempDir()) / "swiftlet_folder.json";
  std::filesystem::create_directories(folder);
  EXPECT_EQ(load_message(folder).rfind(folder.string() + ": cannot read a scene file", 0), 0U) << load_message(folder);
  std::filesystem::remove(folder);
}

TEST(World, SavesAndLoads) {
  const std::filesystem::path path = std::filesystem::path(testing::TempDir()) / "swiftlet_world_test.json";
  const World world(valid());
  world.save(path);
  EXPECT_EQ(World::load(path)->to_json(), world.to_json());
  std::filesystem::remove(path);
  EXPECT_THROW(world.save("/no-such-folder/a.json"), std::invalid_argument);
}

TEST(World, LoadsABareMesh) {
  const std::filesystem::path path = std::filesystem::path(testing::TempDir()) / "swiftlet_world_test.obj";
  std::ofstream(path) << "v 0 0 0\nv 1 0 0\nv 0 2 0\nf 1 2 3\n";
  const auto world = World::load(path);
  EXPECT_EQ(world->name(), "swiftlet_world_test");
  EXPECT_EQ(world->bounds().max, Vec3(1, 2, 0));

  std::ofstream(path) << "v 0 0 0\nv 1 0 0\nv 2 0 0\nf 1 2 3\n";
  EXPECT_EQ(load_message(path),
            path.string() + ": mesh.triangles[0]: expected a triangle with an area, got (0, 0, 0) (1, 0, 0) (2, 0, 0)");
  std::filesystem::remove(path);
}

TEST(World, TheSceneIsBuiltOnce) {
  const World world(valid());
  std::vector<const trace::Scene*> seen(8, nullptr);
  std::vector<std::thread> threads;
  for (const trace::Scene*& slot : seen) threads.emplace_back([&world, &slot] { slot = &world.scene(); });
  for (std::thread& thread : threads) thread.join();
  for (const trace::Scene* scene : seen) EXPECT_EQ(scene, seen[0]);
}

}  // namespace
}  // namespace swiftlet
