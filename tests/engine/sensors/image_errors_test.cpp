// Errors of images: moments over a million pixels, within three standard errors. NumPy twins are in tests/python/sensors.
#include "on_target.hpp"
#include "render/camera_optics.hpp"
#include "sensors/color_errors.hpp"
#include "sensors/depth_errors.hpp"
#include "standard.hpp"

namespace flockstep::sensors {
namespace {

using namespace testing;

constexpr PhiloxInput kNoise{{0, 11, 3, 0}, {7, 0}}, kBlotches{{0, 12, 3, 0}, {7, 0}};
constexpr std::size_t kSide = 1000;  // px

// Returns an image of a wall that errs.
std::vector<float> reading(const DepthErrors& errors, float depth, std::size_t width = kSide, std::size_t height = kSide,
                           std::uint32_t number = 0) {
  std::vector<float> depths(width * height, depth);
  DepthScratch scratch;
  PhiloxInput noise = kNoise, blotches = kBlotches;
  noise.counter[2] = blotches.counter[2] = number;
  add_depth_errors(errors, blotch_threshold(errors.blotches), {.depths = depths, .width = width, .fx = 400.0F, .far_m = 100.0F},
                   noise, blotches, scratch);
  return depths;
}

// Expects that values are normally distributed: their mean, deviation, and share beyond three deviations.
void expect_normal(const std::vector<double>& values, double mean, double sigma) {
  const auto count = static_cast<double>(values.size());
  double sum = 0.0, squares = 0.0, far = 0.0;
  for (const double value : values) {
    sum += value - mean;
    squares += (value - mean) * (value - mean);
    far += std::abs(value - mean) > 3 * sigma ? 1 : 0;
  }
  EXPECT_LT(std::abs(sum / count), 3 * sigma / std::sqrt(count));
  EXPECT_LT(std::abs(std::sqrt(squares / count) - sigma), 3 * sigma / std::sqrt(2 * count));
  const double tail = std::erfc(3 / std::numbers::sqrt2);
  EXPECT_LT(std::abs(far / count - tail), 3 * std::sqrt(tail / count));
}

TEST(DepthErrors, DisparitiesHaveTheirNoise) {
  std::vector<double> disparities;  // 400 px * 0.05 m / 2 m = 10 px
  for (const float depth : reading({.baseline_m = 0.05F, .disparity_noise_px = 0.25F}, 2.0F)) disparities.push_back(20.0 / depth);
  expect_normal(disparities, 10.0, 0.25);
}

TEST(DepthErrors, DepthsHaveTheirNoise) {
  const std::vector<float> depths = reading({.noise_std_m = 0.02F, .noise_per_m = 0.01F}, 5.0F);
  expect_normal({depths.begin(), depths.end()}, 5.0, 0.02 + 0.01 * 5);
}

TEST(DepthErrors, DisparitiesAreRounded) {
  std::vector<float> fine = reading({.disparity_noise_px = 0.5F}, 2.0F);
  const std::vector<float> rounded = reading({.disparity_noise_px = 0.5F, .disparity_step_px = 0.25F}, 2.0F);
  std::size_t differ = 0;
  for (std::size_t i = 0; i < fine.size(); ++i) {
    const double steps = 20.0 / rounded[i] / 0.25;
    EXPECT_NEAR(steps, std::round(steps), 1e-4);
    differ += std::abs(20.0 / rounded[i] - std::round(20.0 / fine[i] / 0.25) * 0.25) > 1e-4 ? 1 : 0;
  }
  EXPECT_LT(differ, fine.size() / 10'000);  // numbers between two steps
}

TEST(DepthErrors, ShareOfDropouts) {
  for (const float share : {0.01F, 0.4F}) {
    const std::vector<float> depths = reading({.dropout = share, .hole_m = 0.0F}, 2.0F);
    const auto holes = static_cast<double>(std::ranges::count(depths, 0.0F));
    const double error = std::sqrt(share * (1 - share) / static_cast<double>(depths.size()));
    EXPECT_LT(std::abs(holes / static_cast<double>(depths.size()) - share), 3 * error);
    EXPECT_EQ(holes + static_cast<double>(std::ranges::count(depths, 2.0F)), static_cast<double>(depths.size()));
  }
}

TEST(DepthErrors, ShareAndSizeOfBlotches) {
  constexpr std::size_t kImages = 100, kWidth = 100;
  for (const float share : {0.02F, 0.3F}) {
    double sum = 0.0, squares = 0.0, same = 0.0, holes = 0.0;
    for (std::uint32_t image = 0; image < kImages; ++image) {
      const auto depths = reading({.blotches = share, .blotch_size_px = 8.0F}, 2.0F, kWidth, kWidth, image);
      const auto found = static_cast<double>(std::ranges::count(depths, kInfinity));
      sum += found;
      squares += found * found;
      for (std::size_t i = 0; i + 1 < depths.size(); ++i) {
        if ((i + 1) % kWidth == 0 || depths[i] != kInfinity) continue;
        holes += 1;
        same += depths[i + 1] == kInfinity ? 1 : 0;
      }
    }
    const double mean = sum / kImages, sigma = std::sqrt(squares / kImages - mean * mean);
    EXPECT_GT(sigma, 0.0);
    EXPECT_LT(std::abs(mean - share * kWidth * kWidth), 3 * sigma / std::sqrt(kImages));
    EXPECT_GT(same / holes, 0.7);  // in neighbours of a hole
  }
}

TEST(BlotchThreshold, IsTheQuantileOfNormalNumbers) {
  for (const double probability : {1e-6, 0.02, 0.5, 0.9}) {
    const auto threshold = static_cast<double>(blotch_threshold(static_cast<float>(probability)));
    EXPECT_NEAR(0.5 * std::erfc(-threshold / std::numbers::sqrt2), probability, 1e-5 * probability);
  }
  EXPECT_GT(blotch_threshold(1.0F), 8.0F);
}

TEST(ImageErrors, AreTheSameOnEveryTarget) {
  std::vector<float> depths;
  std::vector<std::uint8_t> colors;
  const DepthErrors errors{.baseline_m = 0.05F,
                           .edge_shadow = true,
                           .blotches = 0.2F,
                           .disparity_noise_px = 0.25F,
                           .disparity_step_px = 0.125F,
                           .noise_std_m = 0.01F,
                           .dropout = 0.1F};
  const ColorErrors noise{.vignetting = 0.5F, .exposure = 1.2F, .shot_noise = 0.05F, .read_noise = 0.02F, .gamma = 0.9F};
  const auto levels = make_levels(noise);
  const auto optics = render::make_camera_optics({.width_px = 37, .height_px = 21});
  on_every_target([&] {
    const std::vector<float> erring = reading(errors, 3.0F, 37, 21);
    std::vector<std::uint8_t> image(3 * 37 * 21, 90);
    ColorScratch scratch;
    add_color_errors(noise, levels, optics, {.values = image.data(), .width = 37, .height = 21, .planes = 1, .channels = 3},
                     kNoise, scratch);
    if (depths.empty()) depths = erring, colors = image;
    EXPECT_EQ(erring, depths);
    EXPECT_EQ(image, colors);
  });
}

TEST(ColorErrors, ABlackImageStaysBlackUnderAutoExposure) {
  const ColorErrors errors{.auto_exposure = 0.4F};
  std::vector<std::uint8_t> image(3 * 4 * 2);
  ColorScratch scratch;
  add_color_errors(errors, make_levels(errors), render::make_camera_optics({.width_px = 4, .height_px = 2}),
                   {.values = image.data(), .width = 4, .height = 2, .planes = 3, .channels = 1}, kNoise, scratch);
  EXPECT_EQ(image, std::vector<std::uint8_t>(image.size()));
}

TEST(ColorErrors, ColorsHaveTheirNoise) {
  const auto optics = render::make_camera_optics({.width_px = 1000, .height_px = 334});
  const ColorErrors errors{.exposure = 0.8F, .shot_noise = 0.08F, .read_noise = 0.03F};
  const std::vector<std::uint8_t> levels = make_levels(errors);
  const auto normal = [](double x) { return 0.5 * std::erfc(-x / std::numbers::sqrt2); };
  for (const int value : {10, 128, 250}) {
    std::vector<std::uint8_t> image(3 * 1000 * 334, static_cast<std::uint8_t>(value));
    ColorScratch scratch;
    add_color_errors(errors, levels, optics, {.values = image.data(), .width = 1000, .height = 334, .planes = 1, .channels = 3},
                     kNoise, scratch);
    // The expected distribution over the 4,096 levels of light, clipped to them.
    const double srgb = value / 255.0;
    const double light = 0.8 * (srgb <= 0.04045 ? srgb / 12.92 : std::pow((srgb + 0.055) / 1.055, 2.4));
    const double sigma = std::sqrt(0.08 * 0.08 * light + 0.03 * 0.03);
    double mean = 0.0, squares = 0.0, fourth = 0.0, below = 0.0;
    std::vector<double> shares, values;
    for (int i = 0; i < 4096; ++i) {
      const double up_to = i == 4095 ? 1.0 : normal(((i + 0.5) / 4095 - light) / sigma);
      const double level = i / 4095.0;
      const double encoded = level <= 0.0031308 ? 12.92 * level : 1.055 * std::pow(level, 1 / 2.4) - 0.055;
      shares.push_back(up_to - below);
      values.push_back(std::round(255 * encoded));
      mean += shares.back() * values.back();
      below = up_to;
    }
    for (std::size_t i = 0; i < values.size(); ++i) {
      const double off = values[i] - mean;
      squares += shares[i] * off * off;
      fourth += shares[i] * off * off * off * off;
    }
    const auto count = static_cast<double>(image.size());
    double found = 0.0, spread = 0.0;
    for (const std::uint8_t pixel : image) {
      found += pixel - mean;
      spread += (pixel - mean) * (pixel - mean);
    }
    EXPECT_LT(std::abs(found / count), 3 * std::sqrt(squares / count)) << value;
    EXPECT_LT(std::abs(spread / count - squares), 3 * std::sqrt((fourth - squares * squares) / count)) << value;
  }
}

}  // namespace
}  // namespace flockstep::sensors
