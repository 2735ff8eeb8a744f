#include "flockstep/airframe.hpp"

#include <Eigen/Dense>
#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "base/check_fields.hpp"
#include "base/require.hpp"

namespace flockstep {
namespace {

constexpr double kMinLever = 0.01;  // least scaled determinant of the allocation

using Triple = Airframe::Triple;

std::string numbered(const char* field, std::size_t i) { return std::string(field) + '[' + std::to_string(i) + ']'; }

std::string text_of(const Triple& values) {
  std::ostringstream text;
  text << values[0] << ", " << values[1] << ", " << values[2];
  return text.str();
}

// Maps rotor thrusts to total thrust, then torque about x, y and z.
Eigen::Matrix4Xd allocation(const Airframe& frame) {
  Eigen::Matrix4Xd map(4, static_cast<Eigen::Index>(frame.num_rotors()));
  for (std::size_t i = 0; i < frame.num_rotors(); ++i) {
    const double turn = frame.spin[i] == Spin::ccw ? -1.0 : 1.0;
    map.col(static_cast<Eigen::Index>(i)) << 1.0, frame.position_m[i][1], -frame.position_m[i][0], turn * frame.torque_ratio_m;
  }
  return map;
}

}  // namespace

double Airframe::thrust_at(double speed) const {
  return std::max(thrust_n[0] + thrust_n[1] * speed + thrust_n[2] * speed * speed, 0.0);
}

double Airframe::speed_for(double thrust) const {
  const auto [c0, c1, c2] = thrust_n;
  double speed = max_speed_radps;
  if (c2 > 0.0) {
    speed = (-c1 + std::sqrt(std::max(c1 * c1 - 4.0 * c2 * (c0 - thrust), 0.0))) / (2.0 * c2);
  } else if (c1 > 0.0) {
    speed = (thrust - c0) / c1;
  }
  return std::clamp(speed, min_speed_radps, max_speed_radps);
}

double Airframe::thrust_to_weight() const { return static_cast<double>(num_rotors()) * max_thrust() / (mass_kg * kGravity); }

double Airframe::hover_speed() const { return speed_for(mass_kg * kGravity / static_cast<double>(num_rotors())); }

void Airframe::validate() const {
  check_fields(*this, "");
  require(num_rotors() >= kMinRotors && num_rotors() <= kMaxRotors, "rotors position_m",
          std::to_string(kMinRotors) + " to " + std::to_string(kMaxRotors) + " positions", num_rotors());
  require(spin.size() == num_rotors(), "rotors spin", "as many as rotors position_m (" + std::to_string(num_rotors()) + ")",
          spin.size());
  const std::size_t largest = static_cast<std::size_t>(std::ranges::max_element(inertia_kgm2) - inertia_kgm2.begin());
  const double others = inertia_kgm2[(largest + 1) % 3] + inertia_kgm2[(largest + 2) % 3];
  constexpr double kRounding = 1.0 + 1e-9;
  if (inertia_kgm2[largest] > others * kRounding) {
    std::ostringstream got;
    got << text_of(inertia_kgm2) << " (lower " << numbered("inertia_kgm2", largest) << " to " << others
        << ", or raise the others)";
    refuse("inertia_kgm2", "moments of a body, none larger than the sum of the other two", got.str());
  }
  require(min_speed_radps < max_speed_radps, "rotors min_speed_radps", "a number below max_speed_radps", min_speed_radps);
  require(thrust_n[2] >= 0.0, "rotors thrust_n[2]", "a number >= 0", thrust_n[2]);
  require(max_thrust() > 0.0, "rotors thrust_n", "a positive thrust at full speed", max_thrust());
  const double vertex = thrust_n[2] > 0.0 ? -thrust_n[1] / (2.0 * thrust_n[2]) : -1.0;  // rad/s, vertex of the parabola
  require(vertex <= min_speed_radps || thrust_at(vertex) == 0.0, "rotors thrust_n", "a thrust that grows with the speed",
          "one with its minimum at " + std::to_string(vertex) + " rad/s");
  require(thrust_n[2] > 0.0 || thrust_n[1] > 0.0, "rotors thrust_n", "a thrust that grows with the speed",
          "one that does not grow");

  require(thrust_to_weight() > 1.0, "rotors", "a thrust-to-weight above 1, to hover", thrust_to_weight());
  require(static_cast<double>(num_rotors()) * thrust_at(min_speed_radps) < mass_kg * kGravity, "rotors min_speed_radps",
          "a speed at which the thrust is below the weight", min_speed_radps);
  // Scaled by arm and torque ratio, the allocation of an X or plus frame has determinant 16; that of a frame that cannot turn
  // about some axis has determinant 0. With more rotors the volume that its rows span stands for the determinant.
  double arm = 0.0;
  for (const Triple& p : position_m) arm = std::max({arm, std::abs(p[0]), std::abs(p[1])});
  const double scale = arm * arm * torque_ratio_m;
  const Eigen::Matrix4Xd map = allocation(*this);
  const Eigen::Matrix4d squares = map.lazyProduct(map.transpose());  // as in dynamics/physics.cpp
  const double volume = std::sqrt(std::max(squares.determinant(), 0.0));
  require(scale > 0.0 && volume >= kMinLever * scale, "rotors", "positions and spins that can turn the body about each axis",
          "ones that leave an axis without torque");
}

std::size_t most_rotors(std::span<const Airframe> airframes) {
  std::size_t most = kMinRotors;
  for (const Airframe& frame : airframes) most = std::max(most, frame.num_rotors());
  return most;
}

Airframe Airframe::scaled(double size, double mass) const {
  require(std::isfinite(size) && size > 0.0, "size", "a finite number > 0", size);
  require(std::isfinite(mass) && mass > 0.0, "mass", "a finite number > 0", mass);
  const double time = std::sqrt(size);  // also the factor for velocities
  Airframe other = *this;
  other.mass_kg *= mass;
  for (double& j : other.inertia_kgm2) j *= mass * size * size;
  for (Triple& p : other.position_m) {
    for (double& x : p) x *= size;
  }
  for (std::size_t power = 0; power < 3; ++power) other.thrust_n[power] *= mass * std::pow(time, static_cast<double>(power));
  other.torque_ratio_m *= size;
  other.min_speed_radps /= time;
  other.max_speed_radps /= time;
  other.lag_up_s *= time;
  other.lag_down_s *= time;
  other.radius_m *= size;
  other.rotor_inertia_kgm2 *= mass * size * size;
  for (double& k : other.rotor_drag) k *= mass;  // per rotor speed and air speed
  other.rotor_lift *= mass / size;
  for (double& k : other.linear_drag) k *= mass / time;
  for (double& k : other.quadratic_drag) k *= mass / size;
  other.validate();
  return other;
}

}  // namespace flockstep
