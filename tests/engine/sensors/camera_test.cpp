#include "sensors/camera.hpp"

#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <memory>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "numbers.hpp"
#include "on_target.hpp"
#include "picture_oracle.hpp"
#include "random.hpp"
#include "render/pinhole_camera.hpp"
#include "trace/embree.hpp"
#include "trace/packets.hpp"
#include "trace/scene.hpp"

namespace flockstep {
namespace {

using enum PrimitiveKind;
using testing::camera_batch;
using testing::Compared;
using testing::expect_picture;
using testing::kAllOutputs;
using testing::kInfinity;
using testing::look;
using testing::make_world;
using testing::Pixel;
using testing::pixel;
using testing::Poses;
using testing::primitive;
using testing::Random;
using testing::random_poses;
using testing::same_bits;

Quat turned(float degrees, const Vec3& axis) {
  return Quat(Eigen::AngleAxisf(degrees * std::numbers::pi_v<float> / 180.0F, axis.normalized()));
}

std::array<float, 4> wxyz(const Quat& q) { return {q.w(), q.x(), q.y(), q.z()}; }

CameraConfig camera_of(int width, int height, float hfov_deg = 90.0F) {
  return {.width_px = width, .height_px = height, .hfov_deg = hfov_deg, .outputs = kAllOutputs};
}

// Adds a square of two triangles around the x axis at a fixed x, visible from both sides.
void add_square(TriangleMesh& mesh, float x, float half, std::uint16_t material = 0, std::uint16_t object = 0) {
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (const auto& [y, z] : {std::pair{-half, -half}, {half, -half}, {half, half}, {-half, half}})
    mesh.vertices.emplace_back(x, y, z);
  for (const auto& [a, b, c] : {std::array{0, 1, 2}, {0, 2, 3}}) {
    mesh.triangles.push_back({first + a, first + b, first + c});
    mesh.materials.push_back(material);
    mesh.objects.push_back(object);
  }
}

// Returns the number of pixels with an instance id.
std::size_t count_of(const Batch& batch, int instance) {
  const auto& all = batch.images(0).instance;
  return static_cast<std::size_t>(std::count(all.begin(), all.end(), instance));
}

// -- Projection, with results computed by hand.

TEST(CameraProjection, ASphereOfKnownAngularSize) {
  // A sphere of radius 1 at 3 m covers asin(1/3), whose tangent is 1/sqrt(8). Its nearest point is 2 m away.
  const auto world = make_world({primitive(sphere, {3, 0, 0}, {1, 1, 1})});
  const auto batch = look(world, camera_of(65, 49), {0, 0, 0});
  const double radius = 32.5 / std::sqrt(8.0);
  std::size_t inside = 0;
  for (std::size_t row = 0; row < 49; ++row) {
    for (std::size_t column = 0; column < 65; ++column) {
      const double off = std::hypot(static_cast<double>(column) - 32.0, static_cast<double>(row) - 24.0);
      ASSERT_GT(std::abs(off - radius), 1e-3) << "no pixel is as far out as the silhouette";
      EXPECT_EQ(pixel(*batch, row, column).instance, off < radius ? 1 : 0) << row << ' ' << column;
      inside += off < radius;
    }
  }
  EXPECT_GT(inside, 300U);
  EXPECT_NEAR(pixel(*batch, 24, 32).depth, 2.0F, 1e-6F);
  EXPECT_LT((pixel(*batch, 24, 32).normal - Vec3(-1, 0, 0)).norm(), 1e-6F);
}

TEST(CameraProjection, ACornerAndTheOrderOfRowsAndColumns) {
  // The box's face, 4 m ahead, starts 1 m to the left and 0.5 m up. Its corner is at column 32 - 32/4 = 24, row 24 - 32/8 = 20.
  const auto world = make_world({primitive(box, {5, 11, 10.5F}, {1, 10, 10})});
  CameraConfig camera = camera_of(64, 48);
  camera.far_m = 4.1F;  // only the face
  const auto batch = look(world, camera, {0, 0, 0});
  for (std::size_t row = 0; row < 48; ++row) {
    for (std::size_t column = 0; column < 64; ++column) {
      const Pixel is = pixel(*batch, row, column);
      const bool is_box = column < 24 && row < 20;
      ASSERT_EQ(is.instance, is_box ? 1 : 0) << row << ' ' << column;
      ASSERT_EQ(is.depth, is_box ? 4.0F : kInfinity);
    }
  }
}

TEST(CameraProjection, ACheckersCorners) {
  // Squares of 1 m, 2 m ahead, around the axis. Their borders are every 32 / 2 = 16 pixels.
  std::vector<Primitive> squares;
  for (int i = -2; i < 2; ++i) {
    for (int k = -2; k < 2; ++k) {
      if ((i + k) % 2 == 0) continue;
      const Vec3 center(2.5F, static_cast<float>(i) + 0.5F, static_cast<float>(k) + 0.5F);
      squares.push_back(primitive(box, center, {0.5F, 0.5F, 0.5F}));
    }
  }
  CameraConfig camera = camera_of(64, 64);
  camera.far_m = 2.25F;  // only the faces
  const auto batch = look(make_world(squares), camera, {0, 0, 0});
  for (std::size_t row = 0; row < 64; ++row) {
    for (std::size_t column = 0; column < 64; ++column) {
      const bool is_square = (column / 16 + row / 16) % 2 == 1;
      ASSERT_EQ(pixel(*batch, row, column).depth == 2.0F, is_square) << row << ' ' << column;
    }
  }
}

TEST(CameraProjection, FieldsOfViewAcrossAndUp) {
  // A square face with half side 1 at 2 m covers the pixels within f / 2 of the centre, in both directions.
  const auto world = make_world({primitive(box, {3, 0, 0}, {1, 1, 1})});
  struct Case {
    std::optional<float> hfov_deg, vfov_deg;
    std::size_t columns, rows;
  };
  const std::vector<Case> cases{
      {{}, {}, 32, 32},          // f = 32
      {90.0F, {}, 32, 32},       // f = 32
      {60.0F, {}, 56, 48},       // f = 55.4, 27.7 on each side: every row
      {{}, 90.0F, 24, 24},       // f = 24
      {{}, 120.0F, 14, 14},      // f = 13.86, 6.93 on each side
      {90.0F, 60.0F, 32, 42},    // f = 32 horizontally; 41.57 vertically, 20.8 on each side
      {120.0F, 120.0F, 18, 14},  // f = 18.48 horizontally, 9.24 on each side
  };
  for (const Case& one : cases) {
    CameraConfig camera = camera_of(64, 48);
    camera.hfov_deg = one.hfov_deg;
    camera.vfov_deg = one.vfov_deg;
    const auto batch = look(world, camera, {0, 0, 0});
    std::size_t columns = 0;
    std::size_t rows = 0;
    for (std::size_t column = 0; column < 64; ++column) columns += pixel(*batch, 24, column).depth == 2.0F;
    for (std::size_t row = 0; row < 48; ++row) rows += pixel(*batch, row, 32).depth == 2.0F;
    EXPECT_EQ(columns, one.columns) << one.hfov_deg.value_or(0) << ' ' << one.vfov_deg.value_or(0);
    EXPECT_EQ(rows, one.rows) << one.hfov_deg.value_or(0) << ' ' << one.vfov_deg.value_or(0);
  }
}

TEST(CameraProjection, PlacesAndTurnsOfTheMounting) {
  // A drone at (1, 1, 1) in a room with half sizes 4, 5 and 6. The walls are at 3 m ahead, 4 left, 5 behind, 6 right, 5 up and
  // 7 down. The offset is in the body frame.
  const auto world = make_world({primitive(room, {0, 0, 0}, {4, 5, 6})});
  struct Case {
    const char* what;
    Quat body, mounting;
    std::array<float, 3> offset_m;
    float depth;  // planar depth of the wall ahead
  };
  const Vec3 x = Vec3::UnitX();
  const Vec3 y = Vec3::UnitY();
  const Vec3 z = Vec3::UnitZ();
  const Quat none = Quat::Identity();
  const std::vector<Case> cases{
      {"unchanged", none, none, {0, 0, 0}, 3.0F},
      {"moved", none, none, {0.5F, 0.25F, -0.125F}, 2.5F},
      {"yawed to the left", none, turned(90, z), {0, 0, 0}, 4.0F},
      {"yawed and moved", none, turned(90, z), {0.5F, 0.25F, -0.125F}, 3.75F},
      {"rolled", none, turned(90, x), {0.5F, 0.25F, 0}, 2.5F},
      {"pitched down", none, turned(90, y), {0.5F, 0.25F, -0.125F}, 6.875F},
      {"pitched up", none, turned(-90, y), {0.5F, 0.25F, -0.125F}, 5.125F},
      {"the drone to the left", turned(90, z), none, {0.5F, 0.25F, 0}, 3.5F},
      {"the drone to the left, and again", turned(90, z), turned(90, z), {0.5F, 0.25F, 0}, 4.75F},
      {"the drone rolled, then yawed", turned(90, x), turned(90, z), {0.5F, 0.25F, 0}, 4.75F},  // its left is up
  };
  for (const Case& one : cases) {
    SCOPED_TRACE(one.what);
    CameraConfig camera = camera_of(9, 9, 20.0F);
    camera.quat_wxyz = wxyz(one.mounting);
    camera.offset_m = one.offset_m;
    const auto batch = look(world, camera, {1, 1, 1}, one.body);
    for (std::size_t row = 0; row < 9; ++row) {
      for (std::size_t column = 0; column < 9; ++column) ASSERT_NEAR(pixel(*batch, row, column).depth, one.depth, 1e-5F);
    }
    EXPECT_EQ(expect_picture(*batch).clear, 81U);
  }
}

TEST(CameraProjection, ARollTurnsThePictureTheOtherWay) {
  // A sphere ahead and above. With the camera rolled a quarter turn to the right (+x), up is on its left.
  const auto world = make_world({primitive(sphere, {4, 0, 2}, {0.5F, 0.5F, 0.5F})});
  const auto place = [&](float roll_deg) {
    CameraConfig camera = camera_of(41, 41);
    camera.quat_wxyz = wxyz(turned(roll_deg, Vec3::UnitX()));
    const auto batch = look(world, camera, {0, 0, 0});
    Eigen::Vector2d sum(0, 0);
    for (std::size_t row = 0; row < 41; ++row) {
      for (std::size_t column = 0; column < 41; ++column) {
        if (pixel(*batch, row, column).instance == 1)
          sum += Eigen::Vector2d(static_cast<double>(column), static_cast<double>(row));
      }
    }
    EXPECT_GT(count_of(*batch, 1), 20U);
    return Eigen::Vector2d(sum / static_cast<double>(count_of(*batch, 1)) - Eigen::Vector2d(20, 20));
  };
  const Eigen::Vector2d upright = place(0.0F);
  EXPECT_NEAR(upright.x(), 0.0, 0.1);
  EXPECT_NEAR(upright.y(), -10.5, 0.8);  // 20.5 * 2 / 4, plus a little because of the round shape
  EXPECT_LT((place(90.0F) - Eigen::Vector2d(upright.y(), 0.0)).norm(), 0.2);
  EXPECT_LT((place(-90.0F) - Eigen::Vector2d(-upright.y(), 0.0)).norm(), 0.2);
  EXPECT_LT((place(180.0F) + upright).norm(), 0.2);
}

TEST(CameraDepth, PlanarAndRange) {
  // A wall 3 m ahead has a planar depth of 3 m everywhere, and a range of 3 m over the cosine.
  const auto world = make_world({primitive(plane, {3, 0, 0}, {50, 50, 0}, turned(90, Vec3::UnitY()))});
  for (const DepthKind kind : {DepthKind::planar, DepthKind::range}) {
    CameraConfig camera = camera_of(48, 32, 100.0F);
    camera.depth_kind = kind;
    const auto batch = look(world, camera, {0, 0, 0});
    const double focal = 24.0 / std::tan(50.0 * std::numbers::pi / 180.0);
    for (std::size_t row = 0; row < 32; ++row) {
      for (std::size_t column = 0; column < 48; ++column) {
        const double slope = std::hypot(static_cast<double>(column) - 23.5, static_cast<double>(row) - 15.5) / focal;
        const double expected = kind == DepthKind::planar ? 3.0 : 3.0 * std::hypot(1.0, slope);
        ASSERT_NEAR(pixel(*batch, row, column).depth, expected, 2e-6) << row << ' ' << column;
      }
    }
  }
}

// -- Near plane: objects that it cuts are open, and objects behind them are visible.

// Appends enough capsules behind the camera that nothing is traced directly.
std::vector<Primitive> with_company(std::vector<Primitive> primitives) {
  for (int i = 0; i < 600; ++i) {
    const Vec3 center(-3.0F - 0.01F * static_cast<float>(i % 30), 0.2F * static_cast<float>(i / 30) - 2.0F, 0.0F);
    primitives.push_back(primitive(capsule, center, {0.01F, 0.01F, 0.05F}));
  }
  return primitives;
}

// The camera is at the origin and looks along +x, in a room whose walls are 8 m away.
struct NearCase {
  const char* what;
  std::vector<Primitive> primitives;
  TriangleMesh mesh;
  Markers markers;
  float depth;  // at the image centre
};

std::vector<NearCase> near_cases() {
  const Quat facing = turned(90, Vec3::UnitY());
  TriangleMesh near_square;
  add_square(near_square, 0.3F, 2.0F);
  TriangleMesh squares = near_square;
  add_square(squares, 0.7F, 2.0F, 0, 1);
  const Primitive all_around = primitive(room, {0, 0, 0}, {8, 8, 8});
  return {
      {"a box it cuts", {all_around, primitive(box, {0.55F, 0, 0}, {0.25F, 3, 3})}, {}, {}, 0.8F},
      {"a box before it", {all_around, primitive(box, {0.3F, 0, 0}, {0.1F, 3, 3})}, {}, {}, 8.0F},
      {"a box about the camera", {all_around, primitive(box, {0, 0, 0}, {1, 1, 1})}, {}, {}, 1.0F},
      {"a turned box it cuts", {all_around, primitive(box, {0.55F, 0, 0}, {0.25F, 3, 3}, turned(180, {0, 0, 1}))}, {}, {}, 0.8F},
      {"a cylinder it cuts", {all_around, primitive(cylinder, {0.5F, 0, 0}, {0.3F, 0.3F, 2})}, {}, {}, 0.8F},
      {"a cylinder before it", {all_around, primitive(cylinder, {0.3F, 0, 0}, {0.1F, 0.1F, 2})}, {}, {}, 8.0F},
      {"a cylinder close by", {all_around, primitive(cylinder, {1.03F, 0, 0}, {0.5F, 0.5F, 2})}, {}, {}, 0.53F},
      {"a cylinder that lies",
       {all_around, primitive(cylinder, {0.5F, 0, 0}, {0.3F, 0.3F, 2}, turned(90, {1, 0, 0}))},
       {},
       {},
       0.8F},
      {"a sphere about the camera", {all_around, primitive(sphere, {0, 0, 0}, {0.4F, 0.4F, 0.4F})}, {}, {}, 8.0F},
      {"a large sphere about it", {all_around, primitive(sphere, {0, 0, 0}, {2, 2, 2})}, {}, {}, 2.0F},
      {"a sphere it cuts", {all_around, primitive(sphere, {0.5F, 0, 0}, {0.3F, 0.3F, 0.3F})}, {}, {}, 0.8F},
      {"a capsule it cuts", {all_around, primitive(capsule, {0.5F, 0, 0}, {0.3F, 0.3F, 1})}, {}, {}, 0.8F},
      {"a plane before it", {all_around, primitive(plane, {0.3F, 0, 0}, {2, 2, 0}, facing)}, {}, {}, 8.0F},
      {"a disc before it, a plane behind",
       {all_around, primitive(plane, {0.6F, 0, 0}, {2, 2, 0}, facing), primitive(disc, {0.3F, 0, 0}, {2, 2, 0}, facing)},
       {},
       {},
       0.6F},
      {"triangles before it", {all_around}, near_square, {}, 8.0F},
      {"triangles before and behind it", {all_around}, squares, {}, 0.7F},
      {"triangles alone", {}, squares, {}, 0.7F},
      {"a wall before it", {primitive(room, {-4.7F, 0, 0}, {5, 5, 5})}, {}, {}, kInfinity},
      {"a wall close by", {primitive(room, {-4.45F, 0, 0}, {5, 5, 5})}, {}, {}, 0.55F},
      {"a marker it cuts", {all_around}, {}, {.start = Vec3(0.6F, 0, 0)}, 8.0F},
      {"a marker about the camera", {all_around}, {}, {.start = Vec3(0, 0, 0), .goal = Vec3(4, 0, 0)}, 3.75F},
      {"a marker close by", {all_around}, {}, {.goal = Vec3(0.77F, 0, 0)}, 0.52F},
  };
}

TEST(CameraNear, SolidsThatItCutsAreOpen) {
  for (const NearCase& one : near_cases()) {
    for (const bool crowd : {false, true}) {
      SCOPED_TRACE(std::string(one.what) + (crowd ? ", in company" : ""));
      const auto world = make_world(crowd ? with_company(one.primitives) : one.primitives, one.markers, one.mesh);
      CameraConfig camera = camera_of(33, 21, 70.0F);
      camera.near_m = 0.5F;
      const auto batch = look(world, camera, {0, 0, 0});
      const float depth = pixel(*batch, 10, 16).depth;
      EXPECT_TRUE(depth == one.depth || std::abs(depth - one.depth) < 1e-5F) << depth << ", expected " << one.depth;
      EXPECT_EQ(pixel(*batch, 10, 16).instance == 0, one.depth == kInfinity);
      const Compared compared = expect_picture(*batch, 0, 0, crowd ? 7 : 1);
      EXPECT_GT(compared.clear, compared.pixels * 3 / 4);
    }
  }
}

TEST(CameraNear, LeavesNothingNearerInAnyPixel) {
  Random random(11);
  for (int i = 0; i < 30; ++i) {
    std::vector<Primitive> primitives{primitive(room, {0, 0, 0}, {6, 6, 6})};
    for (int k = 0; k < 12; ++k) {
      const PrimitiveKind kind = std::array{box, cylinder, sphere, capsule, plane, disc}[static_cast<std::size_t>(k) % 6];
      const float r = random.within(0.2F, 0.8F);
      Vec3 half(r, r, kind == capsule ? 2 * r : r);
      if (kind == plane || kind == disc) half.z() = 0.0F;
      const bool aligned = kind == sphere || k % 2 == 0;
      primitives.push_back(primitive(kind, random.point(1.2F), half, aligned ? Quat::Identity() : random.rotation()));
    }
    CameraConfig camera = camera_of(32, 24, 100.0F);
    camera.near_m = 0.6F;
    camera.far_m = 5.0F;
    const auto batch = look(make_world(primitives), camera, {0, 0, 0}, random.rotation());
    for (const float depth : batch->images(0).depth) ASSERT_TRUE(depth >= 0.6F && (depth <= 5.0F || depth == kInfinity)) << depth;
    expect_picture(*batch, 0, 0, 3);
  }
}

// -- The far plane and the sky.

TEST(CameraFar, IsAPlanarDepthAndSeenItself) {
  // A wall at 3 m, as a plane, as part of a room, and as triangles.
  TriangleMesh square;
  add_square(square, 3.0F, 50.0F);
  for (const auto& world : {make_world({primitive(plane, {3, 0, 0}, {50, 50, 0}, turned(90, Vec3::UnitY()))}),
                            make_world({primitive(room, {0, 0, 0}, {3, 50, 50})}), make_world({}, {}, square)}) {
    for (const auto& [far_m, is_seen] : {std::pair{2.999F, false}, {3.001F, true}, {100.0F, true}}) {
      CameraConfig camera = camera_of(20, 20, 100.0F);
      camera.far_m = far_m;
      const auto batch = look(world, camera, {0, 0, 0});
      EXPECT_EQ(count_of(*batch, 1), is_seen ? 400U : 0U) << far_m;
    }
  }
  CameraConfig camera = camera_of(20, 20, 100.0F);
  camera.far_m = 3.0F;
  EXPECT_EQ(count_of(*look(make_world({primitive(room, {0, 0, 0}, {3, 50, 50})}), camera, {0, 0, 0}), 1), 400U);
}

TEST(CameraSky, HasNoDepthIdsOrNormalAndTheColourOfItsDirection) {
  SceneDescription description;
  description.primitives = {primitive(sphere, {0, 0, -500}, {1, 1, 1})};
  description.light.zenith_color = {0.0F, 0.25F, 1.0F};
  description.light.horizon_color = {1.0F, 0.25F, 0.0F};
  description.light.gamma = 2.0F;
  const auto world = std::make_shared<const World>(description);
  CameraConfig camera = camera_of(31, 31, 80.0F);
  camera.quat_wxyz = wxyz(turned(-90, Vec3::UnitY()));  // up
  auto batch = look(world, camera, {0, 0, 0});
  EXPECT_EQ(pixel(*batch, 15, 15).rgb, (std::array{0, 128, 255}));  // sqrt(0.25) * 255 is 127.5
  EXPECT_EQ(expect_picture(*batch).sky, 961U);
  camera.quat_wxyz = wxyz(turned(-30, Vec3::UnitY()));  // halfway up: the mean of both colours
  batch = look(world, camera, {0, 0, 0});
  EXPECT_TRUE(testing::is_near(pixel(*batch, 15, 15).rgb, {180, 128, 180}));
  camera.quat_wxyz = wxyz(turned(20, Vec3::UnitY()));  // down: the horizon's colour
  batch = look(world, camera, {0, 0, 0});
  EXPECT_EQ(pixel(*batch, 15, 15).rgb, (std::array{255, 128, 0}));
  for (std::size_t i = 0; i < 31; ++i) {
    const Pixel is = pixel(*batch, i, 30 - i);
    EXPECT_EQ(is.depth, kInfinity);
    EXPECT_EQ(is.semantic, 0);
    EXPECT_EQ(is.instance, 0);
    EXPECT_EQ(is.normal, Vec3(0, 0, 0));
  }
}

// -- Semantic and instance ids.

// One primitive of each kind, two meshes of two materials each, and markers, every 30 degrees around the origin at 4 m, all in
// a room.
struct Ring {
  std::shared_ptr<const World> world;
  struct Thing {
    const char* what;
    int semantic, instance;
  };
  std::vector<Thing> things;  // by angle
  static Quat towards(std::size_t i) { return turned(30.0F * static_cast<float>(i), Vec3::UnitZ()); }
};

Ring ring() {
  SceneDescription description;
  description.materials.clear();
  for (int i = 0; i < 10; ++i) {
    const float part = 0.1F * static_cast<float>(i);
    // Some materials set their class, the others get a number.
    description.materials.push_back({std::string(1, static_cast<char>('a' + i)),
                                     {1.0F - part, part, 0.5F},
                                     static_cast<std::uint16_t>(i % 3 == 0 ? 1000 + i : 0)});
  }
  Ring ring;
  const auto at = [](std::size_t i) { return Vec3(Ring::towards(i) * Vec3(4, 0, 0)); };
  const std::vector<std::pair<PrimitiveKind, Vec3>> kinds{{box, {0.5F, 0.5F, 0.5F}},    {cylinder, {0.5F, 0.5F, 1}},
                                                          {sphere, {0.5F, 0.5F, 0.5F}}, {capsule, {0.5F, 0.5F, 1}},
                                                          {plane, {0.5F, 0.5F, 0}},     {disc, {0.5F, 0.5F, 0}}};
  description.primitives.push_back(primitive(room, {0, 0, 0}, {9, 9, 9}));
  const std::array names{"a box", "a cylinder", "a sphere", "a capsule", "a plane", "a disc"};
  for (std::size_t i = 0; i < kinds.size(); ++i) {
    const bool flat = kinds[i].first == plane || kinds[i].first == disc;
    const Quat facing = flat ? Ring::towards(i) * turned(90, Vec3::UnitY()) : Quat::Identity();
    description.primitives.push_back(primitive(kinds[i].first, at(i), kinds[i].second, facing));
    description.primitives.back().material = static_cast<std::uint16_t>(i + 1);
    // The room has instance 1, the others follow in this order. Material i has class i + 1, or 1000 + i.
    ring.things.push_back(
        {names[i], (i + 1) % 3 == 0 ? 1001 + static_cast<int>(i) : static_cast<int>(i) + 2, static_cast<int>(i) + 2});
  }
  // Two meshes. One half of each has material 7, the other material 8.
  for (std::size_t object = 0; object < 2; ++object) {
    TriangleMesh flat;
    add_square(flat, 4.0F, 0.5F, 0, static_cast<std::uint16_t>(object));
    const auto first = static_cast<std::int32_t>(description.mesh.vertices.size());
    for (const Vec3& vertex : flat.vertices) description.mesh.vertices.push_back(Ring::towards(6 + object) * vertex);
    for (std::size_t i = 0; i < 2; ++i) {
      auto triangle = flat.triangles[i];
      for (std::int32_t& vertex : triangle) vertex += first;
      description.mesh.triangles.push_back(triangle);
      description.mesh.materials.push_back(static_cast<std::uint16_t>(7 + i));
      description.mesh.objects.push_back(static_cast<std::uint16_t>(object));
    }
  }
  ring.things.push_back({"a mesh", 8, 8});  // 7 primitives precede it; material 7 has class 8, 8 has 9
  ring.things.push_back({"another mesh", 8, 9});
  description.markers = {.radius = 0.4F, .start = at(8), .waypoints = {at(9), at(10)}, .goal = at(11)};
  ring.things.push_back({"the start", kSemanticStart, 10});
  ring.things.push_back({"a waypoint", kSemanticWaypoint, 11});
  ring.things.push_back({"another waypoint", kSemanticWaypoint, 12});
  ring.things.push_back({"the goal", kSemanticGoal, 13});
  ring.world = std::make_shared<const World>(description);
  return ring;
}

TEST(CameraIds, OfEveryKindOfThing) {
  const Ring things = ring();
  Compared compared;
  for (std::size_t i = 0; i < things.things.size(); ++i) {
    SCOPED_TRACE(things.things[i].what);
    const auto batch = look(things.world, camera_of(33, 33, 30.0F), {0, 0, 0}, Ring::towards(i));
    // Slightly off the diagonal, where the materials of the meshes meet.
    EXPECT_EQ(pixel(*batch, 18, 15).semantic, i == 6 || i == 7 ? things.things[i].semantic : pixel(*batch, 16, 16).semantic);
    EXPECT_EQ(pixel(*batch, 18, 15).instance, things.things[i].instance);
    EXPECT_EQ(pixel(*batch, 18, 15).semantic, things.things[i].semantic);
    EXPECT_EQ(pixel(*batch, 0, 0).instance, 1) << "the room";
    EXPECT_EQ(pixel(*batch, 0, 0).semantic, 1000) << "the room's class";
    compared += expect_picture(*batch);
  }
  EXPECT_EQ(compared.elements.size(), 1U + 6U + 4U + 4U) << "room, primitives, triangles, markers";
}

TEST(CameraIds, AMarkerIsSeenOnlyFromOutside) {
  const Ring things = ring();
  for (std::size_t i = 8; i < 12; ++i) {  // from inside each marker towards the room's centre
    SCOPED_TRACE(things.things[i].what);
    const Vec3 place = Ring::towards(i) * Vec3(4.2F, 0, 0);
    const auto batch = look(things.world, camera_of(48, 48, 60.0F), place, Ring::towards(i) * turned(180, Vec3::UnitZ()));
    EXPECT_EQ(count_of(*batch, things.things[i].instance), 0U);
    EXPECT_GT(expect_picture(*batch).elements.size(), 2U);
  }
}

TEST(CameraIds, ALidarSeesNoMarkers) {
  BatchConfig config = testing::lidar_batch(1, {.max_range_m = 20.0F, .azimuth_deg = {0}, .elevation_deg = {0}});
  config.cameras = {camera_of(1, 1)};
  const Markers marker{.goal = Vec3(4, 0, 0)};
  Batch batch(config, {make_world({primitive(room, {0, 0, 0}, {9, 9, 9})}, marker)});
  batch.sense();
  EXPECT_EQ(batch.lidar_readings().ranges[0], 9.0F);
  EXPECT_EQ(pixel(batch, 0, 0).depth, 3.75F);
}

// -- Colours and normals against the formula.

// A room with one object, each with its own colour.
std::shared_ptr<const World> exhibit(const Primitive& thing, const Light& light) {
  SceneDescription description;
  description.light = light;
  description.materials = {{"walls", {0.9F, 0.85F, 0.8F}}, {"thing", {0.7F, 0.35F, 0.15F}}};
  if (thing.kind != room) description.primitives = {primitive(room, {0, 0, 0}, {12, 12, 12})};
  description.primitives.push_back(thing);
  description.primitives.back().material = 1;
  return std::make_shared<const World>(description);
}

const Light& evening() {
  static const Light light{.sun_direction = {-1, 2, 0.5F},
                           .sun_color = {1.2F, 0.8F, 0.3F},
                           .sky_ambient = {0.05F, 0.1F, 0.2F},
                           .ground_ambient = {0.15F, 0.1F, 0.02F},
                           .gamma = 1.6F};
  return light;
}

std::vector<Primitive> shapes(const Quat& rotation) {
  return {primitive(box, {0, 0, 0}, {1, 0.7F, 1.2F}, rotation),
          primitive(cylinder, {0, 0, 0}, {1, 1, 0.8F}, rotation),
          primitive(sphere, {0, 0, 0}, {1, 1, 1}),
          primitive(capsule, {0, 0, 0}, {0.6F, 0.6F, 1.3F}, rotation),
          primitive(plane, {0, 0, 0}, {1.2F, 0.8F, 0}, rotation),
          primitive(disc, {0, 0, 0}, {1, 1, 0}, rotation),
          primitive(room, {0, 0, 0}, {2.5F, 2, 1.5F}, Quat::Identity())};
}

TEST(CameraColors, OfEveryKindFromOutsideAndInside) {
  Random random(21);
  for (const Light& light : {Light(), evening()}) {
    for (const Quat& rotation : {Quat::Identity(), turned(50, Vec3::UnitZ()), random.rotation(), random.rotation()}) {
      for (const Primitive& shape : shapes(rotation)) {
        SCOPED_TRACE("kind " + std::to_string(static_cast<int>(shape.kind)));
        const auto world = exhibit(shape, light);
        Compared compared;
        for (int i = 0; i < 6; ++i) {
          const bool inside = i % 2 == 1;
          if (inside && (shape.kind == plane || shape.kind == disc)) continue;
          const Vec3 from = inside ? random.point(0.3F) : Vec3(3.2F * random.direction().normalized());
          const Quat facing = inside
                                  ? random.rotation()
                                  : testing::facing(Vec3::UnitX(), -from) * turned(70.0F * static_cast<float>(i), Vec3::UnitX());
          compared += expect_picture(*look(world, camera_of(40, 30, 70.0F), from, facing), 0, 0, 2);
        }
        EXPECT_GT(compared.clear, compared.pixels * 17 / 20);
        EXPECT_EQ(compared.elements.count(shape.kind == room ? 0 : 1), 1U) << "it was not seen";
      }
    }
  }
}

TEST(CameraColors, OfTrianglesFromBothSides) {
  for (const Light& light : {Light(), evening()}) {
    SceneDescription description;
    description.light = light;
    description.materials = {{"a", {0.9F, 0.2F, 0.1F}}, {"b", {0.1F, 0.8F, 0.3F}, 77}, {"c", {0.2F, 0.2F, 0.9F}}};
    Random random(22);
    for (int i = 0; i < 60; ++i) {
      const Vec3 corner = random.point(2.5F);
      for (int k = 0; k < 3; ++k) description.mesh.vertices.push_back(corner + random.point(0.9F));
      description.mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
      description.mesh.materials.push_back(static_cast<std::uint16_t>(i % 3));
      description.mesh.objects.push_back(static_cast<std::uint16_t>(i / 20));
    }
    const auto world = std::make_shared<const World>(description);
    Compared compared;
    for (int i = 0; i < 8; ++i)
      compared += expect_picture(*look(world, camera_of(40, 30), random.point(2.0F), random.rotation()), 0, 0, 2);
    EXPECT_GT(compared.clear, compared.pixels * 3 / 4);
    EXPECT_GT(compared.elements.size(), 30U);
    EXPECT_GT(compared.sky, 100U);
  }
}

TEST(CameraColors, GreyIsTheWeightedMeanOfRgb) {
  const Ring things = ring();
  CameraConfig grey_alone = camera_of(64, 48);
  grey_alone.outputs = {.rgb = false, .grey = true};
  const auto both = look(things.world, camera_of(64, 48), {0.5F, 0, 0});
  const auto alone = look(things.world, grey_alone, {0.5F, 0, 0});
  for (std::size_t i = 0; i < 64 * 48; ++i) {
    const Pixel is = pixel(*both, i / 64, i % 64);
    const double mean = 0.299 * is.rgb[0] + 0.587 * is.rgb[1] + 0.114 * is.rgb[2];
    ASSERT_EQ(is.grey, static_cast<int>(std::floor(mean + 0.5 + 1e-9))) << mean;
  }
  EXPECT_EQ(both->images(0).grey, alone->images(0).grey);
  EXPECT_GT((std::set<std::uint8_t>(alone->images(0).grey.begin(), alone->images(0).grey.end()).size()), 10U);
}

TEST(CameraColors, SamplesAreTheMeanOfAPictureOfSmallerPixels) {
  const Ring things = ring();
  for (const int side : {2, 3, 4}) {
    for (const bool shadows : {false, true}) {
      SCOPED_TRACE(std::to_string(side) + (shadows ? " with shadows" : ""));
      CameraConfig camera = camera_of(37, 21);
      camera.shadows = shadows;
      const auto plain = look(things.world, camera, {0.3F, 0.2F, 0.1F});
      CameraConfig fine = camera;
      fine.width_px *= side;
      fine.height_px *= side;
      const auto finer = look(things.world, fine, {0.3F, 0.2F, 0.1F});
      camera.samples_per_pixel = side * side;
      const auto smooth = look(things.world, camera, {0.3F, 0.2F, 0.1F});
      std::size_t smoothed = 0;
      for (std::size_t i = 0; i < 37 * 21; ++i) {
        const Pixel is = pixel(*smooth, i / 37, i % 37);
        const auto n = static_cast<std::size_t>(side);
        std::array<int, 3> sum{};
        for (std::size_t k = 0; k < n * n; ++k) {
          const Pixel part = pixel(*finer, n * (i / 37) + k / n, n * (i % 37) + k % n);
          for (std::size_t c = 0; c < 3; ++c) sum[c] += part.rgb[c];
        }
        for (std::size_t c = 0; c < 3; ++c) {
          ASSERT_EQ(is.rgb[c], static_cast<int>(std::lround(static_cast<double>(sum[c]) / (side * side)))) << "pixel " << i;
        }
        // The other outputs belong to the pixel's centre.
        const Pixel centre = pixel(*plain, i / 37, i % 37);
        ASSERT_EQ(is.depth, centre.depth);
        ASSERT_EQ(is.semantic, centre.semantic);
        ASSERT_EQ(is.instance, centre.instance);
        ASSERT_EQ(is.normal, centre.normal);
        smoothed += is.rgb != centre.rgb;
      }
      EXPECT_GT(smoothed, 30U);
    }
  }
}

// -- Shadows.

// Objects above a floor in the sun, a room around them, and a marker.
std::shared_ptr<const World> yard(bool with_mesh) {
  SceneDescription description;
  description.light.sun_direction = {0.5F, 0.3F, 0.8F};
  description.primitives = {primitive(room, {0, 0, 3}, {6, 6, 3}),
                            primitive(box, {1.5F, 1, 0.6F}, {0.4F, 0.3F, 0.6F}, turned(20, Vec3::UnitZ())),
                            primitive(cylinder, {-1, 1.5F, 1}, {0.3F, 0.3F, 1}),
                            primitive(sphere, {0.5F, -1.5F, 1.2F}, {0.5F, 0.5F, 0.5F}),
                            primitive(capsule, {-1.8F, -1, 1}, {0.25F, 0.25F, 0.8F}, turned(40, {1, 1, 0})),
                            primitive(plane, {2.5F, -2, 1.5F}, {0.6F, 0.4F, 0}),
                            primitive(disc, {-3, 0.5F, 1.5F}, {0.5F, 0.5F, 0}, turned(30, {1, 0, 0}))};
  description.markers.goal = Vec3(3, 3, 1);
  if (with_mesh) {
    description.mesh.vertices = {{0, 3, 1}, {1.5F, 3, 1}, {0.5F, 4, 2}, {-0.5F, 2.5F, 0.5F}};
    description.mesh.triangles = {{0, 1, 2}, {0, 2, 3}};
  }
  return std::make_shared<const World>(description);
}

TEST(CameraShadows, AgreeWithTheOracle) {
  Random random(31);
  for (const bool with_mesh : {false, true}) {
    const auto world = yard(with_mesh);
    Compared compared;
    for (int i = 0; i < 10; ++i) {
      const Vec3 from(random.within(-5, 5), random.within(-5, 5), random.within(2.5F, 5.5F));
      CameraConfig camera = camera_of(64, 48, 80.0F);
      camera.shadows = true;
      const Quat facing = testing::facing(Vec3::UnitX(), Vec3(0, 0, 0.5F) - from);
      compared += expect_picture(*look(world, camera, from, facing), 0, 0, 5);
    }
    EXPECT_GT(compared.clear, compared.pixels * 8 / 10);
    EXPECT_GT(compared.shaded, 150U);
    EXPECT_GT(compared.lit, 1000U);
  }
}

TEST(CameraShadows, OfACrowdAreTheSame) {
  const auto alone = yard(false);
  std::vector<Primitive> primitives(alone->primitives().begin(), alone->primitives().end());
  for (int i = 0; i < 30; ++i) {  // below the floor; too many to be traced without Embree
    primitives.push_back(primitive(sphere, {static_cast<float>(i % 6), static_cast<float>(i / 6), -5}, Vec3::Constant(0.1F)));
  }
  SceneDescription description;
  description.light = alone->light();
  description.markers = alone->markers();
  description.primitives = primitives;
  CameraConfig camera = camera_of(64, 48, 80.0F);
  camera.outputs.instance = false;
  camera.shadows = true;
  const Quat facing = testing::facing(Vec3::UnitX(), Vec3(1, -1, -1));
  const auto few = look(alone, camera, {-3, 3, 4}, facing);
  const auto many = look(std::make_shared<const World>(description), camera, {-3, 3, 4}, facing);
  EXPECT_EQ(few->images(0).rgb, many->images(0).rgb);
  camera.shadows = false;
  EXPECT_NE(look(alone, camera, {-3, 3, 4}, facing)->images(0).rgb, few->images(0).rgb);
}

TEST(CameraShadows, AreNotCastIntoRoomsByTheirWallsNorByMarkers) {
  // The sun is overhead, behind the ceiling. The floor has a shadow below the sphere and none below the marker.
  SceneDescription description;
  description.light.sun_direction = {0, 0, 1};
  description.primitives = {primitive(room, {0, 0, 2}, {4, 4, 2}), primitive(sphere, {-1, 0, 3}, {0.25F, 0.25F, 0.25F})};
  description.markers.goal = Vec3(1, 0, 3);
  const auto world = std::make_shared<const World>(description);
  CameraConfig camera = camera_of(41, 41);
  camera.quat_wxyz = wxyz(turned(90, Vec3::UnitY()));  // down, so that up in the image is +x
  camera.shadows = true;
  const auto batch = look(world, camera, {0, 0, 2.05F});  // 10 pixels per metre
  EXPECT_EQ(count_of(*batch, 1), 41U * 41U) << "the floor alone is seen";
  const Pixel open = pixel(*batch, 20, 20);
  EXPECT_EQ(pixel(*batch, 10, 20).rgb, open.rgb) << "below the marker";
  EXPECT_LT(pixel(*batch, 30, 20).rgb[0], open.rgb[0]) << "below the sphere";
  EXPECT_EQ(pixel(*batch, 30, 20).depth, open.depth);
  std::size_t dark = 0;
  for (std::size_t i = 0; i < 41 * 41; ++i) dark += pixel(*batch, i / 41, i % 41).rgb[0] < open.rgb[0];
  EXPECT_NEAR(static_cast<double>(dark), std::numbers::pi * 2.5 * 2.5, 3.0);
  camera.shadows = false;
  EXPECT_EQ(pixel(*look(world, camera, {0, 0, 2.05F}), 30, 20).rgb, open.rgb);
}

// -- Shortcuts do not change results.

TEST(CameraShortCuts, TilesOfOneFace) {
  Random random(41);
  for (int i = 0; i < 40; ++i) {
    // Views inside a room, inside and in front of a box, and in front of a plane, at corners, edges and faces.
    const Quat rotation = i % 3 == 0 ? Quat::Identity() : random.rotation();
    std::vector<Primitive> primitives{primitive(room, {0, 0, 0}, {3, 2, 1.5F})};
    const Vec3 center(0.5F, 0, 0);
    if (i % 4 == 1) primitives.push_back(primitive(box, center, {0.8F, 0.9F, 0.7F}, rotation));
    if (i % 4 == 2) primitives.push_back(primitive(plane, center, {1.5F, 1.5F, 0}, rotation));
    const auto world = make_world(primitives);
    const Vec3 from = i % 2 == 0 ? Vec3(center + random.point(0.6F))
                                 : Vec3(random.within(-2.8F, -0.6F), random.within(-1.8F, 1.8F), random.within(-1.3F, 1.3F));
    CameraConfig camera = camera_of(96, 64, std::array{40.0F, 90.0F, 130.0F}[static_cast<std::size_t>(i) % 3]);
    camera.near_m = i % 5 == 0 ? 0.5F : 0.05F;
    EXPECT_GT(expect_picture(*look(world, camera, from, random.rotation()), 0, 0, 5).clear, 500U);
  }
}

TEST(CameraShortCuts, AreTheGeneralFormula) {
  // With shadows on, every pixel is shaded separately. The only visible shadow is the pillar's on the wall behind it.
  SceneDescription description;
  description.light.sun_direction = {-1, 0.3F, 0.4F};
  description.primitives = {primitive(room, {0, 0, 2}, {6, 6, 2})};
  const auto empty = std::make_shared<const World>(description);
  description.primitives.push_back(primitive(box, {3, 0, 2}, {0.5F, 5, 1.9F}));
  const auto wall = std::make_shared<const World>(description);
  description.primitives.back() = primitive(cylinder, {3, 0, 2}, {0.7F, 0.7F, 1.9F});
  const auto pillar = std::make_shared<const World>(description);
  for (const auto& world : {empty, wall, pillar}) {
    CameraConfig camera = camera_of(96, 64, 30.0F);
    const auto quick = look(world, camera, {-2, 0, 2});
    camera.shadows = true;
    const auto general = look(world, camera, {-2, 0, 2});
    std::size_t different = 0;
    for (std::size_t i = 0; i < 96 * 64; ++i) {
      const Pixel a = pixel(*quick, i / 96, i % 96);
      const Pixel b = pixel(*general, i / 96, i % 96);
      ASSERT_EQ(a.depth, b.depth);
      ASSERT_EQ(a.semantic, b.semantic);
      ASSERT_EQ(a.instance, b.instance);
      ASSERT_EQ(a.normal, b.normal);
      different += a.rgb != b.rgb;
    }
    EXPECT_LT(different, 96U * 64U / 4U);
    if (world != pillar) {
      EXPECT_EQ(different, 0U);
    }
  }
}

TEST(CameraShortCuts, UprightPillarsHaveARampOfColours) {
  // Upright, upside-down and yawed cylinders use the colour ramp if it is fine enough, tilted ones use the formula. All are
  // within one level of it, in a strong and a weak sun, and in one too strong for any ramp.
  Light glare = evening();
  glare.sun_color = {100, 30, 8};
  glare.sky_ambient = glare.ground_ambient = {0, 0, 0};
  for (const Light& light : {Light(), evening(), glare}) {
    for (const Quat& rotation : {Quat::Identity(), Quat(0, 1, 0, 0), turned(77, Vec3::UnitZ()), turned(3, Vec3::UnitX())}) {
      const auto world = exhibit(primitive(cylinder, {0, 0, 0}, {0.8F, 0.8F, 5}, rotation), light);
      Compared compared;
      for (int i = 0; i < 8; ++i) {
        const Quat around = turned(45.0F * static_cast<float>(i), Vec3::UnitZ());
        compared += expect_picture(*look(world, camera_of(64, 16, 60.0F), around * Vec3(-2, 0, 0), around), 0, 0, 3);
      }
      EXPECT_GT(compared.lit, 1500U);
      EXPECT_EQ(compared.elements.count(1), 1U);
    }
  }
}

// -- Layouts, sizes and outputs.

TEST(CameraLayout, ChannelFirstIsChannelLastTurned) {
  const Ring things = ring();
  for (const auto& [width, height] : {std::pair{1, 1}, {17, 3}, {33, 47}, {32, 16}}) {
    for (const int samples : {1, 4}) {
      CameraConfig camera = camera_of(width, height);
      camera.samples_per_pixel = samples;
      const std::vector<float> positions{0.3F, 0, 0, -0.4F, 0.2F, 0.5F};
      const auto shoot = [&](ImageLayout layout) {
        camera.layout = layout;
        auto batch = std::make_unique<Batch>(camera_batch(camera, 2), Batch::Worlds{things.world});
        batch->set_pose(positions, {});
        batch->sense();
        return batch;
      };
      const auto last = shoot(ImageLayout::hwc);
      const auto first = shoot(ImageLayout::chw);
      const auto w = static_cast<std::size_t>(width);
      const auto plane_size = w * static_cast<std::size_t>(height);
      const CameraImages& a = last->images(0);
      const CameraImages& b = first->images(0);
      ASSERT_EQ(a.rgb.size(), 2 * 3 * plane_size);
      ASSERT_EQ(b.rgb.size(), a.rgb.size());
      for (std::size_t drone = 0; drone < 2; ++drone) {
        for (std::size_t c = 0; c < 3; ++c) {
          for (std::size_t i = 0; i < plane_size; ++i) {
            const std::size_t of_drone = 3 * drone * plane_size;
            ASSERT_EQ(a.rgb[of_drone + 3 * i + c], b.rgb[of_drone + c * plane_size + i]);
            ASSERT_EQ(a.normal[of_drone + 3 * i + c], b.normal[of_drone + c * plane_size + i]);
          }
        }
      }
      EXPECT_EQ(a.depth, b.depth);
      EXPECT_EQ(a.semantic, b.semantic);
      EXPECT_EQ(a.instance, b.instance);
      EXPECT_EQ(a.grey, b.grey);
    }
  }
}

TEST(CameraOutputs, EachAloneEqualsItselfAmongAll) {
  const Ring things = ring();
  for (const int samples : {1, 4}) {
    CameraConfig camera = camera_of(33, 47);
    camera.samples_per_pixel = samples;
    const auto all = look(things.world, camera, {0.3F, 0.2F, 0});
    const CameraImages& every = all->images(0);
    const auto alone = [&](const CameraOutputs& outputs) {
      camera.outputs = outputs;
      const auto batch = look(things.world, camera, {0.3F, 0.2F, 0});
      const CameraImages& images = batch->images(0);
      EXPECT_TRUE(images.rgb.empty() == !outputs.rgb && images.depth.empty() == !outputs.depth);
      EXPECT_TRUE(images.semantic.empty() == !outputs.semantic && images.instance.empty() == !outputs.instance);
      EXPECT_TRUE(images.normal.empty() == !outputs.normal && images.grey.empty() == !outputs.grey);
      return images;
    };
    EXPECT_EQ(alone({.rgb = true}).rgb, every.rgb);
    EXPECT_EQ(alone({.rgb = false, .depth = true}).depth, every.depth);
    EXPECT_EQ(alone({.rgb = false, .semantic = true}).semantic, every.semantic);
    EXPECT_EQ(alone({.rgb = false, .instance = true}).instance, every.instance);
    EXPECT_EQ(alone({.rgb = false, .normal = true}).normal, every.normal);
    EXPECT_EQ(alone({.rgb = false, .grey = true}).grey, every.grey);
  }
}

// -- Many objects and meshes, through every tracing path.

// Primitives of every kind in a ball around the origin, except close to the origin.
std::vector<Primitive> crowd(Random& random, int count, float reach, float size) {
  std::vector<Primitive> primitives{primitive(room, {0, 0, 0}, Vec3::Constant(1.5F * reach))};
  while (static_cast<int>(primitives.size()) <= count) {
    const std::size_t i = primitives.size();
    const PrimitiveKind kind = std::array{box, cylinder, sphere, capsule, plane, disc}[i % 6];
    const float r = random.within(0.3F, 1.0F) * size;
    Vec3 half(r, r, random.within(0.5F, 1.0F) * size);
    if (kind == capsule) half.z() += r;
    if (kind == sphere) half.z() = r;
    if (kind == plane || kind == disc) half.z() = 0.0F;
    const Vec3 center = random.point(reach);
    if (center.norm() < 0.2F * reach) continue;
    primitives.push_back(primitive(kind, center, half, kind == sphere || i % 2 == 0 ? Quat::Identity() : random.rotation()));
    primitives.back().material = static_cast<std::uint16_t>(i % 4);
  }
  return primitives;
}

std::shared_ptr<const World> crowded(unsigned seed, int primitives, float reach, int triangles) {
  Random random(seed);
  SceneDescription description;
  description.materials = {
      {"a", {0.9F, 0.2F, 0.1F}}, {"b", {0.1F, 0.8F, 0.3F}}, {"c", {0.2F, 0.3F, 0.9F}}, {"d", {0.8F, 0.8F, 0.8F}}};
  if (primitives > 0) description.primitives = crowd(random, primitives, reach, 0.06F * reach);
  for (int i = 0; i < triangles; ++i) {
    const Vec3 corner = reach * random.direction().normalized() * random.within(0.3F, 1.0F);
    for (int k = 0; k < 3; ++k) description.mesh.vertices.push_back(corner + random.point(0.15F * reach));
    description.mesh.triangles.push_back({3 * i, 3 * i + 1, 3 * i + 2});
    description.mesh.materials.push_back(static_cast<std::uint16_t>(i % 4));
    description.mesh.objects.push_back(static_cast<std::uint16_t>(i % 3));
  }
  description.markers = {.start = Vec3(0, 0, 0), .waypoints = {{0.5F * reach, 0, 0}}, .goal = Vec3(0, 0.5F * reach, 0)};
  return std::make_shared<const World>(description);
}

struct CrowdCase {
  const char* what;
  std::shared_ptr<const World> world;
};

const std::vector<CrowdCase>& crowds() {
  static const std::vector<CrowdCase> all{
      {"a few primitives", crowded(51, 8, 5, 0)},
      {"more than are traced without a common origin", crowded(52, 60, 5, 0)},
      {"more than 384 within reach, some of them in view", crowded(53, 450, 5, 0)},
      {"more than 512 within reach", crowded(54, 700, 5, 0)},
      {"a mesh", crowded(55, 0, 5, 150)},
      {"a few primitives and a mesh", crowded(56, 10, 5, 100)},
      {"a crowd and a mesh", crowded(57, 600, 5, 100)},
  };
  return all;
}

TEST(CameraCrowds, AgreeWithTheOracle) {
  for (const CrowdCase& one : crowds()) {
    SCOPED_TRACE(one.what);
    Random random(55);
    const std::size_t elements = one.world->primitives().size() + one.world->triangles().triangles.size();
    Compared compared;
    for (const auto& [width, height, fov] : {std::tuple{1, 1, 90.0F}, {17, 3, 90.0F}, {33, 47, 90.0F}, {64, 48, 160.0F}}) {
      for (const DepthKind kind : {DepthKind::planar, DepthKind::range}) {
        CameraConfig camera = camera_of(width, height, fov);
        camera.depth_kind = kind;
        camera.near_m = 0.1F;
        const auto batch = look(one.world, camera, random.point(1.0F), random.rotation());
        compared += expect_picture(*batch, 0, 0, width * height < 60 ? 1 : 1 + elements / 20);
      }
    }
    EXPECT_GT(compared.clear, compared.pixels / 2);
    EXPECT_GT(compared.elements.size(), 4U);
  }
}

// All 450 primitives are in view, so even a tile one pixel wide has too many to test one by one.
TEST(CameraCrowds, MoreInViewOfATileThanAreTracedDirectly) {
  Random random(58);
  SceneDescription description;
  for (int i = 0; i < 450; ++i) {
    const Vec3 center(random.within(8, 12), random.within(-1.2F, 1.2F), random.within(-1.2F, 1.2F));
    description.primitives.push_back(
        primitive(i % 2 == 0 ? sphere : box, center, Vec3::Constant(0.05F), i % 2 == 0 ? Quat::Identity() : random.rotation()));
  }
  const auto world = std::make_shared<const World>(description);
  const auto batch = look(world, camera_of(16, 16, 16.0F), {0, 0, 0});
  const Compared compared = expect_picture(*batch);
  EXPECT_GT(compared.clear, 100U);
  EXPECT_GT(compared.elements.size(), 30U);
  EXPECT_GT(compared.sky, 10U);
}

TEST(CameraCrowds, PacketsOfEitherShapeHitTheSame) {
  const auto world = crowded(59, 0, 5, 400);
  const std::unique_ptr<RTCDeviceTy, decltype(&rtcReleaseDevice)> device(rtcNewDevice(nullptr), &rtcReleaseDevice);
  const std::unique_ptr<RTCSceneTy, decltype(&rtcReleaseScene)> scene(rtcNewScene(device.get()), &rtcReleaseScene);
  rtcSetSceneFlags(scene.get(), RTC_SCENE_FLAG_ROBUST);
  RTCGeometry geometry = rtcNewGeometry(device.get(), RTC_GEOMETRY_TYPE_TRIANGLE);
  const TriangleMesh& mesh = world->triangles();
  auto* vertices = static_cast<float*>(
      rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_VERTEX, 0, RTC_FORMAT_FLOAT3, 3 * sizeof(float), mesh.vertices.size()));
  auto* indices = static_cast<unsigned int*>(rtcSetNewGeometryBuffer(geometry, RTC_BUFFER_TYPE_INDEX, 0, RTC_FORMAT_UINT3,
                                                                     3 * sizeof(unsigned int), mesh.triangles.size()));
  for (const Vec3& vertex : mesh.vertices) {
    for (int axis = 0; axis < 3; ++axis) *vertices++ = vertex[axis];
  }
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t index : triangle) *indices++ = static_cast<unsigned int>(index);
  }
  rtcSetGeometryMask(geometry, 0xFFFFFFFFU);
  rtcCommitGeometry(geometry);
  rtcAttachGeometry(scene.get(), geometry);
  rtcReleaseGeometry(geometry);
  rtcCommitScene(scene.get());

  const auto trace = [&](const render::PinholeCamera& pinhole, const render::PixelTile& tile, const Mat3& rotation, bool wide,
                         trace::RayBundle& rays, trace::HitDetails& details) {
    static const std::vector<float> ones(trace::kMaxRays + trace::kRayPadding, 1.0F);
    rays.origin = Vec3(0.1F, 0.2F, 0.3F);
    rays.rotation = rotation;
    rays.near = 0.05F;
    rays.range = 20.0F;
    rays.count = tile.height * render::PixelTile::kSide;
    rays.x = ones.data();
    rays.y = pinhole.grids[0].left.data() + tile.column * render::PixelTile::kSide;
    rays.z = pinhole.grids[0].up.data() + tile.row * render::PixelTile::kSide;
    std::fill_n(rays.t_hit, trace::kMaxRays, kInfinity);
    std::fill_n(rays.element, trace::kMaxRays, -1);
    const FlushDenormals flush;
    trace::trace_tile(scene.get(), 0, wide, trace::Through::nothing, rays, details);
  };
  Random random(60);
  const auto four = std::make_unique<trace::RayBundle>();
  const auto two = std::make_unique<trace::RayBundle>();
  trace::HitDetails of_four, of_two;
  std::size_t hits = 0;
  for (const auto& [width, height] : {std::pair{48, 48}, {17, 3}, {16, 7}, {5, 1}}) {
    const render::PinholeCamera pinhole = render::make_pinhole_camera(camera_of(width, height));
    for (int i = 0; i < 5; ++i) {
      const Mat3 rotation = random.rotation().toRotationMatrix();
      for (const render::PixelTile& tile : pinhole.tiles) {
        trace(pinhole, tile, rotation, true, *four, of_four);
        trace(pinhole, tile, rotation, false, *two, of_two);
        for (std::size_t ray = 0; ray < four->count; ++ray) {
          ASSERT_EQ(four->element[ray], two->element[ray]);
          if (four->element[ray] < 0) continue;
          ++hits;
          ASSERT_NEAR(four->t_hit[ray], two->t_hit[ray], 1e-6F * four->t_hit[ray]);
          const Vec3 a(of_four.normal_x[ray], of_four.normal_y[ray], of_four.normal_z[ray]);
          const Vec3 b(of_two.normal_x[ray], of_two.normal_y[ray], of_two.normal_z[ray]);
          ASSERT_LT((a - b).norm(), 1e-5F * a.norm());
          const auto& [first, second, third] = mesh.triangles[static_cast<std::size_t>(four->element[ray])];
          const auto corner = [&mesh](std::int32_t index) { return mesh.vertices[static_cast<std::size_t>(index)]; };
          const Vec3 point = four->origin + four->t_hit[ray] * four->direction(ray);
          for (const trace::HitDetails* of : {&of_four, &of_two}) {
            const float u = of->u[ray], v = of->v[ray];
            const Vec3 on_triangle = (1.0F - u - v) * corner(first) + u * corner(second) + v * corner(third);
            ASSERT_LT((on_triangle - point).norm(), 1e-3F);
          }
        }
      }
    }
  }
  EXPECT_GT(hits, 1000U);
}

