#include <set>

#include "batch_helpers.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

using namespace testing;

// A scene with a value in every field.
SceneDescription full() {
  SceneDescription scene;
  scene.name = "full";
  scene.materials = {{"a", {0.1F, 0.2F, 0.3F}, 4}, {"b", {0.5F, 0.6F, 0.7F}, 0}};
  scene.primitives = {
      {.kind = PrimitiveKind::box, .center = {1, 2, 3}, .half_extents = {0.5F, 0.6F, 0.7F}, .material = 1},
      {.kind = PrimitiveKind::sphere, .center = {4, 5, 6}, .half_extents = {0.5F, 0.5F, 0.5F}},
  };
  scene.mesh.vertices = {{0, 0, 0}, {1, 0, 0}, {0, 1, 0}, {0, 0, 1}};
  scene.mesh.triangles = {{0, 1, 2}, {0, 1, 3}};
  scene.mesh.materials = {0, 1};
  scene.mesh.objects = {0, 1};
  scene.markers = {.radius = 0.3F,
                   .start = Vec3(1, 1, 1),
                   .waypoints = {{2, 2, 2}, {3, 3, 3}},
                   .goal = Vec3(4, 4, 4),
                   .spawn_box = Aabb{.min = {0, 0, 0}, .max = {1, 1, 1}}};
  scene.gates = {{.center = {1, 2, 3}}, {.shape = GateShape::ring, .center = {4, 5, 6}}};
  return scene;
}

// The hashes of a scene and of its variants. No two may be equal.
class Seen {
 public:
  explicit Seen(SceneDescription& scene) : scene_(scene) { add("unchanged"); }

  void add(const char* what) { EXPECT_TRUE(hashes_.insert(content_hash(scene_)).second) << what; }

  // Flips a bit of each byte of the field in turn.
  template <class T>
  void flip(const char* what, T& field) {
    auto* const bytes = reinterpret_cast<unsigned char*>(&field);
    for (std::size_t i = 0; i < sizeof(T); ++i) {
      bytes[i] ^= 1U;
      add(what);
      bytes[i] ^= 1U;
    }
  }

  // Changes the field temporarily.
  template <class T>
  void change(const char* what, T& field, const T& other) {
    const T before = field;
    field = other;
    add(what);
    field = before;
  }

 private:
  SceneDescription& scene_;
  std::set<std::uint64_t> hashes_;
};

TEST(ContentHash, EveryByteOfEveryFieldCounts) {
  SceneDescription scene = full();
  Seen seen(scene);
  for (Material& material : scene.materials) {
    seen.flip("materials.base_color", material.base_color);
    seen.flip("materials.semantic", material.semantic);
    seen.flip("materials.name", material.name[0]);
    seen.change<std::string>("materials.name", material.name, "longer");
  }
  for (Primitive& primitive : scene.primitives) {
    seen.flip("primitives.kind", primitive.kind);
    seen.flip("primitives.center", primitive.center);
    seen.flip("primitives.rotation", primitive.rotation);
    seen.flip("primitives.half_extents", primitive.half_extents);
    seen.flip("primitives.material", primitive.material);
    seen.flip("primitives.visibility", primitive.visibility);
  }
  for (Vec3& vertex : scene.mesh.vertices) seen.flip("mesh.vertices", vertex);
  for (auto& triangle : scene.mesh.triangles) seen.flip("mesh.triangles", triangle);
  for (auto& material : scene.mesh.materials) seen.flip("mesh.materials", material);
  for (auto& object : scene.mesh.objects) seen.flip("mesh.objects", object);
  for (const auto& visibility : {std::vector{Visibility::visual}, {Visibility::solid}, {Visibility::full, Visibility::visual}}) {
    seen.change("mesh.visibility", scene.mesh.visibility, visibility);
  }
  seen.flip("markers.radius", scene.markers.radius);
  seen.flip("markers.start", *scene.markers.start);
  for (Vec3& waypoint : scene.markers.waypoints) seen.flip("markers.waypoints", waypoint);
  seen.flip("markers.goal", *scene.markers.goal);
  seen.flip("markers.spawn_box", *scene.markers.spawn_box);
  seen.flip("light.sun_direction", scene.light.sun_direction);
  seen.flip("light.sun_color", scene.light.sun_color);
  seen.flip("light.sky_ambient", scene.light.sky_ambient);
  seen.flip("light.ground_ambient", scene.light.ground_ambient);
  seen.flip("light.zenith_color", scene.light.zenith_color);
  seen.flip("light.horizon_color", scene.light.horizon_color);
  seen.flip("light.gamma", scene.light.gamma);
  for (Gate& gate : scene.gates) {
    seen.flip("gates.shape", gate.shape);
    seen.flip("gates.center", gate.center);
    seen.flip("gates.rotation", gate.rotation);
    seen.flip("gates.size", gate.size);
    seen.flip("gates.bar", gate.bar);
    seen.flip("gates.material", gate.material);
    seen.flip("gates.visibility", gate.visibility);
  }
}

