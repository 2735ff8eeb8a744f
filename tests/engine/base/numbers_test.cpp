#include <random>
#include <set>

#include "base/finite.hpp"
#include "base/indices.hpp"
#include "base/random.hpp"
#include "base/srgb.hpp"
#include "flockstep/limits.hpp"
#include "on_target.hpp"
#include "random.hpp"
#include "standard.hpp"

namespace flockstep {
namespace {

TEST(Limits, ContainTheirEndsUnlessTheyExcludeThem) {
  EXPECT_TRUE(between(0, 360).contain(0));
  EXPECT_TRUE(between(0, 360).contain(360));
  EXPECT_FALSE(between(0, 360).contain(360.0001));
  EXPECT_FALSE(above(0).contain(0));
  EXPECT_TRUE(above(0).contain(1e-300));
  EXPECT_FALSE(above_up_to(0, 360).contain(0));
  EXPECT_TRUE(above_up_to(0, 360).contain(360));
  EXPECT_FALSE((Limits{.greatest = 1, .excludes_greatest = true}.contain(1)));
  EXPECT_TRUE(within(100).contain(-100));
}

TEST(Limits, HoldAFloatAgainstTheNearestFloat) {
  EXPECT_LT(static_cast<double>(0.01F), 0.01);
  EXPECT_TRUE(at_least(0.01).contain(0.01F));
  EXPECT_FALSE(at_least(0.01).contain(static_cast<double>(0.01F)));
  EXPECT_FALSE(above(0.01).contain(0.01F));
  EXPECT_FALSE(at_least(0.01).contain(std::nextafter(0.01F, 0.0F)));
}

TEST(Limits, MayBeChoices) {
  for (int value = -1; value < 20; ++value) {
    EXPECT_EQ(one_of(1, 4, 9, 16).contain(value), value == 1 || value == 4 || value == 9 || value == 16) << value;
  }
}

TEST(Limits, NeverContainNonFiniteNumbers) {
  constexpr double kInfinity = std::numeric_limits<double>::infinity();
  EXPECT_TRUE(Limits().contain(-1e308));
  EXPECT_FALSE(Limits().contain(kInfinity));
  EXPECT_FALSE(Limits().contain(-kInfinity));
  EXPECT_FALSE(Limits().contain(std::numeric_limits<double>::quiet_NaN()));
  EXPECT_FALSE(at_least(0).contain(kInfinity));
}

TEST(Limits, ReadAsIntervalsAndComparisons) {
  EXPECT_EQ(above_up_to(0, 360).text(), "in (0, 360]");
  EXPECT_EQ(between_excluding(0, 1).text(), "in (0, 1)");
  EXPECT_EQ(between(-90, 100).text(), "in [-90, 100]");
  EXPECT_EQ(within(1e6).text(), "within +-1e+06");
  EXPECT_EQ(one_of(1, 4, 9, 16).text(), "1, 4, 9 or 16");
  EXPECT_EQ(at_least(0).text(), ">= 0");
  EXPECT_EQ(above(0.5).text(), "> 0.5");
  EXPECT_EQ((Limits{.greatest = 1, .excludes_greatest = true}.text()), "< 1");
  EXPECT_EQ(Limits().text(), "");
}

using namespace testing;

TEST(SortUnique, IsThatOfASet) {
  Random random(1);
  for (const float reach : {1.0F, 30.0F, 100.0F, 1e4F, 1e9F}) {  // from dense to sparse
    for (int count = 0; count < 60; ++count) {
      std::vector<std::int32_t> indices;
      for (int i = 0; i < count; ++i) indices.push_back(static_cast<std::int32_t>(random.within(0.0F, reach)));
      const std::set<std::int32_t> expected(indices.begin(), indices.end());
      sort_unique(indices);
      EXPECT_EQ(indices, std::vector<std::int32_t>(expected.begin(), expected.end()));
    }
  }
}

TEST(SortUnique, TakesTheLargestIndices) {
  constexpr std::uint32_t kMax = std::numeric_limits<std::uint32_t>::max();
  std::vector<std::uint32_t> dense{kMax, kMax - 2, kMax, kMax - 1}, sparse{kMax, 0, kMax};
  sort_unique(dense);
  EXPECT_EQ(dense, (std::vector{kMax - 2, kMax - 1, kMax}));
  sort_unique(sparse);
  EXPECT_EQ(sparse, (std::vector{0U, kMax}));
}

// Returns the byte by comparison with the end of each byte's interval.
int searched(float linear) {
  int byte = 0;
  while (byte < 255 && linear >= linear_of_srgb((static_cast<double>(byte) + 0.5) / 255.0)) ++byte;
  return byte;
}

TEST(Srgb, BytesConvertToLinearAndBack) {
  for (int byte = 0; byte < 256; ++byte) {
    EXPECT_EQ(linear_to_srgb(srgb_to_linear()[static_cast<std::size_t>(byte)]), byte);
  }
}

TEST(Srgb, ALinearValueGetsTheNearestByte) {
  for (int byte = 0; byte < 255; ++byte) {
    const float end = linear_of_srgb((static_cast<double>(byte) + 0.5) / 255.0);
    EXPECT_EQ(linear_to_srgb(std::nextafter(end, 0.0F)), byte);
    EXPECT_EQ(linear_to_srgb(end), byte + 1);
  }
  Random random(1);
  for (int i = 0; i < 20'000; ++i) {
    const float linear = i % 2 == 0 ? random.within(0.0F, 1.0F) : std::exp2(random.within(-16.0F, 0.0F));
    ASSERT_EQ(linear_to_srgb(linear), searched(linear)) << linear;
  }
}

TEST(Srgb, OtherValuesAreClamped) {
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  for (const float low : {-kInfinity, -1.0F, -0.0F, 0.0F, 1e-30F}) EXPECT_EQ(linear_to_srgb(low), 0) << low;
  for (const float high : {1.0F, 1.5F, 1e30F, kInfinity}) EXPECT_EQ(linear_to_srgb(high), 255) << high;
}

using Words = std::array<std::uint32_t, 4>;

// The known-answer vectors published with Random123 (kat_vectors, philox 4x32, 10 rounds).
TEST(Philox, KnownAnswers) {
  EXPECT_EQ(philox4x32({0, 0, 0, 0}, {0, 0}), (Words{0x6627e8d5U, 0xe169c58dU, 0xbc57ac4cU, 0x9b00dbd8U}));
  constexpr std::uint32_t kOnes = 0xffffffffU;
  EXPECT_EQ(philox4x32({kOnes, kOnes, kOnes, kOnes}, {kOnes, kOnes}),
            (Words{0x408f276dU, 0x41c83b0eU, 0xa20bc7c6U, 0x6d5451fdU}));
  EXPECT_EQ(philox4x32({0x243f6a88U, 0x85a308d3U, 0x13198a2eU, 0x03707344U}, {0xa4093822U, 0x299f31d0U}),
            (Words{0xd16cfe09U, 0x94fdccebU, 0x5001e420U, 0x24126ea1U}));
}

TEST(Philox, UniformCoversItsRange) {
  EXPECT_EQ(uniform01(0), 0.0F);
  EXPECT_EQ(uniform01(0xffffffffU), 1.0F - 0x1p-24F);
  EXPECT_EQ(uniform01(0x80000000U), 0.5F);
}

TEST(Philox, NormalHasTheMomentsOfANormal) {
  constexpr std::uint32_t kPairs = 200'000;
  double sum = 0.0;
  double squares = 0.0;
  double fourths = 0.0;
  double products = 0.0;
  for (std::uint32_t i = 0; i < kPairs; ++i) {
    const auto pair = normal_pair(philox4x32({i, 0, 0, 0}, {7, 0}));
    products += static_cast<double>(pair[0]) * pair[1];
    for (const double x : {static_cast<double>(pair[0]), static_cast<double>(pair[1])}) {
      ASSERT_TRUE(std::isfinite(x));
      sum += x;
      squares += x * x;
      fourths += x * x * x * x;
    }
  }
  constexpr double kCount = 2.0 * kPairs;
  // Tolerances are five standard errors: sqrt(1 / n), sqrt(2 / n), sqrt(96 / n), sqrt(2 / n).
  EXPECT_NEAR(sum / kCount, 0.0, 5.0 * std::sqrt(1.0 / kCount));
  EXPECT_NEAR(squares / kCount, 1.0, 5.0 * std::sqrt(2.0 / kCount));
  EXPECT_NEAR(fourths / kCount, 3.0, 5.0 * std::sqrt(96.0 / kCount));
  EXPECT_NEAR(products / kPairs, 0.0, 5.0 * std::sqrt(2.0 / kCount));
}

TEST(Philox, NormalOfExtremeWordsIsFinite) {
  for (const std::uint32_t a : {0U, 0xffffffffU}) {
    for (const std::uint32_t b : {0U, 0xffffffffU}) {
      const auto pair = normal_pair({a, b, 0, 0});
      EXPECT_TRUE(std::isfinite(pair[0]) && std::isfinite(pair[1])) << a << ' ' << b;
    }
  }
}

template <class T>
void try_all() {
  using Limits = std::numeric_limits<T>;
  const T finite[] = {T{0}, -T{0}, T{1}, Limits::max(), Limits::lowest(), Limits::min(), Limits::denorm_min()};
  std::mt19937 random(1);
  for (std::size_t size = 0; size <= 70; ++size) {
    std::vector<T> values(size + 2, Limits::quiet_NaN());  // neighbouring values must not matter
    const std::span<T> inside = std::span(values).subspan(1, size);
    for (T& value : inside) value = finite[random() % std::size(finite)];
    const std::span<const T> seen = inside;
    ASSERT_TRUE(are_finite(seen)) << size;
    for (std::size_t i = 0; i < size; ++i) {
      const T before = inside[i];
      for (const T bad : {Limits::infinity(), -Limits::infinity(), Limits::quiet_NaN(), -Limits::signaling_NaN()}) {
        inside[i] = bad;
        ASSERT_FALSE(are_finite(seen)) << i << " of " << size;
      }
      inside[i] = before;
    }
  }
}

TEST(Finite, FindsOneBadNumberAnywhereOnEveryTarget) {
  on_every_target([&] {
    try_all<float>();
    try_all<double>();
  });
}

}  // namespace
}  // namespace flockstep
