// BodyModel: a body's configuration in the forms that the stages need.
#pragma once

#include "bodies/body_script.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "render/body_surface.hpp"

namespace flockstep::bodies {

struct BodyModel {
  // Throws std::invalid_argument if the configuration is not valid.
  explicit BodyModel(const BodyConfig& config);

  BodyConfig config;
  BodyScript script;
  Primitive solid;  // kind and half_extents
  float radius;     // m, of a ball around the position that contains the body
  render::BodySurface surface;
};

}  // namespace flockstep::bodies
