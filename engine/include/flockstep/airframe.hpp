// Airframe: mass, rotors and drag of a multirotor, the coefficients of its flight model.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"

namespace flockstep {

inline constexpr std::size_t kMinRotors = 4;  // rotors of an airframe, at least
inline constexpr std::size_t kMaxRotors = 8;  // rotors of an airframe, at most

// Direction in which a rotor turns, seen from above. A counter-clockwise rotor yaws the body clockwise.
enum class Spin : std::uint8_t { ccw, cw };
template <>
struct EnumNames<Spin> {
  static constexpr std::array kNames{"ccw", "cw"};
};

// SI units. Body frame: x forward, y left, z up, origin at the centre of mass. The rotors' axes are parallel to z.
struct Airframe {
  using Triple = std::array<double, 3>;  // x, y, z of the body frame

  double mass_kg = 0.0;
  Triple inertia_kgm2{};
  std::vector<Triple> position_m;
  std::vector<Spin> spin;
  Triple thrust_n{};
  double torque_ratio_m = 0.0;
  double min_speed_radps = 0.0;
  double max_speed_radps = 0.0;
  double lag_up_s = 0.0;
  double lag_down_s = 0.0;
  double radius_m = 0.0;
  double rotor_inertia_kgm2 = 0.0;
  Triple rotor_drag{};
  double rotor_lift = 0.0;
  Triple linear_drag{};
  Triple quadratic_drag{};

  // Aliases are the paths of the fields in a drone file.
  static constexpr auto fields() {
    using C = Airframe;
    return field_list(
        field("mass_kg", &C::mass_kg, {.about = "Mass of the drone.", .unit = "kg", .limits = between(1e-4, 1e4)}),
        field("inertia_kgm2", &C::inertia_kgm2,
              {.about = "Moments of inertia about the axes of the body frame, the principal axes.",
               .unit = "kg m^2",
               .limits = between(1e-12, 1e9)}),
        field("position_m", &C::position_m,
              {.about = "Position of each of the 4 to 8 hubs in the body frame; bundled quadrotors: front right, rear left, "
                        "front left, rear right.",
               .unit = "m",
               .limits = within(100),
               .alias = "rotors position_m"}),
        field("spin", &C::spin, {.about = "Direction of each rotor, seen from above.", .alias = "rotors spin"}),
        field("thrust_n", &C::thrust_n,
              {.about = "c0, c1, c2: thrust max(c0 + c1 w + c2 w^2, 0) N at speed w in rad/s.", .alias = "rotors thrust_n"}),
        field("torque_ratio_m", &C::torque_ratio_m,
              {.about = "Torque of a rotor divided by its thrust.",
               .unit = "m",
               .limits = between(1e-6, 10),
               .alias = "rotors torque_ratio_m"}),
        field("min_speed_radps", &C::min_speed_radps,
              {.about = "Slowest commanded speed of a rotor.",
               .unit = "rad/s",
               .limits = at_least(0),
               .alias = "rotors min_speed_radps"}),
        field("max_speed_radps", &C::max_speed_radps,
              {.about = "Fastest commanded speed of a rotor.",
               .unit = "rad/s",
               .limits = between(1e-3, 1e5),
               .alias = "rotors max_speed_radps"}),
        field("lag_up_s", &C::lag_up_s,
              {.about = "Time constant of rising speed. 0: at once.",
               .unit = "s",
               .limits = between(0, 10),
               .alias = "rotors lag_up_s"}),
        field("lag_down_s", &C::lag_down_s,
              {.about = "Time constant of falling speed. 0: at once.",
               .unit = "s",
               .limits = between(0, 10),
               .alias = "rotors lag_down_s"}),
        field("radius_m", &C::radius_m,
              {.about = "Radius of a rotor's disc. 0: no ground effect and no downwash.",
               .unit = "m",
               .limits = between(0, 100),
               .alias = "rotors radius_m"}),
        field("rotor_inertia_kgm2", &C::rotor_inertia_kgm2,
              {.about = "Moment of inertia of one motor's turning part and its propeller.",
               .unit = "kg m^2",
               .limits = between(0, 1e6),
               .alias = "rotors inertia_kgm2"}),
        field("rotor_drag", &C::rotor_drag,
              {.about = "Drag of a rotor: -w diag(rotor_drag) v, with v the air velocity at the hub.",
               .unit = "N/(rad/s)/(m/s)",
               .limits = between(0, 1e6),
               .alias = "rotors drag_n_per_radps_mps"}),
        field("rotor_lift", &C::rotor_lift,
              {.about = "Lift of a rotor, added to its thrust, times vx^2 + vy^2.",
               .unit = "N/(m/s)^2",
               .limits = between(0, 1e6),
               .alias = "rotors lift_n_per_mps2"}),
        field("linear_drag", &C::linear_drag,
              {.about = "Drag of the body: -diag(linear_drag) v, with v the air velocity at its centre.",
               .unit = "N/(m/s)",
               .limits = between(0, 1e6),
               .alias = "drag linear_n_per_mps"}),
        field("quadratic_drag", &C::quadratic_drag,
              {.about = "Drag of the body: -|v| diag(quadratic_drag) v.",
               .unit = "N/(m/s)^2",
               .limits = between(0, 1e6),
               .alias = "drag quadratic_n_per_mps2"}));
  }

  // Throws std::invalid_argument if the body cannot hover. The message names the field, the expected value and the actual one.
  FLOCKSTEP_API void validate() const;

  std::size_t num_rotors() const { return position_m.size(); }      // number of rotors
  FLOCKSTEP_API double thrust_at(double speed_radps) const;         // N, one rotor
  FLOCKSTEP_API double speed_for(double thrust_n) const;            // rad/s, one rotor, within the speed limits
  double max_thrust() const { return thrust_at(max_speed_radps); }  // N, one rotor
  FLOCKSTEP_API double thrust_to_weight() const;                    // largest thrust of all rotors divided by the weight
  FLOCKSTEP_API double hover_speed() const;                         // rad/s, if all rotors share the weight evenly

  // Returns the body in another size: lengths times `size`, mass times `mass`, both > 0. All other coefficients follow Froude's
  // law, so that the scaled body flies alike: speeds and times are multiplied by the square root of `size`, and
  // thrust-to-weight stays the same.
  FLOCKSTEP_API Airframe scaled(double size, double mass) const;
};

// The largest number of rotors of some airframes; 4 without any.
FLOCKSTEP_API std::size_t most_rotors(std::span<const Airframe> airframes);

inline constexpr double kGravity = 9.81;  // m/s^2

}  // namespace flockstep
