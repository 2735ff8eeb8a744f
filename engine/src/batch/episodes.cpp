#include "batch/episodes.hpp"

#include <algorithm>
#include <array>
#include <utility>

#include "base/dtype.hpp"
#include "base/indices.hpp"
#include "base/random.hpp"
#include "batch/bad_states.hpp"
#include "world/scene_description.hpp"

namespace flockstep {
namespace {

// The additive identity: adding it changes no number, not even the sign of 0 and -0.
constexpr double kNothing = -0.0;

// Compares rows and sets a flag for each pair that differs. kColumns: numbers in a row, 0 if unknown at compile time.
template <class T, std::size_t kColumns>
void compare_rows(const Buffer& a, const Buffer& b, std::size_t first, std::size_t count, std::uint8_t* differ) {
  const std::size_t columns = kColumns > 0 ? kColumns : a.columns();
  const T* x = a.row<T>(first).data();
  const T* y = b.row<T>(first).data();
  for (std::size_t row = 0; row < count; ++row, x += columns, y += columns) {
    std::uint8_t is_other = 0;  // rows are short: memcmp would be slower
    for (std::size_t k = 0; k < columns; ++k) is_other |= x[k] != y[k];
    differ[row] = is_other;
  }
}

template <class T>
void compare_rows(const Buffer& a, const Buffer& b, std::size_t first, std::size_t count, std::uint8_t* differ) {
  if (a.columns() == 4) return compare_rows<T, 4>(a, b, first, count, differ);  // rotor commands
  if (a.columns() == 1) return compare_rows<T, 1>(a, b, first, count, differ);
  compare_rows<T, 0>(a, b, first, count, differ);
}

// Sets action_changed for consecutive envs: 1 if the action differs from that of the previous step, or is the first.
void compare_actions(const TaskState& task_state, std::size_t first_env, std::size_t num_envs, std::size_t rows,
                     EpisodeState& episodes) {
  const std::size_t first = first_env * rows, count = num_envs * rows;
  std::uint8_t* const changed = episodes.action_changed.data() + first;
  with_type(task_state.actions.type(),
            [&]<class T>(T) { compare_rows<T>(task_state.actions, task_state.actions_before, first, count, changed); });
  const std::int64_t* const steps = episodes.steps.data() + first;
  for (std::size_t row = 0; row < count; ++row) changed[row] |= steps[row] == 0 ? 1 : 0;
}

// Sums each row, adding its numbers in order. Several rows are summed side by side.
void sum_rows(const double* rows, std::size_t columns, std::size_t count, double* sums) {
  std::fill_n(sums, count, 0.0);
  constexpr std::size_t kTogether = 16;
  for (std::size_t first = 0; first < count; first += kTogether) {
    const std::size_t end = std::min(first + kTogether, count);
    for (std::size_t k = 0; k < columns; ++k) {
      for (std::size_t row = first; row < end; ++row) sums[row] += rows[row * columns + k];
    }
  }
}

// Adds `count` reward terms of consecutive rows, earned in one flown step, to all running sums. Each loop covers the terms of
// all rows.
void add_up(Simulation& sim, std::size_t first, std::size_t count) {
  TaskState& task_state = *sim.task_state;
  const double* const terms = task_state.score.terms.data() + first;
  std::size_t bad = 0;
  for (std::size_t i = 0; i < count; ++i) bad += !is_reward(terms[i]);
  if (bad > 0) drop_bad_terms(sim, first / task_state.score.num_terms, count / task_state.score.num_terms);
  double* const sums = sim.episodes.episode_terms.data() + first;
  double* const shown_sums = sim.outputs.now().episode_terms.data() + first;
  for (std::size_t i = 0; i < count; ++i) shown_sums[i] = sums[i] += terms[i];
  double* const earned = task_state.earned.empty() ? nullptr : task_state.earned.data() + first;
  for (std::size_t i = 0; earned != nullptr && i < count; ++i) earned[i] += terms[i];
  const double* const step = earned != nullptr ? earned : terms;
  float* const shown = sim.outputs.now().reward_terms.data() + first;
  for (std::size_t i = 0; i < count; ++i) shown[i] = static_cast<float>(step[i]);
}

// Adds the rewards that at most kMaxRows consecutive rows earned in a flown step.
constexpr std::size_t kMaxRows = 64;
void accumulate_rewards(Simulation& sim, std::size_t first, std::size_t count) {
  TaskState& task_state = *sim.task_state;
  Outputs& out = sim.outputs.now();
  const std::size_t num_terms = task_state.score.num_terms;
  add_up(sim, first * num_terms, count * num_terms);
  std::array<double, kMaxRows> totals, step_totals;  // sums over this flown step, and over all with this action
  sum_rows(task_state.score.terms.data() + first * num_terms, num_terms, count, totals.data());
  const bool repeats = !task_state.earned.empty();
  if (repeats) sum_rows(task_state.earned.data() + first * num_terms, num_terms, count, step_totals.data());
  const double* const shown = repeats ? step_totals.data() : totals.data();
  double* const returns = sim.episodes.episode_return.data() + first;
  for (std::size_t i = 0; i < count; ++i) returns[i] += totals[i];
  for (std::size_t i = 0; i < count; ++i) out.reward[first + i] = static_cast<float>(shown[i]);
  std::copy_n(returns, count, out.episode_return.data() + first);
}

// The reason why the episode of a row ended.
EpisodeEnd reason_of(const Simulation& sim, std::size_t row, bool hit) {
  const Score& score = sim.task_state->score;
  const Outputs& out = sim.outputs.now();
  const std::int64_t limit = sim.episodes.time_limit[row];
  const bool is_late = limit > 0 && sim.episodes.steps[row] >= limit;
  const bool by_task = score.terminated[row] || score.truncated[row];
  if (out.bad_state[row]) return EpisodeEnd::bad_state;
  if (score.success[row]) return EpisodeEnd::success;
  if (out.terminated[row] && hit) return EpisodeEnd::contact;
  if (by_task && score.left_area[row]) return EpisodeEnd::left_area;
  if (out.truncated[row] && is_late) return EpisodeEnd::time;
  return by_task ? EpisodeEnd::task : EpisodeEnd::teammate;
}

// Decides which of `count` consecutive rows end their episodes, ignoring teammates. Flags are bytes, so that a SIMD register
// holds many of them.
void decide_ends(Simulation& sim, std::size_t first, std::size_t count, std::uint8_t* ends) {
  EpisodeState& episodes = sim.episodes;
  const std::int64_t *const lengths = episodes.steps.data() + first, *const limits = episodes.time_limit.data() + first;
  const Score& score = sim.task_state->score;
  Outputs& out = sim.outputs.now();
  using Flags = std::array<std::uint8_t, kMaxRows>;
  Flags is_late, hits;
  std::copy_n(lengths, count, out.episode_length.data() + first);
  for (std::size_t i = 0; i < count; ++i) is_late[i] = (limits[i] > 0) & (lengths[i] >= limits[i]);
  if (sim.num_rows() == sim.num_drones()) {
    std::copy_n(sim.state.contact.hit.data() + first, count, hits.data());
  } else {
    for (std::size_t i = 0; i < count; ++i) hits[i] = touches(sim, first + i);
  }
  const std::uint8_t ends_on_contact = sim.fleet && sim.config.dynamics.on_contact == OnContact::terminate;
  const std::uint8_t* const bad = episodes.bad.data() + first;
  const std::uint8_t* const terminated_by_task = score.terminated.data() + first;
  const std::uint8_t* const truncated_by_task = score.truncated.data() + first;
  const std::uint8_t* const success = score.success.data() + first;
  Flags terminated, truncated, ended, succeeds, crashes;
  for (std::size_t i = 0; i < count; ++i) {
    terminated[i] = (bad[i] | terminated_by_task[i] | (hits[i] & ends_on_contact)) != 0;
    truncated[i] = (truncated_by_task[i] | is_late[i]) > terminated[i];
    ended[i] = (terminated[i] | truncated[i]) != 0;
    succeeds[i] = (ended[i] & success[i]) > bad[i];
    crashes[i] = (ended[i] & hits[i]) != 0;
  }
  std::copy_n(ended.data(), count, ends);
  std::copy_n(terminated.data(), count, out.terminated.data() + first);
  std::copy_n(truncated.data(), count, out.truncated.data() + first);
  std::copy_n(succeeds.data(), count, out.success.data() + first);
  std::copy_n(crashes.data(), count, out.crashed.data() + first);
  std::copy_n(bad, count, out.bad_state.data() + first);
  std::uint8_t* const reasons = out.episode_end.data() + first;
  std::fill_n(reasons, count, static_cast<std::uint8_t>(EpisodeEnd::none));
  if (is_any(ended.data(), count)) {
    for (std::size_t i = 0; i < count; ++i) {
      if (ended[i]) reasons[i] = static_cast<std::uint8_t>(reason_of(sim, first + i, hits[i] != 0));
    }
  }
  if (is_any(bad, count)) {
    for (std::size_t i = 0; i < count; ++i) episodes.bad_states[first + i] += bad[i];
    std::fill_n(episodes.bad.data() + first, count, std::uint8_t{0});
  }
  std::fill_n(episodes.action_changed.data() + first, count, std::uint8_t{0});  // frame_skip repeats the action
}

// Finishes a flown step of at most kMaxRows consecutive envs with one row each.
void finish_single_rows(Simulation& sim, std::size_t first, std::size_t count) {
  accumulate_rewards(sim, first, count);
  decide_ends(sim, first, count, sim.episodes.done.data() + first);
}

// Truncates the rows of an env whose episodes go on.
void truncate_others(Simulation& sim, EnvIndex env) {
  const std::size_t rows = sim.rows_per_env();
  Outputs& out = sim.outputs.now();
  for (std::size_t row = env * rows; row < (env + 1) * rows; ++row) {
    if (!sim.state.active[row] || out.terminated[row] || out.truncated[row]) continue;
    const bool hit = touches(sim, row);
    out.truncated[row] = 1;
    out.success[row] = sim.task_state->score.success[row];
    out.crashed[row] = hit;
    out.episode_end[row] = static_cast<std::uint8_t>(reason_of(sim, row, hit));
  }
}

// Finishes a flown step of an env with several rows.
void finish_rows(Simulation& sim, EnvIndex env) {
  const std::size_t begin = env * sim.rows_per_env(), end = begin + sim.rows_per_env();
  // Removed drones of a team have a score of 0. Other rows that do not fly keep an old score.
  const bool is_team = sim.episodes_mode() == Episodes::team;
  const auto flies = [&](std::size_t row) { return is_team || sim.takes_part(DroneIndex(row), Part::flying); };
  std::array<std::uint8_t, kMaxRows> ended;
  for (std::size_t first = begin; first < end;) {
    std::size_t count = 0;
    while (count < kMaxRows && first + count < end && flies(first + count)) ++count;
    if (count > 0) {
      accumulate_rewards(sim, first, count);
      decide_ends(sim, first, count, ended.data());
    }
    first += std::max<std::size_t>(count, 1);
  }
  for (std::size_t row = begin; is_team && row < end; ++row) {
    if (!sim.state.active[row]) sim.outputs.clear(row);
  }
  end_rows(sim, env);
}

// Marks all rows of an env as over.
void end_env(Simulation& sim, EnvIndex env) {
  const std::size_t rows = sim.rows_per_env();
  std::fill_n(sim.episodes.done.data() + env * rows, rows, std::uint8_t{1});
}

// Reactivates the env's finished drones.
void reactivate(Simulation& sim, EnvIndex env) {
  for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
    const DroneIndex drone = sim.drone_of(env, member);
    if (std::exchange(sim.state.own.finished[drone], std::uint8_t{0})) sim.set_active(drone, true);
  }
}

// Writes the row of a drone that is finished during a step.
void skip_finished(Simulation& sim, DroneIndex drone) {
  if (sim.episodes.flying[drone]) {  // its first step of rest
    clear_contact(sim.state, drone);
    for (const auto& sensor : sim.suite) sensor->clear(drone);
    sim.cameras.clear(drone);
  }
  if (sim.config.episode.autoreset_mode == AutoresetMode::disabled) {
    sim.outputs.carry_over(drone);
  } else {
    sim.outputs.rest(sim.task_state->spec(), drone);
  }
}

// Selects the drones of an env that fly. Each drone whose episode has ended begins its next one in this step, or holds still.
void select_drones(Simulation& sim, Block& block, EnvIndex env) {
  const bool resets = sim.config.episode.autoreset_mode != AutoresetMode::disabled;
  EpisodeState& episodes = sim.episodes;
  block.flown.push(env);
  block.flying.push(env);
  bool any_resets = false;
  for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
    const DroneIndex drone = sim.drone_of(env, member);
    const bool is_over = sim.state.active[drone] && episodes.done[drone];
    episodes.flying[drone] = !waits(sim, drone);
    sim.begins[drone] = is_over && resets;
    any_resets |= is_over && resets;
    if (!is_over) continue;
    if (resets) {
      sim.outputs.clear(drone);
    } else {
      sim.outputs.carry_over(drone);
    }
  }
  if (any_resets) block.resetting.push(env);
}

}  // namespace

