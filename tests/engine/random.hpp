// Random: reproducible random numbers, positions and rotations for tests. facing(): the rotation between two directions.
#pragma once

#include <random>

#include "flockstep/pose.hpp"

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

}  // namespace flockstep::testing
