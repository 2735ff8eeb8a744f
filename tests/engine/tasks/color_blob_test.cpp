#include "tasks/color_blob.hpp"

#include <iterator>

#include "allocation_counter.hpp"
#include "flockstep/world.hpp"
#include "imaging/color_components.hpp"
#include "on_target.hpp"
#include "random.hpp"
#include "render/appearance.hpp"

namespace flockstep::task {
namespace {

using namespace testing;
using Color = std::array<float, 3>;   // linear
using Pixel = std::array<double, 3>;  // sRGB levels before rounding
constexpr Color kGoal = render::kGoalColor;
constexpr Color kWhite{0.9F, 0.9F, 0.9F};
constexpr Color kPillar{0.35F, 0.45F, 0.6F};
constexpr Color kRed = render::kStartColor;
constexpr Color kYellow = render::kWaypointColor;

// The light formula of world.hpp for a normal with this z and this cosine to the sun.
Pixel shown(const Color& base, double normal_z, double sun_cosine) {
  const Light light;
  Pixel pixel;
  for (std::size_t k = 0; k < 3; ++k) {
    const double up = (1.0 + normal_z) / 2.0;
    const double ambient =
        (1.0 - up) * static_cast<double>(light.ground_ambient[k]) + up * static_cast<double>(light.sky_ambient[k]);
    const double value = static_cast<double>(base[k]) * (static_cast<double>(light.sun_color[k]) * sun_cosine + ambient);
    pixel[k] = 255.0 * std::pow(std::min(value, 1.0), 1.0 / static_cast<double>(light.gamma));
  }
  return pixel;
}

Pixel sky(double up) {
  const Light light;
  Pixel pixel;
  for (std::size_t k = 0; k < 3; ++k) {
    const double value =
        (1.0 - up) * static_cast<double>(light.horizon_color[k]) + up * static_cast<double>(light.zenith_color[k]);
    pixel[k] = 255.0 * std::pow(value, 1.0 / static_cast<double>(light.gamma));
  }
  return pixel;
}

Pixel mixture(const Pixel& a, const Pixel& b, double share_of_a) {
  Pixel pixel;
  for (std::size_t k = 0; k < 3; ++k) pixel[k] = share_of_a * a[k] + (1.0 - share_of_a) * b[k];
  return pixel;
}

std::vector<Pixel> in_every_light(const Color& base) {
  std::vector<Pixel> pixels;
  for (int z = -4; z <= 4; ++z) {
    for (int cosine = 0; cosine <= 4; ++cosine) pixels.push_back(shown(base, z / 4.0, cosine / 4.0));
  }
  return pixels;
}

class Image {
 public:
  Image(int width, int height, ImageLayout layout) : width(width), height(height), layout(layout) {
    bytes.resize(3 * static_cast<std::size_t>(width) * static_cast<std::size_t>(height));
  }

  std::uint8_t& at(int x, int y, std::size_t channel) {
    const auto pixel = static_cast<std::size_t>(y) * static_cast<std::size_t>(width) + static_cast<std::size_t>(x);
    return bytes[layout == ImageLayout::hwc ? 3 * pixel + channel : channel * (bytes.size() / 3) + pixel];
  }
  void set(int x, int y, const Pixel& pixel) {
    for (std::size_t k = 0; k < 3; ++k) at(x, y, k) = static_cast<std::uint8_t>(std::lround(pixel[k]));
  }
  void fill(const Pixel& pixel) {
    for (int y = 0; y < height; ++y) {
      for (int x = 0; x < width; ++x) set(x, y, pixel);
    }
  }
  ColorBlob blob(ColorBlobScratch& scratch) const { return find_color(bytes, width, height, layout, ColorRange(), scratch); }
  ColorBlob blob() const {
    ColorBlobScratch scratch;
    return blob(scratch);
  }

