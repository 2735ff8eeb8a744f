// Intersects several rays at once with a primitive. Included once per SIMD target (by Highway's foreach_target).
//
// Every primitive is convex, so a ray's line is inside it on one interval [enter, exit]. Its surface is visible from both
// sides: a ray from outside hits it at `enter`, a ray from inside at `exit`.
//
// Distances stay fractions. They are compared by cross-multiplication, and one division at the end gives the distance of the
// nearest hit. All operations are correctly rounded and none are contracted, so a ray's result has the same bits on every
// target and beside any other rays. Branches on "no ray of this vector" save work and do not change any bit.
#if defined(FLOCKSTEP_TRACE_INTERSECT_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_TRACE_INTERSECT_INL_HPP
#undef FLOCKSTEP_TRACE_INTERSECT_INL_HPP
#else
#define FLOCKSTEP_TRACE_INTERSECT_INL_HPP
#endif

#include <hwy/highway.h>

#include <cstdint>
#include <limits>

#include "base/wide-inl.hpp"
#include "trace/shape.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type, F here

constexpr float kInfinity = std::numeric_limits<float>::infinity();

// A distance at which a ray meets a surface: num / den with den >= 0; x / 0 is infinite, with the sign of x. Its cosine is the
// magnitude of that between the ray and the surface's normal, if the direction is unit. It costs nothing where it is not read.
template <class F>
struct Fraction {
  F num, den, cosine;

  friend HWY_INLINE typename F::Mask operator<(const Fraction& a, const Fraction& b) { return a.num * b.den < b.num * a.den; }
  friend HWY_INLINE typename F::Mask operator>=(const Fraction& a, F b) { return a.num >= b * a.den; }
  friend HWY_INLINE Fraction select(typename F::Mask mask, const Fraction& yes, const Fraction& no) {
    return {select(mask, yes.num, no.num), select(mask, yes.den, no.den), select(mask, yes.cosine, no.cosine)};
  }
  friend HWY_INLINE Fraction min(const Fraction& a, const Fraction& b) { return select(b < a, b, a); }
  friend HWY_INLINE Fraction max(const Fraction& a, const Fraction& b) { return select(a < b, b, a); }
};

// The part of a ray's line inside a shape, as distances along the ray. It is empty if `hits` is false or enter > exit.
template <class F>
struct Interval {
  Fraction<F> enter, exit;
  typename F::Mask hits;
};

template <class F>
HWY_INLINE Interval<F> intersection(const Interval<F>& a, const Interval<F>& b) {
  return {max(a.enter, b.enter), min(a.exit, b.exit), a.hits & b.hits};
}

// The smallest interval that contains both.
template <class F>
HWY_INLINE Interval<F> hull(const Interval<F>& a, const Interval<F>& b) {
  const auto only_b = ~a.hits;
  const auto b_first = b.hits & (only_b | (b.enter < a.enter));
  const auto b_last = b.hits & (only_b | (a.exit < b.exit));
  return {select(b_first, b.enter, a.enter), select(b_last, b.exit, a.exit), a.hits | b.hits};
}

// Returns the distance at which a ray that starts within [-half, half] leaves it: at the face that it moves towards.
template <class F>
HWY_INLINE Fraction<F> slab_exit(F origin, F direction, float half) {
  const F speed = abs(direction);
  return {half - flip_sign(origin, direction), speed, speed};  // origin, measured in the ray's direction
}

// Returns the interval of t in which o + t d lies within [-half, half].
template <class F>
HWY_INLINE Interval<F> slab(F origin, F direction, float half) {
  const F h = half;
  const F along = flip_sign(origin, direction);
  const F speed = abs(direction);
  const auto parallel = speed == 0.0F;  // always or never inside
  const F den = select(parallel, 1.0F, speed);
  return {{select(parallel, -kInfinity, -(h + along)), den, speed},
          {select(parallel, kInfinity, h - along), den, speed},
          ~parallel | (abs(origin) <= h)};
}

