// Elements that are only visual or only solid. Rays see only the visual ones, drones hit only the solid ones.

#include <random>

#include "collision/obstacles.hpp"
#include "flockstep/raycast.hpp"
#include "flockstep/survey.hpp"
#include "flockstep/world.hpp"
#include "flockstep/world_builder.hpp"
#include "formats/gltf.hpp"
#include "prepared/prepared_world.hpp"
#include "standard.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using namespace testing;

// A world, and the part of it with only visual or only solid elements. kept: element numbers of the part in the whole world.
struct Parts {
  SceneDescription all, part;
  std::vector<std::int32_t> kept;
};

Parts parts(std::uint32_t seed, std::size_t num_primitives, bool (*is_kept)(Visibility)) {
  std::mt19937 random(seed);
  const auto uniform = [&](float low, float high) { return std::uniform_real_distribution<float>(low, high)(random); };
  const auto point = [&] { return Vec3(uniform(-9, 9), uniform(-9, 9), uniform(-9, 9)); };
  Parts made;
  made.all.primitives.push_back({.kind = PrimitiveKind::room, .half_extents = {10, 10, 10}});
  for (std::size_t i = 0; i < num_primitives; ++i) {
    const PrimitiveKind kind = i % 2 == 0 ? PrimitiveKind::box : PrimitiveKind::sphere;
    const float size = uniform(0.2F, 1.0F);
    made.all.primitives.push_back(
        {.kind = kind, .center = point(), .half_extents = Vec3::Constant(size), .visibility = static_cast<Visibility>(i % 3)});
  }
  for (std::uint16_t object = 0; object < 40; ++object) {
    made.all.mesh.visibility.push_back(static_cast<Visibility>(object % 3));
    const Vec3 at = point();
    for (int i = 0; i < 3; ++i) {
      const auto first = static_cast<std::int32_t>(made.all.mesh.vertices.size());
      for (int corner = 0; corner < 3; ++corner) made.all.mesh.vertices.push_back(at + 0.2F * point());
      made.all.mesh.triangles.push_back({first, first + 1, first + 2});
      made.all.mesh.objects.push_back(object);
    }
  }
  made.all = canonical(made.all);
  made.part = made.all;
  made.part.primitives.clear();
  made.part.mesh.triangles.clear();
  made.part.mesh.materials.clear();
  made.part.mesh.objects.clear();
  for (std::size_t i = 0; i < made.all.primitives.size(); ++i) {
    if (!is_kept(made.all.primitives[i].visibility)) continue;
    made.part.primitives.push_back(made.all.primitives[i]);
    made.part.primitives.back().visibility = Visibility::full;
    made.kept.push_back(static_cast<std::int32_t>(i));
  }
  const TriangleMesh& mesh = made.all.mesh;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    if (!is_kept(mesh.visibility_of(i))) continue;
    made.part.mesh.triangles.push_back(mesh.triangles[i]);
    made.part.mesh.objects.push_back(mesh.objects[i]);
    made.kept.push_back(static_cast<std::int32_t>(made.all.primitives.size() + i));
  }
  made.part.mesh.visibility.clear();
  return made;
}

// Few primitives are traced directly, many through Embree.
TEST(Visibility, RaysHitVisibleObjects) {
  for (const std::size_t count : {6U, 600U}) {
    const Parts made = parts(1, count, is_visible);
    const World all(made.all), part(made.part);
    std::mt19937 random(2);
    std::normal_distribution<float> normal;
    std::vector<float> origins, directions;
    for (int i = 0; i < 3 * 4000; ++i) {
      origins.push_back(3.0F * normal(random));
      directions.push_back(normal(random));
    }
    const RayHits got = raycast(all, origins, directions, 50.0F), expected = raycast(part, origins, directions, 50.0F);
    EXPECT_EQ(got.t_hit, expected.t_hit);
    EXPECT_EQ(got.material, expected.material);
    std::size_t others = 0;
    for (std::size_t i = 0; i < got.primitive.size(); ++i) {
      const std::int32_t number = expected.primitive[i];
      ASSERT_EQ(got.primitive[i], number < 0 ? -1 : made.kept[static_cast<std::size_t>(number)]);
      others += number > 0 ? 1U : 0U;
    }
    EXPECT_GT(others, 500U);
  }
}

