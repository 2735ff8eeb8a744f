#include "batch/snapshot.hpp"

#include "batch_helpers.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr std::size_t kDrones = 24;

NavigationBatch lively(AutoresetMode mode) {
  NavigationBatch config = navigation_batch(kDrones);
  config.pose_sensor = {.position_noise_std_m = 0.01F, .orientation_noise_std_deg = 0.5F};
  config.navigation.action = ActionKind::displacement_yaw;
  config.navigation.step_m = 0.3F;
  config.episode.max_episode_steps = 40;
  config.navigation.random_start = true;
  config.episode.random_world = true;
  config.episode.stagger_first_episode = true;
  config.episode.autoreset_mode = mode;
  return config;
}

const Batch::Worlds& worlds() {
  static const Batch::Worlds shared{playground("train-1"), playground("validation-1"), closet()};
  return shared;
}

// Snapshots are long, so failures do not print them.
::testing::AssertionResult same_bytes(const std::string& a, const std::string& b) {
  return a == b ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << "snapshots differ";
}

// Steps batches with actions that do not depend on them. Batches with the mode `disabled` are reset now and then.
class Pilot {
 public:
  explicit Pilot(unsigned seed) : random_(seed) {}
  void step(const std::vector<Batch*>& batches) {
    for (std::size_t i = 0; i < kDrones; ++i) {
      if (steps_ > 0 && random_.within(0, 1) < 0.5F) continue;  // same action as before
      for (std::size_t k = 0; k < 4; ++k) actions_[4 * i + k] = random_.within(-1.0F, 1.0F);
    }
    ++steps_;
    for (Batch* batch : batches) {
      batch->step(std::span<const float>(actions_));
      if (batch->config().episode.autoreset_mode != AutoresetMode::disabled || steps_ % 9 != 0) continue;
      std::vector<std::uint8_t> ended(kDrones);
      for (std::size_t i = 0; i < kDrones; ++i) ended[i] = batch->outputs().terminated[i] || batch->outputs().truncated[i];
      batch->reset({}, ended);
    }
  }

 private:
  Random random_;
  std::vector<float> actions_ = std::vector<float>(4 * kDrones);
  int steps_ = 0;
};

void fly(Batch& batch, Pilot& pilot, int steps) {
  for (int i = 0; i < steps; ++i) pilot.step({&batch});
}

std::vector<std::uint8_t> every(std::size_t n) {
  std::vector<std::uint8_t> mask(kDrones, 0);
  for (std::size_t i = 0; i < kDrones; i += n) mask[i] = 1;
  return mask;
}

TEST(Snapshot, RestoredIsUninterrupted) {
  for (const AutoresetMode mode : {AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled}) {
    SCOPED_TRACE(static_cast<int>(mode));
    NavigationBatch config = lively(mode);
    Batch one = config.make(worlds());
    one.reset({});
    Pilot pilot(1);
    fly(one, pilot, 50);
    one.lidar().set({.max_range_m = 1.5F, .offset_m = {{0.1F, 0, 0.2F}}}, every(2));
    one.lidar().set({.hfov_deg = 360.0F, .quat_wxyz = {{0.6F, 0, 0, 0.8F}}}, every(3));
    one.remove(std::vector<std::int64_t>{4, 9});
    fly(one, pilot, 51);

    // Restores into a new batch with other blocks and threads, and into a used one.
    config.block_size = 5;
    config.num_threads = 2;
    Batch fresh = config.make(worlds());
    Batch lived = config.make(worlds());
    lived.lidar().set({.max_range_m = 2.5F}, every(4));
    lived.reset({});
    Pilot other(2);
    fly(lived, other, 30);
    lived.remove(std::vector<std::int64_t>{1, 4});
    const std::string blob = one.snapshot();
    for (Batch* batch : {&fresh, &lived}) {
      batch->restore(blob);
      EXPECT_TRUE(same_bytes(batch->snapshot(), blob));
      ASSERT_TRUE(same_drones(one, *batch));
      EXPECT_TRUE(std::equal(one.lidar().readings().max_range_m.begin(), one.lidar().readings().max_range_m.end(),
                             batch->lidar().readings().max_range_m.begin()));
    }
    int ends = 0;
    for (int step = 0; step < 300; ++step) {
      pilot.step({&one, &fresh, &lived});
      ASSERT_TRUE(same_drones(one, fresh)) << "step " << step << " of the fresh batch";
      ASSERT_TRUE(same_drones(one, lived)) << "step " << step << " of the batch that had lived";
      ends += std::accumulate(one.outputs().terminated.begin(), one.outputs().terminated.end(), 0);
      if (step == 100) {
        for (Batch* batch : {&one, &fresh, &lived})
          batch->spawn(std::vector<std::int64_t>{9}, std::vector<float>{2, 2, 2}, {}, std::vector<std::int32_t>{0});
      }
    }
    EXPECT_GT(ends, 20);
  }
}

