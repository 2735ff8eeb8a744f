#include "batch/bad_states.hpp"

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "base/contiguous.hpp"
#include "base/finite.hpp"
#include "batch/episodes.hpp"

namespace flockstep {
namespace {

// Returns whether something was bad.
template <class T>
bool mend(const Field& field, std::span<T> row) {
  bool bad = false;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (!is_bad(field, i, static_cast<double>(row[i]))) continue;
    row[i] = T{0};
    bad = true;
  }
  return bad;
}

// The episode, which has been flown and settled, ends in this step after all.
void end_now(Simulation& sim, std::size_t env) {
  Outputs& out = sim.outputs.now();
  if (out.bad_state[env]) return;
  out.bad_state[env] = out.terminated[env] = 1;
  out.truncated[env] = out.success[env] = 0;
  out.crashed[env] = touches(sim, env);
  out.episode_end[env] = static_cast<std::uint8_t>(EpisodeEnd::bad_state);
  sim.episodes.done[env] = 1;
  ++sim.episodes.bad_states[env];
}

}  // namespace

void mark_bad(Simulation& sim, std::size_t env) { sim.episodes.bad[env] = 1; }

void check_setpoints(Simulation& sim, Block& block) {
  const std::size_t m = sim.drones_per_env();
  if (sim.config.dynamics.control != Control::pose) {
    const std::span<const float> command(sim.task_state->setpoints.command);
    for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
      if (are_finite(command.subspan(4 * m * first, 4 * m * count))) return;
      for (std::size_t env = first; env < first + count; ++env) {
        if (!are_finite(command.subspan(4 * m * env, 4 * m))) mark_bad(sim, env);
      }
    });
    return;
  }
  for (const std::uint32_t env : block.flying) {
    for (std::size_t drone = env * m; drone < (env + 1) * m; ++drone) {
      Pose& target = sim.task_state->setpoints.target[drone];
      if (is_valid(target)) continue;
      target = pose_of(sim.state, drone);
      mark_bad(sim, env);
    }
  }
}

bool is_bad(const Field& field, std::size_t column, double value) {
  if (std::isfinite(value)) return false;
  if (std::isnan(value)) return true;
  const std::vector<double>& bounds = value > 0.0 ? field.high : field.low;
  return bounds[bounds.size() == 1 ? 0 : column] != value;
}

void drop_bad_terms(Simulation& sim, std::size_t first_env, std::size_t count) {
  for (std::size_t env = first_env; env < first_env + count; ++env) {
    for (double& term : sim.task_state->score.terms_of(env)) {
      if (is_reward(term)) continue;
      mark_bad(sim, env);
      term = 0.0;
    }
  }
}

void check_observations(Simulation& sim, const EnvList& envs, bool flown) {
  const std::vector<Field>& fields = sim.task_state->spec().observation;
  const auto check = [&]<class T>(const Field& field, Buffer& values, T) {
    for_each_contiguous(envs, [&](std::size_t first, std::size_t count) {
      if (are_finite(std::span<const T>(values.row<T>(first).data(), count * values.columns()))) return;
      for (std::size_t env = first; env < first + count; ++env) {
        if (!mend(field, values.row<T>(env))) continue;
        if (flown) {
          end_now(sim, env);
        } else {
          mark_bad(sim, env);
        }
      }
    });
  };
  for (std::size_t i = 0; i < fields.size(); ++i) {
    Buffer& values = sim.outputs.now().observation[i];
    if (fields[i].type == DType::float32) check(fields[i], values, 0.0F);
    if (fields[i].type == DType::float64) check(fields[i], values, 0.0);
  }
}

}  // namespace flockstep
