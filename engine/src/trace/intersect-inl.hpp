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

#include "trace/shape.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

template <class V>
struct Vec3V {
  V x, y, z;
};

// num / den, den >= 0; x / 0 is infinite, with x's sign.
template <class V>
struct Fraction {
  V num, den;
};

template <class V>
HWY_INLINE auto is_less(const Fraction<V>& a, const Fraction<V>& b) {
  return hn::Lt(hn::Mul(a.num, b.den), hn::Mul(b.num, a.den));
}

template <class M, class V>
HWY_INLINE Fraction<V> select(M mask, const Fraction<V>& yes, const Fraction<V>& no) {
  return {hn::IfThenElse(mask, yes.num, no.num), hn::IfThenElse(mask, yes.den, no.den)};
}

template <class V>
HWY_INLINE Fraction<V> earlier(const Fraction<V>& a, const Fraction<V>& b) {
  return select(is_less(b, a), b, a);
}

template <class V>
HWY_INLINE Fraction<V> later(const Fraction<V>& a, const Fraction<V>& b) {
  return select(is_less(a, b), b, a);
}

// Where a line is inside, in m along the ray; where `meets` is false or enter > exit it never is.
template <class V, class M>
struct Interval {
  Fraction<V> enter, exit;
  M meets;
};

template <class D>
using IntervalOf = Interval<hn::Vec<D>, hn::Mask<D>>;

template <class V, class M>
HWY_INLINE Interval<V, M> intersection(const Interval<V, M>& a, const Interval<V, M>& b) {
  return {later(a.enter, b.enter), earlier(a.exit, b.exit), hn::And(a.meets, b.meets)};
}

// The least interval that holds both.
template <class V, class M>
HWY_INLINE Interval<V, M> hull(const Interval<V, M>& a, const Interval<V, M>& b) {
  const auto only_b = hn::Not(a.meets);
  const auto b_first = hn::And(b.meets, hn::Or(only_b, is_less(b.enter, a.enter)));
  const auto b_last = hn::And(b.meets, hn::Or(only_b, is_less(a.exit, b.exit)));
  return {select(b_first, b.enter, a.enter), select(b_last, b.exit, a.exit), hn::Or(a.meets, b.meets)};
}

// When the ray leaves [-half, half], given that it starts within: at the face it moves towards.
template <class D, class V = hn::Vec<D>>
HWY_INLINE Fraction<V> slab_exit(D d, V origin, V direction, float half) {
  const V along = hn::Xor(origin, hn::And(direction, hn::SignBit(d)));  // the origin, counted in the ray's direction
  return {hn::Sub(hn::Set(d, half), along), hn::Abs(direction)};
}

// Where o + t d lies within [-half, half].
template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> slab(D d, V origin, V direction, float half) {
  const V h = hn::Set(d, half);
  const V along = hn::Xor(origin, hn::And(direction, hn::SignBit(d)));
  const V speed = hn::Abs(direction);
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const auto parallel = hn::Eq(speed, hn::Zero(d));  // inside always or never
  const V den = hn::IfThenElse(parallel, hn::Set(d, 1.0F), speed);
  return {{hn::IfThenElse(parallel, hn::Neg(infinity), hn::Neg(hn::Add(h, along))), den},
          {hn::IfThenElse(parallel, infinity, hn::Sub(h, along)), den},
          hn::Or(hn::Not(parallel), hn::Le(hn::Abs(origin), h))};
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> box_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, const float* half) {
  return intersection(intersection(slab(d, o.x, dir.x, half[0]), slab(d, o.y, dir.y, half[1])), slab(d, o.z, dir.z, half[2]));
}

