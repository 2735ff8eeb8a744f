#include "trace/mesh_tiles.hpp"

#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "meshes.hpp"
#include "ray_oracle.hpp"
#include "trace/mesh_tree.hpp"

namespace flockstep::trace {
namespace {

using namespace testing;

struct Device {
  std::unique_ptr<RTCDeviceTy, decltype(&rtcReleaseDevice)> device{rtcNewDevice(nullptr), &rtcReleaseDevice};
  MeshTree tree(const TriangleMesh& mesh) const { return {device.get(), mesh}; }
  MeshTree tree_in_bunches(const TriangleMesh& mesh) const { return {device.get(), mesh, 0}; }
};

// 256 rays (1, u, v), their pose and their hits.
struct Tile {
  float near = 0.01F;
  std::vector<float> x = std::vector<float>(kMaxRays + kRayPadding, 1.0F), y = x, z = x;
  std::unique_ptr<RayBundle> rays = std::make_unique<RayBundle>();
  std::unique_ptr<HitDetails> details = std::make_unique<HitDetails>();

  void trace(const MeshTree& tree, const Vec3& origin, const Mat3& rotation, std::size_t count = kMaxRays) {
    rays->origin = origin;
    rays->rotation = rotation;
    rays->near = near;
    rays->range = 100.0F;
    rays->count = count;
    rays->x = x.data();
    rays->y = y.data();
    rays->z = z.data();
    std::fill_n(rays->t_hit, kMaxRays, kInfinity);
    std::fill_n(rays->element, kMaxRays, -1);
    trace_on(tree, 0);
  }

