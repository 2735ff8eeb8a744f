// ShadedMesh: the colours of a mesh of a body, in the mesh's frame, in which the sun moves when the body turns.
#pragma once

#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/body_surface.hpp"
#include "render/raycast/shading.hpp"

namespace flockstep::render {

// Computes a triangle's colours when they are needed, and keeps them until the light or the body's rotation changes.
class ShadedMesh {
 public:
  // surface: of a mesh. world: shading of the world that the body is in.
  ShadedMesh(const BodySurface& surface, const Shading& world);

  // Returns true if it has this mesh in this light; it may have another rotation.
  bool fits(const BodySurface& surface, const Light& light) const;
  bool is_turned(const Mat3& to_local) const { return to_local_ != to_local; }
  // Forgets the colours if the rotation (world to body) is another one.
  void turn(const Mat3& to_local);
  // Makes sure that the colours of these triangles are known, in shade as well if `shadows`.
  void light(std::span<const std::int32_t> triangles, bool shadows);

  const Shading::Tables& tables() const { return tables_; }  // for rays in the mesh's frame

 private:
  std::shared_ptr<const World> world_;
  const Shading* shading_;  // of world_
  Light light_;             // world frame
  Mat3 to_local_ = Mat3::Zero();
  Shading::Tables tables_;
  std::uint32_t generation_ = 0;
  std::vector<std::uint32_t> lit_in_[2];  // by triangle, in the sun and in shade: generation of its colours
  std::vector<std::int32_t> missing_;
};

}  // namespace flockstep::render
