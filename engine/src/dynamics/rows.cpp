#include "dynamics/rows.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dynamics/rows.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {

void load_rows3(const float* rows, Lanes<3>& lanes) {
  const D d;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    V3 v;
    hn::LoadInterleaved3(d, rows + 3 * lane, v.x.v, v.y.v, v.z.v);
    store3(v, lanes, lane);
  }
}

void load_rows4(const float* rows, Lanes<4>& lanes) {
  const D d;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    Q q;
    hn::LoadInterleaved4(d, rows + 4 * lane, q.w.v, q.x.v, q.y.v, q.z.v);
    store_rotation(q, lanes, lane);
  }
}

void store_rows3(const Lanes<3>& lanes, float* rows) {
  const D d;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const V3 v = load3(lanes, lane);
    hn::StoreInterleaved3(v.x.v, v.y.v, v.z.v, d, rows + 3 * lane);
  }
}

void store_rows4(const Lanes<4>& lanes, float* rows) {
  const D d;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    const Q q = load_rotation(lanes, lane);
    hn::StoreInterleaved4(q.w.v, q.x.v, q.y.v, q.z.v, d, rows + 4 * lane);
  }
}

// D. E. Knuth, "The Art of Computer Programming", volume 2, 4.2.2: the remainder is exact.
void update_position(Flock& flock) {
  const D d;
  for (std::size_t lane = 0; lane < kLanes; lane += hn::Lanes(d)) {
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const F a = load(flock.origin[axis], lane), b = load(flock.travelled[axis], lane);
      const F s = a + b;
      const F part = s - a;
      store(s, flock.position[axis], lane);
      store((a - (s - part)) + (b - part), flock.remainder[axis], lane);
    }
  }
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::dynamics {

HWY_EXPORT(load_rows3);
HWY_EXPORT(load_rows4);
HWY_EXPORT(store_rows3);
HWY_EXPORT(store_rows4);
HWY_EXPORT(update_position);

void load_rows(const float* rows, Lanes<3>& lanes) { HWY_DYNAMIC_DISPATCH(load_rows3)(rows, lanes); }
void load_rows(const float* rows, Lanes<4>& lanes) { HWY_DYNAMIC_DISPATCH(load_rows4)(rows, lanes); }
void store_rows(const Lanes<3>& lanes, float* rows) { HWY_DYNAMIC_DISPATCH(store_rows3)(lanes, rows); }
void store_rows(const Lanes<4>& lanes, float* rows) { HWY_DYNAMIC_DISPATCH(store_rows4)(lanes, rows); }
void update_position(Flock& flock) { HWY_DYNAMIC_DISPATCH(update_position)(flock); }

}  // namespace flockstep::dynamics
#endif