  int width, height;
  ImageLayout layout;
  std::vector<std::uint8_t> bytes;
};

bool is_green(const Pixel& pixel) {
  Image image(1, 1, ImageLayout::hwc);
  image.fill(pixel);
  return image.blob().found;
}

// Finds the box pixel by pixel in integers.
ColorBlob by_brute_force(Image& image) {
  int left = image.width, top = image.height, right = -1, bottom = -1;
  for (int y = 0; y < image.height; ++y) {
    for (int x = 0; x < image.width; ++x) {
      const int larger = std::max(image.at(x, y, 0), image.at(x, y, 2));
      if (4 * image.at(x, y, 1) <= 5 * larger + 64) continue;
      left = std::min(left, x);
      right = std::max(right, x);
      top = std::min(top, y);
      bottom = std::max(bottom, y);
    }
  }
  if (right < 0) return {};
  const double width = right - left + 1;
  const double height = bottom - top + 1;
  return {.found = true,
          .x = left,
          .y = top,
          .width = right - left + 1,
          .height = bottom - top + 1,
          .offset = static_cast<float>((left + width / 2.0 - image.width / 2.0) / (image.width / 2.0)),
          .area = static_cast<float>(width * height / (static_cast<double>(image.width) * image.height))};
}

void expect_same(const ColorBlob& a, const ColorBlob& b) {
  EXPECT_EQ(a.found, b.found);
  EXPECT_EQ(a.x, b.x);
  EXPECT_EQ(a.y, b.y);
  EXPECT_EQ(a.width, b.width);
  EXPECT_EQ(a.height, b.height);
  EXPECT_FLOAT_EQ(a.offset, b.offset);
  EXPECT_FLOAT_EQ(a.area, b.area);
}

constexpr ImageLayout kLayouts[] = {ImageLayout::hwc, ImageLayout::chw};

// -- Bounding box.

TEST(GreenBlob, OfABoxByHand) {
  for (const ImageLayout layout : kLayouts) {
    Image image(64, 48, layout);
    image.fill(shown(kWhite, 0, 0.5));
    for (int y = 10; y < 14; ++y) {
      for (int x = 40; x < 48; ++x) image.set(x, y, shown(kGoal, 0, 0.5));
    }
    const ColorBlob blob = image.blob();
    EXPECT_TRUE(blob.found);
    EXPECT_EQ(blob.x, 40);
    EXPECT_EQ(blob.y, 10);
    EXPECT_EQ(blob.width, 8);
    EXPECT_EQ(blob.height, 4);
    EXPECT_EQ(blob.offset, 0.375F);  // centre at 44 px: 12 of 32 to the right
    EXPECT_EQ(blob.area, 32.0F / 3072.0F);
  }
}

TEST(GreenBlob, WithoutGreenNothingIsFound) {
  for (const ImageLayout layout : kLayouts) {
    Image image(20, 10, layout);
    image.fill(shown(kWhite, 0, 0.5));
    const ColorBlob blob = image.blob();
    EXPECT_FALSE(blob.found);
    EXPECT_EQ(blob.offset, 0.0F);
    EXPECT_EQ(blob.area, 0.0F);
  }
}

TEST(GreenBlob, OffsetReachesFromEdgeToEdge) {
  for (const ImageLayout layout : kLayouts) {
    for (const int width : {1, 2, 7, 64}) {
      for (int x = 0; x < width; ++x) {
        Image image(width, 3, layout);
        image.set(x, 1, shown(kGoal, 0, 0));
        const ColorBlob blob = image.blob();
        EXPECT_FLOAT_EQ(blob.offset, (static_cast<float>(x) + 0.5F) / (static_cast<float>(width) / 2.0F) - 1.0F);
        EXPECT_LT(std::abs(blob.offset), 1.0F);
      }
      Image image(width, 3, layout);
      image.fill(shown(kGoal, 0, 0));
      EXPECT_EQ(image.blob().offset, 0.0F);
      EXPECT_EQ(image.blob().area, 1.0F);
    }
  }
}

// -- Green threshold.

TEST(GreenBlob, TheGoalIsGreenInEveryLight) {
  for (const Pixel& pixel : in_every_light(kGoal)) EXPECT_TRUE(is_green(pixel)) << pixel[0] << ' ' << pixel[1] << ' ' << pixel[2];
}

TEST(GreenBlob, NothingElseIsAndNoEdgeBetweenTwoOthers) {
  std::vector<Pixel> others;
  for (const Color& color : {kWhite, kPillar, kRed, kYellow}) {
    const auto pixels = in_every_light(color);
    others.insert(others.end(), pixels.begin(), pixels.end());
  }
  for (int up = 0; up <= 10; ++up) others.push_back(sky(up / 10.0));
  others.push_back({0, 0, 0});
  Image image(static_cast<int>(others.size()), static_cast<int>(others.size()), ImageLayout::chw);
  for (const double share : {0.0, 0.2, 0.3, 0.4, 0.5}) {
    for (std::size_t a = 0; a < others.size(); ++a) {
      for (std::size_t b = 0; b < others.size(); ++b) {
        image.set(static_cast<int>(a), static_cast<int>(b), mixture(others[a], others[b], share));
      }
    }
    const ColorBlob blob = image.blob();
    EXPECT_FALSE(blob.found) << share << ": the mixture of " << blob.x << " and " << blob.y << " counts as green";
  }
}

TEST(GreenBlob, APartlyCoveredPixelCountsFromAboutAHalf) {
  for (const Color& behind : {kWhite, kPillar}) {
    for (const Pixel& goal : in_every_light(kGoal)) {
      for (const Pixel& other : in_every_light(behind)) {
        EXPECT_FALSE(is_green(mixture(goal, other, 0.3)));
        EXPECT_TRUE(is_green(mixture(goal, other, 0.65)));
      }
    }
    const Pixel goal = shown(kGoal, 0, 0.5);
    const Pixel other = shown(behind, 0, 0.5);
    EXPECT_TRUE(is_green(mixture(goal, other, 0.5)));
    EXPECT_FALSE(is_green(mixture(goal, other, 0.4)));
  }
}

// -- Comparison with brute force.

void agrees_with_brute_force() {
  Random random(1);
  ColorBlobScratch scratch;  // shared by all sizes, as in a worker
  int found = 0;
  for (int trial = 0; trial < 400; ++trial) {
    const bool large = trial % 50 == 0;
    const int width = 1 + static_cast<int>(random.generator()() % (large ? 500 : 40));
    const int height = 1 + static_cast<int>(random.generator()() % (large ? 400 : 30));
    for (const ImageLayout layout : kLayouts) {
      Image image(width, height, layout);
      // Dim noise with rare green, sometimes every colour.
      const unsigned range = trial % 3 == 0 ? 256 : 20;
      for (auto& byte : image.bytes) byte = static_cast<std::uint8_t>(random.generator()() % range);
      const ColorBlob blob = image.blob(scratch);
      expect_same(blob, by_brute_force(image));
      found += blob.found;
      std::size_t in_mask = 0;
      for (int y = 0; y < height; ++y) {
        for (int x = 0; x < width; ++x) {
          const int larger = std::max(image.at(x, y, 0), image.at(x, y, 2));
          const bool green = 4 * image.at(x, y, 1) > 5 * larger + 64;
          in_mask += green != (scratch.mask[static_cast<std::size_t>(y * width + x)] != 0);
        }
      }
      EXPECT_EQ(in_mask, 0U);
    }
  }
  EXPECT_GT(found, 200);
  EXPECT_LT(found, 780);
}

TEST(GreenBlob, AgreesWithBruteForceOnEveryTarget) {
  on_every_target([&] { agrees_with_brute_force(); });
}

TEST(GreenBlob, EveryTripleOfChannelsNearTheThreshold) {
  Image image(256, 256, ImageLayout::chw);
  ColorBlobScratch scratch;
  for (int green = 0; green < 256; ++green) {
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 256; ++x) {
        image.at(x, y, 0) = static_cast<std::uint8_t>(x);
        image.at(x, y, 1) = static_cast<std::uint8_t>(green);
        image.at(x, y, 2) = static_cast<std::uint8_t>(y);
      }
    }
    image.blob(scratch);
    for (int y = 0; y < 256; ++y) {
      for (int x = 0; x < 256; ++x) {
        ASSERT_EQ(scratch.mask[static_cast<std::size_t>(256 * y + x)] != 0, 4 * green > 5 * std::max(x, y) + 64)
            << x << ' ' << green << ' ' << y;
      }
    }
  }
}

