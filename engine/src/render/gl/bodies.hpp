// GlBody: a body in the form that OpenGL draws.
#pragma once

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

// Appends the visible bodies of an env.
void append_bodies(const VisibleBodies& bodies, const World& world, bool shadows, std::vector<GlBody>& out);

}  // namespace flockstep::render
