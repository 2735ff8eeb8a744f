#include "batch_helpers.hpp"
#include "flockstep/body.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"
#include "service/batch_arrays.hpp"
#include "service/picture.hpp"

namespace flockstep::server {
namespace {

Picture picture_of(std::uint8_t shade, std::size_t bytes = 30) {
  return {.rgb = std::vector<std::uint8_t>(bytes, shade), .width_px = static_cast<int>(bytes / 3), .height_px = 1};
}

// Counts how often a file is made.
struct Files {
  std::string of(const FileMemory::View& view, Picture picture) {
    return memory.file_of(view, picture, [&](const Picture& made) {
      ++count;
      return std::string(made.rgb.begin(), made.rgb.end()) + view.camera;
    });
  }

  FileMemory memory{1000};
  int count = 0;
};

TEST(FileMemory, MakesTheFileOfAStillPictureOnce) {
  Files files;
  const FileMemory::View front{.camera = "front", .drone = 0};
  for (int i = 0; i < 3; ++i) EXPECT_EQ(files.of(front, picture_of('a')), std::string(30, 'a') + "front");
  EXPECT_EQ(files.count, 1);
  EXPECT_EQ(files.of(front, picture_of('b')), std::string(30, 'b') + "front");
  EXPECT_EQ(files.of(front, picture_of('a')), std::string(30, 'a') + "front");
  EXPECT_EQ(files.count, 3);
}

TEST(FileMemory, KeepsAFileForEachView) {
  Files files;
  const FileMemory::View front{.camera = "front", .drone = 0, .format = 0, .quality = 90};
  FileMemory::View side = front, second = front, png = front, rough = front;
  side.camera = "side";
  second.drone = 1;
  png.format = 1;
  rough.quality = 10;
  for (int i = 0; i < 2; ++i) {
    for (const auto& view : {front, side, second, png, rough}) files.of(view, picture_of('a'));
  }
  EXPECT_EQ(files.count, 5);
  Picture tall = picture_of('a');
  tall.width_px = 5;
  tall.height_px = 2;
  files.of(front, tall);
  EXPECT_EQ(files.count, 6) << "the same colours in another shape";
}

TEST(FileMemory, ForgetsTheOldestBeyondItsSize) {
  Files files;
  const auto view = [](std::int64_t drone) { return FileMemory::View{.camera = "a", .drone = drone}; };
  for (std::int64_t drone = 0; drone < 20; ++drone) {
    files.of(view(drone), picture_of('a', 60));
    files.of(view(0), picture_of('a', 60));  // stays the latest but one
    EXPECT_LE(files.memory.bytes(), 1000U);
  }
  EXPECT_EQ(files.count, 20);
  files.of(view(1), picture_of('a', 60));
  EXPECT_EQ(files.count, 21);
  files.of(view(2), picture_of('a', 3000));  // larger than all
  EXPECT_EQ(files.memory.bytes(), 0U);
}

using namespace testing;

TEST(BatchArrays, RowOfBodiesIsAnEnv) {
  BatchConfig config = lidar_batch(3);
  config.max_bodies = 2;
  Batch batch(config, Batch::Worlds{closet()}, nullptr, DroneModel::quadrotor650());
  batch.bodies().spawn(BodyConfig{.size_m = {0.1F, 0.1F, 0.1F}}, std::vector<float>{1, 2, 3, 4, 5, 6, 7, 8, 9});
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
