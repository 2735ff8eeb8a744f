// Calls of a Batch that concern its task: resets, steps and their results.
#include <algorithm>
#include <utility>

#include "batch/call_lock.hpp"
#include "batch/checks.hpp"
#include "batch/episodes.hpp"
#include "batch/growth.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "batch/step.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {
namespace {

bool selects_all(const Simulation& sim, EnvMask mask) {
  bool all = true;
  for_each_selected(sim, EnvMask(), [&](EnvIndex env) { all &= mask.selects(env); });
  return all;
}

// Begins episodes in the envs of Block::resetting. seeds: (E,); empty: the next episode of each env.
void reset_listed(Simulation& sim, std::span<const std::uint64_t> seeds) {
  if (sim.pool) {
    PoolState& pool = *sim.pool;
    pool.moves.clear();
    for (const Block& block : sim.schedule.blocks()) {
      for (const EnvIndex env : block.resetting) {
        const bool goes_on = seeds.empty();
        const std::uint64_t seed = goes_on ? sim.state.seed[env] : seeds[env];
        pool.moves.push_back({env, pool.pool.number_of(seed, goes_on ? next_episode(sim, env) : 0), nullptr});
      }
    }
    fetch_worlds(sim);
    sim.is_cut_short = true;  // until all envs have moved
    move_envs(sim);
  }
  sim.is_cut_short = false;
  sim.outputs.turn_and_copy();
  std::vector<EnvIndex> begun;
  for (const Block& block : sim.schedule.blocks()) {
    for (const EnvIndex env : block.resetting) {
      if (seeds.empty()) {
        start_next_episode(sim, env, *sim.scratches[0]);
      } else {
        sim.state.seed[env] = seeds[env];
        sim.state.episode[env] = 0;
        forget_own_episodes(sim, env);
        open_episode(sim, env, *sim.scratches[0]);
      }
      const std::size_t rows = sim.rows_per_env(), first = env * rows;
      for (std::size_t row = first; row < first + rows; ++row) sim.outputs.clear(row);
      sim.outputs.forget_final(first, rows);
      begun.push_back(env);
    }
  }
  begin_episodes(sim, true);
  if (sim.move_lines.visible().empty()) return;
  std::ranges::sort(begun);
  for (const DroneIndex drone : sim.move_lines.visible()) {
    if (std::ranges::binary_search(begun, sim.env_of(drone))) sim.move_lines.begin(drone);
  }
}

// Begins the next episodes of the selected drones in the envs of Block::resetting, with Episodes::each.
void reset_listed_drones(Simulation& sim, DroneMask mask) {
  sim.outputs.turn_and_copy();
  for (const Block& block : sim.schedule.blocks()) {
    for (const EnvIndex env : block.resetting) {
      for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
        const DroneIndex drone = sim.drone_of(env, member);
        sim.begins[drone] = is_selected(sim, mask, drone);
        if (!sim.begins[drone]) continue;
        start_next_episode(sim, drone);
        sim.outputs.clear(drone);
        sim.outputs.forget_final(drone, 1);
      }
    }
  }
  begin_episodes(sim, true);
  for (const DroneIndex drone : sim.move_lines.visible()) {
    if (is_selected(sim, mask, drone)) sim.move_lines.begin(drone);
  }
}

}  // namespace

const Task* Batch::task() const { return sim_->task_state ? sim_->task_state->task.get() : nullptr; }

const TaskSpec& Batch::spec() const {
  checks::has_task(*sim_);
  return sim_->task_state->spec();
}

void Batch::reset(std::span<const std::uint64_t> seeds, EnvMask mask) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "reset");
  checks::has_task(*sim_);
  checks::mask(*sim_, mask);
  if (!seeds.empty()) checks::size(seeds.size(), sim_->num_envs(), "seeds");
  if (!selects_all(*sim_, mask)) checks::require_not_interrupted(*sim_);
  list_selected(*sim_, mask, &Block::resetting);
  reset_listed(*sim_, seeds);
}

