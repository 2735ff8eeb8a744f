// Models of the bodies that calls spawn: a batch keeps those that its slots hold.
#include <gtest/gtest.h>

#include <cstddef>
#include <cstdint>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

BodyConfig ball_of(float diameter) {
  BodyConfig ball;
  ball.shape = BodyShape::sphere;
  ball.size_m = {diameter, diameter, diameter};
  return ball;
}

TEST(BodyModels, SpawningForeverDoesNotGrowTheSnapshot) {
  BatchConfig config;
  config.num_envs = 2;
  config.bodies = {ball_of(5.0F)};
  config.max_bodies = 4;
  Batch batch(config, {testing::closet()});
  batch.spawn_bodies(ball_of(0.125F));  // stays in slot 1 of both envs
  std::size_t after_a_hundred = 0;
  for (int i = 0; i < 3000; ++i) {
    const float diameter = 0.2F + 1e-4F * static_cast<float>(i);
    const std::vector<std::int64_t> slots = batch.spawn_bodies(ball_of(diameter));
    ASSERT_EQ(slots, (std::vector<std::int64_t>{2, 2}));
    ASSERT_EQ(batch.body_config(1, 0)->size_m[0], 5.0F);
    ASSERT_EQ(batch.body_config(1, 1)->size_m[0], 0.125F);
    ASSERT_EQ(batch.body_config(1, 2)->size_m[0], diameter);
    if (i == 2999) break;
    batch.remove_bodies(std::vector<std::uint8_t>{0, 0, 1, 0, 0, 0, 1, 0});
    if (i == 100) after_a_hundred = batch.snapshot().size();
  }
  const std::string blob = batch.snapshot();
  EXPECT_LT(blob.size(), 2 * after_a_hundred);
  Batch twin(config, {testing::closet()});
  twin.restore(blob);
  EXPECT_EQ(twin.body_config(0, 0)->size_m[0], 5.0F);
  EXPECT_EQ(twin.body_config(0, 1)->size_m[0], 0.125F);
  EXPECT_EQ(twin.body_config(1, 2)->size_m[0], 0.2F + 1e-4F * 2999.0F);
  EXPECT_EQ(twin.snapshot(), blob);
}

}  // namespace
}  // namespace flockstep
