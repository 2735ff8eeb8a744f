// Draws: random numbers for generating worlds.
#pragma once

#include <array>
#include <cstdint>

#include "base/random.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

using Vec2d = Eigen::Vector2d;
using Vec3d = Eigen::Vector3d;

// Uniform numbers keyed by (purpose, seed, attempt).
class Draws {
 public:
  // Purposes, which separate the numbers from other uses of the same seed.
  static constexpr std::uint32_t kPlayground = 0x706C6179, kForest = 0x666F7265, kOffice = 0x6F666669, kWarehouse = 0x77617265,
                                 kCity = 0x63697479, kPlaces = 0x706C6163, kRaceTrack = 0x72616365, kBench = 0x62656E63;

  Draws(std::uint32_t purpose, std::uint64_t seed, std::uint32_t attempt) : purpose_(purpose), seed_(seed), attempt_(attempt) {}

  double uniform(double low, double high) { return low + (high - low) * static_cast<double>(uniform01(bits())); }
  // Returns an integer in [0, count - 1].
  int below(int count) { return static_cast<int>(uniform(0.0, count)); }
  // Draws y first. Two calls as arguments of one function would have an unspecified order.
  Vec2d point(const Vec2d& low, const Vec2d& high) {
    const double y = uniform(low.y(), high.y());
    return {uniform(low.x(), high.x()), y};
  }

 private:
  std::uint32_t bits() {
    const std::uint32_t lane = count_ % 4;
    if (lane == 0) {
      words_ = philox4x32({count_ / 4, attempt_, purpose_, 0},
                          {static_cast<std::uint32_t>(seed_), static_cast<std::uint32_t>(seed_ >> 32U)});
    }
    ++count_;
    return words_[lane];
  }

  std::uint32_t purpose_;
  std::uint64_t seed_;
  std::uint32_t attempt_;
  std::uint32_t count_ = 0;
  std::array<std::uint32_t, 4> words_{};
};

}  // namespace flockstep
