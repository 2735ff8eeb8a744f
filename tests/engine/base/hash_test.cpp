#include "base/hash.hpp"

#include <gtest/gtest.h>

#include <cstdint>
#include <string>
#include <vector>

namespace flockstep {
namespace {

constexpr std::string_view kText =
    "The quick brown fox jumps over the lazy dog, then walks home. The quick brown fox jumps over the lazy dog, then walks home.";

std::uint64_t hash_of(std::string_view text, std::uint64_t seed = 0) { return xxh64(std::as_bytes(std::span(text)), seed); }

// Values of the reference implementation, for every kind of remainder length.
TEST(Hash, IsXxh64) {
  EXPECT_EQ(hash_of(""), 0xEF46DB3751D8E999U);
  EXPECT_EQ(hash_of(kText.substr(0, 1)), 0x5B4D6AF247A3CF7BU);
  EXPECT_EQ(hash_of(kText.substr(0, 3)), 0x4108F90B5DE14D15U);
  EXPECT_EQ(hash_of(kText.substr(0, 4)), 0xCDF13A49D263200FU);
  EXPECT_EQ(hash_of(kText.substr(0, 7)), 0xC6FCE9D72E310949U);
  EXPECT_EQ(hash_of(kText.substr(0, 8)), 0xD07B38A78A153B0BU);
  EXPECT_EQ(hash_of(kText.substr(0, 13)), 0xED6DC8C5841A51E4U);
  EXPECT_EQ(hash_of(kText.substr(0, 31)), 0x3F8D95AB32C127D9U);
  EXPECT_EQ(hash_of(kText.substr(0, 32)), 0xE2BBC9136629A4EEU);
  EXPECT_EQ(hash_of(kText.substr(0, 39)), 0xE01509EC7BDD4B5EU);
  EXPECT_EQ(hash_of(kText.substr(0, 63)), 0x7479E34CE37C6655U);
  EXPECT_EQ(hash_of(kText.substr(0, 64)), 0x442CBEF2243D523CU);
  EXPECT_EQ(hash_of(kText.substr(0, 101)), 0xAE6FAA2D97133BDDU);
  EXPECT_EQ(hash_of(kText.substr(0, 101), 0x123456789ABCDEFU), 0x1286202AB641889FU);
  EXPECT_EQ(hash_of(kText.substr(0, 5), 0x1U), 0x1A8CBEA48D66615DU);
  EXPECT_EQ(hash_of(kText.substr(0, 40), 0xFFFFFFFFFFFFFFFFU), 0xEA51B73D841655C6U);
}

TEST(Hash, BordersBetweenValuesCount) {
  Hash one, other;
  one.add(std::string_view("ab"));
  one.add(std::string_view("c"));
  other.add(std::string_view("a"));
  other.add(std::string_view("bc"));
  EXPECT_NE(one.value(), other.value());
  Hash with_nothing = one;
  with_nothing.add(std::string_view());
  EXPECT_NE(with_nothing.value(), one.value());
}

TEST(Hash, EveryByteCounts) {
  std::string text(100, 'x');
  for (std::size_t length = 1; length <= text.size(); ++length) {
    const std::uint64_t whole = hash_of(std::string_view(text).substr(0, length));
    for (std::size_t i = 0; i < length; ++i) {
      std::string changed = text.substr(0, length);
      changed[i] = 'y';
      ASSERT_NE(hash_of(changed), whole) << i << " of " << length;
    }
  }
}

}  // namespace
}  // namespace flockstep
