// Counter-based random numbers, keyed by (env seed, drone in the env, episode, stream, index). They depend on nothing else and
// need no state.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <string_view>

#include "base/philox.hpp"
#include "flockstep/state.hpp"

namespace flockstep {

// The engine's streams have the top bit set; user streams have it clear.
enum class Stream : std::uint32_t {
  position_noise = 0x80000000U,
  orientation_noise,
  start,
  world,
  time_limit,
  gust,
  imu_noise,
  light,
};

// Returns the stream of an instrument that is not listed above: a hash of its name (FNV-1a) with the top bit set.
constexpr Stream stream_named(std::string_view name) {
  std::uint32_t hash = 2166136261U;
  for (const char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619U;
  return static_cast<Stream>(hash | 0x80000000U);
}

// `member` is the number of the drone in its env, below 2^20. It is mixed into the upper bits of the episode, which no episode
// number reaches. The first drone has the same numbers as its env.
inline std::array<std::uint32_t, 4> draw(std::uint64_t seed, std::int64_t episode, std::uint32_t stream, std::uint32_t index,
                                         std::uint32_t member = 0) {
  const auto e = static_cast<std::uint64_t>(episode);
  return philox4x32({index, stream, static_cast<std::uint32_t>(e), static_cast<std::uint32_t>(e >> 32U) ^ (member << 12U)},
                    {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32U)});
}

// Key of an env's or a drone's random numbers.
struct RandomKey {
  static constexpr std::size_t kNone = SIZE_MAX;

  EnvIndex env;
  std::uint32_t member = 0;
  std::size_t drone = kNone;  // of several in an env

  static RandomKey of(EnvIndex env) { return {env}; }
  static RandomKey of(DroneIndex drone, std::size_t drones_per_env) {
    if (drones_per_env == 1) return {EnvIndex(std::size_t{drone})};
    return {EnvIndex(drone / drones_per_env), static_cast<std::uint32_t>(drone % drones_per_env), drone};
  }
};

// Number of the episode of an env or a drone.
inline std::int64_t episode_of(const State& state, RandomKey key) {
  const bool has_own = key.drone != RandomKey::kNone && !state.own.own_episodes.empty();
  return state.episode[key.env] + (has_own ? state.own.own_episodes[key.drone] : 0);
}

// `number`, below 2^15, distinguishes instruments of one kind that share a stream.
inline std::array<std::uint32_t, 4> draw(const State& state, RandomKey key, Stream stream, std::uint32_t index,
                                         std::uint32_t number = 0) {
  return draw(state.seed[key.env], episode_of(state, key), static_cast<std::uint32_t>(stream) ^ (number << 16U), index,
              key.member);
}

// Returns number `index` of a user stream, uniform in [0, 1).
inline float draw_uniform(const State& state, RandomKey key, std::uint32_t stream, std::uint32_t index) {
  return uniform01(draw(state.seed[key.env], episode_of(state, key), stream, index / 4, key.member)[index % 4]);
}

}  // namespace flockstep
