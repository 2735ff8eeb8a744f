#include "render/textures.hpp"

#include "base/srgb.hpp"
#include "batch_helpers.hpp"
#include "meshes.hpp"
#include "on_target.hpp"
#include "picture_oracle.hpp"

namespace flockstep::render {
namespace {

using namespace testing;
using namespace flockstep::testing;
using enum PrimitiveKind;

// A floor with a repeated texture, a wall with a mirrored and clamped one, an oblique wall with rotated and sheared uv, and a
// plain one.
std::shared_ptr<const World> place() {
  SceneDescription scene;
  scene.textures = {patches(64, 64, 8, 1, {TextureWrap::repeat, TextureWrap::repeat}),
                    patches(48, 20, 5, 2, {TextureWrap::mirror, TextureWrap::clamp})};
  scene.materials = {Material{"plain", {0.3F, 0.5F, 0.7F}}, Material{"floor", {0.9F, 0.8F, 0.7F}, 0, std::uint16_t{0}},
                     Material{"wall", {0.7F, 0.9F, 0.8F}, 0, std::uint16_t{1}}};
  add_quad(scene, {-10, -10, 0}, {20, 0, 0}, {0, 20, 0}, 1, {{{0, 0}, {7.5F, 0}, {7.5F, 7.5F}, {0, 7.5F}}});
  add_quad(scene, {8, -6, 0}, {0, 9, 0}, {0, 0, 5}, 2, {{{-1.3F, 1.4F}, {2.2F, 1.4F}, {2.2F, -0.5F}, {-1.3F, -0.5F}}});
  add_quad(scene, {2, 2, 0.3F}, {2, 1, 1}, {-1, 2, 1}, 1, {{{0.1F, 0.2F}, {1.3F, 0.7F}, {0.9F, 1.9F}, {-0.3F, 1.4F}}});
  add_quad(scene, {2, -5, 0.5F}, {1, 1, 0}, {0, 0, 2}, 0, {});
  scene.primitives.push_back(primitive(box, {4, -1, 0.5F}, {0.4F, 0.4F, 0.5F}));
  return std::make_shared<const World>(std::move(scene));
}

CameraConfig camera_of(bool shadows) { return {.width_px = 160, .height_px = 120, .outputs = kAllOutputs, .shadows = shadows}; }

TEST(TexturedPictures, AgreeWithTheOracle) {
  const auto world = place();
  Compared all;
  for (const bool shadows : {false, true}) {
    Batch batch(camera_batch(camera_of(shadows), 3), {world});
    const Quat down(Eigen::AngleAxisf(0.5F, Vec3::UnitY()));
    const Quat aside(Eigen::AngleAxisf(-0.6F, Vec3::UnitZ()));
    std::vector<float> turns;
    for (const Quat& q : {Quat::Identity(), down, Quat(aside * down)}) turns.insert(turns.end(), {q.w(), q.x(), q.y(), q.z()});
    batch.set_pose(std::vector<float>{-4, 0, 1.5F, -1, 1, 3, 0, 0, 0.4F}, turns);
    batch.sense();
    for (std::size_t drone = 0; drone < 3; ++drone) all += expect_picture(batch, drone, 0, 7);
  }
  EXPECT_GT(all.clear, 10000U);
  for (const int element : {0, 1, 2, 3, 4, 5, 6, 7, 8}) EXPECT_TRUE(all.elements.contains(element)) << element;
}

// Neighbouring entries in a backend's arrays must not matter.
TEST(TexturedPictures, OfSeveralWorlds) {
  const auto textured = place();
  SceneDescription other;
  other.textures = {patches(5, 9, 1, 4, {TextureWrap::clamp, TextureWrap::mirror})};
  other.materials[0].texture = 0;
  add_quad(other, {3, -4, -2}, {0, 8, 1}, {0, -1, 6}, 0, {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}});
  SceneDescription plain;
  add_quad(plain, {3, -4, -2}, {0, 8, 1}, {0, -1, 6}, 0, {});
  const auto plain_world = std::make_shared<const World>(plain);
  Batch batch(camera_batch(camera_of(false), 4), {plain_world, textured, closet(), std::make_shared<const World>(other)});
  batch.set_pose(std::vector<float>{0, 0, 1, 0, 0, 1, 1, 1, 1, 0, 0, 1}, {});
  batch.sense();
  for (std::size_t drone = 0; drone < 4; ++drone) {
    EXPECT_EQ(batch.state().world_index[drone], static_cast<std::int32_t>(drone));
    EXPECT_GT(expect_picture(batch, drone, 0, 7).clear, 2000U);
  }
}

TEST(Textures, ColoursDoNotDependOnOtherOutputs) {
  const auto world = place();
  CameraConfig camera = camera_of(false);
  const auto all = testing::look(world, camera, {-4, 0, 1.5F});
  camera.outputs = {.rgb = true};
  const auto alone = testing::look(world, camera, {-4, 0, 1.5F});
  const auto &expected = all->camera(0).images().rgb, &found = alone->camera(0).images().rgb;
  EXPECT_TRUE(std::equal(expected.begin(), expected.end(), found.begin(), found.end()));
}

TEST(Textures, ABorderShowsTheWrappedTexture) {
  for (const TextureWrap across : {TextureWrap::repeat, TextureWrap::mirror, TextureWrap::clamp}) {
    for (const TextureWrap down : {TextureWrap::repeat, TextureWrap::mirror, TextureWrap::clamp}) {
      const std::vector<Texture> images{patches(5, 3, 1, 1, {}), patches(13, 6, 1, 3, {across, down})};
      const Textures textures(images);
      const auto level = static_cast<std::size_t>(textures.first_level[1]);
      const auto texel = [&](int row, int column) {
        return textures.texels[static_cast<std::size_t>(textures.offset[level] + row * textures.stride[level] + column)];
      };
      const auto within = [](int at, int size, TextureWrap wrap) {
        return wrap == TextureWrap::repeat ? (at + size) % size : std::clamp(at, 0, size - 1);
      };
      for (int row = -1; row <= 6; ++row) {
        for (int column = -1; column <= 13; ++column) {
          EXPECT_EQ(texel(row, column), texel(within(row, 6, down), within(column, 13, across)));
        }
      }
    }
  }
}

TEST(Textures, EverySimdTargetShowsTheSameBits) {
  const auto world = place();
  std::vector<std::vector<std::uint8_t>> pictures;
  on_every_target([&] {
    const auto batch = testing::look(world, camera_of(true), {-4, 0, 1.5F});
    const auto& rgb = batch->camera(0).images().rgb;
    pictures.emplace_back(rgb.begin(), rgb.end());
    EXPECT_EQ(pictures.back(), pictures.front());
  });
}

// Transparent texels do not contribute colour to coarser levels. If all texels are transparent, the colour is their plain mean.
TEST(Textures, LevelsAreMeansOfLinearValuesByAlpha) {
  constexpr std::array kRepeat{TextureWrap::repeat, TextureWrap::repeat};
  std::vector<Texture> images{patches(13, 6, 1, 3, kRepeat, true)};
  for (const std::size_t texel : {0U, 1U, 13U, 14U, 30U}) images[0].rgba[4 * texel + 3] = 0;
  for (const auto& [width, height] : {std::pair(13, 6), std::pair(16, 8), std::pair(12, 10), std::pair(4, 1), std::pair(1, 6)}) {
    images.push_back(patches(width, height, 1, 3, kRepeat));
  }
  for (const Texture& image : images) {
    const bool has_alphas = &image == images.data();
    const Textures textures(std::vector<Texture>{image}, {has_alphas});
    const auto levels = oracle::mip_levels(image, has_alphas);
    ASSERT_EQ(textures.num_levels, std::vector<std::int32_t>{static_cast<std::int32_t>(levels.size())});
    for (std::size_t level = 0; level < levels.size(); ++level) {
      ASSERT_EQ(textures.width[level], levels[level].width);
      ASSERT_EQ(textures.height[level], levels[level].height);
      for (int row = 0; row < levels[level].height; ++row) {
        for (int column = 0; column < levels[level].width; ++column) {
          const std::uint32_t texel =
              textures.texels[static_cast<std::size_t>(textures.offset[level] + row * textures.stride[level] + column)];
          for (Eigen::Index c = 0; c < 3; ++c) {
            const int byte = static_cast<int>(texel >> (8 * c) & 0xFF);
            EXPECT_NEAR(byte, oracle::rounded_to_byte(levels[level].at(row, column)[c]), level == 0 ? 0 : 1) << level;
          }
          if (!has_alphas) continue;
          const double alpha = levels[level].alpha[static_cast<std::size_t>(row * levels[level].width + column)];
          EXPECT_NEAR(static_cast<double>(texel >> 24U), alpha, level == 0 ? 0 : 1) << level;
        }
      }
    }
  }
}

// These bits decide pictures that users have stored.
TEST(Textures, ALevelOfEvenSizeHasTheBitsOfASumInOrder) {
  const Texture image = patches(64, 32, 1, 5, {TextureWrap::clamp, TextureWrap::clamp});
  const Textures textures(std::vector<Texture>{image});
  const std::array<float, 256>& linear = srgb_to_linear();
  for (int row = 0; row < 16; ++row) {
    for (int column = 0; column < 32; ++column) {
      const std::uint32_t texel =
          textures.texels[static_cast<std::size_t>(textures.offset[1] + row * textures.stride[1] + column)];
      for (std::size_t c = 0; c < 3; ++c) {
        float mean = 0.0F;
        for (const int at : {0, 1, 64, 65}) {
          mean += 0.5F * 0.5F * linear[image.rgba[4 * static_cast<std::size_t>(128 * row + 2 * column + at) + c]];
        }
        ASSERT_EQ(texel >> 8 * c & 0xFF, linear_to_srgb(mean));
      }
      ASSERT_EQ(texel >> 24, 0U);
    }
  }
}

TEST(Textures, CoordinatesAreKeptOnlyWhereAMaterialHasATexture) {
  SceneDescription scene;
  add_quad(scene, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 0, {{{0, 0}, {1, 0}, {1, 1}, {0, 1}}});
  EXPECT_TRUE(World(scene).triangles().uv.empty());
  scene.textures = {patches(2, 2, 1, 1, {})};
  scene.materials[0].texture = 0;
  EXPECT_EQ(World(scene).triangles().uv, scene.mesh.uv);
  scene.mesh.uv.clear();
  EXPECT_EQ(World(scene).triangles().uv, (std::vector<std::array<float, 2>>(4)));
}

TEST(Textures, BadOnesAreRefused) {
  SceneDescription good;
  good.textures = {patches(2, 3, 1, 1, {})};
  good.materials[0].texture = 0;
  add_quad(good, {0, 0, 0}, {1, 0, 0}, {0, 1, 0}, 0, {});
  const auto refusal = [&](const auto& spoil) {
    SceneDescription scene = good;
    spoil(scene);
    return testing::refusal([&] { World world(std::move(scene)); });
  };
  EXPECT_EQ(refusal([](auto&) {}), "accepted");
  EXPECT_TRUE(names(refusal([](auto& s) { s.materials[0].texture = 1; }), "materials[0].texture: ... 1 ... 1"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.textures[0].width_px = 0; }), "textures[0]: ... 1 ... 16384 ... 0"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.textures[0].height_px = 16385; }), "textures[0]: ... 1 ... 16384 ... 16385"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.textures[0].rgba.pop_back(); }), "textures[0].rgba: ... 24 ... 23"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.mesh.uv.pop_back(); }), "mesh.uv: ... (4) ... 3"));
  EXPECT_TRUE(names(refusal([](auto& s) { s.mesh.uv[2][1] = std::nanf(""); }), "mesh.uv[2]: ... +-1e+06 ... nan"));
}

}  // namespace
}  // namespace flockstep::render
