#include "flockstep/world_pool.hpp"

#include <map>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"

namespace flockstep {
namespace {

using namespace testing;

// Closets made on demand. Higher numbers are wider.
class Closets final : public WorldSource {
 public:
  std::shared_ptr<const World> get(std::int32_t number) override {
    if (number == broken) throw std::runtime_error("no such closet");
    ++asked;
    const float half = 0.7F + 0.01F * static_cast<float>(number % 50);
    const auto world = make_world({primitive(PrimitiveKind::room, {1, 1, 0.75F}, {half, 1.25F, 0.75F})},
                                  {.start = Vec3(1, 1, 0.75F), .goal = Vec3(1, 1.4F, 0.75F)});
    made.push_back(world);
    return world;
  }
  void want(std::span<const std::int32_t> numbers) override { wanted.assign(numbers.begin(), numbers.end()); }

  std::size_t alive() const {
    return static_cast<std::size_t>(std::ranges::count_if(made, [](const auto& world) { return !world.expired(); }));
  }

  std::int32_t broken = -1;
  int asked = 0;
  std::vector<std::weak_ptr<const World>> made;
  std::vector<std::int32_t> wanted;
};

struct Pool {
  std::shared_ptr<Closets> source = std::make_shared<Closets>();

  Batch make(int num_envs, std::int32_t size, double fresh, AutoresetMode mode = AutoresetMode::same_step) const {
    BatchConfig config = lidar_batch(num_envs);
    config.episode.autoreset_mode = mode;
    config.episode.max_episode_steps = 3;
    return Batch(config, {.source = source, .size = size, .fresh = fresh}, make_task(NavigationConfig{}));
  }
};

void step(Batch& batch, std::int64_t action = 4) {
  const std::vector<std::int64_t> actions(static_cast<std::size_t>(batch.config().num_envs), action);
  batch.step(std::span<const std::int64_t>(actions));
}

TEST(WorldPool, AWorldLivesAsLongAsAnEnvIsInIt) {
  const Pool pool;
  {
    Batch batch = pool.make(20, 100, 2.0);
    EXPECT_EQ(pool.source->alive(), 1U);
    batch.reset({});
    for (int i = 0; i < 300; ++i) {
      step(batch);
      ASSERT_LE(pool.source->alive(), 20U);
      for (std::size_t env = 0; env < 20; ++env) ASSERT_NE(batch.world_of(EnvIndex(env)), nullptr);
    }
    EXPECT_GT(pool.source->asked, 1000);
    EXPECT_TRUE(batch.worlds().empty());
  }
  EXPECT_EQ(pool.source->alive(), 0U);
}

TEST(WorldPool, EnvsOfEqualNumbersShareAWorld) {
  const Pool pool;
  Batch batch = pool.make(50, 7, 0.0);
  batch.reset({});
  for (int i = 0; i < 30; ++i) step(batch);
  std::map<std::int32_t, const World*> by_number;
  for (std::size_t env = 0; env < 50; ++env) {
    const auto [known, is_new] = by_number.emplace(batch.state().world_index[env], batch.world_of(EnvIndex(env)).get());
    EXPECT_EQ(known->second, batch.world_of(EnvIndex(env)).get());
  }
  EXPECT_GT(by_number.size(), 4U);
}

TEST(WorldPool, WorldsOfTheNextEpisodesAreRequestedInTime) {
  const Pool pool;
  Batch batch = pool.make(5, 1000, 1.0, AutoresetMode::next_step);
  batch.reset({});
  std::vector<std::int32_t> wanted = pool.source->wanted;
  EXPECT_EQ(wanted.size(), 5U);
  const WorldPool same{.source = pool.source, .size = 1000, .fresh = 1.0};
  for (std::uint64_t env = 0; env < 5; ++env) EXPECT_NE(std::ranges::find(wanted, same.number_of(env, 1)), wanted.end());
  while (batch.state().episode[0] == 0) step(batch);  // all begin the next episode at the same time
  EXPECT_TRUE(std::ranges::all_of(batch.state().episode, [](std::int64_t episode) { return episode == 1; }));
  for (const std::int32_t number : batch.state().world_index) EXPECT_NE(std::ranges::find(wanted, number), wanted.end());
}

TEST(WorldPool, NumbersEnd) {
  const WorldPool pool{.source = std::make_shared<Closets>(), .size = 1000, .fresh = 3.0};
  constexpr std::int32_t kLast = std::numeric_limits<std::int32_t>::max();
  for (const std::int64_t episode : {std::int64_t{1} << 31, std::int64_t{1} << 62}) {
    for (std::uint64_t seed = 0; seed < 100; ++seed) {
      EXPECT_GT(pool.number_of(seed, episode), kLast - 1000);
    }
  }
  EXPECT_LT(pool.number_of(1, 10), 1030);
  EXPECT_GE(pool.number_of(1, 10), 30);
}

void expect_no_allocation(AutoresetMode mode) {
  const Pool pool;
  Batch batch = pool.make(64, 1, 0.0, mode);  // all episodes use one world
  batch.reset({});
  for (int i = 0; i < 20; ++i) step(batch);
  const std::int64_t before = batch.state().episode[0];
  const std::vector<std::int64_t> actions(64, 4);
  const std::uint64_t allocated = allocations();
  for (int i = 0; i < 100; ++i) batch.step(std::span<const std::int64_t>(actions));
  EXPECT_EQ(allocations() - allocated, 0U);
  EXPECT_GT(batch.state().episode[0], before + 10);
  EXPECT_EQ(pool.source->asked, 1);
}

TEST(WorldPool, AnEpisodeInALoadedWorldAllocatesNothing) {
  expect_no_allocation(AutoresetMode::same_step);
  expect_no_allocation(AutoresetMode::next_step);
}

TEST(WorldPool, AResetThatFailsChangesNothing) {
  const Pool pool;
  Batch batch = pool.make(5, 10, 0.0);
  batch.reset({});
  step(batch);
  const std::string before = batch.snapshot();
  const WorldPool same{.source = pool.source, .size = 10, .fresh = 0.0};
  std::uint64_t seed = 100;
  while (std::ranges::count(batch.state().world_index, same.number_of(seed, 0)) > 0) ++seed;
  pool.source->broken = same.number_of(seed, 0);
  std::vector<std::uint64_t> seeds(5);
  seeds[3] = seed;
  EXPECT_THROW(batch.reset(seeds), std::runtime_error);
  EXPECT_EQ(batch.snapshot(), before);
  step(batch);
}

TEST(WorldPool, AFailedStepIsInterrupted) {
  const Pool pool;
  Batch batch = pool.make(4, 1, 1.0);
  batch.reset({});
  pool.source->broken = 3;
  EXPECT_THROW(
      {
        for (int i = 0; i < 20; ++i) step(batch);
      },
      std::runtime_error);
  EXPECT_EQ(batch.state().episode[0], 2);
  EXPECT_THROW(step(batch), std::runtime_error);
  batch.reset(std::vector<std::uint64_t>(4, 1));
  step(batch);
}

TEST(WorldPool, IsValidated) {
  const auto source = std::make_shared<Closets>();
  const auto refused = [&](const WorldPool& pool) { EXPECT_THROW(pool.validate(), std::invalid_argument); };
  refused({.source = nullptr});
  refused({.source = source, .size = 0});
  refused({.source = source, .size = (1 << 24) + 1});
  refused({.source = source, .fresh = -1.0});
  refused({.source = source, .fresh = std::numeric_limits<double>::quiet_NaN()});
  EXPECT_THROW(Batch(lidar_batch(1), WorldPool{.source = source}, nullptr), std::invalid_argument);
}

}  // namespace
}  // namespace flockstep
