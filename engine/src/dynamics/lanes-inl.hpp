// Loads and stores lanes as wide numbers, and rotates them. Included once per SIMD target.
#if defined(FLOCKSTEP_DYNAMICS_LANES_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_DYNAMICS_LANES_INL_HPP
#undef FLOCKSTEP_DYNAMICS_LANES_INL_HPP
#else
#define FLOCKSTEP_DYNAMICS_LANES_INL_HPP
#endif

#include <hwy/highway.h>

#include <cstddef>

#include "base/wide-inl.hpp"
#include "dynamics/flight.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

using F = WideUpTo<kLanes>;
using V3 = Wide3<F>;

HWY_INLINE F load(const Lane& lane, std::size_t at) { return F::load(lane.data() + at); }
HWY_INLINE void store(F value, Lane& lane, std::size_t at) { value.store(lane.data() + at); }
HWY_INLINE V3 load3(const Lanes<3>& lanes, std::size_t at) {
  return {load(lanes[0], at), load(lanes[1], at), load(lanes[2], at)};
}
HWY_INLINE void store3(const V3& v, Lanes<3>& lanes, std::size_t at) {
  store(v.x, lanes[0], at);
  store(v.y, lanes[1], at);
  store(v.z, lanes[2], at);
}

// Replaces the setpoint by those that have arrived.
HWY_NOINLINE inline void take_arrivals(std::span<const Arrival> arrivals, int tick, std::size_t lane, F* set) {
  const F now(static_cast<float>(tick));
  for (const Arrival& arrival : arrivals) {
    const F::Mask has_arrived = load(arrival.tick, lane) <= now;
    for (std::size_t i = 0; i < 7; ++i) set[i] = select(has_arrived, load(arrival.setpoint[i], lane), set[i]);
  }
}

// A quaternion.
struct Q {
  F w, x, y, z;
};

HWY_INLINE Q operator+(const Q& a, const Q& b) { return {a.w + b.w, a.x + b.x, a.y + b.y, a.z + b.z}; }
HWY_INLINE Q operator*(const Q& a, F s) { return {a.w * s, a.x * s, a.y * s, a.z * s}; }
HWY_INLINE Q load_rotation(const Lanes<4>& lanes, std::size_t at) {
  return {load(lanes[0], at), load(lanes[1], at), load(lanes[2], at), load(lanes[3], at)};
}
HWY_INLINE void store_rotation(const Q& q, Lanes<4>& lanes, std::size_t at) {
  store(q.w, lanes[0], at);
  store(q.x, lanes[1], at);
  store(q.y, lanes[2], at);
  store(q.z, lanes[3], at);
}
// Rows are interleaved: w, x, y, z, w, ...
HWY_INLINE Q load_rows4(const float* rows) {
  Q q;
  hn::LoadInterleaved4(F::Tag(), rows, q.w.part[0], q.x.part[0], q.y.part[0], q.z.part[0]);
  return q;
}
HWY_INLINE void store_rows4(const Q& q, float* rows) {
  hn::StoreInterleaved4(q.w.part[0], q.x.part[0], q.y.part[0], q.z.part[0], F::Tag(), rows);
}

// Quaternion product of q and (s, v).
HWY_INLINE Q product(const Q& q, F s, const V3& v) {
  return {q.w * s - q.x * v.x - q.y * v.y - q.z * v.z, q.w * v.x + q.x * s + q.y * v.z - q.z * v.y,
          q.w * v.y - q.x * v.z + q.y * s + q.z * v.x, q.w * v.z + q.x * v.y - q.y * v.x + q.z * s};
}

// q after turning at a constant angular velocity of the body, in closed form. half: half the duration, s. Sine and cosine use
// their series: the error is below 1e-7 up to half a radian, and normalised() corrects the length.
HWY_INLINE Q turned(const Q& q, const V3& turn, F half) {
  const V3 v = turn * half;
  const F x = dot(v, v);
  const F cosine = 1.0F - x * (1.0F / 2.0F - x * (1.0F / 24.0F - x * (1.0F / 720.0F)));
  const F sine = 1.0F - x * (1.0F / 6.0F - x * (1.0F / 120.0F - x * (1.0F / 5040.0F)));
  return product(q, cosine, v * sine);
}

// Time derivative of q at an angular velocity of the body.
HWY_INLINE Q rate_of(const Q& q, const V3& turn) { return product(q, 0.0F, turn * 0.5F); }

// Normalises q. One step of Newton's method is exact for nearly unit quaternions. Drones that turn by more than half a radian
// in a tick need the division.
HWY_INLINE Q normalised(const Q& q) {
  const F square = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
  F scale = 1.5F - 0.5F * square;
  const F::Mask is_far = abs(square - 1.0F) > 1e-4F;
  if (HWY_UNLIKELY(!none(is_far))) scale = select(is_far, 1.0F / sqrt(square), scale);
  return q * scale;
}

// Rotation matrix, body to world; zx is the world z component of the body's x axis.
struct M3 {
  F xx, xy, xz, yx, yy, yz, zx, zy, zz;
};

HWY_INLINE M3 matrix(const Q& q) {
  const F x2 = q.x * 2.0F, y2 = q.y * 2.0F, z2 = q.z * 2.0F;
  const F wx = q.w * x2, wy = q.w * y2, wz = q.w * z2;
  const F xx = q.x * x2, xy = q.x * y2, xz = q.x * z2;
  const F yy = q.y * y2, yz = q.y * z2, zz = q.z * z2;
  return {1.0F - (yy + zz), xy - wz, xz + wy, xy + wz, 1.0F - (xx + zz), yz - wx, xz - wy, yz + wx, 1.0F - (xx + yy)};
}
HWY_INLINE V3 times(const M3& m, const V3& v) {
  return {m.xx * v.x + m.xy * v.y + m.xz * v.z, m.yx * v.x + m.yy * v.y + m.yz * v.z, m.zx * v.x + m.zy * v.y + m.zz * v.z};
}
HWY_INLINE V3 transpose_times(const M3& m, const V3& v) {
  return {m.xx * v.x + m.yx * v.y + m.zx * v.z, m.xy * v.x + m.yy * v.y + m.zy * v.z, m.xz * v.x + m.yz * v.y + m.zz * v.z};
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