  // Traces with the current setup, keeping earlier hits.
  void trace_on(const MeshTree& tree, std::int32_t first_element) {
    const FlushDenormals flush;
    trace_mesh_tile(tree, first_element, make_tile_axis(y.data()), make_tile_axis(z.data()), *rays, details.get(), {});
  }
};

// Points the rays at an image with the given angle between pixels, in radians, that looks along (1, u, v).
void look(Tile& tile, float pixel, float u = 0.0F, float v = 0.0F) {
  for (std::size_t i = 0; i < kMaxRays; ++i) {
    tile.y[i] = u + pixel * (7.5F - static_cast<float>(i % 16));
    tile.z[i] = v + pixel * (7.5F - static_cast<float>(i / 16));
  }
}

TEST(MeshTiles, AgreeWithAnOracleInDoublePrecision) {
  const Device device;
  Random random(1);
  std::size_t compared = 0, hits = 0;
  for (const int rings : {3, 8, 30}) {
    const TriangleMesh mesh = ball(rings, 2 * rings, 0.5F, random);
    const auto shared = make_world({}, {}, mesh);
    const World& world = *shared;
    const MeshTree tree = device.tree(mesh);
    Tile tile;
    for (int i = 0; i < 12; ++i) {
      const Mat3 rotation = random.rotation().toRotationMatrix();
      const Vec3 origin = i % 3 == 0 ? random.point(1.0F) : Vec3(random.point(6.0F));
      look(tile, std::array{0.15F, 0.02F, 0.002F}[static_cast<std::size_t>(i % 3)], random.within(-0.5F, 0.5F));
      const std::size_t count = i % 4 == 3 ? 112 : kMaxRays;  // rows that do not fill the last sub-tiles
      tile.trace(tree, origin, rotation, count);
      for (std::size_t ray = 0; ray < count; ray += 3) {
        const Eigen::Vector3d from = origin.cast<double>(), along = tile.rays->direction(ray).cast<double>();
        const oracle::Hit expected = oracle::nearest(world, from, along, 100.0);
        if (!oracle::is_clear_cut(world, expected, from, along, 100.0)) continue;
        ++compared;
        ASSERT_EQ(tile.rays->element[ray], expected.element) << "ray " << ray << " of tile " << i;
        if (expected.element < 0) continue;
        ++hits;
        ASSERT_NEAR(static_cast<double>(tile.rays->t_hit[ray]), expected.t, 1e-5 * std::max(1.0, expected.t));
        const auto& [a, b, c] = mesh.triangles[static_cast<std::size_t>(expected.element)];
        const auto corner = [&](std::int32_t vertex) { return mesh.vertices[static_cast<std::size_t>(vertex)]; };
        const float u = tile.details->u[ray], v = tile.details->v[ray];
        const Vec3 point = origin + tile.rays->t_hit[ray] * tile.rays->direction(ray);
        ASSERT_LT(((1.0F - u - v) * corner(a) + u * corner(b) + v * corner(c) - point).norm(), 1e-3F);
        const Vec3 normal(tile.details->normal_x[ray], tile.details->normal_y[ray], tile.details->normal_z[ray]);
        const Vec3 expected_normal = (corner(b) - corner(a)).cross(corner(c) - corner(a)).normalized();
        ASSERT_GT(std::abs(normal.normalized().dot(expected_normal)), 0.9999F);
        const float against = expected_normal.dot(tile.rays->direction(ray).normalized());
        if (std::abs(against) > 1e-3F) {
          ASSERT_EQ(tile.details->back[ray], against > 0.0F ? 1 : 0);
        }
      }
    }
  }
  EXPECT_GT(compared, 2000U);
  EXPECT_GT(hits, 1000U);
}

// Rays from inside a closed mesh towards its vertices and edges, some of them a few ulps off.
TEST(MeshTiles, NoRaySlipsBetweenTriangles) {
  const Device device;
  Random random(2 + (part_tried() << 24U));
  long rays = 0;
  for (long round = 0; round < times_tried(3); ++round) {
    const int rings = std::array{4, 12, 40}[static_cast<std::size_t>(round % 3)];
    const TriangleMesh mesh = ball(rings, 2 * rings, rings == 12 ? 1.0F : 0.0F, random);
    const MeshTree tree = device.tree(mesh);
    Tile tile;
    for (int turn = 0; turn < 40; ++turn) {
      const Mat3 rotation = turn % 4 == 0 ? Mat3(Mat3::Identity()) : random.rotation().toRotationMatrix();
      const Vec3 origin = turn % 2 == 0 ? Vec3(Vec3::Zero()) : random.point(0.8F);
      std::size_t count = 0;
      while (count < kMaxRays) {
        const auto& triangle = mesh.triangles[random.generator()() % mesh.triangles.size()];
        const Vec3 a = mesh.vertices[static_cast<std::size_t>(triangle[0])],
                   b = mesh.vertices[static_cast<std::size_t>(triangle[1])];
        const Vec3 target = random.within(0, 1) < 0.5F ? a : Vec3(a + std::array{0.5F, 0.25F, 1e-4F}[count % 3] * (b - a));
        const Vec3 seen = rotation.transpose() * (target - origin);
        if (seen.x() < 0.3F) continue;
        tile.y[count] = seen.y() / seen.x();
        tile.z[count] = seen.z() / seen.x();
        if (count % 5 == 1) tile.y[count] = std::nextafter(tile.y[count], 10.0F);
        if (count % 5 == 2) tile.z[count] = std::nextafter(tile.z[count], -10.0F);
        ++count;
      }
      tile.trace(tree, origin, rotation);
      for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
        ++rays;
        ASSERT_GE(tile.rays->element[ray], 0) << "ray " << ray << " of turn " << turn << ", " << rings << " rings";
        const float t = tile.rays->t_hit[ray] * tile.rays->direction(ray).norm();
        ASSERT_GT(t, 0.1F);
        ASSERT_LT(t, 6.0F);
      }
    }
  }
  testing::tried("watertight", rays);
}

// The eye is so close above the floor that rounding may decide which side is visible. The floor extends in front of the eye and
// behind it.
TEST(MeshTiles, NoRaySlipsThroughAFloorSeenEdgeOn) {
  const Device device;
  Random random(5);
  const MeshTree tree = device.tree(cube(8.0F));
  Tile tile;
  tile.near = 0.0F;
  for (int round = 0; round < 400; ++round) {
    const Mat3 rotation = random.rotation().toRotationMatrix();
    const Vec3 origin(random.within(-6, 6), random.within(-6, 6), -8.0F + random.within(2e-6F, 6e-6F));
    for (std::size_t count = 0; count < kMaxRays;) {
      const Vec3 target(random.within(-8, 8), random.within(-8, 8), -8.0F);
      const Vec3 seen = rotation.transpose() * (target - origin);
      if (seen.x() < 0.1F) continue;
      tile.y[count] = seen.y() / seen.x();
      tile.z[count] = seen.z() / seen.x();
      ++count;
    }
    tile.trace(tree, origin, rotation);
    for (std::size_t ray = 0; ray < kMaxRays; ++ray)
      ASSERT_GE(tile.rays->element[ray], 0) << "ray " << ray << " of round " << round;
  }
}

// Neighbouring rays and the order of traversal must not change any bit: rays with one origin and frame, shuffled.
TEST(MeshTiles, ARaysResultDoesNotDependOnTheRaysBesideIt) {
  const Device device;
  Random random(3 + (part_tried() << 24U));
  constexpr long kPosesOfAMesh = 10;
  const long poses = times_tried(4 * kPosesOfAMesh);
  const long of_a_mesh = std::max(kPosesOfAMesh, poses / 40);
  long rays = 0, hits = 0;
  Tile tile, shuffled, alone;
  std::unique_ptr<const MeshTree> tree;
  Vec3 eye;
  for (long pose = 0; pose < poses; ++pose) {
    if (pose % of_a_mesh == 0) {
      const int rings = pose / of_a_mesh % 2 == 0 ? 5 : 60;
      TriangleMesh mesh = ball(rings, 2 * rings, 0.7F, random);
      eye = random.point(5.0F);
      add_slivers(mesh, rings == 5 ? 60 : 240, eye, random);
      tree = std::make_unique<const MeshTree>(device.tree(mesh));
    }
    const bool is_level = pose % 6 == 0;  // one row of rays runs along the floor
    const Mat3 rotation = is_level ? Mat3(Eigen::AngleAxisf(random.within(-3, 3), Vec3::UnitZ()).toRotationMatrix())
                                   : random.rotation().toRotationMatrix();
    const Vec3 origin = pose % 2 == 0 ? eye : Vec3(random.point(5.0F));
    look(tile, pose % 4 < 2 ? 0.1F : 0.004F);
    for (std::size_t ray = 0; is_level && ray < kMaxRays; ++ray) {
      if (ray / 16 == 5) tile.z[ray] = -2e-6F;
    }
    tile.trace(*tree, origin, rotation);
    std::array<std::size_t, kMaxRays> from;
    for (std::size_t ray = 0; ray < kMaxRays; ++ray) from[ray] = ray;
    std::shuffle(from.begin(), from.end(), random.generator());
    for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
      const bool is_other = ray % 7 == 0;  // replaced by rays in other directions
      shuffled.y[ray] = is_other ? random.within(-3, 3) : tile.y[from[ray]];
      shuffled.z[ray] = is_other ? random.within(-3, 3) : tile.z[from[ray]];
    }
    shuffled.trace(*tree, origin, rotation);
    for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
      if (ray % 7 == 0) continue;
      ++rays;
      ASSERT_EQ(shuffled.rays->element[ray], tile.rays->element[from[ray]]) << "pose " << pose;
      ASSERT_EQ(shuffled.rays->t_hit[ray], tile.rays->t_hit[from[ray]]) << "pose " << pose;
      hits += shuffled.rays->element[ray] >= 0;
    }
    for (std::size_t ray = static_cast<std::size_t>(pose % 17); ray < kMaxRays; ray += 17) {
      std::fill(alone.y.begin(), alone.y.end(), tile.y[ray]);
      std::fill(alone.z.begin(), alone.z.end(), tile.z[ray]);
      alone.trace(*tree, origin, rotation, 16);
      ASSERT_EQ(alone.rays->element[5], tile.rays->element[ray]) << "pose " << pose;
      ASSERT_EQ(alone.rays->t_hit[5], tile.rays->t_hit[ray]) << "pose " << pose;
    }
  }
  EXPECT_GT(hits, rays / 10);
  testing::tried("independence", rays);
}

