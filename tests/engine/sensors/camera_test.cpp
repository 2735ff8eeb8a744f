#include "sensors/camera.hpp"

#include "sensors/camera_scenes.hpp"

namespace flockstep {
namespace {

using namespace scenes;

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
    for (const float depth : batch->camera(0).images().depth)
      ASSERT_TRUE(depth >= 0.6F && (depth <= 5.0F || depth == kInfinity)) << depth;
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
  EXPECT_TRUE(is_near(pixel(*batch, 15, 15).rgb, {180, 128, 180}));
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

}  // namespace
}  // namespace flockstep
