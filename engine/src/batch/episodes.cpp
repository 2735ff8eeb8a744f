#include "batch/episodes.hpp"

#include <algorithm>
#include <numeric>
#include <type_traits>
#include <utility>

#include "base/random.hpp"
#include "base/require.hpp"
#include "base/runs.hpp"
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
    bool any = false;  // rows are short: a call of memcmp would cost more
    for (std::size_t i = 0; i < columns; ++i) any |= x[i] != y[i];
    differ[row] = any;
  }
}

template <class T>
void compare_rows(const Buffer& a, const Buffer& b, std::size_t first, std::size_t count, std::uint8_t* differ) {
  if (a.columns() == 4) return compare_rows<T, 4>(a, b, first, count, differ);  // what rotors are told
  if (a.columns() == 1) return compare_rows<T, 1>(a, b, first, count, differ);
  compare_rows<T, 0>(a, b, first, count, differ);
}

// Whether the action of this step is another than that of the step before, or the first.
void compare_actions(const TaskRun& run, std::size_t first, std::size_t count, EpisodeState& episodes) {
  std::uint8_t* const changed = episodes.action_changed.data() + first;
  switch (run.actions.type()) {
    case DType::int32:
      compare_rows<std::int32_t>(run.actions, run.actions_before, first, count, changed);
      break;
    case DType::int64:
      compare_rows<std::int64_t>(run.actions, run.actions_before, first, count, changed);
      break;
    case DType::float32:
      compare_rows<float>(run.actions, run.actions_before, first, count, changed);
      break;
    case DType::float64:
      compare_rows<double>(run.actions, run.actions_before, first, count, changed);
      break;
    default:
      compare_rows<std::uint8_t>(run.actions, run.actions_before, first, count, changed);
  }
  for (std::size_t i = 0; i < count; ++i) changed[i] |= episodes.steps[first + i] == 0;
}

double sum(const double* values, std::size_t count) { return std::accumulate(values, values + count, 0.0); }