bool touches(const Simulation& sim, std::size_t row) {
  const std::size_t drones = sim.num_drones() / sim.num_rows();
  return is_any(sim.state.contact.hit.data() + row * drones, drones);
}

bool waits(const Simulation& sim, std::size_t row) {
  const Episodes mode = sim.episodes_mode();
  if (mode == Episodes::each && !sim.state.active[row]) return true;
  return sim.episodes.done[row] || (mode == Episodes::last && sim.state.own.finished[row]);
}

void end_rows(Simulation& sim, EnvIndex env) {
  const std::size_t rows = sim.rows_per_env();
  const Episodes mode = sim.episodes_mode();
  const Outputs& out = sim.outputs.now();
  bool ends = false;
  if (rows == 1) {
    ends = out.terminated[env] || out.truncated[env];
  } else if (mode == Episodes::last && sim.episodes.done[env * rows]) {
    return;  // all have ended before
  } else {
    for (std::size_t row = env * rows; row < (env + 1) * rows; ++row) {
      if (!(out.terminated[row] || out.truncated[row]) || !sim.takes_part(DroneIndex(row), Part::flying)) continue;
      ends = true;
      if (mode == Episodes::each) sim.episodes.done[row] = 1;
      if (mode == Episodes::last) {
        sim.set_active(DroneIndex(row), false);
        sim.state.own.finished[row] = 1;
      }
    }
  }
  if (!ends || mode == Episodes::each) return;
  if (mode == Episodes::last) return end_rest(sim, env);
  end_env(sim, env);
  if (rows > 1) truncate_others(sim, env);
}

