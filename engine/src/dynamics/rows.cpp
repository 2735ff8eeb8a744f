#include "dynamics/lane_group.hpp"
#include "flockstep/limits.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "dynamics/rows.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "dynamics/lanes-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::dynamics::HWY_NAMESPACE {

void load_3(const float* rows, Lanes<3>& lanes) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) store3(V3::load_rows(rows + 3 * lane), lanes, lane);
}

void load_4(const float* rows, Lane* lanes) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    const Q q = load_rows4(rows + 4 * lane);
    store(q.w, lanes[0], lane);
    store(q.x, lanes[1], lane);
    store(q.y, lanes[2], lane);
    store(q.z, lanes[3], lane);
  }
}

void store_3(const Lanes<3>& lanes, float* rows) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) load3(lanes, lane).store_rows(rows + 3 * lane);
}

void store_4(const Lane* lanes, float* rows) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    store_rows4({load(lanes[0], lane), load(lanes[1], lane), load(lanes[2], lane), load(lanes[3], lane)}, rows + 4 * lane);
  }
}

// Sum with exact remainder: D. E. Knuth, "The Art of Computer Programming", volume 2, 4.2.2.
void update_position(Flock& flock) {
  for (std::size_t lane = 0; lane < kLanes; lane += F::kCount) {
    F is_good = load(flock.is_good, lane);
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const F a = load(flock.origin[axis], lane), b = load(flock.travelled[axis], lane);
      const F s = a + b;
      const F part = s - a;
      store(s, flock.position[axis], lane);
      store((a - (s - part)) + (b - part), flock.remainder[axis], lane);
      is_good = select(abs(s) <= static_cast<float>(kMaxCoordinate), is_good, 0.0F);  // false for NaN
    }
    store(is_good, flock.is_good, lane);
  }
}

}  // namespace flockstep::dynamics::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::dynamics {

HWY_EXPORT(load_3);
HWY_EXPORT(load_4);
HWY_EXPORT(store_3);
HWY_EXPORT(store_4);
HWY_EXPORT(update_position);

void load_rows(const float* rows, Lanes<3>& lanes) { HWY_DYNAMIC_DISPATCH(load_3)(rows, lanes); }
void load_rows4(const float* rows, Lane* lanes) { HWY_DYNAMIC_DISPATCH(load_4)(rows, lanes); }
void store_rows(const Lanes<3>& lanes, float* rows) { HWY_DYNAMIC_DISPATCH(store_3)(lanes, rows); }
void store_rows4(const Lane* lanes, float* rows) { HWY_DYNAMIC_DISPATCH(store_4)(lanes, rows); }
void update_position(Flock& flock) { HWY_DYNAMIC_DISPATCH(update_position)(flock); }

}  // namespace flockstep::dynamics
#endif