void Batch::reset_drones(DroneMask mask) {
  const LongCallGuard guard(*lock_);
  Simulation& sim = *sim_;
  checks::not_stepping(sim, "reset_drones");
  checks::has_task(sim);
  require(sim.episodes_mode() != Episodes::team, "mask", "a flag for each env (its drones begin their episodes together)",
          "one for each drone");
  checks::mask(sim, mask);
  checks::require_not_interrupted(sim);
  checks::require_started(sim);
  if (sim.episodes_mode() == Episodes::each) {
    list_selected(sim, mask, &Block::resetting);
    reset_listed_drones(sim, mask);
    return;
  }
  std::vector<std::uint8_t> begins(sim.num_envs());
  std::vector<DroneIndex> finished;
  for (std::size_t i = 0; i < sim.num_envs(); ++i) {
    const EnvIndex env(i);
    bool all = true, any = false, goes_on = false;
    for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
      const DroneIndex drone = sim.drone_of(env, member);
      if (is_removed(sim, drone)) continue;
      const bool chosen = mask.selects(drone);
      any |= chosen;
      all &= chosen;
      goes_on |= chosen && !sim.state.own.finished[drone];
      if (chosen && sim.state.own.finished[drone]) finished.push_back(drone);
    }
    begins[env] = any && (all || sim.episodes.done[env * sim.rows_per_env()]);
    require(begins[env] || !goes_on, "mask", "all drones of env " + std::to_string(i) + ", or some whose episodes have ended",
            "one whose episode goes on");
  }
  std::erase_if(finished, [&](DroneIndex drone) { return begins[sim.env_of(drone)]; });
  const EnvMask envs(begins);
  list_selected(sim, envs, &Block::resetting);
  reset_listed(sim, {});
  for (const DroneIndex drone : finished) {
    sim.outputs.forget_final(drone, 1);
    sim.outputs.rest(sim.task_state->spec(), drone);
  }
}

void Batch::step(std::span<const std::int64_t> actions) {
  const LongCallGuard guard(*lock_);
  checks::can_step(*sim_);
  checks::actions(*sim_, actions);
  if (sim_->task_state->actions.type() == DType::int64) {
    std::copy(actions.begin(), actions.end(), sim_->task_state->next_actions<std::int64_t>());
  } else {
    std::transform(actions.begin(), actions.end(), sim_->task_state->next_actions<std::int32_t>(),
                   [](std::int64_t action) { return static_cast<std::int32_t>(action); });
  }
  flockstep::step(*sim_);
}

void Batch::step(std::span<const float> actions) {
  const LongCallGuard guard(*lock_);
  checks::can_step(*sim_);
  checks::actions(*sim_, actions);
  std::copy(actions.begin(), actions.end(), sim_->task_state->next_actions<float>());
  flockstep::step(*sim_);
}

void Batch::step(Pilot& pilot) {
  const LongCallGuard guard(*lock_);
  checks::can_step(*sim_);
  std::swap(sim_->task_state->actions, sim_->task_state->actions_before);  // rows of removed drones keep older ones
  flockstep::step(*sim_, &pilot);
}

void Batch::set_controller(Controller controller) {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "set_controller");
  checks::has_task(*sim_);
  checks::flies_by_rotors(*sim_, "set_controller");
  require(sim_->config.dynamics.control != Control::pose, "controller", "a control with commands", "control=\"pose\"");
  require(sim_->fleet->commands.empty(), "controller", "commands that are in time",
          "variations of action_delay_s, action_jitter_s or action_loss");
  sim_->controller = std::move(controller);
}

const EpisodeState& Batch::episodes() const {
  checks::has_task(*sim_);
  return sim_->episodes;
}

FlagArray Batch::waiting() const {
  const CallGuard guard(*lock_);
  checks::has_task(*sim_);
  FlagArray rows(sim_->num_rows());
  for (std::size_t row = 0; row < rows.size(); ++row) rows[row] = waits(*sim_, row);
  return rows;
}

std::span<const float> Batch::path() const {
  checks::has_task(*sim_);
  if (sim_->task_state->path.empty()) {
    throw std::logic_error("path: this task does not record it (declare records_path, in Python an attribute of the class)");
  }
  return sim_->task_state->path;
}

const Outputs& Batch::outputs() const { return sim_->outputs.now(); }
Outputs& Batch::outputs() { return sim_->outputs.now(); }

void Batch::visit_task(ArrayVisitor& visitor) const {
  const CallGuard guard(*lock_);
  checks::has_task(*sim_);
  sim_->task_state->task->visit(visitor);
}

}  // namespace flockstep
