// BodyCasters: the bodies and drones of one frame as casters of shadows.
#pragma once

#include <cstddef>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "trace/bodies.hpp"
#include "trace/posed_mesh.hpp"
#include "trace/shape.hpp"

namespace flockstep::render {

// Each thread needs its own.
class BodyCasters {
 public:
  // Begins a frame. Allocates only if there are more bodies than ever before.
  void begin(const trace::Bodies& bodies, const trace::Bodies& drones, const Vec3& to_sun);
  bool empty() const { return casters_.empty() && meshes_.empty(); }
  // Return at least those casters whose shadow reaches into the box, valid until the next call.
  std::span<const trace::NumberedShape> above(const Aabb& box);
  std::span<const trace::PosedMesh> meshes_above(const Aabb& box);

 private:
  // Returns whether the shadow of something in a box reaches into another box. half: of both together.
  bool reaches(const Vec3& offset, const Vec3& half) const;

  Vec3 to_sun_ = Vec3::UnitZ();
  std::vector<trace::NumberedShape> casters_, above_;
  std::vector<trace::PosedMesh> meshes_, meshes_above_;
};

}  // namespace flockstep::render
