// The swept hull among bodies: continuous collision detection of a hull against a world and solids that move during the same
// motion, and bodies that push the hull.
#pragma once

#include <span>

#include "collision/hull.hpp"
#include "collision/moving_bodies.hpp"
#include "collision/obstacles.hpp"
#include "collision/sweep.hpp"
#include "flockstep/pose.hpp"

namespace flockstep::collision {

// A contact with the static world or a body. Point and normal are in the world frame at the time of the contact, or at the start
// if the motion began in penetration.
struct MovingContact : Contact {
  int body = -1;                 // index of the body; -1: the static world
  Vec3 velocity = Vec3::Zero();  // m per motion of the body, of its point at the contact; 0 for the static world
};

// Sweeps the hull from `from` to `to`, while the bodies move from time `begin` to 1 of their motion. The test is exact in time:
// hull and bodies follow their Paths, and the hull is swept along its path relative to each body (RelativePath), however fast
// both move and turn. The rules of sweep() hold for bodies, too: standoff, rest, and a hull that begins inside a body may only
// leave it, relative to the body. The fraction is of the hull's motion. If several contacts come first at the same time, the
// static world is reported before bodies, and the body with the lowest index before others. With no bodies near, the result is
// that of sweep(). leads_out: the motion is known to lead out of all that the hull begins inside of, which is ignored. Allocates
// nothing; the result depends only on the arguments, not on the order of the bodies.
MovingContact first_contact(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& from,
                            const Pose& to, double begin = 0.0, bool leads_out = false);

// The same for one body and no static world.
MovingContact first_contact(const MovingSolid& body, const Hull& hull, const Pose& from, const Pose& to);

// The result of bodies that move while the hull stands.
struct Push {
  Pose pose;              // at the end
  bool pushed = false;    // a body has moved the hull
  bool jammed = false;    // see push()
  float farthest = 0.0F;  // m, largest distance from the beginning
};

// Moves the bodies from time `begin` to 1, while the hull stands at `pose` and gives way. A body that runs into the hull carries
// it along the contact normal, as far as the body advances. If an obstacle or another body is in the way, the hull slides along
// it. The hull only translates. Each of its ways is swept against the static world, so that no body pushes it into or through a
// wall. At the end it is outside of all bodies, unless it is jammed: squeezed between bodies or between a body and a wall, or
// inside a body since the start. A body that passes a jammed hull may leave it free at the end. A hull inside a body since the
// start is not pushed out, but moved so that it gets no deeper along the way out.
// Allocates nothing; the result depends only on the arguments, not on the order of the bodies.
Push push(const Obstacles& obstacles, std::span<const MovingSolid> bodies, const Hull& hull, const Pose& pose,
          double begin = 0.0);

}  // namespace flockstep::collision