// -- The same bits everywhere.

bool same_images(const CameraImages& a, const CameraImages& b) {
  return same_bits(a.rgb, b.rgb) && same_bits(a.depth, b.depth) && same_bits(a.semantic, b.semantic) &&
         same_bits(a.instance, b.instance) && same_bits(a.normal, b.normal) && same_bits(a.grey, b.grey) &&
         a.frame_step == b.frame_step;
}

TEST(CameraBits, AreTheSameOnEverySimdTarget) {
  const auto shoot = [](std::int64_t target) {
    const testing::OnTarget on(target);
    Random random(61);
    std::vector<CameraImages> pictures;
    // Scenes are rebuilt, because Embree's callback is chosen when a scene is made.
    for (const auto& world : {crowded(52, 60, 5, 0), crowded(54, 700, 5, 0), crowded(56, 10, 5, 100), ring().world, yard(true)}) {
      for (const int samples : {1, 4}) {
        CameraConfig camera = camera_of(49, 37);
        camera.samples_per_pixel = samples;
        camera.shadows = samples == 4;
        camera.depth_kind = samples == 4 ? DepthKind::range : DepthKind::planar;
        pictures.push_back(look(world, camera, random.point(0.5F) + Vec3(0, 0, 0.6F), random.rotation())->images(0));
      }
    }
    return pictures;
  };
  const std::vector<std::int64_t> targets = hwy::SupportedAndGeneratedTargets();
  ASSERT_FALSE(targets.empty());
  const std::vector<CameraImages> best = shoot(targets.front());
  for (const std::int64_t target : targets) {
    SCOPED_TRACE(hwy::TargetName(target));
    const std::vector<CameraImages> same = shoot(target);
    for (std::size_t i = 0; i < best.size(); ++i) EXPECT_TRUE(same_images(same[i], best[i])) << "picture " << i;
  }
}

