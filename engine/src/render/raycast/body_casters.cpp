#include "render/raycast/body_casters.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flockstep::render {

void BodyCasters::begin(const trace::Bodies& bodies, const Vec3& to_sun) {
  to_sun_ = to_sun;
  trace::make_shapes(bodies, casters_);
  above_.reserve(casters_.size());
}

std::span<const trace::NumberedShape> BodyCasters::above(const Aabb& box) {
  above_.clear();
  const Vec3 center = 0.5F * (box.min + box.max);
  const Vec3 half = 0.5F * (box.max - box.min);
  for (const trace::NumberedShape& caster : casters_) {
    // The shadow reaches the box if a ray from the box's centre to the sun hits the caster's bounding box, widened by the box.
    const Vec3 offset = caster.shape.box_center - center;
    const Vec3 reach = caster.shape.box_half + half;
    float enter = 0.0F;
    float leave = std::numeric_limits<float>::max();
    for (Eigen::Index axis = 0; axis < 3; ++axis) {
      if (to_sun_[axis] == 0.0F) {
        if (std::abs(offset[axis]) > reach[axis]) leave = -1.0F;
        continue;
      }
      const float low = (offset[axis] - reach[axis]) / to_sun_[axis];
      const float high = (offset[axis] + reach[axis]) / to_sun_[axis];
      enter = std::max(enter, std::min(low, high));
      leave = std::min(leave, std::max(low, high));
    }
    if (enter <= leave) above_.push_back(caster);
  }
  return above_;
}

}  // namespace flockstep::render