TEST(MeshTiles, FullLeavesTakeLessMemoryAndHitTheSame) {
  const Device device;
  Random random(6);
  for (const int rings : {2, 3, 5, 20, 200}) {
    const Vec3 eye = random.point(5.0F);
    TriangleMesh mesh = ball(rings, 2 * rings, 0.02F, random);
    if (rings < 200) add_slivers(mesh, 20 * rings, eye, random);
    const MeshTree tree = device.tree(mesh), full = device.tree_in_bunches(mesh);
    EXPECT_LE(full.bytes(), tree.bytes());
    if (rings == 200) {
      const auto triangles = static_cast<double>(mesh.triangles.size());
      EXPECT_LT(static_cast<double>(full.bytes()), 46.0 * triangles);  // 40 bytes in leaves without gaps
    }
    Tile tile, same;
    for (int pose = 0; pose < 40; ++pose) {
      const Mat3 rotation = random.rotation().toRotationMatrix();
      const Vec3 origin = pose % 2 == 0 ? eye : Vec3(random.point(5.0F));
      look(tile, pose % 4 < 2 ? 0.1F : 0.004F);
      same.y = tile.y;
      same.z = tile.z;
      tile.trace(tree, origin, rotation);
      same.trace(full, origin, rotation);
      for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
        ASSERT_EQ(same.rays->element[ray], tile.rays->element[ray]) << "pose " << pose;
        ASSERT_EQ(same.rays->t_hit[ray], tile.rays->t_hit[ray]) << "pose " << pose;
      }
    }
  }
}

