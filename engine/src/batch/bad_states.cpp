#include "batch/bad_states.hpp"

#include <algorithm>
#include <bit>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <type_traits>
#include <vector>

#include "batch/episodes.hpp"

namespace flockstep {
namespace {

// Whether all are finite, in one pass without a branch: an infinity or a NaN has every bit of the exponent set.
template <class T>
bool are_finite(std::span<const T> values) {
  using Bits = std::conditional_t<sizeof(T) == sizeof(std::uint32_t), std::uint32_t, std::uint64_t>;
  constexpr Bits kExponent = std::bit_cast<Bits>(std::numeric_limits<T>::infinity());
  Bits found = 0;
  for (const T value : values) found |= (std::bit_cast<Bits>(value) & kExponent) == kExponent ? ~Bits{0} : Bits{0};
  return found == 0;
}

// Whether a value that is not finite is one that the field declares.
bool is_declared(const Field& field, std::size_t i, double value) {
  if (std::isnan(value)) return false;
  const std::vector<double>& bounds = value > 0.0 ? field.high : field.low;
  return bounds[bounds.size() == 1 ? 0 : i] == value;
}

// Returns whether something was bad.
template <class T>
bool mend(const Field& field, std::span<T> row) {
  if (are_finite(std::span<const T>(row))) return false;
  bool bad = false;
  for (std::size_t i = 0; i < row.size(); ++i) {
    if (std::isfinite(row[i]) || is_declared(field, i, static_cast<double>(row[i]))) continue;
    row[i] = T{0};
    bad = true;
  }
  return bad;
}

bool mend(const Field& field, Buffer& buffer, std::size_t env) {
  switch (field.type) {
    case DType::float32:
      return mend(field, buffer.row<float>(env));
    case DType::float64:
      return mend(field, buffer.row<double>(env));
    default:
      return false;
  }
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

bool is_valid(const Pose& pose) {
  constexpr float kTolerance = 0.02F;                                                              // of a squared norm
  return is_in_world(pose.position) && std::abs(pose.rotation.squaredNorm() - 1.0F) < kTolerance;  // false for NaN, too
}

void mark_bad(Simulation& sim, std::size_t env) { sim.episodes.bad[env] = 1; }

void check_setpoints(Simulation& sim, Block& block) {
  const std::size_t m = sim.drones_per_env();
  for (const std::uint32_t env : block.flying) {
    for (std::size_t drone = env * m; drone < (env + 1) * m; ++drone) {
      Pose& target = sim.run->setpoints.target[drone];
      if (is_valid(target)) continue;
      target = pose_of(sim.state, drone);
      mark_bad(sim, env);
    }
  }
}

void drop_bad_terms(Simulation& sim, std::size_t env) {
  for (double& term : sim.run->score.terms_of(env)) {
    if (!is_reward(term)) term = 0.0;
  }
  mark_bad(sim, env);
}

void check_observations(Simulation& sim, const EnvList& envs, bool flown) {
  const std::vector<Field>& fields = sim.run->spec().observation;
  Outputs& out = sim.outputs.now();
  for (std::size_t i = 0; i < fields.size(); ++i) {
    if (!is_floating(fields[i].type)) continue;
    for (const std::uint32_t env : envs) {
      if (!mend(fields[i], out.observation[i], env)) continue;
      if (flown) {
        end_now(sim, env);
      } else {
        mark_bad(sim, env);
      }
    }
  }
}

}  // namespace flockstep
