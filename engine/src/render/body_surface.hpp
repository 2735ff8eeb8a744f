// BodySurface: the appearance of a body in camera images.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

#include "flockstep/body.hpp"
#include "trace/bodies.hpp"

namespace flockstep::render {

class Shading;

struct BodySurface {
  std::array<float, 3> color{};  // base colour, linear RGB; not for meshes
  std::uint16_t semantic = 0;
  // Only for meshes. A backend that keeps data of the world shares its ownership.
  const std::shared_ptr<const World>* mesh = nullptr;
  const Shading* shading = nullptr;  // of that world, for raycast
};

// The bodies or drones of one env as its cameras see them. Number i has the instance id first_instance + i.
struct VisibleBodies {
  trace::Bodies shapes;                   // first_element is set by the renderer
  const BodySurface* surfaces = nullptr;  // (shapes.count,), or one for all if they have a common mesh
  std::uint16_t first_instance = kFirstBodyInstance;

  const BodySurface& surface(std::size_t number) const { return surfaces[shapes.common_mesh == nullptr ? number : 0]; }
  std::uint16_t instance(std::size_t number) const { return static_cast<std::uint16_t>(first_instance + number); }

  // Returns the bodies of one env, if these are the bodies of all envs.
  VisibleBodies of_env(std::size_t env, std::size_t per_env) const {
    return {shapes.of_env(env, per_env), surfaces + env * per_env, first_instance};
  }
  // Returns the drones of one env as one of them sees them, if these are the drones of all envs.
  VisibleBodies seen_by(std::size_t drone, std::size_t per_env) const {
    return {shapes.seen_by(drone, per_env), surfaces, first_instance};
  }
};

}  // namespace flockstep::render
