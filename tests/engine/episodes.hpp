// Checks of the episodes of every task: an env of many equals that env alone, and autoreset modes agree.
#pragma once

#include <map>

#include "batch_helpers.hpp"

namespace flockstep::testing {

inline constexpr std::array kAutoresetModes{AutoresetMode::next_step, AutoresetMode::same_step, AutoresetMode::disabled};

// Returns a row of all fields of an observation as bytes.
inline std::vector<std::byte> row_of(const std::vector<Buffer>& observation, std::size_t env) {
  std::vector<std::byte> bytes;
  for (const Buffer& field : observation) {
    const auto values = row(field.bytes(), env, field.row_bytes());
    bytes.insert(bytes.end(), values.begin(), values.end());
  }
  return bytes;
}

// Steps a batch in blocks and threads, and beside it a batch of each env alone. own_worlds(env): worlds of the latter.
// draw(random): the actions of all envs.
template <class Config, class OwnWorlds, class Draw>
void expect_many_equal_single(Config config, const Batch::Worlds& worlds, const OwnWorlds& own_worlds, int steps,
                              const Draw& draw) {
  const auto count = static_cast<std::size_t>(config.num_envs);
  const std::vector<std::uint64_t> seeds = seeds_from(77, count);
  config.block_size = 4;
  config.num_threads = 2;
  Batch many = config.make(worlds);
  many.reset(seeds);
  config.num_envs = config.num_threads = 1;
  config.block_size = 64;
  std::vector<std::unique_ptr<Batch>> alone;
  for (std::size_t i = 0; i < count; ++i) {
    alone.emplace_back(new Batch(config.make(own_worlds(i))));
    alone[i]->reset(std::span(seeds).subspan(i, 1));
  }
  Random random(2);
  std::map<std::string, int> ends;
  for (int step = 0; step < steps; ++step) {
    const auto actions = draw(random);
    many.step(row(actions, 0, actions.size()));
    std::vector<std::uint8_t> mask(count, 0);
    for (std::size_t i = 0; i < count; ++i) {
      alone[i]->step(row(actions, i, actions.size() / count));
      ASSERT_TRUE(same_drone(many, i, *alone[i], 0)) << "step " << step;
      ends["crashed"] += many.outputs().crashed[i];
      ends["success"] += many.outputs().success[i];
      ends["truncated"] += many.outputs().truncated[i];
      mask[i] = step % 7 == 6 && (many.outputs().terminated[i] || many.outputs().truncated[i]);
    }
    if (config.episode.autoreset_mode != AutoresetMode::disabled || std::ranges::count(mask, 1) == 0) continue;
    many.reset({}, mask);
    for (std::size_t i = 0; i < count; ++i) {
      if (mask[i]) alone[i]->reset({});
      ASSERT_TRUE(same_drone(many, i, *alone[i], 0)) << "reset in step " << step;
    }
  }
  for (const char* const kind : {"crashed", "success", "truncated"}) EXPECT_GT(ends[kind], 0) << kind;
}

// The results of an env for the begin of an episode, or for a step.
struct EpisodeRow {
  std::vector<std::byte> observation;
  float reward = 0.0F;
  std::uint8_t terminated = 0, truncated = 0;
  bool operator==(const EpisodeRow&) const = default;
};

// Returns the rows of each env, without those that a mode adds for resets. Actions are functions of env, episode and step:
// action_of(a number of them).
template <class ActionOf>
std::vector<std::vector<EpisodeRow>> episode_rows(const NavigationBatch& config, const Batch::Worlds& worlds, int steps,
                                                  const ActionOf& action_of) {
  const auto count = static_cast<std::size_t>(config.num_envs);
  const AutoresetMode mode = config.episode.autoreset_mode;
  Batch batch = config.make(worlds);
  batch.reset(seeds_from(5, count));
  std::vector<std::vector<EpisodeRow>> rows(count);
  std::vector<std::uint64_t> episode(count, 0), step(count, 0);
  std::vector<std::uint8_t> ended(count, 0);
  std::vector<std::int64_t> actions(count);
  const auto observe = [&](std::size_t env) { rows[env].push_back({row_of(batch.outputs().observation, env)}); };
  for (std::size_t i = 0; i < count; ++i) observe(i);
  for (int time = 0; time < steps; ++time) {
    for (std::size_t i = 0; i < count; ++i) {
      const std::uint64_t number = i * 31 + episode[i] * 17 + step[i] * step[i] * 7 + step[i] / 3;
      actions[i] = static_cast<std::int64_t>(action_of(number));
    }
    batch.step(actions);
    const Outputs& out = batch.outputs();
    for (std::size_t i = 0; i < count; ++i) {
      if (mode == AutoresetMode::next_step && ended[i]) {  // reset row
        observe(i);
        ended[i] = 0;
        continue;
      }
      ended[i] = out.terminated[i] || out.truncated[i];
      const bool was_reset = ended[i] && mode == AutoresetMode::same_step;
      rows[i].push_back(
          {row_of(was_reset ? out.final_observation : out.observation, i), out.reward[i], out.terminated[i], out.truncated[i]});
      ++step[i];
      if (!ended[i]) continue;
      ++episode[i];
      step[i] = 0;
      if (was_reset) observe(i);
    }
    if (mode != AutoresetMode::disabled || std::ranges::count(ended, 1) == 0) continue;
    batch.reset({}, ended);
    for (std::size_t i = 0; i < count; ++i) {
      if (ended[i]) observe(i);
    }
  }
  return rows;
}

// least_rows, least_ends: in each env.
template <class ActionOf>
void expect_modes_agree(NavigationBatch config, const Batch::Worlds& worlds, int steps, const ActionOf& action_of,
                        std::size_t least_rows, long least_ends) {
  config.episode.autoreset_mode = AutoresetMode::next_step;
  const auto next_step = episode_rows(config, worlds, steps, action_of);
  for (const AutoresetMode mode : {AutoresetMode::same_step, AutoresetMode::disabled}) {
    config.episode.autoreset_mode = mode;
    const auto other = episode_rows(config, worlds, steps, action_of);
    for (std::size_t i = 0; i < other.size(); ++i) {
      const std::size_t count = std::min(next_step[i].size(), other[i].size());
      ASSERT_GE(count, least_rows);
      EXPECT_GE(std::ranges::count_if(other[i], [](const EpisodeRow& row) { return row.terminated || row.truncated; }),
                least_ends);
      for (std::size_t k = 0; k < count; ++k) ASSERT_EQ(next_step[i][k], other[i][k]) << "env " << i << ", row " << k;
    }
  }
}

}  // namespace flockstep::testing
