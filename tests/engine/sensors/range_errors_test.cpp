#include "sensors/range_errors.hpp"

#include <cfloat>

#include "on_target.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kCount = 1'000'000;

PhiloxInput input_of(std::uint64_t seed, std::uint32_t index = 0) { return input_of_draw(seed, 1, 0x81234567U, index); }

// Returns readings of a true range.
std::vector<float> readings_of(const RangeErrors& errors, float range, float max_range_m = 100.0F) {
  std::vector<float> ranges(kCount, range);
  sensors::add_range_errors(errors, max_range_m, input_of(3), ranges);
  return ranges;
}

TEST(RangeErrors, HaveTheirMeanAndDeviation) {
  for (const float range : {1.0F, 10.0F, 60.0F}) {
    const RangeErrors errors{.noise_std_m = 0.02F, .noise_per_m = 0.003F, .bias_m = -0.1F};
    double sum = 0.0, squares = 0.0;
    for (const float reading : readings_of(errors, range)) {
      const double error = static_cast<double>(reading) - static_cast<double>(range) + 0.1;
      sum += error;
      squares += error * error;
    }
    const double count = kCount, sigma = 0.02 + 0.003 * static_cast<double>(range);
    EXPECT_LT(std::abs(sum / count), 3.0 * sigma / std::sqrt(count)) << range;
    EXPECT_LT(std::abs(std::sqrt(squares / count) - sigma), 3.0 * sigma / std::sqrt(2.0 * count)) << range;
  }
}

TEST(RangeErrors, DropTheirShareOfBeams) {
  for (const double dropout : {0.001, 0.03, 0.5, 0.97}) {
    const auto readings = readings_of({.dropout = static_cast<float>(dropout)}, 5.0F);
    const double share = static_cast<double>(std::ranges::count(readings, kInfinity)) / kCount;
    EXPECT_LT(std::abs(share - dropout), 3.0 * std::sqrt(dropout * (1.0 - dropout) / kCount)) << dropout;
    EXPECT_EQ(static_cast<std::size_t>(std::ranges::count(readings, kInfinity) + std::ranges::count(readings, 5.0F)), kCount);
  }
  EXPECT_EQ(readings_of({}, 5.0F), std::vector<float>(kCount, 5.0F));
  EXPECT_EQ(readings_of({.dropout = 1.0F}, 5.0F), std::vector<float>(kCount, kInfinity));
}

// Each beam has its own numbers, however many beams there are, and nothing beside the ranges is touched.
TEST(RangeErrors, OfABeamDoNotDependOnTheOthers) {
  constexpr std::size_t kMost = 70, kGuard = 32;
  const RangeErrors errors{.noise_std_m = 0.5F, .dropout = 0.2F};
  std::vector<float> all(kMost, 8.0F);
  sensors::add_range_errors(errors, 20.0F, input_of(5), all);
  for (std::size_t count = 0; count <= kMost; ++count) {
    std::vector<float> some(count + 2 * kGuard, -7.0F);
    std::fill_n(some.begin() + kGuard, count, 8.0F);
    sensors::add_range_errors(errors, 20.0F, input_of(5), std::span(some).subspan(kGuard, count));
    std::vector<float> expected(some.size(), -7.0F);
    std::copy_n(all.begin(), count, expected.begin() + kGuard);
    EXPECT_EQ(some, expected) << count;
  }
}

TEST(RangeErrors, HaveTheSameBitsOnEverySimdTarget) {
  const RangeErrors errors{.clutter_per_m = 0.02F,
                           .noise_std_m = 0.1F,
                           .noise_per_m = 0.01F,
                           .bias_m = -0.05F,
                           .resolution_m = 0.001F,
                           .min_range_m = 0.5F,
                           .dropout = 0.1F,
                           .dropout_per_m = 0.03F};
  Random random(7);
  std::vector<float> exact(10'007);
  for (float& range : exact) range = random.within(-3.0F, 40.0F);
  std::vector<float> first;
  on_every_target([&] {
    std::vector<float> ranges = exact;
    sensors::add_range_errors(errors, 35.0F, input_of(4), ranges);
    if (first.empty()) first = ranges;
    EXPECT_EQ(ranges, first);
  });
  const auto clutter = std::ranges::count_if(first, [](float range) { return range < 0.0F; });
  const auto misses = std::ranges::count(first, kInfinity);
  EXPECT_GT(std::min({clutter, misses, std::ssize(first) - clutter - misses}), 1000);
}

// Whatever the errors, a reading is a miss or a range within the limits.
TEST(RangeErrors, OfAbsurdSizeLeaveRangesOrMisses) {
  constexpr std::array kShares{0.0F, FLT_MIN, 0.1F, 1.0F};
  constexpr std::array kSizes{0.0F, 1e-6F, 0.25F, 1.0F, 1000.0F};
  constexpr std::array kRanges{0.0F,   FLT_TRUE_MIN, FLT_MIN, 1e-6F, 0.1F,    1.0F,
                               1000.F, 16777217.0F,  1e20F,   1e38F, FLT_MAX, kInfinity};
  Random random(11);
  const auto one_of = [&](const auto& values) {
    return values[std::min(values.size() - 1, static_cast<std::size_t>(random.within(0.0F, static_cast<float>(values.size()))))];
  };
  const long times = times_tried(2000);
  long readings = 0, misses = 0;
  for (long i = 0; i < times; ++i) {
    RangeErrors errors{.clutter_per_m = one_of(kShares),
                       .noise_std_m = one_of(kSizes),
                       .noise_per_m = std::min(1.0F, one_of(kSizes)),
                       .bias_m = random.within(-1.0F, 1.0F) * one_of(kSizes),
                       .resolution_m = one_of(kSizes),
                       .min_range_m = one_of(kRanges),
                       .dropout = one_of(kShares),
                       .dropout_per_m = one_of(kShares)};
    float max_range_m = one_of(kRanges);
    if (!(max_range_m > 0.0F && max_range_m <= FLT_MAX)) max_range_m = FLT_MAX;
    if (errors.min_range_m >= max_range_m) errors.min_range_m = 0.0F;
    errors.resolution_m = std::min(errors.resolution_m, max_range_m < 1e-6F ? 0.0F : max_range_m);
    ASSERT_NO_THROW(errors.validate());
    std::vector<float> ranges(static_cast<std::size_t>(i % 40));
    for (float& range : ranges) {
      range = one_of(kRanges);
      if (range > max_range_m) range = kInfinity;
    }
    std::vector<float> got = ranges;
    sensors::add_range_errors(errors, max_range_m, input_of(static_cast<std::uint64_t>(i), UINT32_MAX - 2), got);
    for (std::size_t k = 0; k < got.size(); ++k) {
      const bool is_range = std::abs(got[k]) >= errors.min_range_m && std::abs(got[k]) <= max_range_m;
      const bool is_clutter = std::signbit(got[k]);
      ASSERT_TRUE(got[k] == kInfinity || is_range) << got[k] << " of " << ranges[k] << " in trial " << i;
      ASSERT_TRUE(ranges[k] < kInfinity || got[k] == kInfinity || is_clutter) << "a miss reads " << got[k];
      ASSERT_TRUE(!is_clutter || errors.clutter_per_m > 0.0F) << got[k] << " of " << ranges[k] << " in trial " << i;
      ++(is_range ? readings : misses);
    }
  }
  EXPECT_GT(std::min(readings, misses), times);
}

}  // namespace
}  // namespace flockstep
