#include "trace/bodies.hpp"

#include <algorithm>
#include <bit>

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/bodies.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;

constexpr float kSearchRounding = 1e-5F;  // fraction of distances, by which the search goes farther

// Writes the numbers of the bodies within range_m of the origin, and returns how many there are.
std::size_t find_near(const Bodies& bodies, const Vec3& origin, float range_m, std::uint32_t* found) {
  using F = WideUpTo<16>;
  const Wide3<F> from{origin.x(), origin.y(), origin.z()};
  std::size_t count = 0;
  for (std::size_t i = 0; i < bodies.count; i += F::kCount) {
    const std::size_t here = std::min(F::kCount, bodies.count - i);
    const bool is_last = i + F::kCount > bodies.readable;  // of the whole arrays
    float rows[3 * F::kCount] = {}, radii[F::kCount] = {};
    if (is_last) {
      std::copy_n(bodies.position + 3 * i, 3 * here, rows);
      std::copy_n(bodies.radius + i, here, radii);
    }
    const Wide3<F> away = Wide3<F>::load_rows(is_last ? rows : bodies.position + 3 * i) - from;
    const F radius = F::load_unaligned(is_last ? radii : bodies.radius + i);
    const F reach = (radius + range_m) * (1.0F + kSearchRounding);
    std::uint32_t near = bits((dot(away, away) <= reach * reach) & (radius >= 0.0F)) & ((1U << here) - 1U);
    for (; near != 0; near &= near - 1) {
      found[count++] = static_cast<std::uint32_t>(i) + static_cast<std::uint32_t>(std::countr_zero(near));
    }
  }
  return count;
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(find_near);

namespace {

Shape shape_of(const Bodies& bodies, std::size_t number) {
  Primitive solid = bodies.solids[number];
  const float* const p = bodies.position + 3 * number;
  const float* const q = bodies.quat_wxyz + 4 * number;
  solid.center = {p[0], p[1], p[2]};
  if (solid.kind != PrimitiveKind::sphere) solid.rotation = Quat(q[0], q[1], q[2], q[3]);  // a turned one is the same
  return make_shape(solid);
}

}  // namespace

void make_shapes(const Bodies& bodies, std::vector<NumberedShape>& shapes) {
  shapes.clear();
  shapes.reserve(bodies.count);
  for (std::size_t i = 0; i < bodies.count; ++i) {
    if (bodies.radius[i] >= 0.0F) shapes.push_back({shape_of(bodies, i), bodies.first_element + static_cast<std::int32_t>(i)});
  }
}

void NearBodies::gather(const Bodies& bodies, const Vec3& origin, float near_m, float range_m) {
  shapes_.clear();
  candidates_.clear();
  if (bodies.count == 0) return;
  if (found_.size() < bodies.count) {
    found_.resize(bodies.count);
    shapes_.reserve(bodies.count);
    candidates_.reserve(bodies.count);
  }
  const std::size_t count = HWY_DYNAMIC_DISPATCH(find_near)(bodies, origin, range_m, found_.data());
  for (const std::uint32_t number : std::span(found_).first(count)) {
    shapes_.push_back(shape_of(bodies, number));
    candidates_.push_back(make_candidate(shapes_.back(), bodies.first_element + static_cast<std::int32_t>(number), origin));
    candidates_.back().hint = hint_at_solid(shapes_.back(), candidates_.back().local_origin, near_m);
  }
}

}  // namespace flockstep::trace
#endif
