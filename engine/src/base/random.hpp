// Random numbers of an env: counter-based, keyed by (env seed, episode, stream), so that an env's numbers depend on nothing but
// these, and drawing needs no state.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "base/philox.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

// Streams of the engine have the top bit set; a user's are below.
enum class Stream : std::uint32_t {
  position_noise = 0x80000000U,
  orientation_noise,
  start,
  world,
  time_limit,
  gust,
  imu_noise,
};

inline std::array<std::uint32_t, 4> draw(std::uint64_t seed, std::int64_t episode, std::uint32_t stream, std::uint32_t index) {
  const auto e = static_cast<std::uint64_t>(episode);
  return philox4x32({index, stream, static_cast<std::uint32_t>(e), static_cast<std::uint32_t>(e >> 32U)},
                    {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32U)});
}

inline std::array<std::uint32_t, 4> draw(const State& state, std::size_t env, Stream stream, std::uint32_t index) {
  return draw(state.seed[env], state.episode[env], static_cast<std::uint32_t>(stream), index);
}

// The index-th of the numbers of a user's stream, uniform in [0, 1).
inline float draw_uniform(const State& state, std::size_t env, std::uint32_t stream, std::uint32_t index) {
  return uniform01(draw(state.seed[env], state.episode[env], stream, index / 4)[index % 4]);
}

}  // namespace flockstep