TEST(MeshTiles, KeepsAnEarlierHitThatIsNearer) {
  const Device device;
  Random random(4);
  const MeshTree tree = device.tree(ball(10, 20, 0.0F, random));
  Tile tile;
  look(tile, 0.02F);
  tile.trace(tree, Vec3::Zero(), Mat3::Identity());
  const std::vector<float> depth(tile.rays->t_hit, tile.rays->t_hit + kMaxRays);
  const std::vector<std::int32_t> element(tile.rays->element, tile.rays->element + kMaxRays);
  std::fill_n(tile.rays->t_hit, kMaxRays, 1e-3F);  // ignored while no_hits_yet is set
  tile.rays->no_hits_yet = true;
  tile.trace_on(tree, 0);
  tile.rays->no_hits_yet = false;
  EXPECT_TRUE(std::equal(depth.begin(), depth.end(), tile.rays->t_hit));
  EXPECT_TRUE(std::equal(element.begin(), element.end(), tile.rays->element));
  for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
    tile.rays->t_hit[ray] = ray % 2 == 0 ? 1.0F : 50.0F;
    tile.rays->element[ray] = 1000;
  }
  tile.trace_on(tree, 7);
  for (std::size_t ray = 0; ray < kMaxRays; ++ray) {
    ASSERT_EQ(tile.rays->t_hit[ray], ray % 2 == 0 ? 1.0F : depth[ray]);
    ASSERT_EQ(tile.rays->element[ray] == 1000, ray % 2 == 0);
    ASSERT_GE(tile.rays->element[ray], 7);
  }
  tile.rays->range = 2.0F;
  std::fill_n(tile.rays->t_hit, kMaxRays, kInfinity);
  std::fill_n(tile.rays->element, kMaxRays, -1);
  tile.trace_on(tree, 0);
  EXPECT_TRUE(std::all_of(tile.rays->element, tile.rays->element + kMaxRays, [](std::int32_t e) { return e == -1; }));
}

}  // namespace
}  // namespace flockstep::trace