// -- Any colour, and OpenCV's inRange and connectedComponentsWithStats.

// Returns the box around all components.
ColorBlob by_opencv(const Image& image, const ColorRange& range) {
  const imaging::ColorComponents found = imaging::find_components(image.bytes, image.width, image.height, image.layout, range);
  if (found.list.empty()) return {};
  int left = image.width, top = image.height, right = 0, bottom = 0;
  for (const imaging::ColorComponent& part : found.list) {
    left = std::min(left, part.x);
    top = std::min(top, part.y);
    right = std::max(right, part.x + part.width);
    bottom = std::max(bottom, part.y + part.height);
  }
  const auto half = static_cast<float>(image.width);
  const auto pixels = static_cast<float>(image.width * image.height);
  return {.found = true,
          .x = left,
          .y = top,
          .width = right - left,
          .height = bottom - top,
          .offset = static_cast<float>(left + right - image.width) / half,
          .area = static_cast<float>((right - left) * (bottom - top)) / pixels};
}

// Draws a few patches of colour on walls, with noise.
Image painted(Random& random, int width, int height, ImageLayout layout) {
  Image image(width, height, layout);
  const auto below = [&](int end) { return static_cast<int>(random.generator()() % static_cast<unsigned>(end)); };
  image.fill(shown(below(2) == 0 ? kWhite : kPillar, 0, below(5) / 4.0));
  const Color colors[] = {kGoal, kRed, kYellow, kPillar, {0.1F, 0.2F, 0.9F}};
  for (int patch = below(5); patch > 0; --patch) {
    const Pixel color = shown(colors[below(5)], below(3) - 1, below(5) / 4.0);
    const int x = below(width), y = below(height);
    for (int v = y; v < std::min(y + 1 + below(6), height); ++v) {
      for (int u = x; u < std::min(x + 1 + below(6), width); ++u) image.set(u, v, color);
    }
  }
  for (int speck = below(8); speck > 0; --speck) {
    image.bytes[random.generator()() % image.bytes.size()] = static_cast<std::uint8_t>(random.generator()());
  }
  return image;
}

