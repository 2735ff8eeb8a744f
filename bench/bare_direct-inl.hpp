// A lower bound for direct tracing: the minimal code that does the same work. It traces any number of rooms, boxes, cylinders
// and spheres in any orientation. Shapes out of a sensor's range are culled once per sensor, and every ray is tested against
// the rest. It has no tree, batches, elements or meshes. Poses, beams and ranges are plain arrays. Included once per SIMD
// target.
#ifndef FLOCKSTEP_BENCH_BARE_DIRECT_TYPES
#define FLOCKSTEP_BENCH_BARE_DIRECT_TYPES
#include <cstddef>

namespace bench {

enum class Kind { box, cylinder, sphere };  // a room is a box

struct Shape {
  Kind kind;
  bool turned;        // set if to_local is not the identity
  float center[3];    // m
  float half[3];      // m
  float bounds[3];    // m, half sizes of the bounding box
  float to_local[9];  // row-major
};

struct Sensors {
  std::size_t count;
  const float* position;   // (count, 3) m
  const float* rotation;   // (count, 3, 3) rotation from sensor to world
  std::size_t beams;       // beams per sensor
  const float *x, *y, *z;  // (beams,) plus up to 15 for padding, unit vectors in the sensor frame
  float range;             // m
  std::size_t stride;      // ranges per sensor, at least beams + 15
};

}  // namespace bench
#endif

#if defined(FLOCKSTEP_BENCH_BARE_DIRECT_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_BENCH_BARE_DIRECT_INL_HPP
#undef FLOCKSTEP_BENCH_BARE_DIRECT_INL_HPP
#else
#define FLOCKSTEP_BENCH_BARE_DIRECT_INL_HPP
#endif

#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

HWY_BEFORE_NAMESPACE();
namespace bench::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

constexpr hn::CappedTag<float, 16> kFloats;
using V = hn::Vec<decltype(kFloats)>;

HWY_INLINE V set(float x) { return hn::Set(kFloats, x); }

struct Ray {
  V ox, oy, oz, dx, dy, dz;
};

// The nearest hit so far, at distance num / den.
struct Best {
  V num, den;
};

HWY_INLINE void keep(Best& best, V num, V den, hn::Mask<decltype(kFloats)> valid) {
  const auto nearer = hn::And(valid, hn::Lt(hn::Mul(num, best.den), hn::Mul(best.num, den)));
  best.num = hn::IfThenElse(nearer, num, best.num);
  best.den = hn::IfThenElse(nearer, den, best.den);
}

HWY_INLINE void meet_box(const Ray& r, const float* half, Best& best) {
  const V tiny = set(1e-20F);
  V enter = set(-std::numeric_limits<float>::infinity());
  V exit = set(std::numeric_limits<float>::infinity());
  const V o[3] = {r.ox, r.oy, r.oz};
  const V d[3] = {r.dx, r.dy, r.dz};
  for (int i = 0; i < 3; ++i) {
    const V inverse = hn::Div(set(1.0F), hn::CopySign(hn::Max(hn::Abs(d[i]), tiny), d[i]));
    const V a = hn::Mul(hn::Sub(set(-half[i]), o[i]), inverse);
    const V b = hn::Mul(hn::Sub(set(half[i]), o[i]), inverse);
    enter = hn::Max(enter, hn::Min(a, b));
    exit = hn::Min(exit, hn::Max(a, b));
  }
  const V t = hn::IfThenElse(hn::Ge(enter, set(0.0F)), enter, exit);
  keep(best, t, set(1.0F), hn::And(hn::Le(enter, exit), hn::Ge(exit, set(0.0F))));
}

// Intersects rays that start inside a room with the nearest wall ahead.
HWY_INLINE void leave_room(const Ray& r, const float* half, Best& best) {
  const V o[3] = {r.ox, r.oy, r.oz};
  const V d[3] = {r.dx, r.dy, r.dz};
  for (int i = 0; i < 3; ++i) {
    const V along = hn::Xor(o[i], hn::And(d[i], hn::SignBit(kFloats)));
    const V num = hn::Sub(set(half[i]), along);
    const V den = hn::Abs(d[i]);
    const auto nearer = hn::Lt(hn::Mul(num, best.den), hn::Mul(best.num, den));
    best.num = hn::IfThenElse(nearer, num, best.num);
    best.den = hn::IfThenElse(nearer, den, best.den);
  }
}

// Intersects rays that start beside a cylinder with its side.
HWY_INLINE void meet_side(const Ray& r, const float* half, Best& best) {
  const V b = hn::Add(hn::Mul(r.ox, r.dx), hn::Mul(r.oy, r.dy));
  const V a = hn::Add(hn::Mul(r.dx, r.dx), hn::Mul(r.dy, r.dy));
  const V c = hn::Sub(hn::Mul(r.ox, r.dy), hn::Mul(r.oy, r.dx));
  const V square = hn::Sub(hn::Mul(set(half[0] * half[0]), a), hn::Mul(c, c));
  const auto hit = hn::And(hn::Ge(square, set(0.0F)), hn::Lt(b, set(0.0F)));
  if (hn::AllFalse(kFloats, hit)) return;
  const V enter = hn::Sub(hn::Neg(b), hn::Sqrt(hn::Max(square, set(0.0F))));
  const V height = hn::Add(hn::Mul(r.oz, a), hn::Mul(enter, r.dz));
  keep(best, enter, a, hn::And(hit, hn::Le(hn::Abs(height), hn::Mul(set(half[2]), a))));
}

