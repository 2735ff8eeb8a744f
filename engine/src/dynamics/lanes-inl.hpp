// Loads and stores lanes as wide numbers, and rotates them. Included once per SIMD target.
#if defined(FLOCKSTEP_DYNAMICS_LANES_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_DYNAMICS_LANES_INL_HPP
#undef FLOCKSTEP_DYNAMICS_LANES_INL_HPP
#else
#define FLOCKSTEP_DYNAMICS_LANES_INL_HPP
#endif

#include <hwy/highway.h>

#include <cstddef>
#include <type_traits>

#include "base/wide-inl.hpp"
#include "dynamics/flight.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

// Templates compute with numbers of type T: F, or numbers that keep derivatives.
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
    for (std::size_t i = 0; i < kSetpoint; ++i) set[i] = select(has_arrived, load(arrival.setpoint[i], lane), set[i]);
  }
}

// A quaternion.
template <class T>
struct Quaternion {
  T w, x, y, z;

  friend HWY_INLINE Quaternion operator+(const Quaternion& a, const Quaternion& b) {
    return {a.w + b.w, a.x + b.x, a.y + b.y, a.z + b.z};
  }
  friend HWY_INLINE Quaternion operator*(const Quaternion& a, T s) { return {a.w * s, a.x * s, a.y * s, a.z * s}; }
};
using Q = Quaternion<F>;

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
template <class T>
HWY_INLINE Quaternion<T> product(const Quaternion<T>& q, std::type_identity_t<T> s, const Wide3<T>& v) {
  return {q.w * s - q.x * v.x - q.y * v.y - q.z * v.z, q.w * v.x + q.x * s + q.y * v.z - q.z * v.y,
          q.w * v.y - q.x * v.z + q.y * s + q.z * v.x, q.w * v.z + q.x * v.y - q.y * v.x + q.z * s};
}

// q after turning at a constant angular velocity of the body, in closed form. half: half the duration, s. Sine and cosine use
// their series: the error is below 1e-7 up to half a radian, and normalised() corrects the length.
template <class T>
HWY_INLINE Quaternion<T> turned(const Quaternion<T>& q, const Wide3<T>& turn, std::type_identity_t<T> half) {
  const Wide3<T> v = turn * half;
  const T x = dot(v, v);
  const T cosine = 1.0F - x * (1.0F / 2.0F - x * (1.0F / 24.0F - x * (1.0F / 720.0F)));
  const T sine = 1.0F - x * (1.0F / 6.0F - x * (1.0F / 120.0F - x * (1.0F / 5040.0F)));
  return product(q, cosine, v * sine);
}

// Time derivative of q at an angular velocity of the body.
template <class T>
HWY_INLINE Quaternion<T> rate_of(const Quaternion<T>& q, const Wide3<T>& turn) {
  return product(q, 0.0F, turn * 0.5F);
}

// Normalises q. One step of Newton's method is exact for nearly unit quaternions. Drones that turn by more than half a radian
// in a tick need the division.
template <class T>
HWY_INLINE Quaternion<T> normalised(const Quaternion<T>& q) {
  const T square = q.w * q.w + q.x * q.x + q.y * q.y + q.z * q.z;
  T scale = 1.5F - 0.5F * square;
  const auto is_far = abs(square - 1.0F) > 1e-4F;
  if (HWY_UNLIKELY(!none(is_far))) scale = select(is_far, T(1.0F / sqrt(square)), scale);
  return q * scale;
}

// Rotation matrix, body to world; zx is the world z component of the body's x axis.
template <class T>
struct Matrix3 {
  T xx, xy, xz, yx, yy, yz, zx, zy, zz;
};
using M3 = Matrix3<F>;

template <class T>
HWY_INLINE Matrix3<T> matrix(const Quaternion<T>& q) {
  const T x2 = q.x * 2.0F, y2 = q.y * 2.0F, z2 = q.z * 2.0F;
  const T wx = q.w * x2, wy = q.w * y2, wz = q.w * z2;
  const T xx = q.x * x2, xy = q.x * y2, xz = q.x * z2;
  const T yy = q.y * y2, yz = q.y * z2, zz = q.z * z2;
  return {1.0F - (yy + zz), xy - wz, xz + wy, xy + wz, 1.0F - (xx + zz), yz - wx, xz - wy, yz + wx, 1.0F - (xx + yy)};
}
template <class T>
HWY_INLINE Wide3<T> times(const Matrix3<T>& m, const Wide3<T>& v) {
  return {m.xx * v.x + m.xy * v.y + m.xz * v.z, m.yx * v.x + m.yy * v.y + m.yz * v.z, m.zx * v.x + m.zy * v.y + m.zz * v.z};
}
template <class T>
HWY_INLINE Wide3<T> transpose_times(const Matrix3<T>& m, const Wide3<T>& v) {
  return {m.xx * v.x + m.yx * v.y + m.zx * v.z, m.xy * v.x + m.yy * v.y + m.zy * v.z, m.xz * v.x + m.yz * v.y + m.zz * v.z};
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
