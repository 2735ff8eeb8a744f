// RenderRequest: one image to render, and its destination.
#pragma once

#include <cstdint>
#include <optional>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/appearance.hpp"
#include "render/camera_optics.hpp"
#include "render/exposure.hpp"
#include "trace/tracer.hpp"

namespace flockstep::trace {
class Scene;
}

namespace flockstep::render {

class Shading;

// One image per output, laid out as in CameraImages; null if the camera does not write it.
struct RenderTargets {
  std::uint8_t* rgb = nullptr;
  float* depth = nullptr;
  std::uint16_t* semantic = nullptr;
  std::uint16_t* instance = nullptr;
  float* normal = nullptr;
  std::uint8_t* grey = nullptr;
};

// Computes grey by ITU-R BT.601, rounded.
inline std::uint8_t grey_of(std::uint8_t r, std::uint8_t g, std::uint8_t b) {
  return static_cast<std::uint8_t>((299U * r + 587U * g + 114U * b + 500U) / 1000U);
}

struct RenderRequest {
  const World* world;
  const trace::Scene* scene;  // scene of that world, for raycast
  const Shading* shading;     // colours of that world, for raycast
  const CameraConfig* camera;
  const CameraOptics* optics;  // optics of that camera, with this drone's field of view
  Vec3 position;               // m, world frame
  Mat3 rotation;               // camera to world
  RenderTargets frame;
  std::uint8_t* centres = nullptr;  // adaptive cameras: planes of r, g, b at the pixels' centres, padded to whole tiles
  trace::TracePolicy policy{};
  VisibleBodies bodies{};              // bodies of the env; their arrays must outlive the rendering
  VisibleBodies drones{};              // the same for the drones that the camera sees
  std::optional<Exposure> exposure{};  // of a camera that takes_time(); it ends at the position and rotation above
};

}  // namespace flockstep::render