TEST(Snapshot, ARestoredBatchRepeatsItsFlight) {
  Batch batch = lively(AutoresetMode::same_step).make(worlds());
  batch.reset({});
  Pilot before(3);
  fly(batch, before, 40);
  const std::string blob = batch.snapshot();
  std::vector<std::vector<std::byte>> first;  // all written bytes of every drone, step by step
  for (int round = 0; round < 3; ++round) {
    Pilot pilot(4);
    for (std::size_t step = 0; step < 120; ++step) {
      pilot.step({&batch});
      for (std::size_t drone = 0; drone < kDrones; ++drone) {
        const auto bytes = bytes_of(batch, drone);
        if (round == 0) {
          first.push_back(bytes);
        } else {
          ASSERT_TRUE(bytes == first[step * kDrones + drone]) << "drone " << drone << ", step " << step;
        }
      }
    }
    // Restoring undoes these changes.
    batch.lidar().set({.max_range_m = 0.5F});
    batch.remove(std::vector<std::int64_t>{round});
    batch.restore(blob);
  }
}

TEST(Snapshot, ARestoreKeepsTheResultsOfTheLastStep) {
  Batch batch = lively(AutoresetMode::same_step).make(worlds());
  batch.reset({});
  Pilot pilot(7);
  fly(batch, pilot, 3);
  const std::string blob = batch.snapshot();
  const AlignedVector<std::byte> earlier = batch.outputs().observation[0].bytes();
  fly(batch, pilot, 4);
  const AlignedVector<std::byte>& view = batch.outputs().observation[0].bytes();
  const AlignedVector<std::byte> returned = view;
  batch.restore(blob);
  EXPECT_EQ(batch.outputs().observation[0].bytes(), earlier);
  EXPECT_EQ(view, returned);
}

TEST(Snapshot, WithoutATask) {
  BatchConfig config = lidar_batch(kDrones);
  config.pose_sensor.position_noise_std_m = 0.1F;
  Batch one(config, worlds());
  Batch other(config, worlds());
  Random random(5);
  const auto move = [&](const std::vector<Batch*>& batches) {
    std::vector<float> position;
    for (std::size_t i = 0; i < kDrones; ++i) position.insert(position.end(), {random.within(0, 14), random.within(0, 14), 2});
    for (Batch* batch : batches) {
      batch->move(position, {});
      batch->sense();
    }
  };
  const std::vector<std::uint64_t> seeds = seeds_from(100, kDrones);
  one.seed(seeds);
  for (int i = 0; i < 5; ++i) move({&one});
  one.begin_episode(every(2));
  other.restore(one.snapshot());
  for (int i = 0; i < 50; ++i) {
    ASSERT_TRUE(same_drones(one, other)) << i;
    move({&one, &other});
  }
}

// -- Refusals: each throws with a message and changes nothing.

class SnapshotRefusal : public ::testing::Test {
 protected:
  SnapshotRefusal() : batch_(lively(AutoresetMode::next_step).make(worlds())) {
    batch_.reset({});
    Pilot pilot(6);
    fly(batch_, pilot, 20);
    batch_.lidar().set({.max_range_m = 1.25F}, every(2));
    blob_ = batch_.snapshot();
    fly(batch_, pilot, 20);
    before_ = batch_.snapshot();
  }