template <class F>
HWY_INLINE Interval<F> box_interval(const Wide3<F>& o, const Wide3<F>& dir, const float* half) {
  return intersection(intersection(slab(o.x, dir.x, half[0]), slab(o.y, dir.y, half[1])), slab(o.z, dir.z, half[2]));
}

// Returns the interval of t with |o + t d| <= r: the roots (-o.d -+ sqrt(r^2 d.d - |o x d|^2)) / d.d of a quadratic. The
// distance of the line from the centre comes from a cross product instead of o.o - (o.d)^2 / d.d. That avoids a difference of
// two large squares and keeps thin, distant primitives exact. `hits` is false if the ball is missed or entirely behind the
// origin. The cosine of a unit direction is that of half the chord to the radius.
template <class F>
HWY_INLINE Interval<F> ball(F o_dot_d, F d_dot_d, F cross_squared, float radius) {
  const F square = radius * radius * d_dot_d - cross_squared;
  const auto ahead = (o_dot_d < 0.0F) | (square >= o_dot_d * o_dot_d);
  const auto hits = (square >= 0.0F) & ahead;
  if (none(hits)) return {{0.0F, d_dot_d, 0.0F}, {0.0F, d_dot_d, 0.0F}, hits};
  const F half_chord = sqrt(max(square, 0.0F));
  const F cosine = half_chord * (1.0F / radius);
  return {{-o_dot_d - half_chord, d_dot_d, cosine}, {half_chord - o_dot_d, d_dot_d, cosine}, hits};
}

template <class F>
HWY_INLINE Interval<F> sphere_interval(const Wide3<F>& o, const Wide3<F>& dir, float radius) {
  const Wide3<F> c = cross(o, dir);
  return ball(dot(o, dir), dot(dir, dir), dot(c, c), radius);
}

// A solid cylinder about local z: a circle in x and y, intersected with the slab between the caps.
template <class F>
HWY_INLINE Interval<F> cylinder_interval(const Wide3<F>& o, const Wide3<F>& dir, float radius, float half_height) {
  const F cross = o.x * dir.y - o.y * dir.x;
  const F d_dot_d = dir.x * dir.x + dir.y * dir.y;
  Interval<F> circle = ball(o.x * dir.x + o.y * dir.y, d_dot_d, cross * cross, radius);
  if (none(circle.hits)) return circle;
  // A ray parallel to the axis is always or never inside the circle. A deviation below 1e-12 rad counts as parallel: it moves
  // the ray by at most 1e-6 m over 1000 km, and radius^2 d.d of the smallest radius, 1e-6 m, would soon be flushed to 0.
  const auto parallel = d_dot_d <= 1e-24F;
  circle.enter = select(parallel, {-kInfinity, 1.0F, 0.0F}, circle.enter);
  circle.exit = select(parallel, {kInfinity, 1.0F, 0.0F}, circle.exit);
  circle.hits = circle.hits & (~parallel | (o.x * o.x + o.y * o.y <= radius * radius));
  return intersection(circle, slab(o.z, dir.z, half_height));
}

// A cylinder and two balls. The capsule is convex, so its interval is the hull of the intervals of these three.
template <class F>
HWY_INLINE Interval<F> capsule_interval(const Wide3<F>& o, const Wide3<F>& dir, float radius, float half_height) {
  const float middle = half_height - radius;
  Interval<F> body = cylinder_interval(o, dir, radius, middle);
  body.hits = without(body.hits, body.exit < body.enter);
  return hull(hull(body, sphere_interval<F>({o.x, o.y, o.z - middle}, dir, radius)),
              sphere_interval<F>({o.x, o.y, o.z + middle}, dir, radius));
}

