#include "base/finite.hpp"

#include <gtest/gtest.h>
#include <hwy/targets.h>

#include <cmath>
#include <cstddef>
#include <limits>
#include <random>
#include <span>
#include <vector>

#include "on_target.hpp"

namespace flockstep {
namespace {

template <class T>
void try_all() {
  using Limits = std::numeric_limits<T>;
  const T finite[] = {T{0}, -T{0}, T{1}, Limits::max(), Limits::lowest(), Limits::min(), Limits::denorm_min()};
  std::mt19937 random(1);
  for (std::size_t size = 0; size <= 70; ++size) {
    std::vector<T> values(size + 2, Limits::quiet_NaN());  // neighbouring values must not matter
    const std::span<T> inside = std::span(values).subspan(1, size);
    for (T& value : inside) value = finite[random() % std::size(finite)];
    const std::span<const T> seen = inside;
    ASSERT_TRUE(are_finite(seen)) << size;
    for (std::size_t i = 0; i < size; ++i) {
      const T before = inside[i];
      for (const T bad : {Limits::infinity(), -Limits::infinity(), Limits::quiet_NaN(), -Limits::signaling_NaN()}) {
        inside[i] = bad;
        ASSERT_FALSE(are_finite(seen)) << i << " of " << size;
      }
      inside[i] = before;
    }
  }
}

TEST(Finite, FindsOneBadNumberAnywhereOnEveryTarget) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    const testing::OnTarget on(target);
    try_all<float>();
    try_all<double>();
  }
}

}  // namespace
}  // namespace flockstep