const ColorRange kRanges[] = {
    {},
    {ColorSpace::excess, {17, 0, 0}, {255, 255, 255}},
    {ColorSpace::excess, {0, 1, 0}, {0, 90, 0}},
    {ColorSpace::excess, {0, 0, 5}, {255, 255, 255}},
    {ColorSpace::rgb, {100, 20, 0}, {255, 120, 110}},
    {ColorSpace::rgb, {0, 0, 0}, {255, 255, 255}},
    {ColorSpace::hsv, {45, 80, 20}, {75, 255, 255}},
    {ColorSpace::hsv, {170, 100, 20}, {10, 255, 255}},  // red, across the wrap of the hue
    {ColorSpace::hsv, {91, 0, 0}, {90, 255, 255}},      // every hue
};

void agrees_with_opencv(int frames) {
  Random random(7);
  ColorBlobScratch scratch;
  std::array<int, std::size(kRanges)> found{};
  for (int frame = 0; frame < frames; ++frame) {
    const Image image = painted(random, frame % 7 == 0 ? 5 : 64, 16, kLayouts[frame % 2]);
    for (std::size_t i = 0; i < std::size(kRanges); ++i) {
      if (i > 0 && frame % 10 != 0) continue;  // green in every frame, the others in every tenth
      const ColorBlob blob = find_color(image.bytes, image.width, image.height, image.layout, kRanges[i], scratch);
      const ColorBlob expected = by_opencv(image, kRanges[i]);
      expect_same(blob, expected);
      if (::testing::Test::HasFailure()) FAIL() << "frame " << frame << ", range " << i;
      found[i] += blob.found;
    }
  }
  for (const int count : found) EXPECT_GT(count, frames / 100);
}

