// Normals of solids at points of their surfaces, in the solids' frames. Included once per SIMD target.
#if defined(FLOCKSTEP_TRACE_NORMALS_INL_HPP) == defined(HWY_TARGET_TOGGLE)
#ifdef FLOCKSTEP_TRACE_NORMALS_INL_HPP
#undef FLOCKSTEP_TRACE_NORMALS_INL_HPP
#else
#define FLOCKSTEP_TRACE_NORMALS_INL_HPP
#endif

#include <hwy/highway.h>

#include <limits>

#include "base/wide-inl.hpp"
#include "trace/shape.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

template <class F>
HWY_INLINE Wide3<F> normalised(const Wide3<F>& v) {
  return v / sqrt(dot(v, v));
}

// The face of a box whose plane is nearest: across z, otherwise across y, otherwise across x. A plane has no thickness, so its z
// face is always selected.
template <class F>
struct NearestFace {
  typename F::Mask y_over_x, z_over_xy;
};
template <class F>
HWY_INLINE NearestFace<F> nearest_face(const Shape& box, const Wide3<F>& at) {
  const float* const half = box.half_extents;
  const F outside_x = abs(at.x) - half[0], outside_y = abs(at.y) - half[1];
  const F outside_z = half[2] > 0.0F ? abs(at.z) - half[2] : F(std::numeric_limits<float>::infinity());
  return {outside_y > outside_x, outside_z > max(outside_x, outside_y)};
}

// Returns the outward normal of a curved surface.
template <class F>
HWY_INLINE Wide3<F> outward_normal(const Shape& shape, const Wide3<F>& at) {
  const float radius = shape.half_extents[0], middle = shape.half_extents[2] - radius;
  switch (shape.kind) {
    case ShapeKind::cylinder:
      return {at.x * (1.0F / radius), at.y * (1.0F / radius), 0.0F};
    case ShapeKind::capsule:
      return normalised<F>({at.x, at.y, at.z - min(max(at.z, -middle), middle)});
    default:
      return normalised(at);
  }
}

// Returns where points lie on a cap of a cylinder. Points of the side are `radius` away from the axis, up to rounding.
// r^2 - radius^2 is 2 radius times the rounding error.
template <class F>
HWY_INLINE typename F::Mask is_on_cap(const Shape& cylinder, const Wide3<F>& at) {
  const float radius = cylinder.half_extents[0], half_height = cylinder.half_extents[2];
  const F beyond = at.x * at.x + at.y * at.y - radius * radius;
  const F from_cap = abs(abs(at.z) - half_height);
  return half_height > 0.0F ? from_cap * (2.0F * radius) < abs(beyond) : typename F::Mask(true);
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#endif  // include guard