  void expect_refused(const std::string& blob, const std::string& field = "snapshot") {
    EXPECT_REFUSED(batch_.restore(blob), field);
    EXPECT_TRUE(same_bytes(batch_.snapshot(), before_)) << "a refused blob changed the batch";
  }
  // Returns the offset of an array in a snapshot, which starts with its length.
  std::size_t offset_of(std::string_view array) const {
    std::vector<std::string> names{"config"};  // then the arrays of the state, in order
    for_each_array(batch_.state(), [&](const std::string& name, const auto&) { names.push_back(name); });
    names.insert(names.end(), {"env_lights", "lidar_ranges", "lidar_settings", "sensed_position", "sensed_quat_wxyz"});
    std::size_t at = sizeof(SnapshotHeader);
    for (const std::string& name : names) {
      if (name == array) return at;
      std::uint64_t length = 0;
      std::memcpy(&length, blob_.data() + at, sizeof(length));
      at += sizeof(length) + length;
    }
    throw std::logic_error("no array of that name");
  }

  Batch batch_;
  std::string blob_, before_;
};

TEST_F(SnapshotRefusal, AcceptsAValidSnapshot) {
  batch_.restore(blob_);
  EXPECT_TRUE(same_bytes(batch_.snapshot(), blob_));
}

TEST_F(SnapshotRefusal, ATruncatedOne) {
  const auto expect_refused_at = [&](std::size_t length) {
    expect_refused(blob_.substr(0, length));
    if (length >= sizeof(SnapshotHeader)) expect_refused(mended(blob_.substr(0, length)));
  };
  for (std::size_t length = 0; length < blob_.size(); length += length < 64 ? 1 : 97) expect_refused_at(length);
  for (std::size_t missing = 1; missing <= 16; ++missing) expect_refused_at(blob_.size() - missing);
}

TEST_F(SnapshotRefusal, TrailingBytes) {
  for (const std::string& longer : {blob_ + '\0', blob_ + blob_}) {
    expect_refused(longer);
    expect_refused(mended(longer), "no bytes after its last array");
  }
}

TEST_F(SnapshotRefusal, AFlippedBitOfTheHeader) {
  for (std::size_t byte = 0; byte < sizeof(SnapshotHeader); ++byte) {
    for (const int bit : {0, 7}) {
      std::string damaged = blob_;
      damaged[byte] = static_cast<char>(damaged[byte] ^ (1 << bit));
      expect_refused(damaged);
      // With length and checksum updated, the other header fields are checked separately.
      if (byte < offsetof(SnapshotHeader, length)) expect_refused(mended(damaged));
    }
  }
}

TEST_F(SnapshotRefusal, AnotherFormatIsNamed) {
  SnapshotHeader header{};
  std::memcpy(&header, blob_.data(), sizeof(header));
  const std::string ours = std::to_string(header.format);
  const std::string next = std::to_string(++header.format);
  std::string newer = blob_;
  std::memcpy(newer.data(), &header, sizeof(header));
  for (const std::string& blob : {newer, mended(newer)}) {
    expect_refused(blob, "snapshot: ... format " + ours + " ... " + next);
  }
}

TEST_F(SnapshotRefusal, OtherBytesAreNamed) { expect_refused(std::string(1000, 'x'), "snapshot: ... snapshot"); }

TEST_F(SnapshotRefusal, AnArrayOfAnotherLength) {
  for (const char* array : {"position", "sensed"}) {
    for (const std::size_t byte : {0U, 7U}) {
      std::string damaged = blob_;
      damaged[offset_of(array) + byte] ^= 1;
      expect_refused(damaged, "bytes that match their checksum");
      expect_refused(mended(damaged), array);
    }
  }
}

TEST_F(SnapshotRefusal, AnUnknownWorld) {
  for (const std::int32_t world : {-1, 3, 1 << 30}) {
    std::string damaged = blob_;
    std::memcpy(damaged.data() + offset_of("world_index") + 8 + 4 * (kDrones - 1), &world, 4);
    expect_refused(damaged, "bytes that match their checksum");
    expect_refused(mended(damaged), "world indices below 3");
  }
}

