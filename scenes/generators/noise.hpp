// Noise for the surfaces and terrain of generated worlds. It uses only operations that IEEE 754 rounds correctly, therefore a
// seed gives the same world on every machine.
#pragma once

#include <array>
#include <cmath>
#include <cstdint>

#include "base/random.hpp"

namespace flockstep {

using Color = std::array<float, 3>;

inline double mixed(double a, double b, double share) { return a + (b - a) * share; }

inline Color mixed(const Color& a, const Color& b, double share) {
  const auto f = static_cast<float>(share);
  return {a[0] + (b[0] - a[0]) * f, a[1] + (b[1] - a[1]) * f, a[2] + (b[2] - a[2]) * f};
}

// Value noise: random values in [0, 1) at integers, interpolated smoothly.
class Noise {
 public:
  // The key is (purpose, seed, number). Purposes are those of Draws.
  Noise(std::uint32_t purpose, std::uint64_t seed, std::uint32_t number) : purpose_(purpose), seed_(seed), number_(number) {}

  // Repeats every `period` integers along each axis.
  double at(double x, double y, int period = 1 << 20) const {
    const double left = std::floor(x), low = std::floor(y);
    const auto column = static_cast<int>(left), row = static_cast<int>(low);
    const auto wrapped = [&](int i) { return ((i % period) + period) % period; };
    const auto value = [&](int i, int j) { return lattice(wrapped(column + i), wrapped(row + j)); };
    const double u = smooth(x - left), v = smooth(y - low);
    return mixed(mixed(value(0, 0), value(1, 0), u), mixed(value(0, 1), value(1, 1), u), v);
  }

  // Sum of `count` octaves, each with twice the frequency and half the amplitude of the one before.
  double octaves(double x, double y, int count, int period = 1 << 20) const {
    double sum = 0.0, weight = 1.0, total = 0.0;
    for (int i = 0; i < count; ++i) {
      sum += weight * at(x, y, period);
      total += weight;
      weight *= 0.5;
      x *= 2.0;
      y *= 2.0;
      period *= 2;
    }
    return sum / total;
  }

 private:
  static double smooth(double t) { return t * t * (3.0 - 2.0 * t); }
  double lattice(int column, int row) const {
    const auto words = philox4x32({static_cast<std::uint32_t>(column), static_cast<std::uint32_t>(row), number_, purpose_},
                                  {static_cast<std::uint32_t>(seed_), static_cast<std::uint32_t>(seed_ >> 32U)});
    return static_cast<double>(uniform01(words[0]));
  }

  std::uint32_t purpose_;
  std::uint64_t seed_;
  std::uint32_t number_;
};

}  // namespace flockstep
