// BodyModel: a body's configuration in the forms that the stages need.
#pragma once

#include <span>
#include <vector>

#include "bodies/body_script.hpp"
#include "collision/corners.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "render/body_surface.hpp"
#include "trace/scene.hpp"

namespace flockstep::bodies {

struct BodyModel {
  // Throws std::invalid_argument if the configuration is not valid.
  explicit BodyModel(const BodyConfig& config);
  BodyModel(const BodyModel&) = delete;  // `surface` refers to `config`
  BodyModel& operator=(const BodyModel&) = delete;

  BodyConfig config;
  BodyScript script;
  Primitive solid;                                         // kind and half_extents; not for a mesh
  const trace::Scene* mesh = nullptr;                      // of a mesh
  const std::vector<collision::Corners>* parts = nullptr;  // of a mesh
  float radius;                                            // m, of a ball around the position that contains the body
  render::BodySurface surface;
};

// Bodies of a world.
using Models = std::span<const BodyModel>;

// Returns the models of World::bodies(). They are made on first use and kept with the world's other prepared data. Thread-safe.
Models models_of(const World& world);

}  // namespace flockstep::bodies
