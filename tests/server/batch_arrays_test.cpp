#include "service/batch_arrays.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/body.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"

namespace flockstep::server {
namespace {

TEST(BatchArrays, RowOfBodiesIsAnEnv) {
  BatchConfig config = testing::lidar_batch(3);
  config.max_bodies = 2;
  Batch batch(config, Batch::Worlds{testing::closet()}, nullptr, DroneModel::quadrotor650());
  batch.spawn_bodies(BodyConfig{.size_m = {0.1F, 0.1F, 0.1F}}, std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8, 9});
  const std::optional<ArrayView> array = LiveArrays(batch).find("", "body_position");
  ASSERT_TRUE(array);
  protocol::FrameWriter writer;
  add_row(writer, "row", *array, 1);
  add_rows(writer, *array, std::array<std::size_t, 2>{2, 0});
  protocol::Reply reply{.id = 1, .arrays = {}, .result = protocol::Done()};
  writer.finish(reply);
  const std::string bytes = writer.header() + writer.values();
  protocol::Reply received;
  protocol::read_header(bytes, received);
  const std::vector<protocol::ReceivedArray> arrays = protocol::read_arrays(bytes, received.arrays);
  ASSERT_EQ(arrays.size(), 2U);
  EXPECT_EQ(arrays[0].array->shape, (std::vector<std::uint64_t>{2, 3}));
  EXPECT_EQ(arrays[0].values<float>(), (std::vector<float>{4, 5, 6, 0, 0, 0}));
  EXPECT_EQ(arrays[1].array->shape, (std::vector<std::uint64_t>{2, 2, 3}));
  EXPECT_EQ(arrays[1].values<float>(), (std::vector<float>{7, 8, 9, 0, 0, 0, 1, 2, 3, 0, 0, 0}));
}

}  // namespace
}  // namespace flockstep::server
