// Counter-based random numbers, keyed by (env seed, drone in the env, episode, stream, index). They depend on nothing else and
// need no state.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <string_view>

#include "flockstep/state.hpp"

namespace flockstep {

// Philox 4x32-10, a counter-based random number generator: a keyed bijection of the counter, with no state.
// Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11.
inline std::array<std::uint32_t, 4> philox4x32(std::array<std::uint32_t, 4> counter, std::array<std::uint32_t, 2> key) {
  constexpr int kRounds = 10;
  for (int round = 0; round < kRounds; ++round) {
    const std::uint64_t a = std::uint64_t{0xD2511F53U} * counter[0];
    const std::uint64_t b = std::uint64_t{0xCD9E8D57U} * counter[2];
    counter = {static_cast<std::uint32_t>(b >> 32U) ^ counter[1] ^ key[0], static_cast<std::uint32_t>(b),
               static_cast<std::uint32_t>(a >> 32U) ^ counter[3] ^ key[1], static_cast<std::uint32_t>(a)};
    key[0] += 0x9E3779B9U;  // Weyl sequences: the golden ratio and sqrt(3) - 1
    key[1] += 0xBB67AE85U;
  }
  return counter;
}

// Input of Philox. The first number of the counter is the index of a draw.
struct PhiloxInput {
  std::array<std::uint32_t, 4> counter;
  std::array<std::uint32_t, 2> key;
};

// Returns a uniform number in [0, 1) from the top 24 bits, so that every value is exact in float32.
inline float uniform01(std::uint32_t bits) { return static_cast<float>(bits >> 8U) * 0x1p-24F; }

// Returns two independent standard normal numbers from two words (Box and Muller, 1958).
inline std::array<float, 2> normal_pair(const std::array<std::uint32_t, 4>& bits) {
  const double radius = std::sqrt(-2.0 * std::log((bits[0] + 1.0) * 0x1p-32));
  const double angle = 2.0 * std::numbers::pi * (bits[1] * 0x1p-32);
  return {static_cast<float>(radius * std::cos(angle)), static_cast<float>(radius * std::sin(angle))};
}

// The engine's streams have the top bit set; user streams have it clear.
enum class Stream : std::uint32_t {
  position_noise = 0x80000000U,
  orientation_noise,
  start,
  world,
  time_limit,
  gust,
  light = 0x80000007U,  // the number before it belongs to a sensor, which has it beside its noise
};

// Returns the stream of an instrument that is not listed above: a hash of its name (FNV-1a) with the top bit set.
constexpr Stream stream_named(std::string_view name) {
  std::uint32_t hash = 2166136261U;
  for (const char c : name) hash = (hash ^ static_cast<unsigned char>(c)) * 16777619U;
  return static_cast<Stream>(hash | 0x80000000U);
}

// `member` is the number of the drone in its env, below 2^20. It is mixed into the upper bits of the episode, which no episode
// number reaches. The first drone has the same numbers as its env.
inline PhiloxInput input_of_draw(std::uint64_t seed, std::int64_t episode, std::uint32_t stream, std::uint32_t index,
                                 std::uint32_t member = 0) {
  const auto e = static_cast<std::uint64_t>(episode);
  return {{index, stream, static_cast<std::uint32_t>(e), static_cast<std::uint32_t>(e >> 32U) ^ (member << 12U)},
          {static_cast<std::uint32_t>(seed), static_cast<std::uint32_t>(seed >> 32U)}};
}
inline std::array<std::uint32_t, 4> draw(std::uint64_t seed, std::int64_t episode, std::uint32_t stream, std::uint32_t index,
                                         std::uint32_t member = 0) {
  const PhiloxInput input = input_of_draw(seed, episode, stream, index, member);
  return philox4x32(input.counter, input.key);
}

// Key of an env's or a drone's random numbers.
struct RandomKey {
  static constexpr std::size_t kNone = SIZE_MAX;

  EnvIndex env;
  std::uint32_t member = 0;
  std::size_t drone = kNone;  // index, if an env has several

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
inline PhiloxInput input_of_draw(const State& state, RandomKey key, Stream stream, std::uint32_t index,
                                 std::uint32_t number = 0) {
  return input_of_draw(state.seed[key.env], episode_of(state, key), static_cast<std::uint32_t>(stream) ^ (number << 16U), index,
                       key.member);
}
inline std::array<std::uint32_t, 4> draw(const State& state, RandomKey key, Stream stream, std::uint32_t index,
                                         std::uint32_t number = 0) {
  const PhiloxInput input = input_of_draw(state, key, stream, index, number);
  return philox4x32(input.counter, input.key);
}

// Returns number `index` of a user stream, uniform in [0, 1).
inline float draw_uniform(const State& state, RandomKey key, std::uint32_t stream, std::uint32_t index) {
  return uniform01(draw(state.seed[key.env], episode_of(state, key), stream, index / 4, key.member)[index % 4]);
}

}  // namespace flockstep
