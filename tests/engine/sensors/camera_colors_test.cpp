// Colours, ids, shadows and layouts of images.
#include "sensors/camera_scenes.hpp"

namespace flockstep {
namespace {

using namespace scenes;

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
  BatchConfig config = lidar_batch(1, {.max_range_m = 20.0F, .azimuth_deg = {0}, .elevation_deg = {0}});
  config.cameras = {camera_of(1, 1)};
  const Markers marker{.goal = Vec3(4, 0, 0)};
  Batch batch(config, {make_world({primitive(room, {0, 0, 0}, {9, 9, 9})}, marker)});
  batch.sense();
  EXPECT_EQ(batch.lidar().readings().ranges[0], 9.0F);
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
  EXPECT_EQ(both->camera(0).images().grey, alone->camera(0).images().grey);
  EXPECT_GT((std::set<std::uint8_t>(alone->camera(0).images().grey.begin(), alone->camera(0).images().grey.end()).size()), 10U);
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

TEST(CameraColors, AdaptiveSamplesAreTakenWhereColoursDiffer) {
  for (const auto& [width, height] : {std::pair{1, 1}, {37, 21}, {70, 50}}) {
    for (const auto& world : {ring().world, yard(true)}) {
      for (const int samples : {4, 9, 16}) {
        CameraConfig camera = camera_of(width, height);
        camera.shadows = true;
        const auto shoot = [&] { return look(world, camera, {-0.4F, 0.2F, 0.6F}, turned(40, Vec3::UnitZ())); };
        const auto plain = shoot();
        camera.samples_per_pixel = samples;
        const auto all = shoot();
        camera.adaptive_samples = true;
        const auto adaptive = shoot();
        std::size_t refined = 0, even = 0;
        const auto rows = static_cast<std::size_t>(height), columns = static_cast<std::size_t>(width);
        for (std::size_t i = 0; i < rows * columns; ++i) {
          const std::size_t row = i / columns, column = i % columns;
          std::array<int, 3> low{255, 255, 255}, high{};
          for (std::size_t r = row - std::min<std::size_t>(row, 1); r < std::min(row + 2, rows); ++r) {
            for (std::size_t k = column - std::min<std::size_t>(column, 1); k < std::min(column + 2, columns); ++k) {
              for (std::size_t c = 0; c < 3; ++c) {
                low[c] = std::min<int>(low[c], pixel(*plain, r, k).rgb[c]);
                high[c] = std::max<int>(high[c], pixel(*plain, r, k).rgb[c]);
              }
            }
          }
          const bool differs = high[0] - low[0] > 8 || high[1] - low[1] > 8 || high[2] - low[2] > 8;
          Pixel expected = pixel(*plain, row, column);
          expected.rgb = pixel(*(differs ? all : plain), row, column).rgb;
          const Pixel is = pixel(*adaptive, row, column);
          ASSERT_EQ(is.rgb, expected.rgb) << samples << " samples, row " << row << ", column " << column;
          ASSERT_EQ(std::tie(is.depth, is.semantic, is.instance, is.normal),
                    std::tie(expected.depth, expected.semantic, expected.instance, expected.normal));
          ASSERT_EQ(is.grey, pixel(*(differs ? all : plain), row, column).grey);
          (differs ? refined : even) += 1;
        }
        if (width > 1) {
          EXPECT_GT(refined, rows * columns / 20);
          EXPECT_GT(even, rows * columns / 5);
        }
      }
    }
  }
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
  EXPECT_EQ(few->camera(0).images().rgb, many->camera(0).images().rgb);
  camera.shadows = false;
  EXPECT_NE(look(alone, camera, {-3, 3, 4}, facing)->camera(0).images().rgb, few->camera(0).images().rgb);
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
    for (const int samples : {1, 4, 9}) {
      CameraConfig camera = camera_of(width, height);
      camera.samples_per_pixel = samples;
      camera.adaptive_samples = samples == 9;
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
      const CameraImages& a = last->camera(0).images();
      const CameraImages& b = first->camera(0).images();
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
  for (const int samples : {1, 4, 9}) {
    CameraConfig camera = camera_of(33, 47);
    camera.samples_per_pixel = samples;
    camera.adaptive_samples = samples == 9;
    const auto all = look(things.world, camera, {0.3F, 0.2F, 0});
    const CameraImages& every = all->camera(0).images();
    const auto alone = [&](const CameraOutputs& outputs) {
      camera.outputs = outputs;
      const auto batch = look(things.world, camera, {0.3F, 0.2F, 0});
      const CameraImages& images = batch->camera(0).images();
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

}  // namespace
}  // namespace flockstep
