#include "tasks/hover_kernels.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "tasks/hover_kernels.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::task::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;
using dynamics::kLanes;
using namespace dynamics::HWY_NAMESPACE;  // the wide type

HWY_INLINE V3 rows3(const float* rows, std::size_t lane) {
  V3 v;
  hn::LoadInterleaved3(D(), rows + 3 * lane, v.x.v, v.y.v, v.z.v);
  return v;
}
HWY_INLINE Q rows4(const float* rows, std::size_t lane) {
  Q q;
  hn::LoadInterleaved4(D(), rows + 4 * lane, q.w.v, q.x.v, q.y.v, q.z.v);
  return q;
}

// e^x for x <= 0: 2^n times a polynomial for what is left, within half of ln 2. Coefficients of S. Moshier's Cephes library,
// expf: off by less than 2e-7 of the result. Below e^-80 it stays there.
HWY_INLINE F exponential(F x) {
  const D d;
  const hn::RebindToSigned<D> di;
  x = max(x, F(-80.0F));
  const F n = F(hn::Round((x * F(1.44269504F)).v));
  const F r = (x - n * F(0.693359375F)) - n * F(-2.12194440e-4F);
  F p = F(1.9875691500e-4F) * r + F(1.3981999507e-3F);
  p = p * r + F(8.3334519073e-3F);
  p = p * r + F(4.1665795894e-2F);
  p = p * r + F(1.6666665459e-1F);
  p = p * r + F(5.0000001201e-1F);
  const F whole = p * (r * r) + r + F(1.0F);
  const auto power = hn::ShiftLeft<23>(hn::Add(hn::ConvertTo(di, n.v), hn::Set(di, 127)));
  return whole * F(hn::BitCast(d, power));
}

// In double precision: a step changes a distance by little.
HWY_INLINE void score_distances(const HoverRows& rows, double reach_m, HoverScores& scores) {
  const hn::CappedTag<double, kLanes / 2> d;
  const hn::Rebind<float, decltype(d)> df;
  alignas(64) dynamics::Lanes<3> a, b;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(D())) {
    store3(rows3(rows.target, lane), a, lane);
    store3(rows3(rows.position, lane), b, lane);
  }
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    auto squares = hn::Zero(d);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto way =
          hn::Sub(hn::PromoteTo(d, hn::Load(df, a[axis].data() + lane)), hn::PromoteTo(d, hn::Load(df, b[axis].data() + lane)));
      squares = hn::Add(squares, hn::Mul(way, way));
    }
    const auto distance = hn::Sqrt(squares);
    const auto one = hn::Set(d, 1.0);
    const auto holding = hn::Div(one, hn::Add(one, hn::Mul(squares, hn::Set(d, 1.0 / (reach_m * reach_m)))));
    hn::Store(distance, d, scores.distance.data() + lane);
    hn::Store(holding, d, scores.holding.data() + lane);
    hn::Store(hn::DemoteTo(df, distance), df, scores.closeness.data() + lane);
  }
}

void score_hover(const HoverRows& rows, double reach_m, HoverScores& scores) {
  score_distances(rows, reach_m, scores);
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(D())) {
    store(exponential(load(scores.closeness, lane) * F(-2.0F)), scores.closeness, lane);
    const V3 velocity = rows3(rows.velocity, lane), spin = rows3(rows.angular_velocity, lane);
    store(sqrt(dot(velocity, velocity)), scores.speed, lane);
    store(sqrt(dot(spin, spin)), scores.spin, lane);
    const Q now = rows4(rows.action, lane), before = rows4(rows.action_before, lane);
    const F a = now.w - before.w, b = now.x - before.x, c = now.y - before.y, e = now.z - before.z;
    store(((a * a + b * b) + (c * c + e * e)) * F(0.25F), scores.change, lane);
  }
}

void observe_hover(const HoverRows& rows, const RotorUnits& rotors, float spin_unit, float* out) {
  const D d;
  alignas(64) float quarters[4][4 * kLanes];
  const auto rotor = [&](F speed) HWY_ATTR {
    const F away = speed - F(rotors.hovering);
    return min(away, F(0.0F)) * F(rotors.inverse_below) + max(away, F(0.0F)) * F(rotors.inverse_above);
  };
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const M3 to_world = matrix(rows4(rows.quat_wxyz, lane));
    const V3 way = transpose_times(to_world, rows3(rows.target, lane) - rows3(rows.position, lane));
    const V3 velocity = transpose_times(to_world, rows3(rows.velocity, lane));
    const V3 spin = rows3(rows.angular_velocity, lane) * F(1.0F / spin_unit);
    const Q speed = rows4(rows.rotor_speed, lane);
    const auto keep = [&](std::size_t quarter, F a, F b, F c, F e)
                          HWY_ATTR { hn::StoreInterleaved4(a.v, b.v, c.v, e.v, d, quarters[quarter] + 4 * lane); };
    keep(0, way.x, way.y, way.z, velocity.x);
    keep(1, velocity.y, velocity.z, to_world.zx, to_world.zy);
    keep(2, to_world.zz, spin.x, spin.y, spin.z);
    keep(3, rotor(speed.w), rotor(speed.x), rotor(speed.y), rotor(speed.z));
  }
  const hn::CappedTag<float, 4> four;
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    for (std::size_t quarter = 0; quarter < 4; ++quarter) {
      for (std::size_t k = 0; k < 4; k += hn::Lanes(four)) {
        hn::StoreU(hn::Load(four, quarters[quarter] + 4 * lane + k), four, out + kHoverNumbers * lane + 4 * quarter + k);
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