// Where |o + t d| <= r, as the roots (-o.d -+ sqrt(r^2 d.d - |o x d|^2)) / d.d of a quadratic. Taking the distance of the line
// from the centre out of a cross product, and not out of o.o - (o.d)^2 / d.d, keeps thin far primitives exact: there is no
// difference of two large squares. Meets nothing where the ball is missed or wholly behind.
template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> ball(D d, V o_dot_d, V d_dot_d, V cross_squared, float radius) {
  const V square = hn::Sub(hn::Mul(hn::Set(d, radius * radius), d_dot_d), cross_squared);
  const auto ahead = hn::Or(hn::Lt(o_dot_d, hn::Zero(d)), hn::Ge(square, hn::Mul(o_dot_d, o_dot_d)));
  const auto meets = hn::And(hn::Ge(square, hn::Zero(d)), ahead);
  if (hn::AllFalse(d, meets)) return {{hn::Zero(d), d_dot_d}, {hn::Zero(d), d_dot_d}, meets};
  const V half_chord = hn::Sqrt(hn::Max(square, hn::Zero(d)));
  return {{hn::Sub(hn::Neg(o_dot_d), half_chord), d_dot_d}, {hn::Sub(half_chord, o_dot_d), d_dot_d}, meets};
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> sphere_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, float radius) {
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
HWY_INLINE IntervalOf<D> cylinder_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, float radius, float half_height) {
  const V cross = hn::Sub(hn::Mul(o.x, dir.y), hn::Mul(o.y, dir.x));
  const V o_dot_d = hn::Add(hn::Mul(o.x, dir.x), hn::Mul(o.y, dir.y));
  const V d_dot_d = hn::Add(hn::Mul(dir.x, dir.x), hn::Mul(dir.y, dir.y));
  IntervalOf<D> circle = ball(d, o_dot_d, d_dot_d, hn::Mul(cross, cross), radius);
  if (hn::AllFalse(d, circle.meets)) return circle;
  // A ray along the axis stays within the circle or never comes in. One that leaves it by less than 1e-12 rad counts as such: it
  // is off by no more than 1e-6 m after 1000 km, and radius^2 d.d of the least radius, 1e-6 m, would soon be flushed to 0.
  const auto parallel = hn::Le(d_dot_d, hn::Set(d, 1e-24F));
  const V infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const V one = hn::Set(d, 1.0F);
  const V o_dot_o = hn::Add(hn::Mul(o.x, o.x), hn::Mul(o.y, o.y));
  circle.enter = select(parallel, {hn::Neg(infinity), one}, circle.enter);
  circle.exit = select(parallel, {infinity, one}, circle.exit);
  circle.meets = hn::And(circle.meets, hn::Or(hn::Not(parallel), hn::Le(o_dot_o, hn::Set(d, radius * radius))));
  return intersection(circle, slab(d, o.z, dir.z, half_height));
}

// Where a ray enters a cylinder through its side, given that it starts beside it: outside its circle, between the planes of its
// caps. Where the circle is entered above or below the caps, the ray has left their slab for good.
template <class V, class M>
struct Entry {
  Fraction<V> at;
  M valid;
};
template <class D, class V = hn::Vec<D>>
HWY_INLINE Entry<V, hn::Mask<D>> cylinder_side(D d, const Vec3V<V>& o, const Vec3V<V>& dir, float radius, float half_height) {
  const V cross = hn::Sub(hn::Mul(o.x, dir.y), hn::Mul(o.y, dir.x));
  const V o_dot_d = hn::Add(hn::Mul(o.x, dir.x), hn::Mul(o.y, dir.y));
  const V d_dot_d = hn::Add(hn::Mul(dir.x, dir.x), hn::Mul(dir.y, dir.y));
  const V square = hn::Sub(hn::Mul(hn::Set(d, radius * radius), d_dot_d), hn::Mul(cross, cross));
  const auto ahead = hn::And(hn::Ge(square, hn::Zero(d)), hn::Lt(o_dot_d, hn::Zero(d)));
  if (hn::AllFalse(d, ahead)) return {{hn::Zero(d), d_dot_d}, ahead};
  const V enter = hn::Sub(hn::Neg(o_dot_d), hn::Sqrt(hn::Max(square, hn::Zero(d))));
  const V height = hn::Add(hn::Mul(o.z, d_dot_d), hn::Mul(enter, dir.z));  // times d.d, as `enter` is
  return {{enter, d_dot_d}, hn::And(ahead, hn::Le(hn::Abs(height), hn::Mul(hn::Set(d, half_height), d_dot_d)))};
}

// A cylinder and two balls: being convex, it is the hull of what the line has in common with each.
template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> capsule_interval(D d, const Vec3V<V>& o, const Vec3V<V>& dir, float radius, float half_height) {
  const float middle = half_height - radius;
  IntervalOf<D> body = cylinder_interval(d, o, dir, radius, middle);
  body.meets = hn::And(body.meets, hn::Not(is_less(body.exit, body.enter)));
  const V up = hn::Set(d, middle);
  return hull(hull(body, sphere_interval(d, {o.x, o.y, hn::Sub(o.z, up)}, dir, radius)),
              sphere_interval(d, {o.x, o.y, hn::Add(o.z, up)}, dir, radius));
}

