// Enumerations by the names Python has for them. Each throws ValueError naming the field, what was expected and what came.
#pragma once

#include <string>

#include "flockstep/config.hpp"

namespace flockstep::bindings {

CaptureMode capture_mode(const std::string& text);      // "every_step", "on_movement" or "on_demand"
CameraBackend camera_backend(const std::string& text);  // "raycast", "gl" or "auto"

}  // namespace flockstep::bindings
