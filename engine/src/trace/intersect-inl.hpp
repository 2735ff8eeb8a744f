// Ray against primitive, several rays at a time. Included once per SIMD target (Highway's foreach_target).
//
// Every primitive is convex, so a ray's line is inside it on one interval [enter, exit]. Its surface is seen from both sides:
// the hit is `enter` from outside and `exit` from inside.
//
// Distances stay fractions: what is nearer is decided by multiplying crosswise, and one division at the end gives the nearest
// hit's distance. Only correctly rounded operations are used and nothing is contracted, so a ray's result has the same bits on
// every target and beside any other rays. Branches on "no ray of this vector" save work and change no bit.
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

// num / den, den >= 0; x / 0 is infinite, with x's sign.
template <class F>
struct Fraction {
  F num, den;

  friend HWY_INLINE typename F::Mask operator<(const Fraction& a, const Fraction& b) { return a.num * b.den < b.num * a.den; }
  friend HWY_INLINE typename F::Mask operator>=(const Fraction& a, F b) { return a.num >= b * a.den; }
  friend HWY_INLINE Fraction select(typename F::Mask mask, const Fraction& yes, const Fraction& no) {
    return {select(mask, yes.num, no.num), select(mask, yes.den, no.den)};
  }
  friend HWY_INLINE Fraction min(const Fraction& a, const Fraction& b) { return select(b < a, b, a); }
  friend HWY_INLINE Fraction max(const Fraction& a, const Fraction& b) { return select(a < b, b, a); }
};

// Where a line is inside, in m along the ray; where `meets` is false or enter > exit it never is.
template <class F>
struct Interval {
  Fraction<F> enter, exit;
  typename F::Mask meets;
};

template <class F>
HWY_INLINE Interval<F> intersection(const Interval<F>& a, const Interval<F>& b) {
  return {max(a.enter, b.enter), min(a.exit, b.exit), a.meets & b.meets};
}

// The least interval that holds both.
template <class F>
HWY_INLINE Interval<F> hull(const Interval<F>& a, const Interval<F>& b) {
  const auto only_b = ~a.meets;
  const auto b_first = b.meets & (only_b | (b.enter < a.enter));
  const auto b_last = b.meets & (only_b | (a.exit < b.exit));
  return {select(b_first, b.enter, a.enter), select(b_last, b.exit, a.exit), a.meets | b.meets};
}

// When the ray leaves [-half, half], given that it starts within: at the face it moves towards.
template <class F>
HWY_INLINE Fraction<F> slab_exit(F origin, F direction, float half) {
  return {half - flip_sign(origin, direction), abs(direction)};  // the origin, counted in the ray's direction
}

// Where o + t d lies within [-half, half].
template <class F>
HWY_INLINE Interval<F> slab(F origin, F direction, float half) {
  const F h = half;
  const F along = flip_sign(origin, direction);
  const F speed = abs(direction);
  const auto parallel = speed == 0.0F;  // inside always or never
  const F den = select(parallel, 1.0F, speed);
  return {{select(parallel, -kInfinity, -(h + along)), den},
          {select(parallel, kInfinity, h - along), den},
          ~parallel | (abs(origin) <= h)};
}

template <class F>
HWY_INLINE Interval<F> box_interval(const Wide3<F>& o, const Wide3<F>& dir, const float* half) {
  return intersection(intersection(slab(o.x, dir.x, half[0]), slab(o.y, dir.y, half[1])), slab(o.z, dir.z, half[2]));
}

// Where |o + t d| <= r, as the roots (-o.d -+ sqrt(r^2 d.d - |o x d|^2)) / d.d of a quadratic. Taking the distance of the line
// from the centre out of a cross product, and not out of o.o - (o.d)^2 / d.d, keeps thin far primitives exact: there is no
// difference of two large squares. Meets nothing where the ball is missed or wholly behind.
template <class F>
HWY_INLINE Interval<F> ball(F o_dot_d, F d_dot_d, F cross_squared, float radius) {
  const F square = radius * radius * d_dot_d - cross_squared;
  const auto ahead = (o_dot_d < 0.0F) | (square >= o_dot_d * o_dot_d);
  const auto meets = (square >= 0.0F) & ahead;
  if (none(meets)) return {{0.0F, d_dot_d}, {0.0F, d_dot_d}, meets};
  const F half_chord = sqrt(max(square, 0.0F));
  return {{-o_dot_d - half_chord, d_dot_d}, {half_chord - o_dot_d, d_dot_d}, meets};
}

template <class F>
HWY_INLINE Interval<F> sphere_interval(const Wide3<F>& o, const Wide3<F>& dir, float radius) {
  const Wide3<F> c = cross(o, dir);
  return ball(dot(o, dir), dot(dir, dir), dot(c, c), radius);
}

