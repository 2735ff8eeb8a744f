// ShadedBodies: the bodies and drones of one frame in the form that the shading kernels need.
#pragma once

#include <algorithm>
#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/appearance.hpp"
#include "render/raycast/shading.hpp"
#include "trace/bodies.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace flockstep::render {

// ShadedMesh: the colours of a mesh of a body, in the mesh's frame, in which the sun moves when the body turns.
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
  const Shading* shading_;  // world_'s
  Light light_;             // world frame
  Mat3 to_local_ = Mat3::Zero();
  Shading::Tables tables_;
  std::uint32_t generation_ = 0;
  std::vector<std::uint32_t> lit_in_[2];  // by triangle, in the sun and in shade: generation of its colours
  std::vector<std::int32_t> missing_;
};

// Each thread needs its own. A body is computed when the first ray of the frame hits it. Drones are numbered after the bodies.
class ShadedBodies {
 public:
  // Begins a frame. The arguments must outlive it. Allocates only if there are more bodies than ever before.
  void begin(const VisibleBodies& bodies, const VisibleBodies& drones, const Shading& shading);
  bool is_mesh(std::size_t number) const { return of(number).surface(number_among(number)).shading != nullptr; }
  // Returns body `number`, which is no mesh; the reference is valid until the next begin().
  const ShadedSolid& at(std::size_t number) {
    Body& body = shaded_[number];
    if (body.frame != frame_) shade(number, body);
    return body.solid;
  }

  struct Mesh {
    ShadedMesh* shaded;  // valid until the next begin()
    trace::PosedMesh posed;
    Surface surface;  // semantic and instance
  };
  // Returns body `number`, which is a mesh.
  Mesh mesh_at(std::size_t number);
  // Computes the colours of the mesh's triangles that the rays of a tile hit. element: of the body.
  void light(const Mesh& mesh, std::int32_t element, const trace::RayBundle& rays, const trace::HitDetails& details,
             bool shadows);
  // The meshes that a tile shows, each once.
  void see_mesh(std::int32_t number) {
    if (std::find(seen_meshes_.begin(), seen_meshes_.end(), number) == seen_meshes_.end()) seen_meshes_.push_back(number);
  }
  std::span<const std::int32_t> take_seen_meshes() {
    taken_meshes_.swap(seen_meshes_);
    seen_meshes_.clear();
    return taken_meshes_;
  }

 private:
  // A mesh in one light and rotation. Its colours are kept, because many envs and frames share them.
  struct KeptMesh {
    std::unique_ptr<ShadedMesh> shaded;
    std::uint64_t frame = 0;  // frame of the last use
  };
  struct Body {
    trace::Shape shape;
    ShadedSolid solid;
    std::uint64_t frame = 0;  // frame for which it was computed
  };
  // A ramp and what it depends on. Computing one takes longer than a body, and bodies share colours.
  struct Ramp {
    std::array<float, 3> color{};
    Light light;
    bool is_fine = false;
    std::uint64_t frame = 0;  // frame of the last use; 0: never
    Shading::Ramp entries{};
  };

  bool is_drone(std::size_t number) const { return number >= bodies_.shapes.count; }
  const VisibleBodies& of(std::size_t number) const { return is_drone(number) ? drones_ : bodies_; }
  std::size_t number_among(std::size_t number) const { return is_drone(number) ? number - bodies_.shapes.count : number; }
  void shade(std::size_t number, Body& body);
  const std::int32_t* find_ramp(const Surface& surface);  // null if the ramp would be too coarse

  const Shading* shading_ = nullptr;
  VisibleBodies bodies_, drones_;
  std::uint64_t frame_ = 0;
  std::vector<Body> shaded_;  // by number
  std::vector<std::unique_ptr<Ramp>> ramps_;
  std::vector<KeptMesh> meshes_;
  std::vector<std::int32_t> seen_meshes_, taken_meshes_, triangles_;
};

// Casters: what casts shadows in one frame, except the triangles of the world, and its primitives if they are many.
// Each thread needs its own.
class Casters {
 public:
  static constexpr std::size_t kMaxListed = 64;  // primitives of the world; Embree's tree finds more of them sooner

  // Begins a frame. Allocates only if there are more casters than ever before. room: of the world, may be null. primitives: of
  // the world, without rooms.
  void begin(const trace::Shape* room, std::span<const trace::NumberedShape> primitives, const trace::Bodies& bodies,
             const trace::Bodies& drones);
  bool lists_primitives() const { return lists_primitives_; }

  // Directions of rays: differ from `axis` by at most `spread`. No axis: finds what is in the box itself, with the room, which
  // casts no shadow of the sun.
  struct Beam {
    Vec3 axis = Vec3::Zero();
    float spread = 0.0F;
  };
  // Return at least those casters that rays from the box can hit, valid until the next call.
  std::span<const trace::NumberedShape> above(const Aabb& box, const Beam& beam);
  std::span<const trace::PosedMesh> meshes_above(const Aabb& box, const Beam& beam);

 private:
  bool lists_primitives_ = false;
  const trace::Shape* room_ = nullptr;
  std::vector<trace::NumberedShape> casters_, above_;
  std::vector<trace::PosedMesh> meshes_, meshes_above_;
};

}  // namespace flockstep::render