void end_rest(Simulation& sim, EnvIndex env) {
  if (sim.episodes_mode() != Episodes::last || is_any(sim.state.active.data() + sim.drone_of(env, 0), sim.drones_per_env()))
    return;
  reactivate(sim, env);
  end_env(sim, env);
}

void clear_contact(State& state, DroneIndex drone) {
  state.contact.hit[drone] = state.contact.inside[drone] = 0;
  state.contact.fraction[drone] = 1.0F;
  std::fill_n(state.contact.point.data() + 3 * drone, 3, 0.0F);
  std::fill_n(state.contact.normal.data() + 3 * drone, 3, 0.0F);
  state.contact.body[drone] = state.contact.drone[drone] = -1;
  std::fill_n(state.contact.surface_velocity.data() + 3 * drone, 3, 0.0F);
}

void forget_own_episodes(Simulation& sim, EnvIndex env) {
  if (sim.state.own.own_episodes.empty()) return;
  std::fill_n(sim.state.own.own_episodes.data() + sim.drone_of(env, 0), sim.drones_per_env(), std::int64_t{0});
}

void forget_readings(Simulation& sim, EnvIndex env) {
  sim.state.tick[env] = 0;
  sim.state.sensed[env] = -1;
  for (std::size_t member = 0; member < sim.drones_per_env(); ++member) forget_readings(sim, sim.drone_of(env, member));
}

