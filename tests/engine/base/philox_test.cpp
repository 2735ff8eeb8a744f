#include <gtest/gtest.h>

#include <cmath>

#include "base/random.hpp"

namespace flockstep {
namespace {

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

}  // namespace
}  // namespace flockstep
