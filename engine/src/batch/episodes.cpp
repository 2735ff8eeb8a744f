#include "batch/episodes.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <string>
#include <type_traits>
#include <utility>

#include "base/contiguous.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "batch/bad_states.hpp"
#include "batch/checks.hpp"

namespace flockstep {
namespace {

// The number that changes no other by being added to it, 0 and -0 included.
constexpr double kNothing = -0.0;

// Whether rows differ. kColumns: how many numbers a row has, 0 if that is not known when this is compiled.
template <class T, std::size_t kColumns>
void compare_rows(const Buffer& a, const Buffer& b, std::size_t first, std::size_t count, std::uint8_t* differ) {
  const std::size_t columns = kColumns > 0 ? kColumns : a.columns();
  const T* x = a.row<T>(first).data();
  const T* y = b.row<T>(first).data();
  for (std::size_t row = 0; row < count; ++row, x += columns, y += columns) {
    std::uint8_t is_other = 0;  // rows are short: a call of memcmp would cost more
    for (std::size_t k = 0; k < columns; ++k) is_other |= x[k] != y[k];
    differ[row] = is_other;
  }
}

template <class T>
void compare_rows(const Buffer& a, const Buffer& b, std::size_t first, std::size_t count, std::uint8_t* differ) {
  if (a.columns() == 4) return compare_rows<T, 4>(a, b, first, count, differ);  // what rotors are told
  if (a.columns() == 1) return compare_rows<T, 1>(a, b, first, count, differ);
  compare_rows<T, 0>(a, b, first, count, differ);
}

// Whether the action of this step is another than that of the step before, or the first.
void compare_actions(const TaskState& task_state, std::size_t first, std::size_t count, EpisodeState& episodes) {
  std::uint8_t* const changed = episodes.action_changed.data() + first;
  switch (task_state.actions.type()) {
    case DType::int32:
      compare_rows<std::int32_t>(task_state.actions, task_state.actions_before, first, count, changed);
      break;
    case DType::int64:
      compare_rows<std::int64_t>(task_state.actions, task_state.actions_before, first, count, changed);
      break;
    case DType::float32:
      compare_rows<float>(task_state.actions, task_state.actions_before, first, count, changed);
      break;
    case DType::float64:
      compare_rows<double>(task_state.actions, task_state.actions_before, first, count, changed);
      break;
    default:
      compare_rows<std::uint8_t>(task_state.actions, task_state.actions_before, first, count, changed);
  }
  for (std::size_t i = 0; i < count; ++i) changed[i] |= episodes.steps[first + i] == 0;
}

// The sum of each of some rows, of its numbers in their order, of several rows side by side.
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

// So many terms of the score's, from the first on, go into all sums that there are of them. They are what envs that follow each
// other have earned in a flown step, so these loops are long.
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

// Adds up the rewards of at most kSettled consecutive envs, and decides which of their episodes end.
constexpr std::size_t kSettled = 64;
void settle_contiguous(Simulation& sim, std::size_t first, std::size_t count) {
  EpisodeState& episodes = sim.episodes;
  TaskState& task_state = *sim.task_state;
  Outputs& out = sim.outputs.now();
  const std::size_t num_terms = task_state.score.num_terms;
  add_up(sim, first * num_terms, count * num_terms);

  std::array<double, kSettled> totals, step_totals;  // of this flown step, and of those flown so far
  sum_rows(task_state.score.terms.data() + first * num_terms, num_terms, count, totals.data());
  if (!task_state.earned.empty()) sum_rows(task_state.earned.data() + first * num_terms, num_terms, count, step_totals.data());
  const double* const shown = task_state.earned.empty() ? totals.data() : step_totals.data();
  double* const returns = episodes.episode_return.data() + first;
  for (std::size_t i = 0; i < count; ++i) returns[i] += totals[i];
  for (std::size_t i = 0; i < count; ++i) out.reward[first + i] = static_cast<float>(shown[i]);
  std::copy_n(returns, count, out.episode_return.data() + first);
  std::copy_n(episodes.steps.data() + first, count, out.episode_length.data() + first);

  // Flags: bytes, of which a vector holds many. Nothing is asked of one that another has decided.
  using Flags = std::array<std::uint8_t, kSettled>;
  Flags is_late, hits;
  const std::int64_t* const steps = episodes.steps.data() + first;
  const std::int64_t* const limits = episodes.time_limit.data() + first;
  for (std::size_t i = 0; i < count; ++i) is_late[i] = (limits[i] > 0) & (steps[i] >= limits[i]);
  if (sim.drones_per_env() == 1) {
    std::copy_n(sim.state.contact.hit.data() + first, count, hits.data());
  } else {
    for (std::size_t i = 0; i < count; ++i) hits[i] = touches(sim, first + i);
  }
  const std::uint8_t ends_on_contact = sim.fleet && sim.config.dynamics.on_contact == OnContact::terminate;
  const std::uint8_t* const bad = episodes.bad.data() + first;
  const std::uint8_t* const told_terminated = task_state.score.terminated.data() + first;
  const std::uint8_t* const told_truncated = task_state.score.truncated.data() + first;
  const std::uint8_t* const success = task_state.score.success.data() + first;
  Flags terminated, truncated, ends, succeeds, crashes;
  for (std::size_t i = 0; i < count; ++i) {
    terminated[i] = (bad[i] | told_terminated[i] | (hits[i] & ends_on_contact)) != 0;
    truncated[i] = (told_truncated[i] | is_late[i]) > terminated[i];
    ends[i] = (terminated[i] | truncated[i]) != 0;
    succeeds[i] = (ends[i] & success[i]) > bad[i];
    crashes[i] = (ends[i] & hits[i]) != 0;
  }
  std::copy_n(terminated.data(), count, out.terminated.data() + first);
  std::copy_n(truncated.data(), count, out.truncated.data() + first);
  std::copy_n(succeeds.data(), count, out.success.data() + first);
  std::copy_n(crashes.data(), count, out.crashed.data() + first);
  std::copy_n(ends.data(), count, episodes.done.data() + first);
  std::uint8_t* const reasons = out.episode_end.data() + first;
  std::fill_n(reasons, count, static_cast<std::uint8_t>(EpisodeEnd::none));
  if (is_any(ends.data(), count)) {
    const std::uint8_t* const left_area = task_state.score.left_area.data() + first;
    for (std::size_t i = 0; i < count; ++i) {
      if (!ends[i]) continue;
      const bool by_task = told_terminated[i] || told_truncated[i];
      const EpisodeEnd end = bad[i]                       ? EpisodeEnd::bad_state
                             : success[i]                 ? EpisodeEnd::success
                             : terminated[i] && hits[i]   ? EpisodeEnd::contact
                             : by_task && left_area[i]    ? EpisodeEnd::left_area
                             : truncated[i] && is_late[i] ? EpisodeEnd::time
                                                          : EpisodeEnd::task;
      reasons[i] = static_cast<std::uint8_t>(end);
    }
  }
  std::copy_n(bad, count, out.bad_state.data() + first);
  if (is_any(bad, count)) {
    for (std::size_t i = 0; i < count; ++i) episodes.bad_states[first + i] += bad[i];
    std::fill_n(episodes.bad.data() + first, count, std::uint8_t{0});
  }
  std::fill_n(episodes.action_changed.data() + first, count, std::uint8_t{0});  // flown once more, it is the same
}

std::string quoted(Control control) {
  return '"' + std::string(EnumNames<Control>::kNames[static_cast<std::size_t>(control)]) + '"';
}

// Those that a task takes, as a message lists them.
std::string controls_of(const Task& task) {
  std::string list;
  for (std::size_t i = 0; i < EnumNames<Control>::kNames.size(); ++i) {
    const auto control = static_cast<Control>(i);
    if (task.takes(control)) list += (list.empty() ? "" : ", ") + quoted(control);
  }
  return "a control that this task takes (" + list + ")";
}

}  // namespace

bool touches(const Simulation& sim, std::size_t env) {
  const std::size_t m = sim.drones_per_env();
  if (m == 1) return sim.state.contact.hit[env] != 0;
  return std::any_of(sim.state.contact.hit.begin() + static_cast<std::ptrdiff_t>(env * m),
                     sim.state.contact.hit.begin() + static_cast<std::ptrdiff_t>((env + 1) * m),
                     [](std::uint8_t hit) { return hit != 0; });
}

void begin_task(Simulation& sim, std::unique_ptr<Task> task) {
  const std::size_t n = sim.num_envs();
  for_each_field(sim.episodes, [n](const auto&, auto& array) { array.resize(n); });
  sim.task_state.emplace(TaskState{.task = std::move(task)});
  TaskState& task_state = *sim.task_state;
  const Control control = sim.config.dynamics.control;
  if (!task_state.task->takes(control)) refuse("control", controls_of(*task_state.task), quoted(control));
  task_state.task->setup(*sim.context);
  if (sim.pool) require_world_of_pool(sim, 0, sim.world_pointers[0]);
  if (!sim.pool) {
    for (const World* const world : sim.world_pointers) task_state.task->require_world(*world, sim.drone_model);
  }
  const TaskSpec& spec = task_state.spec();
  checks::spec(spec);
  double bytes = 0.0;  // of an observation, in two slots, twice: the present and the final one
  for (const Field& field : spec.observation) bytes += 4.0 * static_cast<double>(field.size() * size_of(field.type));
  checks::memory(bytes * static_cast<double>(n));
  task_state.actions = task_state.actions_before = Buffer(spec.action, n);
  const bool tells_poses = sim.config.dynamics.control == Control::pose;
  if (tells_poses) task_state.setpoints.target.resize(sim.num_drones());
  if (!tells_poses) task_state.setpoints.command.resize(4 * sim.num_drones());
  if (tells_poses && sim.config.clock.substeps() > 1) task_state.step_start.resize(sim.num_drones());
  task_state.score.num_terms = spec.reward_terms.size();
  task_state.score.terms.resize(n * task_state.score.num_terms);
  sim.episodes.episode_terms.resize(n * task_state.score.num_terms);
  task_state.score.terminated.resize(n);
  task_state.score.truncated.resize(n);
  task_state.score.success.resize(n);
  task_state.score.left_area.resize(n);
  if (sim.config.episode.frame_skip > 1) task_state.earned.resize(n * task_state.score.num_terms);
  task_state.max_episode_steps = sim.config.episode.max_episode_steps.value_or(task_state.task->defaults().max_episode_steps);
  require(!sim.config.episode.stagger_first_episode || task_state.max_episode_steps > 0, "stagger_first_episode",
          "False where max_episode_steps is 0 (there is no limit to stagger)", "True");
  sim.outputs.allocate(spec, n);
}

void clear_contact(State& state, std::size_t first, std::size_t count) {
  std::fill_n(state.contact.hit.data() + first, count, std::uint8_t{0});
  std::fill_n(state.contact.inside.data() + first, count, std::uint8_t{0});
  std::fill_n(state.contact.fraction.data() + first, count, 1.0F);
  std::fill_n(state.contact.point.data() + 3 * first, 3 * count, 0.0F);
  std::fill_n(state.contact.normal.data() + 3 * first, 3 * count, 0.0F);
}

void forget_readings(Simulation& sim, std::size_t env) {
  sim.state.tick[env] = 0;
  sim.state.sensed[env] = -1;
  for (std::size_t m = 0; sim.imu && m < sim.drones_per_env(); ++m) sim.imu->begin(env * sim.drones_per_env() + m);
  if (sim.cameras.empty()) return;
  for (std::size_t m = 0; m < sim.drones_per_env(); ++m) sim.cameras.mark_stale(env * sim.drones_per_env() + m);
}

std::int64_t next_episode(const Simulation& sim, std::size_t env) {
  return sim.state.episode[env] + (sim.episodes.begun[env] ? 1 : 0);
}

void open_next_episode(Simulation& sim, std::size_t env, Scratch& scratch) {
  sim.state.episode[env] = next_episode(sim, env);
  open_episode(sim, env, scratch);
}

void open_episode(Simulation& sim, std::size_t env, Scratch& scratch) {
  State& state = sim.state;
  forget_readings(sim, env);
  if (sim.config.episode.random_world && !sim.pool) {
    const double u = uniform01(draw(state, env, Stream::world, 0)[0]);
    const auto world = static_cast<std::int32_t>(u * static_cast<double>(sim.worlds.size()));
    scratch.moved_world |= world != state.world_index[env];
    state.world_index[env] = world;
  }
  start_counts(sim, env);
}

void start_counts(Simulation& sim, std::size_t env) {
  EpisodeState& episodes = sim.episodes;
  episodes.steps[env] = 0;
  episodes.episode_return[env] = 0.0;
  const std::size_t terms = sim.task_state->score.num_terms;
  std::fill_n(episodes.episode_terms.begin() + static_cast<std::ptrdiff_t>(env * terms), terms, 0.0);
  episodes.begun[env] = 1;
  episodes.done[env] = 0;
  episodes.action_changed[env] = 0;
  episodes.bad[env] = 0;
  episodes.time_limit[env] = sim.task_state->max_episode_steps;
  if (sim.config.episode.stagger_first_episode && sim.state.episode[env] == 0) {
    const double u = uniform01(draw(sim.state, env, Stream::time_limit, 0)[0]);
    episodes.time_limit[env] = 1 + static_cast<std::int64_t>(u * sim.task_state->max_episode_steps);
  }
}

void take_part(Simulation& sim, Block& block) {
  const bool resets_in_next_step = sim.config.episode.autoreset_mode == AutoresetMode::next_step;
  const bool skips = !sim.task_state->earned.empty();
  const std::size_t terms = sim.task_state->score.num_terms;
  block.flown.clear();
  block.flying.clear();
  block.opening.clear();
  bool all_fly = true;
  for_each_contiguous(block.envs, [&](std::size_t first, std::size_t count) {
    sim.outputs.forget_final(first, count);
    all_fly &= !is_any(sim.episodes.done.data() + first, count);
  });
  if (all_fly) {  // as in most steps
    block.flown.assign(block.envs);
    block.flying.assign(block.envs);
    for_each_contiguous(block.envs, [&](std::size_t first, std::size_t count) {
      std::fill_n(sim.episodes.flying.data() + first, count, std::uint8_t{1});
    });
  } else {
    for (const std::uint32_t env : block.envs) {
      const bool flies = !sim.episodes.done[env];
      sim.episodes.flying[env] = flies;
      if (flies) {
        block.flown.push(env);
        block.flying.push(env);
      } else if (resets_in_next_step) {
        block.opening.push(env);
        sim.outputs.clear(env);
      } else {
        sim.outputs.carry_over(env);
      }
    }
  }
  for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
    if (skips) std::fill_n(sim.task_state->earned.data() + first * terms, count * terms, kNothing);
    compare_actions(*sim.task_state, first, count, sim.episodes);
  });
}

void settle(Simulation& sim, Block& block) {
  for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
    for (std::size_t done = 0; done < count; done += kSettled)
      settle_contiguous(sim, first + done, std::min(kSettled, count - done));
  });
  block.flying.filter([&](std::uint32_t env) { return !sim.episodes.done[env]; });
}

void keep_final(Simulation& sim, Block& block) {
  for (const std::uint32_t env : block.flown) {
    if (sim.episodes.done[env]) sim.outputs.keep_final(env);
  }
}

void list_opening(Simulation& sim, Block& block) {
  if (sim.config.episode.autoreset_mode != AutoresetMode::same_step) return;
  for (const std::uint32_t env : block.flown) {
    if (sim.episodes.done[env]) block.opening.push(env);
  }
}

void turn_over(Simulation& sim, Block& block, Scratch& scratch) {
  for (const std::uint32_t env : block.opening) open_next_episode(sim, env, scratch);
}

void first_moment(Simulation& sim, Block& block) {
  for (const std::uint32_t env : block.opening) {
    ++sim.state.sensed[env];
    for (std::size_t m = 0; m < sim.drones_per_env(); ++m) clear_contact(sim.state, env * sim.drones_per_env() + m);
  }
}

}  // namespace flockstep
