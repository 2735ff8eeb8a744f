#include "tasks/hover_kernels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tasks/hover_kernels.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/lanes-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::task::HWY_NAMESPACE {
using dynamics::kLanes;
using namespace dynamics::HWY_NAMESPACE;

HWY_INLINE V3 rows3(const float* rows, std::size_t lane) { return V3::load_rows(rows + 3 * lane); }
HWY_INLINE Q rows4(const float* rows, std::size_t lane) { return load_rows4(rows + 4 * lane); }

// e^x for x <= 0, as 2^n times a polynomial in the remainder, which is within half of ln 2. The coefficients are from expf of
// S. Moshier's Cephes library; the relative error is below 2e-7. Results are clamped to at least e^-80.
HWY_INLINE F exponential(F x) {
  x = max(x, -80.0F);
  const F n = round(x * 1.44269504F);
  const F r = (x - n * 0.693359375F) - n * -2.12194440e-4F;
  F p = 1.9875691500e-4F * r + 1.3981999507e-3F;
  p = p * r + 8.3334519073e-3F;
  p = p * r + 4.1665795894e-2F;
  p = p * r + 1.6666665459e-1F;
  p = p * r + 5.0000001201e-1F;
  return (p * (r * r) + r + 1.0F) * bit_cast<F>(shift_left<23>(convert<F::Int>(n) + 127));
}

// Distances are in double precision, since they change little in a step.
HWY_INLINE void score_distances(const HoverRows& rows, double reach_m, HoverScores& scores) {
  using Double = Wide<hn::CappedTag<double, kLanes / 2>>;
  using Float = Wide<hn::Rebind<float, Double::Tag>>;  // same lane count
  alignas(64) dynamics::Lanes<3> a, b;
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    store3(rows3(rows.target, lane), a, lane);
    store3(rows3(rows.position, lane), b, lane);
  }
  for (std::size_t lane = 0; lane < kLanes; lane += Double::kCount) {
    Double squares = 0.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto number = [&](const auto& lanes) HWY_ATTR { return convert<Double>(Float::load(lanes[axis].data() + lane)); };
      const Double way = number(a) - number(b);
      squares = squares + way * way;
    }
    const Double distance = sqrt(squares);
    distance.store(scores.distance.data() + lane);
    (1.0 / (1.0 + squares * (1.0 / (reach_m * reach_m)))).store(scores.holding.data() + lane);
    convert<Float>(distance).store(scores.closeness.data() + lane);
  }
}

void score_hover(const HoverRows& rows, double reach_m, HoverScores& scores) {
  score_distances(rows, reach_m, scores);
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    store(exponential(load(scores.closeness, lane) * -2.0F), scores.closeness, lane);
    const V3 velocity = rows3(rows.velocity, lane), spin = rows3(rows.angular_velocity, lane);
    store(sqrt(dot(velocity, velocity)), scores.speed, lane);
    store(sqrt(dot(spin, spin)), scores.spin, lane);
    store(F(0.0F), scores.change, lane);
    if (rows.action == nullptr) continue;
    const Q now = rows4(rows.action, lane), before = rows4(rows.action_before, lane);
    const F a = now.w - before.w, b = now.x - before.x, c = now.y - before.y, e = now.z - before.z;
    store(((a * a + b * b) + (c * c + e * e)) * 0.25F, scores.change, lane);
  }
}

void observe_hover(const HoverRows& rows, const RotorUnits& rotors, float spin_unit, float* out) {
  alignas(64) float quarters[4][4 * kLanes];
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    const F hovering = load(rotors.hovering, lane);
    const F inverse_below = load(rotors.inverse_below, lane), inverse_above = load(rotors.inverse_above, lane);
    const auto rotor = [&](F speed) HWY_ATTR {
      const F away = speed - hovering;
      return min(away, 0.0F) * inverse_below + max(away, 0.0F) * inverse_above;
    };
    const M3 to_world = matrix(rows4(rows.quat_wxyz, lane));
    const V3 way = transpose_times(to_world, rows3(rows.target, lane) - rows3(rows.position, lane));
    const V3 velocity = transpose_times(to_world, rows3(rows.velocity, lane));
    const V3 spin = rows3(rows.angular_velocity, lane) * (1.0F / spin_unit);
    const Q speed = rows4(rows.rotor_speed, lane);
    const auto keep = [&](std::size_t quarter, const Q& values) HWY_ATTR { store_rows4(values, quarters[quarter] + 4 * lane); };
    keep(0, {way.x, way.y, way.z, velocity.x});
    keep(1, {velocity.y, velocity.z, to_world.zx, to_world.zy});
    keep(2, {to_world.zz, spin.x, spin.y, spin.z});
    keep(3, {rotor(speed.w), rotor(speed.x), rotor(speed.y), rotor(speed.z)});
  }
  using Four = WideUpTo<4>;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    for (std::size_t quarter = 0; quarter < 4; ++quarter) {
      for (std::size_t k = 0; k < 4; k += Four::kCount) {
        Four::load(quarters[quarter] + 4 * lane + k).store_unaligned(out + kHoverNumbers * lane + 4 * quarter + k);
      }
    }
  }
}

}  // namespace flockstep::task::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::task {

HWY_EXPORT(score_hover);
HWY_EXPORT(observe_hover);

void score_hover(const HoverRows& rows, double reach_m, HoverScores& scores) {
  HWY_DYNAMIC_DISPATCH(score_hover)(rows, reach_m, scores);
}
void observe_hover(const HoverRows& rows, const RotorUnits& rotors, float spin_unit, float* out) {
  HWY_DYNAMIC_DISPATCH(observe_hover)(rows, rotors, spin_unit, out);
}

}  // namespace flockstep::task
#endif
