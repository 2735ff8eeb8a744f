// Downsampling, compared with brute force and OpenCV, and colour spaces.
#include "imaging/resample.hpp"

#include "allocation_counter.hpp"
#include "imaging/opencv.hpp"
#include "random.hpp"

namespace flockstep::imaging {
namespace {

using namespace testing;

struct Sizes {
  int from_width, from_height, to_width, to_height;
};
constexpr Sizes kSizes[] = {{64, 48, 16, 12}, {64, 48, 64, 48}, {84, 61, 35, 20}, {160, 120, 84, 84}, {7, 5, 3, 5},
                            {33, 1, 10, 1},   {1, 9, 1, 4},     {50, 40, 1, 1},   {40, 30, 39, 29}};
constexpr Pool kPools[] = {Pool::mean, Pool::min, Pool::max};

// Resamples pixel by pixel in double precision. An output pixel covers from / to input pixels along each axis.
template <class Value>
std::vector<double> by_brute_force(const std::vector<Value>& image, const Sizes& s, int channels, Pool pool) {
  std::vector<double> result;
  const double tall = double(s.from_height) / s.to_height, wide = double(s.from_width) / s.to_width;
  for (int y = 0; y < s.to_height; ++y) {
    for (int x = 0; x < s.to_width; ++x) {
      for (int c = 0; c < channels; ++c) {
        double sum = 0.0, weights = 0.0;
        double least = std::numeric_limits<double>::infinity(), greatest = -least;
        for (int v = 0; v < s.from_height; ++v) {
          for (int u = 0; u < s.from_width; ++u) {
            const double down = std::min(v + 1.0, (y + 1) * tall) - std::max<double>(v, y * tall);
            const double across = std::min(u + 1.0, (x + 1) * wide) - std::max<double>(u, x * wide);
            if (down < 1e-9 || across < 1e-9) continue;
            const double value = static_cast<double>(image[static_cast<std::size_t>((v * s.from_width + u) * channels + c)]);
            sum += down * across * value;
            weights += down * across;
            least = std::min(least, value);
            greatest = std::max(greatest, value);
          }
        }
        result.push_back(pool == Pool::mean ? sum / weights : pool == Pool::min ? least : greatest);
      }
    }
  }
  return result;
}

std::size_t area(int width, int height) { return static_cast<std::size_t>(width) * static_cast<std::size_t>(height); }

template <class Value>
std::vector<Value> resampled(const std::vector<Value>& image, const Sizes& s, int channels, Pool pool, ResampleScratch& scratch) {
  std::vector<Value> small(area(s.to_width, s.to_height) * static_cast<std::size_t>(channels));
  const Resample resample(s.from_width, s.from_height, s.to_width, s.to_height, pool);
  resample(image.data(), small.data(), static_cast<std::size_t>(channels), scratch);
  return small;
}

std::vector<std::uint8_t> random_bytes(Random& random, std::size_t count) {
  std::vector<std::uint8_t> bytes(count);
  for (auto& byte : bytes) byte = static_cast<std::uint8_t>(random.generator()());
  return bytes;
}

TEST(Resample, AgreesWithBruteForceAndOpenCv) {
  prepare_opencv();
  Random random(1);
  ResampleScratch scratch;
  for (const Sizes& s : kSizes) {
    for (const int channels : {1, 3}) {
      const auto bytes = random_bytes(random, area(s.from_width, s.from_height) * static_cast<std::size_t>(channels));
      const std::vector<float> floats(bytes.begin(), bytes.end());
      for (const Pool pool : kPools) {
        const auto expected = by_brute_force(bytes, s, channels, pool);
        const auto small = resampled(bytes, s, channels, pool, scratch);
        const auto fine = resampled(floats, s, channels, pool, scratch);
        for (std::size_t i = 0; i < expected.size(); ++i) {
          EXPECT_NEAR(small[i], expected[i], pool == Pool::mean ? 0.5 + 1e-9 : 0.0);
          EXPECT_NEAR(fine[i], expected[i], 1e-5 * expected[i]);
        }
        if (pool != Pool::mean) continue;
        cv::Mat by_opencv;
        cv::resize(cv::Mat(s.from_height, s.from_width, CV_32FC(channels), const_cast<float*>(floats.data())), by_opencv,
                   cv::Size(s.to_width, s.to_height), 0, 0, cv::INTER_AREA);
        for (std::size_t i = 0; i < fine.size(); ++i) EXPECT_NEAR(fine[i], by_opencv.ptr<float>()[i], 2e-3);
      }
    }
  }
}

TEST(Resample, RoundsHalvesUp) {
  ResampleScratch scratch;
  EXPECT_EQ(resampled<std::uint8_t>({0, 1, 254, 255}, {2, 1, 1, 1}, 1, Pool::mean, scratch)[0], 1);
  EXPECT_EQ(resampled<std::uint8_t>({255, 255, 255, 255}, {4, 1, 3, 1}, 1, Pool::mean, scratch),
            (std::vector<std::uint8_t>{255, 255, 255}));
}

TEST(Resample, OneMissMakesAMeanInfiniteButNotALeast) {
  constexpr float kInf = std::numeric_limits<float>::infinity();
  const std::vector<float> depth{1, kInf, 2, 4, kInf, kInf};
  const Sizes s{6, 1, 3, 1};
  ResampleScratch scratch;
  EXPECT_EQ(resampled(depth, s, 1, Pool::mean, scratch), (std::vector<float>{kInf, 3, kInf}));
  EXPECT_EQ(resampled(depth, s, 1, Pool::min, scratch), (std::vector<float>{1, 2, kInf}));
  EXPECT_EQ(resampled(depth, s, 1, Pool::max, scratch), (std::vector<float>{kInf, 4, kInf}));
}

TEST(Hsv, IsTheSameInBothLayouts) {
  Random random(2);
  HsvScratch scratch;
  for (const auto& [width, height] : {std::pair{33, 17}, std::pair{1, 1}, std::pair{640, 480}}) {
    const std::size_t pixels = area(width, height);
    const auto rgb = random_bytes(random, 3 * pixels);
    std::vector<std::uint8_t> planes(3 * pixels), hsv(3 * pixels), apart(3 * pixels);
    for (std::size_t i = 0; i < 3 * pixels; ++i) planes[i % 3 * pixels + i / 3] = rgb[i];
    rgb_to_hsv(rgb.data(), width, height, ImageLayout::hwc, hsv.data(), scratch);
    rgb_to_hsv(planes.data(), width, height, ImageLayout::chw, apart.data(), scratch);
    for (std::size_t i = 0; i < 3 * pixels; ++i) ASSERT_EQ(apart[i % 3 * pixels + i / 3], hsv[i]);
  }
}

TEST(Imaging, AllocatesNothingAfterTheFirstCall) {
  ResampleScratch scratch;
  HsvScratch hsv_scratch;
  Random random(3);
  const auto rgb = random_bytes(random, 3 * area(640, 480));
  const std::vector<float> depth(area(640, 480), 1.0F);
  std::vector<std::uint8_t> hsv(rgb.size()), small(rgb.size());
  std::vector<float> near(depth.size());
  const Resample resample(640, 480, 84, 63, Pool::mean), least(640, 480, 160, 120, Pool::min);
  const auto all = [&] {
    resample(rgb.data(), small.data(), 3, scratch);
    least(depth.data(), near.data(), 1, scratch);
    rgb_to_hsv(rgb.data(), 640, 480, ImageLayout::hwc, hsv.data(), hsv_scratch);
    rgb_to_hsv(rgb.data(), 640, 480, ImageLayout::chw, hsv.data(), hsv_scratch);
  };
  all();
  const auto before = allocations();
  all();
  EXPECT_EQ(allocations(), before);
}

}  // namespace
}  // namespace flockstep::imaging
