#include "batch/bad_states.hpp"

#include <cmath>
#include <cstdint>
#include <span>
#include <vector>

#include "base/finite.hpp"
#include "base/indices.hpp"
#include "batch/episodes.hpp"

namespace flockstep {
namespace {

// Sets bad numbers of a row to 0. Returns true if there were any.
template <class T>
bool clear_bad(const Field& field, std::span<T> row) {
  bool bad = false;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (!is_bad(field, i, static_cast<double>(row[i]))) continue;
    row[i] = T{0};
    bad = true;
  }
  return bad;
}

// Ends the episode in this step, after the step has been scored.
void end_now(Simulation& sim, EnvIndex env, std::size_t row) {
  Outputs& out = sim.outputs.now();
  if (out.bad_state[row]) return;
  out.bad_state[row] = out.terminated[row] = 1;
  out.truncated[row] = out.success[row] = 0;
  out.crashed[row] = touches(sim, row);
  out.episode_end[row] = static_cast<std::uint8_t>(EpisodeEnd::bad_state);
  ++sim.episodes.bad_states[row];
  end_rows(sim, env);
}

}  // namespace

void mark_bad(Simulation& sim, std::size_t row) { sim.episodes.bad[row] = 1; }

void check_setpoints(Simulation& sim, Block& block) {
  const std::size_t m = sim.drones_per_env();
  if (sim.config.dynamics.control != Control::pose) {
    const std::span<const float> command(sim.task_state->setpoints.command);
    for_each_contiguous(block.flying, [&](std::size_t first_env, std::size_t count) {
      const std::size_t first = first_env * m, end = (first_env + count) * m;
      if (are_finite(command.subspan(4 * first, 4 * (end - first)))) return;
      for (std::size_t i = first; i < end; ++i) {
        const DroneIndex drone(i);
        if (!sim.takes_part(drone, Part::flying) || are_finite(command.subspan(4 * i, 4))) continue;
        mark_bad(sim, sim.row_of(drone));
      }
    });
    return;
  }
  for (const EnvIndex env : block.flying) {
    for (std::size_t member = 0; member < m; ++member) {
      const DroneIndex drone = sim.drone_of(env, member);
      Pose& target = sim.task_state->setpoints.target[drone];
      if (!sim.takes_part(drone, Part::flying) || is_valid(target)) continue;
      target = pose_of(sim.state, drone);
      mark_bad(sim, sim.row_of(drone));
    }
  }
}

bool is_bad(const Field& field, std::size_t column, double value) {
  if (std::isfinite(value)) return false;
  if (std::isnan(value)) return true;
  const std::vector<double>& bounds = value > 0.0 ? field.high : field.low;
  return bounds[bounds.size() == 1 ? 0 : column] != value;
}

void drop_bad_terms(Simulation& sim, std::size_t first_row, std::size_t count) {
  for (std::size_t row = first_row; row < first_row + count; ++row) {
    for (double& term : sim.task_state->score.terms_of(row)) {
      if (is_reward(term)) continue;
      mark_bad(sim, row);
      term = 0.0;
    }
  }
}

void check_observations(Simulation& sim, const EnvList& envs, bool flown) {
  const std::vector<Field>& fields = sim.task_state->task->spec().observation;
  const std::span<Buffer> observed = sim.observed();
  const std::size_t rows = sim.rows_per_env();
  const auto check = [&]<class T>(const Field& field, Buffer& values, T) {
    for_each_contiguous(envs, [&](std::size_t first_env, std::size_t count) {
      const std::size_t first = first_env * rows, end = (first_env + count) * rows;
      if (are_finite(std::span<const T>(values.row<T>(first).data(), (end - first) * values.columns()))) return;
      for (std::size_t row = first; row < end; ++row) {
        if (rows > 1 && !sim.takes_part(DroneIndex(row), envs.part())) continue;
        if (!clear_bad(field, values.row<T>(row))) continue;
        if (flown) {
          end_now(sim, EnvIndex(row / rows), row);
        } else {
          mark_bad(sim, row);
        }
      }
    });
  };
  for (std::size_t i = 0; i < fields.size(); ++i) {
    Buffer& values = observed[i];
    if (fields[i].type == DType::float32) check(fields[i], values, 0.0F);
    if (fields[i].type == DType::float64) check(fields[i], values, 0.0);
  }
}

}  // namespace flockstep
