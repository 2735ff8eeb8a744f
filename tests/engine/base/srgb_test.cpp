#include "base/srgb.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

#include "random.hpp"

namespace flockstep {
namespace {

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
  testing::Random random(1);
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

}  // namespace
}  // namespace flockstep
