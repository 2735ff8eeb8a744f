#include "batch/bad_states.hpp"

#include <algorithm>
#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

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

bool is_command(const Simulation& sim, std::size_t drone) {
  const auto row = std::span(sim.run->setpoints.command).subspan(4 * drone, 4);
  return std::all_of(row.begin(), row.end(), [](float value) { return std::isfinite(value); });
}

// The episode, which has been flown and settled, ends in this step after all.
void end_now(Simulation& sim, std::size_t env) {
  Outputs& out = sim.outputs.now();
  if (out.bad_state[env]) return;
  out.bad_state[env] = out.terminated[env] = 1;
  out.truncated[env] = out.success[env] = 0;
  out.crashed[env] = touches(sim, env);
  sim.episodes.done[env] = 1;
  ++sim.episodes.bad_states[env];
}

}  // namespace

void mark_bad(Simulation& sim, std::size_t env) { sim.episodes.bad[env] = 1; }

void check_setpoints(Simulation& sim, Block& block) {
  const std::size_t m = sim.drones_per_env();
  for (const std::uint32_t env : block.flying) {
    for (std::size_t drone = env * m; drone < (env + 1) * m; ++drone) {
      if (sim.config.dynamics.control != Control::pose) {
        if (!is_command(sim, drone)) mark_bad(sim, env);
        continue;
      }
      Pose& target = sim.run->setpoints.target[drone];
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

double drop_bad_terms(Simulation& sim, std::size_t env) {
  mark_bad(sim, env);
  double total = 0.0;
  for (double& term : sim.run->score.terms_of(env)) {
    if (!is_reward(term)) term = 0.0;
    total += term;
  }
  return total;
}

void check_observations(Simulation& sim, const EnvList& envs, bool flown) {
  const std::vector<Field>& fields = sim.run->spec().observation;
  const auto check = [&]<class T>(const Field& field, Buffer& values, T) {
    for (const std::uint32_t env : envs) {
      const std::span<T> row = values.row<T>(env);
      if (are_finite(std::span<const T>(row)) || !mend(field, row)) continue;
      if (flown) {
        end_now(sim, env);
      } else {
        mark_bad(sim, env);
      }
    }
  };
  for (std::size_t i = 0; i < fields.size(); ++i) {
    Buffer& values = sim.outputs.now().observation[i];
    if (fields[i].type == DType::float32) check(fields[i], values, 0.0F);
    if (fields[i].type == DType::float64) check(fields[i], values, 0.0);
  }
}

}  // namespace flockstep
