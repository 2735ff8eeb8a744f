#include "trace/near_balls.hpp"

#include <algorithm>
#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/near_balls.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;

constexpr float kBallRounding = 1e-5F;  // fraction of distances, by which the search goes farther

using NearF = WideUpTo<16>;

HWY_INLINE NearF::Mask is_near(const Wide3<NearF>& away, NearF radius, float range_m) {
  const NearF reach = (radius + range_m) * (1.0F + kBallRounding);
  return (dot(away, away) <= reach * reach) & (radius >= 0.0F);
}

std::size_t find_balls(const Balls& balls, const Vec3& origin, float range_m, std::uint32_t* found) {
  using F = NearF;
  const Wide3<F> from{origin.x(), origin.y(), origin.z()};
  std::size_t count = 0;
  for (std::size_t i = 0; i < balls.count; i += F::kCount) {
    // Another thread may be writing the balls that follow the last one: they belong to another env.
    const std::size_t here = std::min(F::kCount, balls.count - i);
    const Wide3<F> away = Wide3<F>::load_first_rows(here, balls.center + 3 * i) - from;
    std::uint32_t near = bits(is_near(away, F::load_first(here, balls.radius + i), range_m)) & ((1U << here) - 1U);
    for (; near != 0; near &= near - 1) {
      found[count++] = static_cast<std::uint32_t>(i) + static_cast<std::uint32_t>(std::countr_zero(near));
    }
  }
  return count;
}

// Without branches: how many balls of a vector are near cannot be predicted.
std::size_t find_in_columns(const BallColumns& balls, const Vec3& origin, float range_m, std::uint32_t* found) {
  using F = NearF;
  static_assert(F::kCount <= BallColumns::kPadding);
  const Wide3<F> from{origin.x(), origin.y(), origin.z()};
  std::size_t count = 0;
  for (std::size_t i = 0; i < balls.count; i += F::kCount) {
    const Wide3<F> away = Wide3<F>::load_unaligned(balls.x + i, balls.y + i, balls.z + i) - from;
    const F::Int number = F::Int::iota() + F::Int(static_cast<std::int32_t>(i));
    const F::Mask near =
        is_near(away, F::load_unaligned(balls.radius + i), range_m) & (number < F::Int(static_cast<std::int32_t>(balls.count)));
    for (std::size_t p = 0; p < F::kParts; ++p) {
      count += hn::CompressStore(number.part[p], near.part[p], F::Int::Tag(), reinterpret_cast<std::int32_t*>(found + count));
    }
  }
  return count;
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(find_balls);
HWY_EXPORT(find_in_columns);

std::size_t find_near_balls(const Balls& balls, const Vec3& origin, float range_m, std::uint32_t* found) {
  return HWY_DYNAMIC_DISPATCH(find_balls)(balls, origin, range_m, found);
}

std::size_t find_near_balls(const BallColumns& balls, const Vec3& origin, float range_m, std::uint32_t* found) {
  return HWY_DYNAMIC_DISPATCH(find_in_columns)(balls, origin, range_m, found);
}

}  // namespace flockstep::trace
#endif