template <class F>
HWY_INLINE Interval<F> interval(const Shape& shape, const Wide3<F>& o, const Wide3<F>& dir) {
  const float* const half = shape.half_extents;
  switch (shape.kind) {
    case ShapeKind::cylinder:
      return cylinder_interval(o, dir, half[0], half[2]);
    case ShapeKind::sphere:
      return sphere_interval(o, dir, half[0]);
    case ShapeKind::capsule:
      return capsule_interval(o, dir, half[0], half[2]);
    default:
      return box_interval(o, dir, half);
  }
}

// Use of the numbers of the nearest hits' elements: none, or they are kept. They are compared at equal distances, unless
// the elements come in ascending order.
enum class Numbers { none, ascending, any };

// The nearest hits so far of one vector of rays. Without numbers, `element` stays -1.
template <class F, Numbers kNumbers = Numbers::any>
struct Nearest {
  using I = typename F::Int;
  using M = typename F::Mask;
  Fraction<F> distance;  // m, infinite without a hit
  I element;             // -1 without a hit

  HWY_INLINE Nearest() : Nearest(kInfinity, -1) {}
  HWY_INLINE Nearest(F metres, I number) : distance{metres, 1.0F, 0.0F}, element(number) {}

  // Keeps a hit at a smaller distance; at equal distances the lower element wins. Distances are >= 0.
  HWY_INLINE void take(const Fraction<F>& hit, M valid, std::int32_t number) {
    M nearer = hit < distance;
    if constexpr (kNumbers == Numbers::any) {
      nearer = nearer | ((hit.num * distance.den == distance.num * hit.den) & (number < element));
    }
    nearer = valid & nearer;
    distance = select(nearer, hit, distance);
    if constexpr (kNumbers != Numbers::none) element = select(nearer, number, element);
  }

  // Hits the surface of a solid, from outside or inside, at a distance of at least `near` >= 0.
  HWY_INLINE void intersect(const Interval<F>& inside, std::int32_t number, F near) {
    const M valid = without(inside.hits & (inside.exit >= near), inside.exit < inside.enter);
    if (none(valid)) return;
    take(select(inside.enter >= near, inside.enter, inside.exit), valid, number);
  }

  // The same, from outside only.
  HWY_INLINE void intersect_front(const Interval<F>& inside, std::int32_t number, F near) {
    const M valid = without(inside.hits & (inside.enter >= near), inside.exit < inside.enter);
    if (!none(valid)) take(inside.enter, valid, number);
  }

  // Hits a cylinder with rays that start beside it: outside its circle, between the planes of its caps. They can enter through
  // its side only. A ray that enters the circle above or below the caps has left their slab for good.
  HWY_INLINE void meet_cylinder_side(const Wide3<F>& o, const Wide3<F>& dir, float radius, float half_height,
                                     std::int32_t number) {
    const F cross = o.x * dir.y - o.y * dir.x;
    const F o_dot_d = o.x * dir.x + o.y * dir.y;
    const F d_dot_d = dir.x * dir.x + dir.y * dir.y;
    const F square = radius * radius * d_dot_d - cross * cross;
    const M ahead = (square >= 0.0F) & (o_dot_d < 0.0F);
    if (none(ahead)) return;
    const F half_chord = sqrt(max(square, 0.0F));
    const F enter = -o_dot_d - half_chord;
    const F height = o.z * d_dot_d + enter * dir.z;  // times d.d, like `enter`
    const M valid = ahead & (abs(height) <= half_height * d_dot_d);
    if (!none(valid)) take({enter, d_dot_d, half_chord * (1.0F / radius)}, valid, number);
  }

  // m; inf without a hit.
  HWY_INLINE F metres() const { return distance.num / distance.den; }
};

// Returns the interval of a shape for rays of arbitrary origins, in the world frame.
template <class F>
HWY_INLINE Interval<F> world_interval(const Shape& shape, const Wide3<F>& origin, const Wide3<F>& direction) {
  const Wide3<F> o = origin - Wide3<F>{shape.center[0], shape.center[1], shape.center[2]};
  if (shape.aligned) return interval(shape, o, direction);
  return interval(shape, rotate(shape.to_local, o), rotate(shape.to_local, direction));
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