// A full cylinder about local z: its circle in x and y, and the slab between its caps.
template <class F>
HWY_INLINE Interval<F> cylinder_interval(const Wide3<F>& o, const Wide3<F>& dir, float radius, float half_height) {
  const F cross = o.x * dir.y - o.y * dir.x;
  const F d_dot_d = dir.x * dir.x + dir.y * dir.y;
  Interval<F> circle = ball(o.x * dir.x + o.y * dir.y, d_dot_d, cross * cross, radius);
  if (none(circle.meets)) return circle;
  // A ray along the axis stays within the circle or never comes in. One that leaves it by less than 1e-12 rad counts as such: it
  // is off by no more than 1e-6 m after 1000 km, and radius^2 d.d of the least radius, 1e-6 m, would soon be flushed to 0.
  const auto parallel = d_dot_d <= 1e-24F;
  circle.enter = select(parallel, {-kInfinity, 1.0F}, circle.enter);
  circle.exit = select(parallel, {kInfinity, 1.0F}, circle.exit);
  circle.meets = circle.meets & (~parallel | (o.x * o.x + o.y * o.y <= radius * radius));
  return intersection(circle, slab(o.z, dir.z, half_height));
}

// A cylinder and two balls: being convex, it is the hull of what the line has in common with each.
template <class F>
HWY_INLINE Interval<F> capsule_interval(const Wide3<F>& o, const Wide3<F>& dir, float radius, float half_height) {
  const float middle = half_height - radius;
  Interval<F> body = cylinder_interval(o, dir, radius, middle);
  body.meets = without(body.meets, body.exit < body.enter);
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

// What one vector of rays has hit so far. kNumbered: by which element is asked, too; without, that is -1 for all.
template <class F, bool kNumbered = true>
struct Nearest {
  using I = typename F::Int;
  using M = typename F::Mask;
  Fraction<F> distance;  // m, infinite where nothing is hit
  I element;             // -1 where nothing is hit

  HWY_INLINE Nearest() : Nearest(kInfinity, -1) {}
  HWY_INLINE Nearest(F metres, I number) : distance{metres, 1.0F}, element(number) {}

  // Takes a hit at a smaller distance; of two at one distance that of the lower element. Distances >= 0.
  HWY_INLINE void take(const Fraction<F>& hit, M valid, std::int32_t number) {
    M nearer = hit < distance;
    if constexpr (kNumbered) nearer = nearer | ((hit.num * distance.den == distance.num * hit.den) & (number < element));
    nearer = valid & nearer;
    distance = select(nearer, hit, distance);
    if constexpr (kNumbered) element = select(nearer, number, element);
  }

  // The surface of a solid, seen from outside and from inside, no nearer than `near` >= 0.
  HWY_INLINE void meet(const Interval<F>& inside, std::int32_t number, F near) {
    const M valid = without(inside.meets & (inside.exit >= near), inside.exit < inside.enter);
    if (none(valid)) return;
    take(select(inside.enter >= near, inside.enter, inside.exit), valid, number);
  }

  // The same, seen from outside only.
  HWY_INLINE void meet_front(const Interval<F>& inside, std::int32_t number, F near) {
    const M valid = without(inside.meets & (inside.enter >= near), inside.exit < inside.enter);
    if (!none(valid)) take(inside.enter, valid, number);
  }

  // A cylinder, by rays that begin beside it: outside its circle, between the planes of its caps. They can enter through its side
  // only. Where the circle is entered above or below the caps, the ray has left their slab for good.
  HWY_INLINE void meet_cylinder_side(const Wide3<F>& o, const Wide3<F>& dir, float radius, float half_height,
                                     std::int32_t number) {
    const F cross = o.x * dir.y - o.y * dir.x;
    const F o_dot_d = o.x * dir.x + o.y * dir.y;
    const F d_dot_d = dir.x * dir.x + dir.y * dir.y;
    const F square = radius * radius * d_dot_d - cross * cross;
    const M ahead = (square >= 0.0F) & (o_dot_d < 0.0F);
    if (none(ahead)) return;
    const F enter = -o_dot_d - sqrt(max(square, 0.0F));
    const F height = o.z * d_dot_d + enter * dir.z;  // times d.d, as `enter` is
    const M valid = ahead & (abs(height) <= half_height * d_dot_d);
    if (!none(valid)) take({enter, d_dot_d}, valid, number);
  }

  // m; inf where nothing is hit.
  HWY_INLINE F metres() const { return distance.num / distance.den; }
};

// The shape met by rays of any origin, in the world frame.
template <class F>
HWY_INLINE Interval<F> world_interval(const Shape& shape, const Wide3<F>& origin, const Wide3<F>& direction) {
  const Wide3<F> o = origin - Wide3<F>{shape.center[0], shape.center[1], shape.center[2]};
  if (shape.aligned) return interval(shape, o, direction);
  return interval(shape, rotate(shape.to_local, o), rotate(shape.to_local, direction));
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
