// Random: reproducible random numbers, positions and rotations for tests, and how many trials there are. facing(): the rotation
// between two directions.
#pragma once

#include <random>

#include "flockstep/pose.hpp"
#include "standard.hpp"

namespace flockstep::testing {

// Returns the shortest rotation from one direction to another, or any of them if they are opposite. Eigen's FromTwoVectors()
// would pull in a singular value decomposition, which costs seconds of compile time per file.
inline Quat facing(const Vec3& from, const Vec3& to) {
  const Vec3 a = from.normalized(), b = to.normalized();
  const float cosine = a.dot(b);
  const Vec3 axis = cosine > -0.999999F ? a.cross(b) : a.unitOrthogonal();
  return Quat(cosine > -0.999999F ? 1.0F + cosine : 0.0F, axis.x(), axis.y(), axis.z()).normalized();
}

class Random {
 public:
  explicit Random(unsigned seed) : generator_(seed) {}
  float within(float low, float high) { return low + (high - low) * unit_(generator_); }
  Vec3 point(float reach) { return {within(-reach, reach), within(-reach, reach), within(-reach, reach)}; }
  Vec3 direction() {
    for (;;) {
      const Vec3 v = point(1.0F);
      if (v.norm() > 0.1F) return v;
    }
  }
  Quat rotation() {
    const Eigen::Vector4f v(normal_(generator_), normal_(generator_), normal_(generator_), normal_(generator_));
    return Quat(v.normalized());
  }
  float normal() { return normal_(generator_); }
  std::mt19937& generator() { return generator_; }

 private:
  std::mt19937 generator_;
  std::uniform_real_distribution<float> unit_{0.0F, 1.0F};
  std::normal_distribution<float> normal_;
};

// The suite runs some thousand trials of randomised tests; ./dev try multiplies them by FLOCKSTEP_TRY.

// Returns count times FLOCKSTEP_TRY, or count if it is not set.
inline long times_tried(long count) {
  const char* const factor = std::getenv("FLOCKSTEP_TRY");
  return factor == nullptr ? count : count * std::max(1L, std::atol(factor));
}

// Returns the index of the part to try, FLOCKSTEP_TRY_PART, which defaults to 0. Parts have different seeds, so their counts
// add up.
inline unsigned part_tried() {
  const char* const part = std::getenv("FLOCKSTEP_TRY_PART");
  return part == nullptr ? 0U : static_cast<unsigned>(std::max(0L, std::atol(part)));
}

// Sanitizers and debug builds are slow, and see what they can in few trials: they run one in kThinning.
#if defined(NDEBUG)
constexpr int kThinning = 1;
#else
constexpr int kThinning = 5;
#endif

// Records the number of trials in the test report, where bench/tried.py reads it.
inline void tried(const std::string& what, long count) {
  ::testing::Test::RecordProperty("tried_" + what, std::to_string(count));
}

}  // namespace flockstep::testing
