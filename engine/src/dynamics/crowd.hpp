// Crowd: contacts of drones of one env with each other, and with the world and bodies, during one tick.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "collision/convex.hpp"
#include "collision/hull.hpp"
#include "collision/moving_bodies.hpp"
#include "collision/moving_sweep.hpp"
#include "collision/obstacles.hpp"
#include "dynamics/contact.hpp"
#include "dynamics/rebound.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/pose.hpp"
#include "trace/hulls.hpp"

namespace flockstep::dynamics {

// A drone of a crowd during a tick.
struct Neighbor {
  std::uint32_t number = 0;            // in its env
  const Airframe* airframe = nullptr;  // null: kinematic motion
  TickMotion motion;                   // without any contact; `from` and `to` are equal if the drone stands
  bool is_open = false;                // neither the world nor a body is within reach of the motion
  bool has_contact = false;            // an earlier contact, which the drone keeps; it stands
  bool holds = false;                  // the drone stands, and impulses do not move it

  // --- the result
  Pose pose;
  Velocity velocity;
  bool is_deflected = false;         // pose and velocity are not those of the motion
  collision::MovingContact contact;  // the first contact of a drone that then stands; otherwise the last one
  std::int32_t other = -1;           // number of the drone that it touched; -1: none
  float reach = 0.0F;                // m, largest distance from the beginning of the motion
};

// All drones of a crowd have the same hull. Contacts are resolved in the order of their times. At a contact with on_contact
// terminate, or with kinematic motion, both drones stop; bodies may push them until the end of the tick. Otherwise both rebound,
// by opposite impulses, and fly on. Each way is swept against everything else, so no drone ends inside another one, except one
// that begins there or is squeezed; contact.inside says so.
//
// The result does not depend on the order of the drones, unless some have equal motions. Make it once; resolving allocates only
// if there are more drones, or more contacts to come, than ever before.
class Crowd {
 public:
  // corners: of the hull; both must outlive the crowd.
  Crowd(const collision::Hull& hull, const collision::Corners& corners);

  // bodies: of the env. Without bodies the count is 0. Polls for interrupts.
  void resolve(std::span<Neighbor* const> drones, const collision::Obstacles& obstacles, const collision::MovingBodies& bodies,
               const DynamicsConfig& config);

 private:
  // The rest of a drone's motion, from a time on.
  struct Leg {
    double begin = 0.0;  // fraction of the tick
    Pose from, to;
    Velocity first, last;
    int contacts = 0;
    bool is_first = true;
    bool stands = false;
    Vec3 low = Vec3::Zero(), high = Vec3::Zero();  // m, corners of a box that contains the hull during the whole leg

    bool rests() const { return from.position == to.position && from.rotation.coeffs() == to.rotation.coeffs(); }
  };
  // A contact to come. The hull of drone `a` meets drone `b`, or the world or a body if b is kNone.
  struct Meeting {
    double time;   // fraction of the tick
    double begin;  // begin of both legs together
    std::size_t a, b;
    collision::MovingContact contact;
  };
  static constexpr std::size_t kNone = ~std::size_t{0};
  // Points at which a drone touches another one, or a body, or the world, since it last moved.
  struct Touched {
    std::size_t b = kNone;
    int body = -1;
    ContactPoints points;
  };

  Neighbor& drone(std::size_t a) { return *drones_[order_[a]]; }
  const Neighbor& drone(std::size_t a) const { return *drones_[order_[a]]; }
  const Vec3& began(std::size_t a) const { return drone(a).motion.from.position; }  // in ascending order of x
  std::int32_t number(std::size_t a) const { return static_cast<std::int32_t>(drone(a).number); }
  float widest_gap(std::size_t a) const;
  void set_box(Leg& leg) const;
  bool is_near(const Pose& pose, const Vec3& point, float reach) const;
  void find_with_world(std::size_t a);
  void find_with_drone(std::size_t a, std::size_t b);
  void find_all(std::size_t a, std::size_t except);
  Pose pose_at(std::size_t a, double time) const;
  void note(std::size_t a, const collision::MovingContact& contact, std::int32_t other);
  void stop(std::size_t a, double time, const Pose& pose, const Velocity& velocity);
  void fly_on(std::size_t a, double time, const Pose& pose, const Velocity& after, const Velocity& at_end);
  Velocity velocity_after(const Leg& leg, std::size_t a, float share) const;
  void meet(const Meeting& meeting);
  ContactPoints& points_of(std::size_t a, std::size_t b, int body, float share);
  double moved(std::size_t a, float share) const;
  void meet_world(const Meeting& meeting);
  void meet_drone(const Meeting& meeting);
  void push(std::size_t a);
  void move_out(std::size_t a);
  std::span<const collision::MovingSolid> solids_near(std::size_t a, float range_m, bool with_drones);
  double left_s(double time) const { return (1.0 - time) * drones_.front()->motion.duration_s; }
  Vec3 surface_velocity(std::size_t a, double time, const Vec3& point) const;

  const collision::Hull& hull_;
  const collision::Corners& corners_;
  const trace::HullPlanes planes_;
  std::span<Neighbor* const> drones_;
  const collision::Obstacles* obstacles_ = nullptr;
  collision::MovingBodies bodies_;
  const DynamicsConfig* config_ = nullptr;
  bool stops_ = false;     // drones stop at contacts
  float farthest_ = 0.0F;  // m, largest reach of all drones so far
  std::vector<std::size_t> order_;
  std::vector<Leg> legs_;
  std::vector<Meeting> meetings_;
  std::vector<collision::MovingSolid> solids_;
  collision::NearSolids near_;
  std::vector<Touched> touched_;
};

// Writes contact and other of a drone; contact.velocity is in m/s.
void write_contact(State& state, DroneIndex drone, const Neighbor& neighbor);

}  // namespace flockstep::dynamics
