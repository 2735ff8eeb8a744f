// GlBody, GlMeshBody: bodies in the form that OpenGL draws.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "flockstep/world.hpp"
#include "render/body_surface.hpp"
#include "render/gl/model.hpp"
#include "render/gl/sun_grid.hpp"

namespace flockstep::render {

struct GlBody {
  RoundKind kind;
  RoundShape shape;
  RoundBound bound;
  SunCaster caster;  // in the sun's frame of the env's world; empty without shadows
};

// A body that is a mesh. Its triangles are drawn as flat geometry in its own frame.
struct GlMeshBody {
  std::uint32_t model;  // number given by GlPainter::add()
  Vec3 position;        // m, world frame
  Mat3 rotation;        // body to world
  float radius;         // m, of the ball around the position that contains it
  std::uint32_t ids;    // as in FlatVertex
  SunCaster caster;     // as in GlBody, without its nodes
};

struct GlBodies {
  std::vector<GlBody> solids;
  std::vector<GlMeshBody> meshes;
};

// Appends the visible bodies or drones of an env. model_of: returns the model of a mesh body's world.
void append_bodies(const VisibleBodies& bodies, const World& world, bool shadows,
                   const std::function<std::uint32_t(const std::shared_ptr<const World>&)>& model_of, GlBodies& out);

}  // namespace flockstep::render