TEST(ColorBlob, AgreesWithOpenCvOnTenThousandFrames) { agrees_with_opencv(10000); }

TEST(ColorBlob, AgreesWithOpenCvOnEveryTarget) {
  on_every_target([&] { agrees_with_opencv(500); });
}

TEST(ColorBlob, GreenByItsRangeIsGreenByItsOwnKernel) {
  Random random(8);
  ColorBlobScratch scratch, other;
  ColorRange same;
  same.high[1] = 254;  // Selects the general kernel. An excess of 255 needs black beside it, which no patch has.
  for (int frame = 0; frame < 1000; ++frame) {
    const Image image = painted(random, 64, 48, kLayouts[frame % 2]);
    expect_same(find_color(image.bytes, 64, 48, image.layout, same, scratch), image.blob(other));
    ASSERT_EQ(scratch.mask, other.mask);
  }
}

TEST(ColorRange, RefusesInvalidRanges) {
  EXPECT_NO_THROW(ColorRange().validate());
  EXPECT_NO_THROW((ColorRange{ColorSpace::hsv, {170, 0, 0}, {10, 255, 255}}.validate()));
  for (const ColorRange& bad :
       {ColorRange{ColorSpace::rgb, {-1, 0, 0}, {255, 255, 255}}, ColorRange{ColorSpace::rgb, {0, 0, 0}, {255, 256, 255}},
        ColorRange{ColorSpace::rgb, {170, 0, 0}, {10, 255, 255}}, ColorRange{ColorSpace::hsv, {0, 9, 0}, {9, 8, 9}}}) {
    EXPECT_THROW(bad.validate(), std::invalid_argument);
  }
}

// -- Threads and memory.

TEST(GreenBlob, AllocatesNothingAfterTheFirstCall) {
  for (const ImageLayout layout : kLayouts) {
    Image small(64, 48, layout);
    Image large(640, 480, layout);
    large.fill(shown(kGoal, 0, 0));
    ColorBlobScratch scratch;
    large.blob(scratch);
    small.blob(scratch);
    const auto before = allocations();
    for (int i = 0; i < 10; ++i) {
      small.blob(scratch);
      large.blob(scratch);
    }
    EXPECT_EQ(allocations(), before);
    const auto all_ranges = [&] {
      for (const ColorRange& range : kRanges) find_color(large.bytes, 640, 480, layout, range, scratch);
    };
    all_ranges();
    const auto warm = allocations();
    all_ranges();
    EXPECT_EQ(allocations(), warm);
  }
}

TEST(GreenBlob, ManyThreadsAtOnce) {
  std::vector<Image> images;
  std::vector<ColorBlob> expected;
  Random random(2);
  for (int i = 0; i < 16; ++i) {
    images.emplace_back(320, 240, i % 2 == 0 ? ImageLayout::hwc : ImageLayout::chw);
    images.back().fill(shown(kWhite, 0, 0));
    for (int k = 0; k < 5; ++k) {
      images.back().set(static_cast<int>(random.generator()() % 320), static_cast<int>(random.generator()() % 240),
                        shown(kGoal, 0, 1));
    }
    expected.push_back(by_brute_force(images.back()));
  }
  std::vector<std::vector<ColorBlob>> seen(4);
  std::vector<std::thread> threads;
  for (auto& own : seen) {
    threads.emplace_back([&own, &images] {
      ColorBlobScratch scratch;
      for (int round = 0; round < 20; ++round) {
        for (const Image& image : images) own.push_back(image.blob(scratch));
      }
    });
  }
  for (auto& thread : threads) thread.join();
  for (const auto& own : seen) {
    for (std::size_t i = 0; i < own.size(); ++i) expect_same(own[i], expected[i % images.size()]);
  }
}

}  // namespace
}  // namespace flockstep::task
