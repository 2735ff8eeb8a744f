// BodyConfig: a solid in an env that may move, and BodyMotion: the script that moves it.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <string>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/limits.hpp"
#include "flockstep/visibility.hpp"

namespace flockstep {

class World;

// Shape of a body. Solids are full: a ray from outside stops at their surface. A mesh consists of triangles: sensors detect
// these, and drones hit the convex hull of each of its objects.
enum class BodyShape : std::uint8_t { box, cylinder, sphere, capsule, mesh };
template <>
struct EnumNames<BodyShape> {
  static constexpr std::array kNames{"box", "cylinder", "sphere", "capsule", "mesh"};
};

// Scripts of bodies.
enum class BodyMotionKind : std::uint8_t { velocity, waypoints, orbit, hinge, slider, random_walk };
template <>
struct EnumNames<BodyMotionKind> {
  static constexpr std::array kNames{"velocity", "waypoints", "orbit", "hinge", "slider", "random_walk"};
};

// Continuation of a route after its last point.
enum class BodyRoute : std::uint8_t { loop, back_and_forth, once };
template <>
struct EnumNames<BodyRoute> {
  static constexpr std::array kNames{"loop", "back_and_forth", "once"};
};

// The pose of a scripted body is a function of the time since the episode began, so it does not drift. bodies/body_script.hpp
// has the formulas.
struct BodyMotion {
  BodyMotionKind kind = BodyMotionKind::velocity;
  std::array<float, 3> velocity_mps{0.0F, 0.0F, 0.0F};
  std::array<float, 3> turn_rate_dps{0.0F, 0.0F, 0.0F};
  std::vector<std::array<float, 3>> points_m;
  BodyRoute route = BodyRoute::loop;
  float speed_mps = 1.0F;
  float corner_radius_m = 0.0F;
  bool faces_travel = false;
  std::array<float, 3> center_m{0.0F, 0.0F, 0.0F};
  std::array<float, 3> axis{0.0F, 0.0F, 1.0F};
  float period_s = 10.0F;
  float angle_deg = 90.0F;
  std::array<float, 3> travel_m{0.0F, 0.0F, 0.0F};
  std::array<float, 3> box_min_m{0.0F, 0.0F, 0.0F};
  std::array<float, 3> box_max_m{0.0F, 0.0F, 0.0F};
  float phase = 0.0F;
  bool random_phase = false;
  float speed_spread = 0.0F;

  static constexpr auto fields() {
    using C = BodyMotion;
    return field_list(
        field("kind", &C::kind,
              {.about =
                   "``\"velocity\"``: constant ``velocity_mps`` and ``turn_rate_dps``. ``\"waypoints\"``: along ``points_m`` at "
                   "``speed_mps``. ``\"orbit\"``: around ``center_m`` and ``axis``, one turn per ``period_s``. ``\"hinge\"``: "
                   "around them to ``angle_deg`` and back in ``period_s``. ``\"slider\"``: to ``travel_m`` away and back in "
                   "``period_s``. ``\"random_walk\"``: straight to a new random point of the box every ``period_s``."}),
        field("velocity_mps", &C::velocity_mps, {.about = "Velocity, world frame.", .unit = "m/s", .limits = within(1e4)}),
        field("turn_rate_dps", &C::turn_rate_dps,
              {.about = "Angular velocity, body frame.", .unit = "deg/s", .limits = within(36000)}),
        field("points_m", &C::points_m,
              {.about = "Positions (x, y, z) of ``\"waypoints\"``, world frame, from the first one instead of ``position_m``.",
               .unit = "m",
               .limits = within(kMaxCoordinate)}),
        field("route", &C::route,
              {.about = "After the last of ``\"waypoints\"``: ``\"loop\"`` goes to the first, ``\"back_and_forth\"`` returns "
                        "along the same path, ``\"once\"`` stays."}),
        field("speed_mps", &C::speed_mps, {.about = "Speed along the points.", .unit = "m/s", .limits = between(0, 1e4)}),
        field("corner_radius_m", &C::corner_radius_m,
              {.about = "Radius of arcs that round the corners of ``\"waypoints\"``, smaller between short legs.",
               .unit = "m",
               .limits = between(0, kMaxCoordinate)}),
        field("faces_travel", &C::faces_travel,
              {.about = "Turns the body about z along ``\"waypoints\"``, so that its x axis points ahead. At a corner without a "
                        "radius it turns at once."}),
        field("center_m", &C::center_m,
              {.about = "A point of the axis of ``\"orbit\"`` and ``\"hinge\"``, world frame.",
               .unit = "m",
               .limits = within(kMaxCoordinate)}),
        field("axis", &C::axis,
              {.about = "Direction of the axis of ``\"orbit\"`` and ``\"hinge\"``, world frame, at least 1e-6 long. Turns are "
                        "counter-clockwise.",
               .limits = within(kMaxCoordinate)}),
        field("period_s", &C::period_s,
              {.about = "Time of one turn, of a swing there and back, or of one segment of a random walk.",
               .unit = "s",
               .limits = between(1e-3, 1e6)}),
        field("angle_deg", &C::angle_deg, {.about = "Widest angle of a hinge.", .unit = "deg", .limits = within(360)}),
        field("travel_m", &C::travel_m,
              {.about = "Displacement of a slider to its far end, world frame.", .unit = "m", .limits = within(kMaxCoordinate)}),
        field("box_min_m", &C::box_min_m,
              {.about = "Lower corner of the box of a random walk, world frame.", .unit = "m", .limits = within(kMaxCoordinate)}),
        field("box_max_m", &C::box_max_m, {.about = "Upper corner of that box.", .unit = "m", .limits = within(kMaxCoordinate)}),
        field("phase", &C::phase,
              {.about = "Part of the turn, swing or round trip that is over when an episode begins.", .limits = between(0, 1)}),
        field("random_phase", &C::random_phase, {.about = "Draws the phase of each episode."}),
        field("speed_spread", &C::speed_spread,
              {.about = "Each episode multiplies the speed by a factor in [1 - spread, 1 + spread].",
               .limits = {.least = 0, .greatest = 1, .excludes_greatest = true}}));
  }

