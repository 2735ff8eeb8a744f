// Airframe: the mass, rotors and drag of a quadrotor, from which its flight is computed.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/fields.hpp"

namespace flockstep {

inline constexpr std::size_t kRotors = 4;

// Which way a rotor turns, seen from above. One that turns counter-clockwise yaws the body clockwise.
enum class Spin : std::uint8_t { ccw, cw };
template <>
struct EnumNames<Spin> {
  static constexpr std::array kNames{"ccw", "cw"};
};

// SI units; the body frame is x forward, y left, z up, its origin the centre of mass. Rotors point along z.
struct Airframe {
  using Triple = std::array<double, 3>;  // x, y, z of the body frame

  double mass_kg = 0.0;
  Triple inertia_kgm2{};  // about the axes of the body frame, which are principal

  // Of the rotors. Shipped frames have them in the order front right, rear left, front left, rear right.
  std::array<Triple, kRotors> position_m{};
  std::array<Spin, kRotors> spin{};
  Triple thrust_n{};             // c0, c1, c2: at speed w (rad/s) a rotor pushes with max(c0 + c1 w + c2 w^2, 0)
  double torque_ratio_m = 0.0;   // its torque over its thrust
  double min_speed_radps = 0.0;  // slowest and fastest speed it can be told
  double max_speed_radps = 0.0;
  double lag_up_s = 0.0;    // time constant of its speed where it gains; 0: at once
  double lag_down_s = 0.0;  // where it slows down
  double radius_m = 0.0;    // of its disc; 0: no ground effect
  double rotor_inertia_kgm2 = 0.0;
  Triple rotor_drag{};      // N / (rad/s) / (m/s): -w diag(.) v, v the air velocity at the hub
  double rotor_lift = 0.0;  // N / (m/s)^2: added to the thrust, times vx^2 + vy^2

  // Of the body, by the air velocity v at its centre: -diag(linear) v - |v| diag(quadratic) v.
  Triple linear_drag{};     // N / (m/s)
  Triple quadratic_drag{};  // N / (m/s)^2

  static constexpr auto fields() {
    using C = Airframe;
    return field_list(field("mass_kg", &C::mass_kg), field("inertia_kgm2", &C::inertia_kgm2), field("position_m", &C::position_m),
                      field("spin", &C::spin), field("thrust_n", &C::thrust_n), field("torque_ratio_m", &C::torque_ratio_m),
                      field("min_speed_radps", &C::min_speed_radps), field("max_speed_radps", &C::max_speed_radps),
                      field("lag_up_s", &C::lag_up_s), field("lag_down_s", &C::lag_down_s), field("radius_m", &C::radius_m),
                      field("rotor_inertia_kgm2", &C::rotor_inertia_kgm2), field("rotor_drag", &C::rotor_drag),
                      field("rotor_lift", &C::rotor_lift), field("linear_drag", &C::linear_drag),
                      field("quadratic_drag", &C::quadratic_drag));
  }

  // Throws std::invalid_argument where it is no body that can hover: it names the field, what was expected, what came.
  void validate() const;

  double thrust_at(double speed_radps) const;                       // N, of one rotor
  double speed_for(double thrust_n) const;                          // rad/s, within the limits
  double max_thrust() const { return thrust_at(max_speed_radps); }  // N, of one rotor
  double thrust_to_weight() const;
  double hover_speed() const;  // rad/s, of rotors that share the weight evenly

  // The same body in another size: lengths times `size`, mass times `mass`, and all the rest so that it flies alike, at speeds
  // and in times that are longer by the square root of `size` (Froude's law); thrust-to-weight stays. Both > 0.
  Airframe scaled(double size, double mass) const;
};

inline constexpr double kGravity = 9.81;  // m/s^2

}  // namespace flockstep
