// Light::at_hour: the light of a clear day, by the height of the sun.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <numbers>

#include "base/check_fields.hpp"
#include "flockstep/light.hpp"

namespace flockstep {
namespace {

constexpr double kSolarDegree = std::numbers::pi / 180.0;
constexpr double kDefaultHeightDeg = 60.0;  // of the default light's sun
constexpr double kDiscDeg = 0.53;           // width of the sun
constexpr double kTwilightDeg = 6.0;        // below the horizon, where civil twilight ends

// Red, green and blue, at 0.65, 0.55 and 0.45 um. Optical depths of clear air: Rayleigh scattering (Hansen and Travis, 1974), and
// 0.1 of aerosols. What is left of the sky's colours at night.
constexpr std::array kOpticalDepth{0.149, 0.197, 0.321};
constexpr std::array kNightSky{0.04, 0.05, 0.1};

// Returns the way of the sun's light through the air, as a multiple of the vertical one (Kasten and Young, 1989).
double air_mass(double height_deg) {
  return 1.0 / (std::sin(height_deg * kSolarDegree) + 0.50572 * std::pow(height_deg + 6.07995, -1.6364));
}

// Returns the angle of the sun above the equator. The earth moves by 0.98565 degrees a day on an ellipse (eccentricity 0.0167, so
// that 1.914 degrees = 2 e), nearest to the sun on day 2, and its axis leans away from it by 23.44 degrees (sine 0.39779) 10 days
// before the year begins.
double declination(double days) {
  const double mean = 0.98565 * kSolarDegree;
  const double angle = mean * (days + 10.0) + 1.914 * kSolarDegree * std::sin(mean * (days - 2.0));
  return -std::asin(0.39779 * std::cos(angle));
}

}  // namespace

Light Light::at_hour(float hour, float latitude_deg, int day_of_year) {
  check_number(hour, between(0.0, 24.0), "hour");
  check_number(latitude_deg, within(90.0), "latitude_deg");
  check_number(day_of_year, between(1.0, 366.0), "day_of_year");
  // The sun circles the earth's axis, which points to the north, up by the latitude. It is in the meridian at 12.
  const double above_equator = declination(static_cast<double>(day_of_year - 1) + static_cast<double>(hour) / 24.0);
  const double turned = (static_cast<double>(hour) - 12.0) * 15.0 * kSolarDegree;
  const double latitude = static_cast<double>(latitude_deg) * kSolarDegree;
  const double along_axis = std::sin(above_equator), outwards = std::cos(above_equator) * std::cos(turned);
  const double east = -std::cos(above_equator) * std::sin(turned);
  const double north = along_axis * std::cos(latitude) - outwards * std::sin(latitude);
  const double up = along_axis * std::sin(latitude) + outwards * std::cos(latitude);
  const double height_deg = std::asin(std::clamp(up, -1.0, 1.0)) / kSolarDegree;
  const double disc = std::clamp(0.5 + height_deg / kDiscDeg, 0.0, 1.0);  // share that has risen
  const double dark = -std::sin(kTwilightDeg * kSolarDegree), bright = std::sin(kDefaultHeightDeg * kSolarDegree);
  const double daylight = std::clamp((up - dark) / (bright - dark), 0.0, 1.0);

  Light light;
  light.sun_direction = {static_cast<float>(east), static_cast<float>(north), static_cast<float>(up)};
  for (std::size_t c = 0; c < 3; ++c) {
    const double air = disc > 0.0 ? air_mass(height_deg) - air_mass(kDefaultHeightDeg) : 0.0;
    light.sun_color[c] *= static_cast<float>(disc * std::exp(-kOpticalDepth[c] * air));
    const auto sky = static_cast<float>(kNightSky[c] + (1.0 - kNightSky[c]) * daylight);
    for (auto* const color : {&light.sky_ambient, &light.ground_ambient, &light.zenith_color, &light.horizon_color}) {
      (*color)[c] *= sky;
    }
  }
  return light;
}

}  // namespace flockstep