  FLOCKSTEP_API void validate() const;
};

// Limits of ids in camera images.
inline constexpr std::uint16_t kSemanticBody = 65532;       // default semantic id of bodies
inline constexpr std::uint16_t kFirstBodyInstance = 61440;  // instance id of an env's first body; the others follow
inline constexpr int kMaxBodies = 4096;                     // per env
// The same for the drones of an env, if they see each other; at most kMaxBodies of them.
inline constexpr std::uint16_t kSemanticDrone = 65531;       // semantic id of drones
inline constexpr std::uint16_t kFirstDroneInstance = 57344;  // instance id of an env's first drone; the others follow
static_assert(kFirstDroneInstance + kMaxBodies == kFirstBodyInstance);

struct BodyConfig {
  std::string name = "body";
  BodyShape shape = BodyShape::box;
  std::array<float, 3> size_m{1.0F, 1.0F, 1.0F};
  std::shared_ptr<const World> mesh;
  std::array<float, 3> position_m{0.0F, 0.0F, 0.0F};
  std::array<float, 4> quat_wxyz{1.0F, 0.0F, 0.0F, 0.0F};
  BodyMotion motion;
  std::array<float, 3> color{0.8F, 0.25F, 0.1F};
  int semantic = 0;
  Visibility visibility = Visibility::full;

  static constexpr auto fields() {
    using C = BodyConfig;
    return field_list(
        field("name", &C::name, {.about = "Name in messages. Several bodies may share it.", .form = Form::plain_name}),
        field("shape", &C::shape,
              {.about = "Cylinders and capsules stand along z. Sensors detect the triangles of a ``\"mesh\"``, drones hit the "
                        "convex hull of each of its objects."}),
        field("size_m", &C::size_m,
              {.about = "Sizes along x, y and z. A cylinder or a capsule has equal x and y, and a capsule's z includes its caps. "
                        "A sphere has equal sizes. Not for a mesh.",
               .unit = "m",
               .limits = between(1e-3, 1e5)}),
        field("mesh", &C::mesh,
              {.about = "World whose triangles, materials and textures make up the ``\"mesh\"``, in the body's frame. It must "
                        "have no primitives and no bodies."}),
        field("position_m", &C::position_m,
              {.about = "Position of the centre, or of a mesh's origin, when an episode begins, world frame.",
               .unit = "m",
               .limits = within(kMaxCoordinate)}),
        field("quat_wxyz", &C::quat_wxyz,
              {.about = "Rotation (w, x, y, z) when an episode begins, body to world.", .form = Form::unit_quaternion}),
        field("motion", &C::motion, {.about = "The script that moves the body."}),
        field("color", &C::color,
              {.about = "Base colour, linear RGB. A mesh has the colours of its materials.", .limits = between(0, 1)}),
        field("semantic", &C::semantic,
              {.about = "Semantic id in camera images. 0: 65532.", .limits = between(0, kSemanticBody)}),
        field("visibility", &C::visibility,
              {.about = "``\"full\"``: sensors see it and drones hit it. ``\"visual\"``: only sensors. ``\"solid\"``: only "
                        "drones."}));
  }

  FLOCKSTEP_API void validate() const;
};

}  // namespace flockstep
