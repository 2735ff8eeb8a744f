// BodySurface: the appearance of a body in camera images.
#pragma once

#include <array>
#include <cstdint>
#include <memory>

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

// The bodies of one env as its cameras see them. Body b has the instance id kFirstBodyInstance + b.
struct VisibleBodies {
  trace::Bodies shapes;                   // first_element is set by the renderer
  const BodySurface* surfaces = nullptr;  // (shapes.count,)

  // Returns the bodies of one env, if these are the bodies of all envs.
  VisibleBodies of_env(std::size_t env, std::size_t per_env) const {
    return {shapes.of_env(env, per_env), surfaces + env * per_env};
  }
};

}  // namespace flockstep::render