TEST(Visibility, DronesHitSolidObjects) {
  for (const std::size_t count : {6U, 600U}) {
    const Parts made = parts(3, count, is_solid);
    const World all(made.all), part(made.part);
    const collision::Obstacles& got = prepared(all).obstacles();
    const collision::Obstacles& expected = prepared(part).obstacles();
    std::mt19937 random(4);
    std::uniform_real_distribution<float> uniform(-9.5F, 9.5F);
    std::size_t near = 0;
    for (int i = 0; i < 4000; ++i) {
      const Vec3 place(uniform(random), uniform(random), uniform(random));
      ASSERT_EQ(got.distance(place, 20.0F), expected.distance(place, 20.0F));
      ASSERT_EQ(got.is_clear(place, 0.5F), expected.is_clear(place, 0.5F));
      ASSERT_EQ(got.touches(place, 0.5F), expected.touches(place, 0.5F));
      near += got.touches(place, 0.5F) ? 1U : 0U;
    }
    EXPECT_GT(near, 100U);
    EXPECT_LT(near, 3900U);
    const Aabb box{Vec3::Constant(-9), Vec3::Constant(9)};
    EXPECT_TRUE(occupancy(all, 0.5F, box).occupied == occupancy(part, 0.5F, box).occupied);
  }
}

TEST(Visibility, SurveysReportBoth) {
  const World world(parts(5, 6, is_visible).all);
  const ObjectList list = objects(world);
  ASSERT_EQ(list.visibility.size(), 47U);
  std::vector<std::size_t> points(47, 0);
  for (const std::int32_t object : point_cloud(world, 0.1F).objects) ++points[static_cast<std::size_t>(object)];
  for (std::size_t i = 0; i < 47; ++i) {
    const Visibility expected = i < 7 ? world.primitives()[i].visibility : static_cast<Visibility>((i - 7) % 3);
    EXPECT_EQ(list.visibility[i], expected);
    EXPECT_EQ(points[i] > 0, is_visible(expected)) << i;
  }
}

TEST(Visibility, FilesStoreIt) {
  const SceneDescription scene = parts(6, 30, is_visible).all;
  const World world(scene);
  EXPECT_EQ(World::from_json(world.to_json())->content_hash(), world.content_hash());
  for (const GltfForm form : {GltfForm::binary, GltfForm::text}) {
    GltfFile file = parse_gltf(write_gltf(scene, form, "x"), "x", "");
    EXPECT_TRUE(file.ignored.empty());
    EXPECT_EQ(World(std::move(file.scene)).content_hash(), world.content_hash());
  }
}

TEST(Visibility, DescriptionsAreNormalised) {
  SceneDescription scene;
  scene.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}};
  scene.mesh.triangles = {{0, 1, 2}, {2, 1, 0}};
  scene.mesh.objects = {0, 3};
  const std::uint64_t plain = World(scene).content_hash();
  scene.mesh.visibility = {Visibility::full, Visibility::visual, Visibility::solid, Visibility::full, Visibility::visual};
  EXPECT_TRUE(canonical(scene).mesh.visibility.empty());
  EXPECT_EQ(World(scene).content_hash(), plain);
  scene.mesh.visibility[3] = Visibility::visual;
  EXPECT_EQ(canonical(scene).mesh.visibility,
            (std::vector<Visibility>{Visibility::full, Visibility::full, Visibility::full, Visibility::visual}));
  EXPECT_NE(World(scene).content_hash(), plain);

  const auto refusal_of = [](const SceneDescription& description) { return refusal([&] { canonical(description); }); };
  scene.mesh.visibility[0] = Visibility::visual;
  EXPECT_TRUE(names(refusal_of(scene), "scene: ... primitive"));
  scene.primitives = {{.kind = PrimitiveKind::sphere, .visibility = Visibility::solid}};
  EXPECT_EQ(refusal_of(scene), "accepted");
  scene.primitives[0].visibility = static_cast<Visibility>(3);
  EXPECT_TRUE(names(refusal_of(scene), "primitives[0].visibility: ... 3"));
  scene.primitives = {{.kind = PrimitiveKind::room, .visibility = Visibility::solid}};
  EXPECT_TRUE(names(refusal_of(scene), "primitives[0].visibility: ... Visibility"));
}

TEST(Visibility, BuildersSetIt) {
  WorldBuilder builder;
  const std::uint16_t material = builder.material({"a"});
  builder.sphere({0, 0, 0}, 1.0F, material, Visibility::solid);
  builder.box({5, 0, 0}, {1, 1, 1}, material, Quat::Identity(), Visibility::visual);
  builder.mesh({.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}}, .triangles = {{0, 1, 2}}}, material);
  builder.heightfield({.columns = 2, .rows = 2, .heights = {0, 0, 0, 0}}, material, Visibility::visual);
  const auto world = builder.build();
  EXPECT_EQ(world->primitives()[0].visibility, Visibility::visual);  // boxes come first
  EXPECT_EQ(world->primitives()[1].visibility, Visibility::solid);
  EXPECT_EQ(world->triangles().visibility, (std::vector<Visibility>{Visibility::full, Visibility::visual}));
}

}  // namespace
}  // namespace flockstep
