#include <cmath>
#include <numbers>
#include <string>
#include <utility>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "flockstep/camera.hpp"

namespace flockstep {
namespace {

// Returns the focal length in pixels for a side with this many pixels.
float focal_length(int pixels, float fov_deg) {
  return static_cast<float>(0.5 * pixels / std::tan(0.5 * static_cast<double>(fov_deg) * std::numbers::pi / 180.0));
}

}  // namespace

float CameraConfig::fx() const { return hfov_deg || !vfov_deg ? focal_length(width_px, hfov_deg.value_or(90.0F)) : fy(); }

float CameraConfig::fy() const { return vfov_deg ? focal_length(height_px, *vfov_deg) : fx(); }

void CameraConfig::validate() const {
  check_fields(*this, "camera.");
  // Checks both fields of view, since one may be derived from the other.
  for (const float slope : {0.5F * static_cast<float>(width_px) / fx(), 0.5F * static_cast<float>(height_px) / fy()}) {
    require(slope < 115.0F, hfov_deg ? "camera.hfov_deg" : "camera.vfov_deg",
            "an angle that keeps the other below 179 degrees (pixels are square)",
            hfov_deg ? *hfov_deg : vfov_deg.value_or(90.0F));
  }
  require(far_m > near_m, "camera.far_m", "a number > near_m (" + std::to_string(near_m) + ")", far_m);
  bool any = false;
  for_each_field(outputs, [&](const auto&, bool chosen) { any = any || chosen; });
  require(any, "camera.outputs", "at least one of rgb, depth, semantic, instance, normal, grey, hsv", "none");
  if (!resize) {
    require(pool == Pool::mean, "camera.pool", "\"mean\" without resize (set resize=(width, height) of the images)",
            std::string("\"") + EnumNames<Pool>::kNames[static_cast<std::size_t>(pool)] + '"');
    return;
  }
  const std::string size = "(" + std::to_string((*resize)[0]) + ", " + std::to_string((*resize)[1]) + ")";
  require((*resize)[0] >= 1 && (*resize)[0] <= width_px && (*resize)[1] >= 1 && (*resize)[1] <= height_px, "camera.resize",
          "width and height in [1, " + std::to_string(width_px) + "] and [1, " + std::to_string(height_px) + "]", size);
  for (const auto& [output, chosen] :
       {std::pair("semantic", outputs.semantic), std::pair("instance", outputs.instance), std::pair("normal", outputs.normal)}) {
    require(!chosen, "camera.resize",
            std::string("None with the output ") + output + " (ids and directions cannot be averaged: use a second camera)",
            size);
  }
}

}  // namespace flockstep
