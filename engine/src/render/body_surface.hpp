// BodySurface: the appearance of a body in camera images.
#pragma once

#include <array>
#include <cstdint>

#include "trace/bodies.hpp"

namespace flockstep::render {

struct BodySurface {
  std::array<float, 3> color{};  // base colour, linear RGB
  std::uint16_t semantic = 0;
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
