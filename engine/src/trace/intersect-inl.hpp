// Ray against primitive, several rays at a time. Included once per SIMD target (Highway's foreach_target).
//
// Every primitive is convex, so a ray's line is inside it on one interval [enter, exit]. Its surface is seen from both sides:
// the hit is `enter` from outside and `exit` from inside. Only correctly rounded operations are used and nothing is
// contracted, so a ray's result has the same bits on every target and beside any other rays.
#if defined(SWIFTLET_TRACE_INTERSECT_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef SWIFTLET_TRACE_INTERSECT_INL_HPP
#undef SWIFTLET_TRACE_INTERSECT_INL_HPP
#else
#define SWIFTLET_TRACE_INTERSECT_INL_HPP
#endif

#include <hwy/highway.h>

#include <limits>

#include "trace/shape.hpp"

HWY_BEFORE_NAMESPACE();
namespace swiftlet::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class V>
struct Vec3V {
  V x, y, z;
};

template <class V>
struct Interval {
  V enter, exit;  // m along the ray; empty when enter > exit
};

// Where o + t d lies within [-half, half].
template <class D, class V = hn::Vec<D>>
HWY_INLINE Interval<V> slab(D d, V origin, V direction, float half) {
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const V h = hn::Set(d, half);
  const V towards = hn::CopySign(h, direction);  // the face the ray moves towards
  const auto parallel = hn::Eq(direction, hn::Zero(d));
  const auto within = hn::Le(hn::Abs(origin), h);
  const V divisor = hn::IfThenElse(parallel, hn::Set(d, 1.0F), direction);
  const V exit = hn::Div(hn::Sub(towards, origin), divisor);
  const V enter = hn::Div(hn::Neg(hn::Add(towards, origin)), divisor);
  const V always = hn::IfThenElse(within, infinity, hn::Neg(infinity));
  return {hn::IfThenElse(parallel, hn::Neg(always), enter), hn::IfThenElse(parallel, always, exit)};
}

template <class V>
HWY_INLINE Interval<V> intersection(const Interval<V>& a, const Interval<V>& b) {
  return {hn::Max(a.enter, b.enter), hn::Min(a.exit, b.exit)};
}

// Where |o + t d| <= r, given the closest approach t = -o.d / d.d and the distance there (as distance^2 * d.d).
// Taking the distance at the closest approach from a cross product, not from o.o - (o.d)^2 / d.d, keeps thin far
// primitives exact: there is no difference of two large squares.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Interval<V> ball(D d, V o_dot_d, V d_dot_d, V cross_squared, float radius) {
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const auto parallel = hn::Eq(d_dot_d, hn::Zero(d));  // only for a cylinder's circle
  const V divisor = hn::IfThenElse(parallel, hn::Set(d, 1.0F), d_dot_d);
  const V square = hn::Sub(hn::Mul(hn::Set(d, radius * radius), d_dot_d), cross_squared);
  const auto miss = hn::Lt(square, hn::Zero(d));
  const V half_chord = hn::Div(hn::Sqrt(hn::Max(square, hn::Zero(d))), divisor);
  const V middle = hn::Div(hn::Neg(o_dot_d), divisor);
  return {hn::IfThenElse(miss, infinity, hn::Sub(middle, half_chord)),
          hn::IfThenElse(miss, hn::Neg(infinity), hn::Add(middle, half_chord))};
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE Interval<V> box_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, const float* half) {
  return intersection(intersection(slab(d, o.x, dir.x, half[0]), slab(d, o.y, dir.y, half[1])), slab(d, o.z, dir.z, half[2]));
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE Interval<V> sphere_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, float radius) {
  const V cx = hn::Sub(hn::Mul(o.y, dir.z), hn::Mul(o.z, dir.y));
  const V cy = hn::Sub(hn::Mul(o.z, dir.x), hn::Mul(o.x, dir.z));
  const V cz = hn::Sub(hn::Mul(o.x, dir.y), hn::Mul(o.y, dir.x));
  const V cross_squared = hn::Add(hn::Add(hn::Mul(cx, cx), hn::Mul(cy, cy)), hn::Mul(cz, cz));
  const V o_dot_d = hn::Add(hn::Add(hn::Mul(o.x, dir.x), hn::Mul(o.y, dir.y)), hn::Mul(o.z, dir.z));
  const V d_dot_d = hn::Add(hn::Add(hn::Mul(dir.x, dir.x), hn::Mul(dir.y, dir.y)), hn::Mul(dir.z, dir.z));
  return ball(d, o_dot_d, d_dot_d, cross_squared, radius);
}

