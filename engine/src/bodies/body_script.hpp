// BodyScript: the pose of a body as a function of time.
//
// With the time s of the script, in seconds; the period T; x = s / T + phase; the initial position p and rotation q:
//
//   velocity     position p + s v; rotation q turned by s w in the body frame
//   waypoints    bodies/route.hpp at the distance phase L + speed s, with L the length of the round trip: of the loop, of the
//                way there and back, or of the way with the route `once`, at whose end the body stays. With faces_travel the
//                rotation is yaw q, with the yaw about world z that turns the x axis to the horizontal direction of travel.
//   orbit        position and rotation turned by 2 pi x about the axis through center_m
//   hinge        the same by angle_deg (1 - cos(2 pi x)) / 2
//   slider       position p + travel_m (1 - cos(2 pi x)) / 2
//   random_walk  position a + (b - a) (x - k) with k = floor(x), between the random points number k and k + 1 of the box
//
// s is the time since the episode began times a factor, 1 or random; the phase is given or random.
#pragma once

#include <cstdint>

#include "bodies/route.hpp"
#include "flockstep/body.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::bodies {

// Key of a body's random numbers in an episode.
struct ScriptKey {
  std::uint64_t seed = 0;    // seed of the env
  std::int64_t episode = 0;  // number of the episode
  std::uint32_t body = 0;    // number of the body in the env
};

struct Moment {
  Pose pose;
  Velocity velocity;  // the derivative of the pose
};

class BodyScript {
 public:
  // The configuration must be valid.
  explicit BodyScript(const BodyConfig& config);

  // True if the pose ever changes.
  bool moves() const { return moves_; }

  // Upper bounds of a motion within a time: of the turn (rad), and of how far (m) the position leaves the straight and uniform
  // motion between the ends, along which contacts sweep a body.
  struct Reach {
    double turn, bend;
  };
  Reach within(double time_s) const;

  // Returns the pose and velocity at a time, in seconds since the episode began. The same arguments always give the same bits.
  // Allocates nothing. Times up to 1e7 s lose no accuracy.
  Moment at(double time_s, const ScriptKey& key) const;

 private:
  struct Draws;
  struct Wave;

  Draws draws_of(const ScriptKey& key) const;
  double turns_at(double time_s, double phase) const;  // in [0, 1)
  Wave wave_at(double time_s, double phase) const;
  Moment on_route(double time_s, const Draws& draws) const;
  Moment turned(double angle, double rate) const;  // about the axis; rad, rad/s
  Moment walking(double time_s, double phase, const ScriptKey& key) const;
  Eigen::Vector3d point(std::int64_t number, const ScriptKey& key) const;  // point of the random walk

  BodyMotion motion_;
  Pose first_;  // pose of the body when an episode begins
  Route route_;
  bool moves_ = false;
};

}  // namespace flockstep::bodies
