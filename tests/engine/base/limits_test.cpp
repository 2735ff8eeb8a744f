#include "flockstep/limits.hpp"

#include <gtest/gtest.h>

#include <cmath>
#include <limits>

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

}  // namespace
}  // namespace flockstep