void forget_readings(Simulation& sim, DroneIndex drone) {
  if (sim.fleet) sim.fleet->begin_parameters(sim.state, drone);
  for (const auto& sensor : sim.suite) sensor->begin(drone, sim.state);
  sim.cameras.mark_stale(drone);
}

std::int64_t next_episode(const Simulation& sim, EnvIndex env) {
  return sim.state.episode[env] + (sim.episodes.started[env] ? 1 : 0);
}

void start_next_episode(Simulation& sim, EnvIndex env, Scratch& scratch) {
  sim.state.episode[env] = next_episode(sim, env);
  open_episode(sim, env, scratch);
}

void start_next_episode(Simulation& sim, DroneIndex drone) {
  ++sim.state.own.own_episodes[drone];
  forget_readings(sim, drone);
  start_counts(sim, sim.row_of(drone), 1);
}

void open_episode(Simulation& sim, EnvIndex env, Scratch& scratch) {
  State& state = sim.state;
  if (sim.episodes_mode() == Episodes::last) reactivate(sim, env);
  forget_readings(sim, env);
  if (sim.config.episode.random_world && !sim.pool) {
    const double u = uniform01(draw(state, RandomKey::of(env), Stream::world, 0)[0]);
    const auto world = static_cast<std::int32_t>(u * static_cast<double>(sim.worlds.size()));
    scratch.moved_world |= world != state.world_index[env];
    state.world_index[env] = world;
  }
  draw_light(sim, env);
  if (sim.bodies) sim.bodies->begin(env);
  start_counts(sim, env);
}