// So many terms of the score's, from the first on, go into all sums that there are of them. They are what envs that follow each
// other have earned in a flown step, so these loops are long.
void add_up(Simulation& sim, std::size_t first, std::size_t count) {
  TaskRun& run = *sim.run;
  const double* terms = run.score.terms.data() + first;
  std::size_t bad = 0;
  for (std::size_t i = 0; i < count; ++i) bad += !is_reward(terms[i]);
  if (bad > 0) drop_bad_terms(sim, first / run.score.num_terms, count / run.score.num_terms);
  double* const sums = sim.episodes.episode_terms.data() + first;
  for (std::size_t i = 0; i < count; ++i) sums[i] += terms[i];
  std::copy_n(sums, count, sim.outputs.now().episode_terms.data() + first);
  if (!run.earned.empty()) {
    double* const earned = run.earned.data() + first;
    for (std::size_t i = 0; i < count; ++i) earned[i] += terms[i];
    terms = earned;
  }
  float* const shown = sim.outputs.now().reward_terms.data() + first;
  for (std::size_t i = 0; i < count; ++i) shown[i] = static_cast<float>(terms[i]);
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
  sim.run.emplace(TaskRun{.task = std::move(task)});
  TaskRun& run = *sim.run;
  const Control control = sim.config.dynamics.control;
  require(run.task->takes(control), "control",
          "one that this task tells drones by (those of most tasks are told poses, those of flight anything else)",
          '"' + std::string(EnumNames<Control>::kNames[static_cast<std::size_t>(control)]) + '"');
  run.task->setup(*sim.context);
  if (sim.pool) require_world_of_pool(sim, 0, sim.world_pointers[0]);
  if (!sim.pool) {
    for (const World* const world : sim.world_pointers) run.task->require_world(*world, sim.drone_model);
  }
  const TaskSpec& spec = run.spec();
  checks::spec(spec);
  double bytes = 0.0;  // of an observation, in two slots, twice: the present and the final one
  for (const Field& field : spec.observation) bytes += 4.0 * static_cast<double>(field.size() * size_of(field.type));
  checks::memory(bytes * static_cast<double>(n));
  run.actions = run.actions_before = Buffer(spec.action, n);
  const bool tells_poses = sim.config.dynamics.control == Control::pose;
  if (tells_poses) run.setpoints.target.resize(sim.num_drones());
  if (!tells_poses) run.setpoints.command.resize(4 * sim.num_drones());
  if (tells_poses && sim.config.clock.substeps() > 1) run.step_start.resize(sim.num_drones());
  run.score.num_terms = spec.reward_terms.size();
  run.score.terms.resize(n * run.score.num_terms);
  sim.episodes.episode_terms.resize(n * run.score.num_terms);
  run.score.terminated.resize(n);
  run.score.truncated.resize(n);
  run.score.success.resize(n);
  if (sim.config.episode.frame_skip > 1) run.earned.resize(n * run.score.num_terms);
  run.max_episode_steps = sim.config.episode.max_episode_steps.value_or(run.task->defaults().max_episode_steps);
  require(!sim.config.episode.stagger_first_episode || run.max_episode_steps > 0, "stagger_first_episode",
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
  const std::size_t terms = sim.run->score.num_terms;
  std::fill_n(episodes.episode_terms.begin() + static_cast<std::ptrdiff_t>(env * terms), terms, 0.0);
  episodes.begun[env] = 1;
  episodes.done[env] = 0;
  episodes.action_changed[env] = 0;
  episodes.bad[env] = 0;
  episodes.time_limit[env] = sim.run->max_episode_steps;
  if (sim.config.episode.stagger_first_episode && sim.state.episode[env] == 0) {
    const double u = uniform01(draw(sim.state, env, Stream::time_limit, 0)[0]);
    episodes.time_limit[env] = 1 + static_cast<std::int64_t>(u * sim.run->max_episode_steps);
  }
}

void take_part(Simulation& sim, Block& block) {
  const bool resets_in_next_step = sim.config.episode.autoreset_mode == AutoresetMode::next_step;
  const bool skips = !sim.run->earned.empty();
  const std::size_t terms = sim.run->score.num_terms;
  block.flown.clear();
  block.flying.clear();
  block.opening.clear();
  for (const std::uint32_t env : block.envs) {
    const bool flies = !sim.episodes.done[env];
    sim.episodes.flying[env] = flies;
    sim.outputs.forget_final(env);
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
  for_each_run(block.flying, [&](std::size_t first, std::size_t count) {
    if (skips) std::fill_n(sim.run->earned.data() + first * terms, count * terms, kNothing);
    compare_actions(*sim.run, first, count, sim.episodes);
  });
}

void settle(Simulation& sim, Block& block) {
  EpisodeState& episodes = sim.episodes;
  TaskRun& run = *sim.run;
  Outputs& out = sim.outputs.now();
  const std::size_t num_terms = run.score.num_terms;
  const double* const earned = run.earned.empty() ? run.score.terms.data() : run.earned.data();
  const bool ends_on_contact = sim.physics && sim.config.dynamics.on_contact == OnContact::terminate;
  for_each_run(block.flying, [&](std::size_t first, std::size_t count) { add_up(sim, first * num_terms, count * num_terms); });
  for (const std::uint32_t env : block.flying) {
    const double total = sum(run.score.terms.data() + env * num_terms, num_terms);
    const double step_total = sum(earned + env * num_terms, num_terms);  // of those flown so far
    const double episode_return = episodes.episode_return[env] += total;
    const std::int64_t steps = episodes.steps[env];
    const std::int64_t limit = episodes.time_limit[env];
    const bool bad = episodes.bad[env] != 0;
    const bool terminated = bad || run.score.terminated[env] != 0 || (ends_on_contact && touches(sim, env));
    const bool truncated = !terminated && (run.score.truncated[env] != 0 || (limit > 0 && steps >= limit));
    const bool ends = terminated || truncated;
    out.reward[env] = static_cast<float>(step_total);
    out.episode_return[env] = episode_return;
    out.episode_length[env] = steps;
    out.terminated[env] = terminated;
    out.truncated[env] = truncated;
    out.success[env] = ends && !bad && run.score.success[env];
    out.crashed[env] = ends && touches(sim, env);
    out.bad_state[env] = bad;
    episodes.done[env] = ends;
    episodes.action_changed[env] = 0;  // flown once more, it is the same
    if (bad) {
      episodes.bad[env] = 0;
      ++episodes.bad_states[env];
    }
  }
  block.flying.filter([&](std::uint32_t env) { return !episodes.done[env]; });
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
