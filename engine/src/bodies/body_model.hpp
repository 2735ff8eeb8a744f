// BodyModel: a body's configuration in the forms that the stages need.
#pragma once

#include <span>
#include <string>
#include <vector>

#include "bodies/body_script.hpp"
#include "collision/convex.hpp"
#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "render/appearance.hpp"
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
  const trace::Scene* mesh = nullptr;                      // only for a mesh
  const std::vector<collision::Corners>* parts = nullptr;  // only for a mesh
  float radius;                                            // m, of a ball around the position that contains the body
  render::BodySurface surface;
};

// Bodies of a world.
using Models = std::span<const BodyModel>;

// Returns the models of World::bodies(). They are made on first use and kept with the world's other prepared data. Thread-safe.
Models models_of(const World& world);

}  // namespace flockstep::bodies

namespace flockstep {

// Checks a world whose triangles are the mesh of a body or a drone. Throws std::invalid_argument that names the field unless the
// world has triangles, and neither primitives nor bodies.
void require_mesh(const World& world, const std::string& field);

}  // namespace flockstep
