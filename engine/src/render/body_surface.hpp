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
};

}  // namespace flockstep::render