TEST_F(SnapshotRefusal, AnInvalidLidar) {
  // hfov, vfov and range come first.
  for (const auto& [place, field] : {std::pair{0, "hfov_deg"}, {4, "vfov_deg"}, {8, "max_range_m"}}) {
    const float value = -1.0F;
    std::string damaged = blob_;
    std::memcpy(damaged.data() + offset_of("lidar_settings") + 8 + place, &value, 4);
    expect_refused(damaged, "bytes that match their checksum");
    expect_refused(mended(damaged), field);
  }
}

// Changes any byte to any other value.
TEST(Snapshot, AnyByteThatChangedIsRefused) {
  NavigationBatch config = navigation_batch(2, {.azimuth_deg = {0, 90, 180}, .elevation_deg = {0, 0, 0}});
  config.pose_sensor.position_noise_std_m = 0.01F;
  config.cameras = {{.width_px = 2, .height_px = 2}};
  Batch batch = config.make({closet()});
  batch.reset({});
  const std::vector<std::int64_t> actions{0, 1};
  for (int i = 0; i < 3; ++i) batch.step(actions);
  const std::string blob = batch.snapshot();
  batch.step(actions);
  const std::string before = batch.snapshot();
  Random random(8);
  for (std::size_t byte = 0; byte < blob.size(); ++byte) {
    std::string damaged = blob;
    damaged[byte] = static_cast<char>(damaged[byte] ^ static_cast<char>(1 + random.generator()() % 255));
    ASSERT_THROW(batch.restore(damaged), std::invalid_argument) << "byte " << byte;
    ASSERT_TRUE(same_bytes(batch.snapshot(), before)) << "byte " << byte;
  }
  batch.restore(blob);
  EXPECT_TRUE(same_bytes(batch.snapshot(), blob));
}

TEST_F(SnapshotRefusal, OneOfAnotherConfiguration) {
  const std::vector<std::function<void(NavigationBatch&)>> changes{
      [](NavigationBatch& c) { c.num_envs = kDrones + 1; },
      [](NavigationBatch& c) { c.episode.autoreset_mode = AutoresetMode::same_step; },
      [](NavigationBatch& c) { c.pose_sensor.position_noise_std_m = 0.02F; },
      [](NavigationBatch& c) { c.pose_sensor.orientation_noise_std_deg = 0.6F; },
      [](NavigationBatch& c) { c.pose_sensor.rate_hz = 5.0F; },
      [](NavigationBatch& c) { c.clock.policy_hz = 5.0F; },
      [](NavigationBatch& c) { c.clock.physics_hz = 20.0F; },
      [](NavigationBatch& c) { c.episode.frame_skip = 2; },
      [](NavigationBatch& c) { c.lidars[0].name = "scanner"; },
      [](NavigationBatch& c) { c.lidars[0].rate_hz = 5.0F; },
      [](NavigationBatch& c) { c.lidars[0].beams = 34; },
      [](NavigationBatch& c) { c.lidars[0].channels = 35, c.lidars[0].beams = 1; },
      [](NavigationBatch& c) { c.lidars[0].hfov_deg = 180.0F; },
      [](NavigationBatch& c) { c.lidars[0].vfov_deg = 10.0F; },
      [](NavigationBatch& c) { c.lidars[0].max_range_m = std::nextafter(3.0F, 4.0F); },
      [](NavigationBatch& c) { c.lidars[0].offset_m[2] = 0.1F; },
      [](NavigationBatch& c) { c.lidars[0].quat_wxyz = {0, 1, 0, 0}; },
      [](NavigationBatch& c) { c.lidars[0].azimuth_deg = c.lidars[0].elevation_deg = std::vector<float>(35, 1.0F); },
      [](NavigationBatch& c) { c.navigation.action = ActionKind::displacement; },
      [](NavigationBatch& c) { c.navigation.step_m = 0.2F; },
      [](NavigationBatch& c) { c.navigation.yaw_step_deg = 11.0F; },
      [](NavigationBatch& c) { c.episode.max_episode_steps = 41; },
      [](NavigationBatch& c) { c.navigation.random_start = false; },
      [](NavigationBatch& c) { c.episode.random_world = false; },
      [](NavigationBatch& c) { c.episode.stagger_first_episode = false; },
      [](NavigationBatch& c) { c.navigation.reward.distance_weight = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.crash_weight = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.free_space_weight = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.step_weight = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.action_change_weight = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.overshoot_weight = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.goal_reward = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.waypoint_share = 0.2F; },
      [](NavigationBatch& c) { c.navigation.reward.goal_radius_m = 0.4F; },
      [](NavigationBatch& c) { c.navigation.reward.min_clearance = 0.3F; },
      [](NavigationBatch& c) { c.navigation.reward.step_scale = 2.0F; },
      [](NavigationBatch& c) { c.navigation.reward.carry_over_distance = true; },
  };
  for (std::size_t i = 0; i < changes.size(); ++i) {
    SCOPED_TRACE("change " + std::to_string(i));
    NavigationBatch config = lively(AutoresetMode::next_step);
    changes[i](config);
    expect_refused(config.make(worlds()).snapshot(), "one of a batch with the same configuration and worlds");
  }
  expect_refused(Batch(lively(AutoresetMode::next_step), worlds()).snapshot());  // no task
}