// A bumpy grid of triangles that share edges. On it Embree's last bits depend on neighbouring rays.
std::shared_ptr<const World> hills() {
  TriangleMesh mesh;
  constexpr int kSide = 40;
  for (int i = 0; i <= kSide; ++i) {
    for (int k = 0; k <= kSide; ++k) {
      const float x = 0.2F * static_cast<float>(i) - 4.0F;
      const float y = 0.2F * static_cast<float>(k) - 4.0F;
      mesh.vertices.emplace_back(x, y, 0.4F * std::sin(2.0F * x) * std::cos(3.0F * y) - 1.5F);
    }
  }
  for (int i = 0; i < kSide; ++i) {
    for (int k = 0; k < kSide; ++k) {
      const int a = (kSide + 1) * i + k;
      mesh.triangles.push_back({a, a + kSide + 1, a + kSide + 2});
      mesh.triangles.push_back({a, a + kSide + 2, a + 1});
    }
  }
  return make_world({}, {}, mesh);
}

// The last rows of a tile are padded to whole packets. Rays traced there before must not matter.
TEST(CameraBits, OfAPictureDoNotDependOnTheOneBefore) {
  const auto world = hills();
  Random random(63);
  for (const auto& [width, height] : {std::pair{48, 1}, {48, 2}, {48, 3}, {16, 5}, {48, 19}}) {
    const Poses poses = random_poses(random, 15, Vec3::Constant(0.9F));
    CameraConfig small = camera_of(width, height);
    BatchConfig config = camera_batch(camera_of(64, 64));
    small.name = "small";
    config.cameras.push_back(small);
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    std::size_t different = 0;
    for (std::size_t drone = 0; drone < 15; ++drone) {
      Batch after(config, {world});  // captures the large image first
      Batch alone(camera_batch(small), {world});
      for (Batch* batch : {&after, &alone}) {
        batch->set_pose(testing::row(poses.position, drone, 3), testing::row(poses.quat_wxyz, drone, 4));
        batch->sense();
      }
      ASSERT_EQ(alone.images(0).depth.size(), pixels);
      different += !same_images(after.images(1), alone.images(0));
    }
    EXPECT_EQ(different, 0U) << "of 15 pictures of " << width << " x " << height;
  }
}

