#include "world/drone_doubts.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <sstream>

namespace flockstep {

std::vector<std::string> doubts_about(const DroneModel& drone) {
  constexpr double kMaxThrustToWeight = 20.0;
  constexpr double kSpeedOfSound = 340.0;  // m/s
  std::vector<std::string> doubts;
  if (!drone.airframe()) return doubts;
  const auto check = [&doubts](double got, double most, const std::string& field, const std::string& what,
                               const std::string& hint) {
    std::ostringstream text;
    text << field << ": expected " << what << " of at most " << most << ", got " << got << ": " << hint;
    if (got > most) doubts.push_back(text.str());
  };
  const Airframe& frame = *drone.airframe();
  // No mass within a ball has a larger moment about its centre than the same mass on its surface.
  check(*std::ranges::max_element(frame.inertia_kgm2), frame.mass_kg * std::pow(static_cast<double>(drone.radius()), 2.0),
        "inertia_kgm2", "moments in kg m^2 (mass times squared radius of the hull)",
        "are they in g m^2 (1e-3 kg m^2) or g cm^2 (1e-7)?");
  check(frame.thrust_to_weight(), kMaxThrustToWeight, "rotors max_thrust_n", "a thrust-to-weight",
        "is the thrust in grams (1 g is 0.00981 N) or that of all rotors?");
  // Without a radius, half the distance of two rotors stands for it, which is the largest propeller that fits.
  double radius_m = frame.radius_m;
  if (radius_m == 0.0) {
    const auto& [x, y, z] = frame.position_m[0];
    radius_m = std::numeric_limits<double>::infinity();
    for (std::size_t i = 1; i < frame.position_m.size(); ++i) {
      radius_m = std::min(radius_m, 0.5 * std::hypot(frame.position_m[i][0] - x, frame.position_m[i][1] - y));
    }
  }
  check(frame.max_speed_radps * radius_m, kSpeedOfSound, "rotors max_speed_radps", "propeller tips in m/s",
        "is the speed in rpm (1 rpm is 0.1047 rad/s), or radius_m a diameter?");
  return doubts;
}

}  // namespace flockstep