TEST(ContentHash, ContentsAndTheirOrderCount) {
  SceneDescription scene = full();
  Seen seen(scene);
  const SceneDescription whole = scene;
  const auto without = [&](const char* what, const auto& remove) {
    remove(scene);
    seen.add(what);
    scene = whole;
  };
  without("a material", [](SceneDescription& s) { s.materials.pop_back(); });
  without("a primitive", [](SceneDescription& s) { s.primitives.pop_back(); });
  without("the primitives", [](SceneDescription& s) { s.primitives.clear(); });
  without("a vertex", [](SceneDescription& s) { s.mesh.vertices.pop_back(); });
  without("a triangle", [](SceneDescription& s) { s.mesh.triangles.pop_back(); });
  without("materials of triangles", [](SceneDescription& s) { s.mesh.materials.clear(); });
  without("objects of triangles", [](SceneDescription& s) { s.mesh.objects.clear(); });
  without("the mesh", [](SceneDescription& s) { s.mesh = {}; });
  without("a start", [](SceneDescription& s) { s.markers.start.reset(); });
  without("a waypoint", [](SceneDescription& s) { s.markers.waypoints.pop_back(); });
  without("a goal", [](SceneDescription& s) { s.markers.goal.reset(); });
  without("a spawn box", [](SceneDescription& s) { s.markers.spawn_box.reset(); });
  without("a gate", [](SceneDescription& s) { s.gates.pop_back(); });
  without("the gates", [](SceneDescription& s) { s.gates.clear(); });
  without("order of gates", [](SceneDescription& s) { std::swap(s.gates[0], s.gates[1]); });
  without("order of primitives", [](SceneDescription& s) { std::swap(s.primitives[0], s.primitives[1]); });
  without("order of waypoints", [](SceneDescription& s) { std::swap(s.markers.waypoints[0], s.markers.waypoints[1]); });
  without("a start that is a goal", [](SceneDescription& s) {
    s.markers.goal = s.markers.start;
    s.markers.start.reset();
  });
}

TEST(ContentHash, IsOfTheContentNotOfTheNameOrTheFile) {
  SceneDescription scene = full();
  const World world(scene);
  scene.name = "renamed";
  EXPECT_EQ(World(scene).content_hash(), world.content_hash());
  EXPECT_EQ(World::from_json(world.to_json())->content_hash(), world.content_hash());
  std::swap(scene.primitives[0], scene.primitives[1]);
  EXPECT_EQ(World(scene).content_hash(), world.content_hash()) << "in canonical order boxes come before spheres";
}

TEST(ContentHash, DistinguishesSunsInTheSkyAndFogs) {
  SceneDescription scene = full();
  std::set<std::uint64_t> seen{World(scene).content_hash()};
  for (const auto& [radius, glow, fog] : std::vector<std::array<float, 3>>{
           {1, 0, 0}, {0, 1, 0}, {1, 1, 0}, {2, 1, 0}, {0, 0, 1}, {0, 1, 1}, {0, 1, 30}, {0, 0, 30}}) {
    scene.light.sun_radius_deg = radius;
    scene.light.sun_glow = glow;
    scene.light.fog_visibility_m = fog;
    EXPECT_TRUE(seen.insert(World(scene).content_hash()).second);
  }
}

TEST(ContentHash, DistinguishesTextures) {
  SceneDescription scene;
  scene.textures = {Texture{"a", 1, 2, std::vector<std::uint8_t>(8, 7)}, Texture{"b", 2, 1, std::vector<std::uint8_t>(8, 7)}};
  scene.materials[0].texture = 0;
  scene.mesh.vertices = {Vec3(0, 0, 0), Vec3(1, 0, 0), Vec3(0, 1, 0)};
  scene.mesh.triangles = {{0, 1, 2}};
  scene.mesh.uv.resize(3);
  std::set<std::uint64_t> seen{World(scene).content_hash()};
  const auto expect_other = [&](const auto& change) {
    SceneDescription other = scene;
    change(other);
    EXPECT_TRUE(seen.insert(World(other).content_hash()).second) << seen.size();
  };
  expect_other([](auto& s) { s.materials[0].texture = 1; });
  expect_other([](auto& s) { s.materials[0].texture.reset(); });
  expect_other([](auto& s) { s.materials[0].alpha_cutoff = 0.5F; });
  expect_other([](auto& s) { s.textures[0].rgba[5] = 8; });
  expect_other([](auto& s) { s.textures[0].wrap[0] = TextureWrap::clamp; });
  expect_other([](auto& s) { s.textures[0].wrap[1] = TextureWrap::clamp; });
  expect_other([](auto& s) { s.textures[0].name = "c"; });
  expect_other([](auto& s) { std::swap(s.textures[0].width_px, s.textures[0].height_px); });
  expect_other([](auto& s) { s.mesh.uv[1][0] = 0.5F; });
  expect_other([](auto& s) { s.mesh.uv[1][1] = 0.5F; });
  expect_other([](auto& s) { s.textures.pop_back(); });
}

TEST(ContentHash, IsTheSameFromAnyThreadAndOnAnyDay) {
  const auto world = closet();
  std::vector<std::uint64_t> seen(8);
  std::vector<std::thread> threads;
  for (std::uint64_t& slot : seen) threads.emplace_back([&world, &slot] { slot = world->content_hash(); });
  for (std::thread& thread : threads) thread.join();
  for (const std::uint64_t hash : seen) EXPECT_EQ(hash, 0x56F31CB32C9F830CU);  // existing snapshots contain this value
}

}  // namespace
}  // namespace flockstep