// A full cylinder about local z: its circle in x and y, and the slab between its caps.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Interval<V> cylinder_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, const float* half) {
  const float radius = half[0];
  const V cross = hn::Sub(hn::Mul(o.x, dir.y), hn::Mul(o.y, dir.x));
  const V o_dot_d = hn::Add(hn::Mul(o.x, dir.x), hn::Mul(o.y, dir.y));
  const V d_dot_d = hn::Add(hn::Mul(dir.x, dir.x), hn::Mul(dir.y, dir.y));
  Interval<V> circle = ball(d, o_dot_d, d_dot_d, hn::Mul(cross, cross), radius);
  // A ray along the axis stays within the circle or never comes in.
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const auto parallel = hn::Eq(d_dot_d, hn::Zero(d));
  const V o_dot_o = hn::Add(hn::Mul(o.x, o.x), hn::Mul(o.y, o.y));
  const V always = hn::IfThenElse(hn::Le(o_dot_o, hn::Set(d, radius * radius)), infinity, hn::Neg(infinity));
  circle.enter = hn::IfThenElse(parallel, hn::Neg(always), circle.enter);
  circle.exit = hn::IfThenElse(parallel, always, circle.exit);
  return intersection(circle, slab(d, o.z, dir.z, half[2]));
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE Vec3V<V> rotate(D d, const float* m, const Vec3V<V>& v) {
  const auto row = [&](int i) HWY_ATTR {
    return hn::Add(hn::Add(hn::Mul(hn::Set(d, m[3 * i]), v.x), hn::Mul(hn::Set(d, m[3 * i + 1]), v.y)),
                   hn::Mul(hn::Set(d, m[3 * i + 2]), v.z));
  };
  return {row(0), row(1), row(2)};
}

// Distance to the shape's surface along the ray, in [t_near, inf]; inf on a miss.
template <class D, class V = hn::Vec<D>>
HWY_INLINE V hit_distance(D d, const Shape& shape, const Vec3V<V>& origin, const Vec3V<V>& direction, V t_near) {
  Vec3V<V> o{hn::Sub(origin.x, hn::Set(d, shape.center[0])), hn::Sub(origin.y, hn::Set(d, shape.center[1])),
             hn::Sub(origin.z, hn::Set(d, shape.center[2]))};
  Vec3V<V> dir = direction;
  if (!shape.aligned) {
    o = rotate(d, shape.to_local, o);
    dir = rotate(d, shape.to_local, dir);
  }
  Interval<V> inside;
  switch (shape.kind) {
    case PrimitiveKind::cylinder:
      inside = cylinder_interval(d, o, dir, shape.half_extents);
      break;
    case PrimitiveKind::sphere:
      inside = sphere_interval(d, o, dir, shape.half_extents[0]);
      break;
    default:
      inside = box_interval(d, o, dir, shape.half_extents);
  }
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const V t = hn::IfThenElse(hn::Ge(inside.enter, t_near), inside.enter, inside.exit);
  const auto hit = hn::And(hn::Le(inside.enter, inside.exit), hn::Ge(t, t_near));
  return hn::IfThenElse(hit, t, infinity);
}

}  // namespace swiftlet::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