void draw_light(Simulation& sim, EnvIndex env) {
  const std::vector<Light>& lights = sim.config.lights;
  if (lights.empty()) return;
  const double u = uniform01(draw(sim.state, RandomKey::of(env), Stream::light, 0)[0]);
  Light light = lights[static_cast<std::size_t>(u * static_cast<double>(lights.size()))];
  check_light(light);  // makes the direction a unit vector
  sim.lights.set(env, light);
}

void start_counts(Simulation& sim, EnvIndex env) {
  const std::size_t rows = sim.rows_per_env(), first = env * rows;
  sim.episodes.started[env] = 1;
  start_counts(sim, first, rows);
  const bool is_each = sim.episodes_mode() == Episodes::each;
  if (is_each) std::copy_n(sim.state.active.data() + first, rows, sim.begins.data() + first);
  if (!sim.config.episode.stagger_first_episode || sim.state.episode[env] != 0) return;
  for (std::size_t row = first; row < first + rows; ++row) {
    const RandomKey key = is_each ? sim.random_key(DroneIndex(row)) : RandomKey::of(env);
    const double u = uniform01(draw(sim.state, key, Stream::time_limit, 0)[0]);
    sim.episodes.time_limit[row] = 1 + static_cast<std::int64_t>(u * sim.task_state->max_episode_steps);
  }
}

void start_counts(Simulation& sim, std::size_t first, std::size_t count) {
  EpisodeState& episodes = sim.episodes;
  const std::size_t terms = sim.task_state->score.num_terms;
  const auto fill = [&](auto& values, auto value) { std::fill_n(values.data() + first, count, value); };
  fill(episodes.steps, std::int64_t{0});
  fill(episodes.time_limit, std::int64_t{sim.task_state->max_episode_steps});
  fill(episodes.episode_return, 0.0);
  std::fill_n(episodes.episode_terms.data() + first * terms, count * terms, 0.0);
  fill(episodes.done, std::uint8_t{0});
  fill(episodes.action_changed, std::uint8_t{0});
  fill(episodes.bad, std::uint8_t{0});
}

