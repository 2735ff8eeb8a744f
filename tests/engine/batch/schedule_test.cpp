#include "batch/schedule.hpp"

#include "allocation_counter.hpp"
#include "random.hpp"

namespace flockstep {
namespace {

using namespace testing;

struct Envs {
  std::vector<std::int32_t> world_index;
  std::vector<std::uint8_t> active;
};

Envs random_envs(Random& random, std::size_t count, std::size_t num_worlds, float part) {
  Envs envs;
  for (std::size_t i = 0; i < count; ++i) {
    envs.world_index.push_back(static_cast<std::int32_t>(random.generator()() % num_worlds));
    envs.active.push_back(random.within(0, 1) < part);
  }
  return envs;
}

std::vector<EnvIndex> envs_of(Schedule& schedule) {
  std::vector<EnvIndex> envs;
  for (const Block& block : schedule.blocks()) envs.insert(envs.end(), block.envs.begin(), block.envs.end());
  return envs;
}

void expect_schedule(Schedule& schedule, const Envs& envs, std::size_t block_size) {
  const auto world_of = [&](EnvIndex env) { return envs.world_index.empty() ? 0 : envs.world_index[env]; };
  for (const Block& block : schedule.blocks()) {
    ASSERT_FALSE(block.envs.empty());
    ASSERT_LE(block.envs.size(), block_size);
    for (const EnvList* list : {&block.flown, &block.flying, &block.resetting, &block.selected}) ASSERT_TRUE(list->empty());
  }
  // Every active env appears once, sorted by world if worlds are given, then by index.
  std::vector<EnvIndex> expected;
  for (std::size_t env = 0; env < envs.active.size(); ++env) {
    if (envs.active[env]) expected.push_back(EnvIndex(env));
  }
  std::stable_sort(expected.begin(), expected.end(), [&](auto a, auto b) { return world_of(a) < world_of(b); });
  ASSERT_EQ(envs_of(schedule), expected);
  // Only the last block may be smaller.
  for (std::size_t i = 1; i < schedule.blocks().size(); ++i) {
    ASSERT_EQ(schedule.blocks()[i - 1].envs.size(), std::min(block_size, envs.active.size()));
  }
}

TEST(Schedule, BlocksHoldEveryActiveEnvOnceInOrder) {
  Random random(1);
  for (const std::size_t count : {1U, 2U, 7U, 64U, 200U}) {
    for (const std::size_t worlds : {1U, 3U, 50U}) {
      for (const std::size_t block_size : {1U, 4U, 64U, 1000U}) {
        SCOPED_TRACE(::testing::Message() << count << " envs in " << worlds << " worlds, blocks of " << block_size);
        Schedule schedule(count, worlds, block_size);
        for (const float part : {1.0F, 0.5F, 0.0F, 0.9F}) {
          Envs envs = random_envs(random, count, worlds, part);
          schedule.rebuild(envs.world_index, envs.active);
          expect_schedule(schedule, envs, block_size);
          envs.world_index.clear();
          schedule.rebuild({}, envs.active);
          expect_schedule(schedule, envs, block_size);
        }
      }
    }
  }
}

TEST(Schedule, ChoosesItsBlocksByEnvsAndThreads) {
  EXPECT_EQ(Schedule(4096, 1, 0, 1).block_size(), 256U);
  EXPECT_EQ(Schedule(2048, 1, 0, 2).block_size(), 128U);  // gives each thread eight blocks
  EXPECT_EQ(Schedule(1024, 1, 0, 8).block_size(), 64U);
  EXPECT_EQ(Schedule(5, 1, 0, 8).block_size(), 5U);
  EXPECT_EQ(Schedule(4096, 1, 7, 1).block_size(), 7U);
}

TEST(Schedule, OfNoActiveEnvHasNoBlocks) {
  Schedule schedule(3, 2, 4);
  schedule.rebuild(std::vector<std::int32_t>{0, 1, 0}, std::vector<std::uint8_t>{0, 0, 0});
  EXPECT_TRUE(schedule.blocks().empty());
}

TEST(Schedule, RebuildingAllocatesNothing) {
  Random random(2);
  Schedule schedule(100, 30, 4);
  std::vector<Envs> all;
  for (int i = 0; i < 20; ++i) all.push_back(random_envs(random, 100, 30, 0.1F * static_cast<float>(i % 11)));
  const std::uint64_t before = allocations();
  for (const Envs& envs : all) schedule.rebuild(envs.world_index, envs.active);
  EXPECT_EQ(allocations() - before, 0U);
}

TEST(Schedule, ListsHoldTheirWholeBlockAndAreApart) {
  Random random(3);
  const Envs envs = random_envs(random, 50, 3, 0.9F);
  Schedule schedule(50, 3, 8);
  schedule.rebuild(envs.world_index, envs.active);
  constexpr EnvList Block::* kLists[] = {&Block::flown, &Block::flying, &Block::resetting, &Block::selected};
  for (Block& block : schedule.blocks()) {
    for (const auto list : kLists) {
      for (const EnvIndex env : block.envs) (block.*list).push(env);
    }
  }
  for (const Block& block : schedule.blocks()) {
    for (const auto list : kLists) {
      const EnvList& listed = block.*list;
      EXPECT_EQ(listed.size(), block.envs.size());
      EXPECT_TRUE(std::equal(listed.begin(), listed.end(), block.envs.begin(), block.envs.end()));
    }
  }
  schedule.rebuild(envs.world_index, envs.active);
  expect_schedule(schedule, envs, 8);
}

TEST(EnvList, FilterKeepsTheOrder) {
  EnvIndex storage[6];
  EnvList list(storage, Part::active);
  EXPECT_TRUE(list.empty());
  for (const std::uint32_t env : {9U, 2U, 7U, 4U, 1U, 8U}) list.push(EnvIndex(env));
  std::vector<std::size_t> asked;
  list.filter([&](EnvIndex env) {
    asked.push_back(env);
    return env % 2 == 1 || env == 8;
  });
  EXPECT_EQ(asked, (std::vector<std::size_t>{9, 2, 7, 4, 1, 8})) << "each once";
  EXPECT_EQ(std::vector<std::size_t>(list.begin(), list.end()), (std::vector<std::size_t>{9, 7, 1, 8}));
  list.push(EnvIndex(3));
  EXPECT_EQ(list.size(), 5U);
  EXPECT_EQ(list.end()[-1], EnvIndex(3));
  list.filter([](EnvIndex) { return false; });
  EXPECT_TRUE(list.empty());
}

}  // namespace
}  // namespace flockstep
