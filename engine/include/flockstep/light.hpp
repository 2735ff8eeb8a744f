// Light: sun, sky and fog of camera images.
#pragma once

#include <array>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/limits.hpp"

namespace flockstep {

// Colours are linear RGB.
//
// A surface with unit normal n and base colour c has the colour c * (sun_color * max(0, n . sun_direction) +
// lerp(ground_ambient, sky_ambient, (1 + n.z) / 2)) plus its emission. The sky in unit direction d has the colour
// lerp(horizon_color, zenith_color, max(0, d.z)). A value v is written as 255 * min(v, 1)^(1 / gamma), rounded.
//
// The sun is drawn if sun_radius_deg or sun_glow is not 0. With q = |d - sun_direction|^2 and r = 2 sin(sun_radius_deg / 2),
// the sky is then lerp(sky, s, max(disc, sun_glow / (1 + 100 q))), with disc = clamp((r^2 - q) / (0.19 r^2), 0, 1) and s =
// sun_color over its largest channel. The outer tenth of the disc's radius is its soft border.
//
// Fog lies everywhere if fog_visibility_m is not 0. A surface of colour v at distance t in direction d then has the colour
// lerp(sky, v, exp(-3.9 t / fog_visibility_m)), where sky is the colour of the sky in direction d without the sun.
struct Light {
  std::array<float, 3> sun_direction{0.4F, 0.3F, 0.8660254F};  // unit in a World
  std::array<float, 3> sun_color{0.45F, 0.43F, 0.4F};
  std::array<float, 3> sky_ambient{0.6F, 0.62F, 0.65F};
  std::array<float, 3> ground_ambient{0.48F, 0.47F, 0.46F};
  std::array<float, 3> zenith_color{0.16F, 0.36F, 0.72F};
  std::array<float, 3> horizon_color{0.68F, 0.78F, 0.88F};
  float gamma = 2.2F;
  float sun_radius_deg = 0.0F;
  float sun_glow = 0.0F;
  float fog_visibility_m = 0.0F;

  static constexpr Limits kBrightness = between(0.0, 100.0);  // brighter than images can show, and far from overflow

  static constexpr auto fields() {
    using C = Light;
    return field_list(
        field("sun_direction", &C::sun_direction,
              {.about = "Direction towards the sun, of any length.", .limits = within(kMaxCoordinate), .form = Form::direction}),
        field("sun_color", &C::sun_color, {.about = "Linear RGB of the sun's light.", .limits = kBrightness}),
        field("sky_ambient", &C::sky_ambient, {.about = "Linear RGB of the light from above.", .limits = kBrightness}),
        field("ground_ambient", &C::ground_ambient, {.about = "Linear RGB of the light from below.", .limits = kBrightness}),
        field("zenith_color", &C::zenith_color, {.about = "Linear RGB of the sky straight up.", .limits = kBrightness}),
        field("horizon_color", &C::horizon_color,
              {.about = "Linear RGB of the sky at the horizon and below.", .limits = kBrightness}),
        field("gamma", &C::gamma, {.about = "A value v is written as 255 * min(v, 1)^(1 / gamma).", .limits = between(1.0, 4.0)}),
        field("sun_radius_deg", &C::sun_radius_deg,
              {.about = "Radius of the sun's disc. 0: no disc. The real sun's is 0.27.",
               .unit = "deg",
               .limits = zero_or_between(0.1, 45.0)}),  // float32 directions can resolve 0.1
        field("sun_glow", &C::sun_glow,
              {.about = "Share of the sun's colour in the sky next to it. It falls to half at 5.7 degrees.",
               .limits = between(0.0, 1.0)}),
        field("fog_visibility_m", &C::fog_visibility_m,
              {.about = "Distance at which fog leaves 2 % of a surface's contrast to the sky. 0: no fog.",
               .unit = "m",
               .limits = zero_or_between(0.1, 1e6)}));
  }

  // Returns the light of a clear day or night, in the world frame. It is the default light while the sun is 60 degrees high, and
  // redder and darker below. hour: solar time in [0, 24], 12 when the sun is highest. latitude_deg: in [-90, 90], positive in the
  // north. day_of_year: in [1, 366]; 172 is the longest day of the north. Throws std::invalid_argument that names the argument.
  FLOCKSTEP_API static Light at_hour(float hour, float latitude_deg = 48.0F, int day_of_year = 172);

  bool operator==(const Light&) const = default;

  FLOCKSTEP_API void validate() const;
};

}  // namespace flockstep