void select_envs(Simulation& sim, Block& block) {
  const bool resets = sim.config.episode.autoreset_mode != AutoresetMode::disabled;
  const Episodes mode = sim.episodes_mode();
  const bool skips = !sim.task_state->earned.empty();
  const std::size_t terms = sim.task_state->score.num_terms, rows = sim.rows_per_env();
  block.flown.clear();
  block.flying.clear();
  block.resetting.clear();
  bool all_fly = true;
  for_each_contiguous(block.envs, [&](std::size_t first, std::size_t count) {
    sim.outputs.forget_final(first * rows, count * rows);
    all_fly &= !is_any(sim.episodes.done.data() + first * rows, count * rows);
  });
  if (mode == Episodes::each) {
    for (const EnvIndex env : block.envs) select_drones(sim, block, env);
  } else if (all_fly && mode == Episodes::team) {  // the usual case
    block.flown.assign(block.envs);
    block.flying.assign(block.envs);
    for_each_contiguous(block.envs, [&](std::size_t first, std::size_t count) {
      std::fill_n(sim.episodes.flying.data() + first * rows, count * rows, std::uint8_t{1});
    });
  } else {
    for (const EnvIndex env : block.envs) {
      const bool flies = !sim.episodes.done[env * rows];
      for (std::size_t row = env * rows; row < (env + 1) * rows; ++row) {
        if (!flies && resets) sim.outputs.clear(row);
        if (!flies && !resets) sim.outputs.carry_over(row);
        if (flies && waits(sim, row)) skip_finished(sim, DroneIndex(row));
        sim.episodes.flying[row] = !waits(sim, row);
      }
      if (flies) {
        block.flown.push(env);
        block.flying.push(env);
      } else if (resets) {
        block.resetting.push(env);
      }
    }
  }
  for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
    if (skips) std::fill_n(sim.task_state->earned.data() + first * rows * terms, count * rows * terms, kNothing);
    compare_actions(*sim.task_state, first, count, rows, sim.episodes);
  });
}

void finish_step(Simulation& sim, Block& block) {
  if (sim.rows_per_env() == 1) {
    for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
      for (std::size_t done = 0; done < count; done += kMaxRows) {
        finish_single_rows(sim, first + done, std::min(kMaxRows, count - done));
      }
    });
  } else {
    for (const EnvIndex env : block.flying) finish_rows(sim, env);
  }
  if (sim.episodes_mode() == Episodes::each) return;  // the env goes on
  block.flying.filter([&](EnvIndex env) { return !sim.episodes.done[env * sim.rows_per_env()]; });
}

void keep_final(Simulation& sim, Block& block) {
  const std::size_t rows = sim.rows_per_env();
  const bool is_team = sim.episodes_mode() == Episodes::team;
  for (const EnvIndex env : block.flown) {
    if (is_team && !sim.episodes.done[env * rows]) continue;
    for (std::size_t row = env * rows; row < (env + 1) * rows; ++row) {
      if (!is_team && !sim.takes_part(DroneIndex(row), Part::flown)) continue;
      if (sim.outputs.now().terminated[row] || sim.outputs.now().truncated[row]) sim.outputs.keep_final(row);
    }
  }
}

void list_resetting(Simulation& sim, Block& block) {
  if (sim.config.episode.autoreset_mode != AutoresetMode::same_step) return;
  const std::size_t rows = sim.rows_per_env();
  const bool is_each = sim.episodes_mode() == Episodes::each;
  for (const EnvIndex env : block.flown) {
    const std::uint8_t* const done = sim.episodes.done.data() + env * rows;
    if (is_each) std::copy_n(done, rows, sim.begins.data() + env * rows);
    if (is_any(done, rows)) block.resetting.push(env);
  }
}

void advance_episodes(Simulation& sim, Block& block, Scratch& scratch) {
  if (sim.episodes_mode() == Episodes::each) {
    for (const DroneIndex drone : sim.drones_of(block.resetting, scratch)) start_next_episode(sim, drone);
  } else {
    for (const EnvIndex env : block.resetting) start_next_episode(sim, env, scratch);
  }
}

void initial_readings(Simulation& sim, Block& block, Scratch& scratch) {
  for (const EnvIndex env : block.resetting) sim.state.sensed[env] = std::max<std::int64_t>(sim.state.sensed[env], 0);
  for (const DroneIndex drone : sim.drones_of(block.resetting, scratch)) clear_contact(sim.state, drone);
}

void show_finished(Simulation& sim, Block& block) {
  for (const EnvIndex env : block.flown) {
    for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
      const DroneIndex drone = sim.drone_of(env, member);
      if (sim.state.own.finished[drone]) sim.outputs.show_absent(sim.task_state->spec(), drone);
    }
  }
}

}  // namespace flockstep
