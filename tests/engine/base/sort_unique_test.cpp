#include <gtest/gtest.h>

#include <cstdint>
#include <limits>
#include <set>
#include <vector>

#include "base/indices.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

TEST(SortUnique, IsThatOfASet) {
  testing::Random random(1);
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

}  // namespace
}  // namespace flockstep
