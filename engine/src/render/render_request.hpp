// RenderRequest: one picture to take, and where to write it.
#pragma once

#include <cstdint>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/pinhole_camera.hpp"
#include "trace/tracer.hpp"

namespace flockstep::trace {
class Scene;
}

namespace flockstep::render {

class Shading;

// One image of each output, laid out as in CameraImages; null where the camera does not write it.
struct Frame {
  std::uint8_t* rgb = nullptr;
  float* depth = nullptr;
  std::uint16_t* semantic = nullptr;
  std::uint16_t* instance = nullptr;
  float* normal = nullptr;
  std::uint8_t* grey = nullptr;
};

// ITU-R BT.601, rounded.
inline std::uint8_t grey_of(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  return static_cast<std::uint8_t>((299U * r + 587U * g + 114U * b + 500U) / 1000U);
}

struct RenderRequest {
  const World* world;
  const trace::Scene* scene;  // of that world, and
  const Shading* shading;     // its colours: for rendering by rays
  const CameraConfig* camera;
  const PinholeCamera* pinhole;  // the model of that camera, with the field of view that this drone has
  Vec3 position;                 // m, world frame
  Mat3 rotation;                 // camera to world
  Frame frame;
  trace::TracePolicy policy{};
};

}  // namespace flockstep::render