template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> interval(D d, const Shape& shape, const Vec3V<V>& o, const Vec3V<V>& dir) {
  const float* const half = shape.half_extents;
  switch (shape.kind) {
    case ShapeKind::cylinder:
      return cylinder_interval(d, o, dir, half[0], half[2]);
    case ShapeKind::sphere:
      return sphere_interval(d, o, dir, half[0]);
    case ShapeKind::capsule:
      return capsule_interval(d, o, dir, half[0], half[2]);
    default:
      return box_interval(d, o, dir, half);
  }
}

// m: a matrix as m(row, column).
template <class D, class Matrix, class V = hn::Vec<D>>
HWY_INLINE Vec3V<V> rotate(D d, const Matrix& m, const Vec3V<V>& v) {
  const auto row = [&](int i) HWY_ATTR {
    return hn::Add(hn::Add(hn::Mul(hn::Set(d, m(i, 0)), v.x), hn::Mul(hn::Set(d, m(i, 1)), v.y)),
                   hn::Mul(hn::Set(d, m(i, 2)), v.z));
  };
  return {row(0), row(1), row(2)};
}

// What one vector of rays has hit so far. kNumbered: by which element is asked, too; without, that is -1 for all.
template <class D, bool kNumbered = true>
struct Nearest {
  using V = hn::Vec<D>;
  using I = hn::Vec<hn::RebindToSigned<D>>;
  Fraction<V> distance;  // m, infinite where nothing is hit
  I element;             // -1 where nothing is hit

  HWY_INLINE explicit Nearest(D d)
      : distance{hn::Set(d, std::numeric_limits<float>::infinity()), hn::Set(d, 1.0F)},
        element(hn::Set(hn::RebindToSigned<D>(), -1)) {}
  HWY_INLINE Nearest(D d, V metres, I number) : distance{metres, hn::Set(d, 1.0F)}, element(number) {}

  // Takes a hit at a smaller distance; of two at one distance that of the lower element. Distances >= 0.
  HWY_INLINE void take(D d, const Fraction<V>& hit, hn::Mask<D> valid, std::int32_t number) {
    const hn::RebindToSigned<D> di;
    const V left = hn::Mul(hit.num, distance.den);
    const V right = hn::Mul(distance.num, hit.den);
    const I its = hn::Set(di, number);
    auto nearer = hn::Lt(left, right);
    if constexpr (kNumbered) {
      nearer = hn::Or(nearer, hn::And(hn::Eq(left, right), hn::RebindMask(d, hn::Lt(its, element))));
    }
    nearer = hn::And(valid, nearer);
    distance = select(nearer, hit, distance);
    if constexpr (kNumbered) element = hn::IfThenElse(hn::RebindMask(di, nearer), its, element);
  }

  // The surface of a solid, seen from outside and from inside, no nearer than `near` >= 0.
  HWY_INLINE void meet(D d, const IntervalOf<D>& inside, std::int32_t number, V near) {
    const auto valid = hn::And(inside.meets, hn::And(is_ahead(inside.exit, near), hn::Not(is_less(inside.exit, inside.enter))));
    if (hn::AllFalse(d, valid)) return;
    take(d, select(is_ahead(inside.enter, near), inside.enter, inside.exit), valid, number);
  }

  // The same, seen from outside only.
  HWY_INLINE void meet_front(D d, const IntervalOf<D>& inside, std::int32_t number, V near) {
    const auto valid = hn::And(inside.meets, hn::And(is_ahead(inside.enter, near), hn::Not(is_less(inside.exit, inside.enter))));
    if (!hn::AllFalse(d, valid)) take(d, inside.enter, valid, number);
  }

  static HWY_INLINE auto is_ahead(const Fraction<V>& at, V near) { return hn::Ge(at.num, hn::Mul(near, at.den)); }

  // m; inf where nothing is hit.
  HWY_INLINE V metres() const { return hn::Div(distance.num, distance.den); }
};

// The shape met by rays of any origin, in the world frame.
template <class D, class V = hn::Vec<D>>
HWY_INLINE IntervalOf<D> world_interval(D d, const Shape& shape, const Vec3V<V>& origin, const Vec3V<V>& direction) {
  const Vec3V<V> o{hn::Sub(origin.x, hn::Set(d, shape.center[0])), hn::Sub(origin.y, hn::Set(d, shape.center[1])),
                   hn::Sub(origin.z, hn::Set(d, shape.center[2]))};
  if (shape.aligned) return interval(d, shape, o, direction);
  return interval(d, shape, rotate(d, shape.to_local, o), rotate(d, shape.to_local, direction));
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
