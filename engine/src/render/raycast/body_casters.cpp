#include "render/raycast/body_casters.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

namespace flockstep::render {

void BodyCasters::begin(const trace::Bodies& bodies, const trace::Bodies& drones, const Vec3& to_sun) {
  to_sun_ = to_sun;
  casters_.clear();
  meshes_.clear();
  trace::append_shapes(bodies, casters_);
  trace::append_meshes(bodies, meshes_);
  trace::append_meshes(drones, meshes_);
  above_.reserve(casters_.size());
  meshes_above_.reserve(meshes_.size());
}

// The shadow reaches the box if a ray from the box's centre to the sun hits the caster's bounding box, widened by the box.
bool BodyCasters::reaches(const Vec3& offset, const Vec3& half) const {
  float enter = 0.0F;
  float leave = std::numeric_limits<float>::max();
  for (Eigen::Index axis = 0; axis < 3; ++axis) {
    if (to_sun_[axis] == 0.0F) {
      if (std::abs(offset[axis]) > half[axis]) leave = -1.0F;
      continue;
    }
    const float low = (offset[axis] - half[axis]) / to_sun_[axis];
    const float high = (offset[axis] + half[axis]) / to_sun_[axis];
    enter = std::max(enter, std::min(low, high));
    leave = std::min(leave, std::max(low, high));
  }
  return enter <= leave;
}

std::span<const trace::NumberedShape> BodyCasters::above(const Aabb& box) {
  above_.clear();
  const Vec3 center = 0.5F * (box.min + box.max), half = 0.5F * (box.max - box.min);
  for (const trace::NumberedShape& caster : casters_) {
    if (reaches(caster.shape.box_center - center, caster.shape.box_half + half)) above_.push_back(caster);
  }
  return above_;
}

std::span<const trace::PosedMesh> BodyCasters::meshes_above(const Aabb& box) {
  meshes_above_.clear();
  const Vec3 center = 0.5F * (box.min + box.max), half = 0.5F * (box.max - box.min);
  for (const trace::PosedMesh& mesh : meshes_) {
    const Vec3 reach = Vec3::Constant(mesh.radius * 1.0001F + 1e-5F * (1.0F + mesh.position.cwiseAbs().maxCoeff()));
    if (reaches(mesh.position - center, reach + half)) meshes_above_.push_back(mesh);
  }
  return meshes_above_;
}

}  // namespace flockstep::render
