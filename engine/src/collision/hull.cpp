#include "collision/hull.hpp"

#include <algorithm>
#include <cstdint>

namespace flockstep::collision {

namespace {

// Four numbers compared at once, which every 64-bit target supports. GCC and Clang compile the operators to its vector
// instructions.
constexpr int kWidth = 4;
using Floats = float __attribute__((vector_size(kWidth * sizeof(float))));
using Ints = std::int32_t __attribute__((vector_size(kWidth * sizeof(std::int32_t))));

Floats load(const float* aligned) { return *reinterpret_cast<const Floats*>(aligned); }

}  // namespace

Hull::Hull(const DroneModel& drone) : count_(static_cast<int>(drone.hull().size())), radius_(drone.radius()) {
  for (std::size_t i = 0; i < kMaxHullVertices; ++i) {
    const Vec3& v = drone.hull()[std::min(i, drone.hull().size() - 1)];
    x_[i] = v.x();
    y_[i] = v.y();
    z_[i] = v.z();
  }
}

Hull::Hull() : count_(1) {
  x_.fill(0.0F);
  y_.fill(0.0F);
  z_.fill(0.0F);
}

int Hull::support(const Vec3& direction) const {
  const auto along = [&](int first) {
    return load(x_.data() + first) * direction.x() + load(y_.data() + first) * direction.y() +
           load(z_.data() + first) * direction.z();
  };
  Floats best = along(0);
  Ints index = {0, 1, 2, 3};
  Ints candidate = index;
  for (int first = kWidth; first < count_; first += kWidth) {
    const Floats value = along(first);
    candidate += kWidth;
    const Ints farther = value > best;
    best = farther ? value : best;
    index = farther ? candidate : index;
  }
  int lane = 0;
  for (int other = 1; other < kWidth; ++other) lane = best[other] > best[lane] ? other : lane;
  return index[lane];
}

}  // namespace flockstep::collision
