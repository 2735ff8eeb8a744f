#include "render/renderer.hpp"

#include <chrono>

#include "batch_helpers.hpp"
#include "faulty_driver.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep::render {
namespace {

using namespace testing;
using namespace flockstep::testing;

// Some images of a playground, with their buffers.
struct PlaygroundAlbum {
  static constexpr std::size_t kBytes = 32 * 24 * 3;

  std::shared_ptr<const World> world = playground("camera-train-1");
  CameraConfig camera{.width_px = 32, .height_px = 24};
  CameraOptics optics = make_camera_optics(camera);
  std::vector<std::uint8_t> rgb = std::vector<std::uint8_t>(4 * kBytes);
  std::vector<RenderRequest> requests;

  PlaygroundAlbum() {
    Random random(3);
    for (std::size_t i = 0; i < 4; ++i) {
      requests.push_back({.world = world.get(),
                          .scene = &prepared(*world).scene(),
                          .shading = &prepared(*world).shading(),
                          .camera = &camera,
                          .optics = &optics,
                          .position = Vec3(7, 7, 2) + random.point(1.5F),
                          .rotation = random.rotation().toRotationMatrix(),
                          .frame = RenderTargets{.rgb = rgb.data() + i * kBytes}});
    }
  }
  PlaygroundAlbum(const PlaygroundAlbum&) = delete;
  PlaygroundAlbum& operator=(const PlaygroundAlbum&) = delete;

  std::vector<std::uint8_t> take(Renderer& renderer, Workers& workers) {
    std::fill(rgb.begin(), rgb.end(), std::uint8_t{0});
    renderer.start(requests);
    renderer.finish(requests, workers);
    return rgb;
  }
};

enum class Trouble { none_there, error, hang };

class RendererInTrouble : public ::testing::TestWithParam<Trouble> {};

TEST_P(RendererInTrouble, RaycastRendersInsteadAndOneWarningSaysWhy) {
  const Trouble trouble = GetParam();
  try {
    const GlRenderer good;
  } catch (const GlUnavailable& error) {
    ASSERT_NE(std::string(error.what()).find("not installed"), std::string::npos) << error.what();
    GTEST_SKIP() << error.what();
  }
  Workers workers(2);
  PlaygroundAlbum album;
  Renderer reference(CameraBackend::raycast, workers);
  const std::vector<std::uint8_t> expected = album.take(reference, workers);
  EXPECT_TRUE(std::any_of(expected.begin(), expected.end(), [](std::uint8_t value) { return value != 0; }));

  std::optional<FaultyDriver> driver;
  if (trouble == Trouble::none_there) setenv("FLOCKSTEP_EGL", "none", 1);
  if (trouble == Trouble::error) driver.emplace(FaultyDriver::Fault::error);
  if (trouble == Trouble::hang) driver.emplace(FaultyDriver::Fault::hang);
  {
    const auto patience = trouble == Trouble::hang ? std::chrono::milliseconds(200) : GlRenderer::kPatience;
    Renderer renderer(CameraBackend::gl, workers, patience);
    unsetenv("FLOCKSTEP_EGL");
    EXPECT_EQ(album.take(renderer, workers), expected);
    const std::string why = trouble == Trouble::none_there ? "EGL is switched off by FLOCKSTEP_EGL=none"
                            : trouble == Trouble::error    ? "OpenGL failed with error 1285"
                                                           : "the OpenGL driver did not answer within 200 ms";
    EXPECT_EQ(renderer.take_warning(), "cameras: gl is not available; raycast renders instead: " + why);
    EXPECT_EQ(renderer.report(), "raycast: gl is not available (" + why + ")");
    EXPECT_EQ(album.take(renderer, workers), expected);
    EXPECT_EQ(renderer.take_warning(), "");
  }
}

INSTANTIATE_TEST_SUITE_P(All, RendererInTrouble, ::testing::Values(Trouble::none_there, Trouble::error, Trouble::hang));

TEST(Renderer, AutoIsRaycast) {
  Workers workers(1);
  EXPECT_EQ(Renderer(CameraBackend::automatic, workers).report(), "raycast: the choice of auto");
}

}  // namespace
}  // namespace flockstep::render