TEST(CameraBits, AreTheSameForAnyBlocksThreadsAndNeighbours) {
  // Images with padded last rows of tiles, in worlds in which padding could matter, and images with more tiles than are
  // rendered at once.
  const Batch::Worlds worlds{crowds()[1].world, crowds()[5].world, crowds()[6].world, hills()};
  for (const auto& [width, height, drones] : {std::tuple{35, 33, 12}, {170, 97, 4}}) {
    SCOPED_TRACE(width);
    CameraConfig camera = camera_of(width, height);
    camera.shadows = width == 35;
    Random random(62);
    const Poses poses = random_poses(random, drones, Vec3::Constant(0.9F));
    const auto shoot = [&, drone_count = drones](int block_size, int num_threads) {
      BatchConfig config = camera_batch(camera, drone_count);
      config.block_size = block_size;
      config.num_threads = num_threads;
      Batch batch(config, worlds);
      batch.set_pose(poses.position, poses.quat_wxyz);
      batch.sense();
      return batch.images(0);
    };
    const CameraImages images = shoot(64, 1);
    EXPECT_TRUE(same_images(images, shoot(1, 1)));
    EXPECT_TRUE(same_images(images, shoot(5, 2)));
    EXPECT_TRUE(same_images(images, shoot(1, 7)));
    const auto pixels = static_cast<std::size_t>(width) * static_cast<std::size_t>(height);
    for (std::size_t drone = 0; drone < static_cast<std::size_t>(drones); ++drone) {
      Batch alone(camera_batch(camera), {worlds[drone % 4]});
      alone.set_pose(testing::row(poses.position, drone, 3), testing::row(poses.quat_wxyz, drone, 4));
      alone.sense();
      const CameraImages& expected = alone.images(0);
      EXPECT_TRUE(same_bits(testing::row(images.rgb, drone, 3 * pixels), expected.rgb)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.depth, drone, pixels), expected.depth)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.semantic, drone, pixels), expected.semantic)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.instance, drone, pixels), expected.instance)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.normal, drone, 3 * pixels), expected.normal)) << drone;
      EXPECT_TRUE(same_bits(testing::row(images.grey, drone, pixels), expected.grey)) << drone;
    }
  }
}

}  // namespace
}  // namespace flockstep
