// Philox 4x32-10, a counter-based random number generator: a keyed bijection of the counter, with no state.
// Source: J. K. Salmon, M. A. Moraes, R. O. Dror, D. E. Shaw, "Parallel random numbers: as easy as 1, 2, 3", SC11.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>

namespace flockstep {

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

// Returns a uniform number in [0, 1) from the top 24 bits, so that every value is exact in float32.
inline float uniform01(std::uint32_t bits) { return static_cast<float>(bits >> 8U) * 0x1p-24F; }

// Returns two independent standard normal numbers from two words (Box and Muller, 1958).
inline std::array<float, 2> normal_pair(const std::array<std::uint32_t, 4>& bits) {
  const double radius = std::sqrt(-2.0 * std::log((bits[0] + 1.0) * 0x1p-32));
  const double angle = 2.0 * std::numbers::pi * (bits[1] * 0x1p-32);
  return {static_cast<float>(radius * std::cos(angle)), static_cast<float>(radius * std::sin(angle))};
}

}  // namespace flockstep