// Finds the first root of a t^2 + 2 b t + c that is not behind the ray, using the distance of the line from the centre.
HWY_INLINE void meet_round(const Ray& r, const Shape& shape, Best& best) {
  const bool sphere = shape.kind == Kind::sphere;
  const float radius = shape.half[0];
  const V z = sphere ? r.oz : set(0.0F);
  const V w = sphere ? r.dz : set(0.0F);
  const V b = hn::Add(hn::Add(hn::Mul(r.ox, r.dx), hn::Mul(r.oy, r.dy)), hn::Mul(z, w));
  const V a = hn::Add(hn::Add(hn::Mul(r.dx, r.dx), hn::Mul(r.dy, r.dy)), hn::Mul(w, w));
  const V cx = hn::Sub(hn::Mul(r.oy, w), hn::Mul(z, r.dy));
  const V cy = hn::Sub(hn::Mul(z, r.dx), hn::Mul(r.ox, w));
  const V cz = hn::Sub(hn::Mul(r.ox, r.dy), hn::Mul(r.oy, r.dx));
  V square = hn::Sub(hn::Mul(set(radius * radius), a), hn::Mul(cz, cz));
  if (sphere) square = hn::Sub(square, hn::Add(hn::Mul(cx, cx), hn::Mul(cy, cy)));
  const auto hit = hn::And(hn::Ge(square, set(0.0F)), hn::Or(hn::Lt(b, set(0.0F)), hn::Ge(square, hn::Mul(b, b))));
  if (hn::AllFalse(kFloats, hit)) return;
  const V root = hn::Sqrt(hn::Max(square, set(0.0F)));
  V enter = hn::Sub(hn::Neg(b), root);
  V exit = hn::Sub(root, b);
  if (!sphere) {  // clip to the slab between the caps, in units of 1 / a
    const V inverse = hn::Div(a, hn::CopySign(hn::Max(hn::Abs(r.dz), set(1e-20F)), r.dz));
    const V low = hn::Mul(hn::Sub(set(-shape.half[2]), r.oz), inverse);
    const V high = hn::Mul(hn::Sub(set(shape.half[2]), r.oz), inverse);
    enter = hn::Max(enter, hn::Min(low, high));
    exit = hn::Min(exit, hn::Max(low, high));
  }
  const V t = hn::IfThenElse(hn::Ge(enter, set(0.0F)), enter, exit);
  keep(best, t, a, hn::And(hit, hn::And(hn::Le(enter, exit), hn::Ge(exit, set(0.0F)))));
}

HWY_INLINE V row(const float* m, V x, V y, V z) {
  return hn::Add(hn::Add(hn::Mul(set(m[0]), x), hn::Mul(set(m[1]), y)), hn::Mul(set(m[2]), z));
}

void scan(const Sensors& sensors, const std::vector<Shape>& shapes, float* ranges) {
  struct Near {
    const Shape* shape;
    float o[3];  // in the shape's frame
    enum { anywhere, in_room, beside } place;
  };
  Near near[64];
  for (std::size_t s = 0; s < sensors.count; ++s) {
    const float* const p = sensors.position + 3 * s;
    const float* const m = sensors.rotation + 9 * s;
    std::size_t count = 0;
    for (const Shape& shape : shapes) {
      float square = 0.0F;
      for (int i = 0; i < 3; ++i) {
        const float outside = std::max(std::abs(p[i] - shape.center[i]) - shape.bounds[i], 0.0F);
        square += outside * outside;
      }
      if (square > sensors.range * sensors.range) continue;
      Near& n = near[count++];
      n.shape = &shape;
      const float offset[3] = {p[0] - shape.center[0], p[1] - shape.center[1], p[2] - shape.center[2]};
      for (int i = 0; i < 3; ++i) {
        const float* const q = shape.to_local + 3 * i;
        n.o[i] = shape.turned ? q[0] * offset[0] + q[1] * offset[1] + q[2] * offset[2] : offset[i];
      }
      const auto within = [&](int i) { return std::abs(n.o[i]) <= shape.half[i]; };
      n.place = Near::anywhere;
      if (shape.kind == Kind::box && within(0) && within(1) && within(2)) n.place = Near::in_room;
      if (shape.kind == Kind::cylinder && within(2) && n.o[0] * n.o[0] + n.o[1] * n.o[1] > shape.half[0] * shape.half[0]) {
        n.place = Near::beside;
      }
    }
    float* const out = ranges + s * sensors.stride;
    for (std::size_t i = 0; i < sensors.beams; i += hn::Lanes(kFloats)) {
      const V x = hn::LoadU(kFloats, sensors.x + i);
      const V y = hn::LoadU(kFloats, sensors.y + i);
      const V z = hn::LoadU(kFloats, sensors.z + i);
      const V dx = row(m, x, y, z);
      const V dy = row(m + 3, x, y, z);
      const V dz = row(m + 6, x, y, z);
      Best best{set(std::numeric_limits<float>::infinity()), set(1.0F)};
      for (std::size_t k = 0; k < count; ++k) {
        const Shape& shape = *near[k].shape;
        Ray ray{set(near[k].o[0]), set(near[k].o[1]), set(near[k].o[2]), dx, dy, dz};
        if (shape.turned) {
          const float* const q = shape.to_local;
          ray.dx = row(q, dx, dy, dz);
          ray.dy = row(q + 3, dx, dy, dz);
          ray.dz = row(q + 6, dx, dy, dz);
        }
        if (near[k].place == Near::in_room) {
          leave_room(ray, shape.half, best);
        } else if (near[k].place == Near::beside) {
          meet_side(ray, shape.half, best);
        } else if (shape.kind == Kind::box) {
          meet_box(ray, shape.half, best);
        } else {
          meet_round(ray, shape, best);
        }
      }
      const V t = hn::Div(best.num, best.den);
      hn::StoreU(hn::IfThenElse(hn::Le(t, set(sensors.range)), t, set(std::numeric_limits<float>::infinity())), kFloats, out + i);
    }
  }
}

}  // namespace bench::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