TEST_F(SnapshotRefusal, NamesTheFieldThatDiffers) {
  const std::pair<std::function<void(NavigationBatch&)>, std::string> changes[] = {
      {[](NavigationBatch& c) { c.clock.policy_hz = 20.0F; }, "clock.policy_hz"},
      {[](NavigationBatch& c) { c.lidars[0].max_range_m = 2.0F; }, "lidars"},
      {[](NavigationBatch& c) { c.navigation.step_m = 0.2F; }, "task"},
  };
  for (const auto& [change, name] : changes) {
    NavigationBatch config = lively(AutoresetMode::next_step);
    change(config);
    expect_refused(config.make(worlds()).snapshot(), ", got one that differs in " + name);
  }
}

TEST(Snapshot, IsRefusedByAnotherPattern) {
  const auto batch_of = [](std::vector<float> azimuth_deg, std::vector<float> elevation_deg) {
    return std::make_unique<Batch>(
        lidar_batch(2, {.azimuth_deg = std::move(azimuth_deg), .elevation_deg = std::move(elevation_deg)}), worlds());
  };
  const auto batch = batch_of({0, 10}, {0, 20});
  EXPECT_NO_THROW(batch->restore(batch_of({0, 10}, {0, 20})->snapshot()));
  EXPECT_REFUSED(batch->restore(batch_of({0, 11}, {0, 20})->snapshot()), "snapshot");
  EXPECT_REFUSED(batch->restore(batch_of({0, 10}, {0, 21})->snapshot()), "snapshot");
}

TEST_F(SnapshotRefusal, OneOfOtherWorldsOrAnotherDrone) {
  const NavigationBatch config = lively(AutoresetMode::next_step);
  Batch::Worlds swapped = worlds();
  std::swap(swapped[0], swapped[1]);
  expect_refused(config.make(swapped).snapshot());
  Batch::Worlds fewer = worlds();
  fewer.pop_back();
  expect_refused(config.make(fewer).snapshot());
  Batch::Worlds more = worlds();
  more.push_back(more[0]);
  expect_refused(config.make(more).snapshot());
  const auto changed = [&](const std::string& from, const std::string& to) {
    std::string json = worlds()[0]->to_json();
    const std::size_t at = json.find(from);
    EXPECT_NE(at, std::string::npos) << from;
    Batch::Worlds other = worlds();
    other[0] = World::from_json(json.replace(at, from.size(), to));
    return config.make(other).snapshot();
  };
  expect_refused(changed(R"("name")", R"("light": {"gamma": 2}, "name")"));
  expect_refused(changed(R"("base_color")", R"("semantic": 9, "base_color")"));
  std::vector<Vec3> hull(batch_.drone().hull().begin(), batch_.drone().hull().end());
  hull[0] *= 0.99F;
  expect_refused(Batch(config, worlds(), make_task(config.navigation), DroneModel(hull)).snapshot());
  EXPECT_NO_THROW(batch_.restore(changed(R"("name")", R"("light": {"gamma": 2.2}, "name")")));  // same as the default
}

}  // namespace
}  // namespace flockstep
