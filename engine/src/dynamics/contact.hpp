// Contact: resolves the contacts of drones of one env during one tick, with the world, with moving objects and with each other.
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
#include "dynamics/rebound.hpp"
#include "flockstep/airframe.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "trace/hulls.hpp"

namespace flockstep::dynamics {

// A drone of a contact group, the drones that may touch each other in a tick. Most groups have one drone.
struct GroupMember {
  std::uint32_t number = 0;            // in its env
  const Airframe* airframe = nullptr;  // null: kinematic motion
  TickMotion motion;                   // `from` and `to` are equal if the drone stands
  bool is_open = false;                // neither the world nor a moving object is within reach of the motion
  bool has_contact = false;            // an earlier contact, which the drone keeps; it stands
  bool is_fixed = false;               // impulses do not move the drone: it stops at a contact

  // --- the result
  Pose pose;
  Velocity velocity;
  bool is_deflected = false;         // pose and velocity are not those of the motion
  collision::MovingContact contact;  // the first one of a drone that stops there, otherwise the last one; fraction: of the tick,
                                     // until the contact; velocity: of the other surface, in m/s
  std::int32_t other = -1;           // number of the drone that it touched; -1: none
  float reach = 0.0F;                // m, largest distance from the beginning of the motion
};

// The motion of a drone that stands.
inline TickMotion standing(const Pose& pose, double duration_s) { return {pose, pose, {}, {}, duration_s}; }

// Resolves contacts in the order of their times. At a contact with OnContact::terminate, or with kinematic motion, a drone stops,
// and moving objects may push it until the end of the tick. Otherwise it rebounds, by impulses that are opposite for two drones,
// and flies on. It may have kMaxContacts contacts in a tick; after the last one the surface moves it aside. A motion that begins
// inside something may lead out of it, which is a contact, too; at the end of the tick such a drone is moved towards the way out.
// Each segment of a path is swept against everything else, so no drone ends inside anything, except one that begins there or is
// squeezed; contact.inside says so.
//
// All drones have the same hull. The result does not depend on their order, unless some have equal motions. Make a resolver once;
// resolving allocates only if there are several drones, and more drones, or more contacts to come, than ever before.
class ContactResolver {
 public:
  // corners: of the hull; both must outlive the resolver.
  ContactResolver(const collision::Hull& hull, const collision::Corners& corners);

  // bodies: the moving objects of the env; their count may be 0. Polls for interrupts if there are several drones.
  void resolve(std::span<GroupMember* const> drones, const collision::Obstacles& obstacles, const collision::MovingBodies& bodies,
               const DynamicsConfig& config);
  // The same for a drone that can touch no other one.
  void resolve(GroupMember& drone, const collision::Obstacles& obstacles, const collision::MovingBodies& bodies,
               const DynamicsConfig& config) {
    GroupMember* const only = &drone;
    resolve({&only, 1}, obstacles, bodies, config);
  }

 private:
  // The remaining path of a drone, from a time on.
  struct Segment {
    double begin = 0.0;   // fraction of the tick
    double left_s = 0.0;  // until the end of the tick
    Pose from, to;
    Velocity first, last;
    int contacts = 0;
    bool is_first = true;
    bool stands = false;
    bool is_inside = false;                        // it begins inside something, or is squeezed at its end
    Vec3 low = Vec3::Zero(), high = Vec3::Zero();  // m, corners of a box that contains the hull on the whole segment

    bool rests() const { return from.position == to.position && from.rotation.coeffs() == to.rotation.coeffs(); }
  };
  // A contact to come. The hull of drone `a` hits drone `b`, or the world or a moving object if b is kNone.
  struct Event {
    double time;   // time of impact, as a fraction of the tick
    double begin;  // begin of both segments together
    std::size_t a, b;
    collision::MovingContact contact;
  };
  static constexpr std::size_t kNone = ~std::size_t{0};
  // Points at which a drone touches another one, or a moving object, or the world, since it last moved.
  struct Manifold {
    std::size_t b = kNone;
    int body = -1;
    ContactPoints points;
  };

  void begin();
  GroupMember& drone(std::size_t a) { return *drones_[order_[a]]; }
  const GroupMember& drone(std::size_t a) const { return *drones_[order_[a]]; }
  const Vec3& began(std::size_t a) const { return drone(a).motion.from.position; }  // in ascending order of x
  std::int32_t number(std::size_t a) const { return static_cast<std::int32_t>(drone(a).number); }
  float widest_gap(std::size_t a) const;
  void set_box(Segment& segment) const;
  bool is_near(const Pose& pose, const Vec3& point, float reach) const;
  collision::MovingContact hit_on(const Pose& from, const Pose& to, double begin);
  void find_with_world(std::size_t a);
  void add_with_world(std::size_t a, const collision::MovingContact& contact);
  void find_with_drone(std::size_t a, std::size_t b);
  void find_all(std::size_t a, std::size_t except);
  Pose pose_at(std::size_t a, double time) const;
  void record(std::size_t a, const collision::MovingContact& contact, double time, std::int32_t other);
  void reach(std::size_t a, const Pose& pose);
  void stop(std::size_t a, double time, double left_s, const Pose& pose, Velocity velocity);
  void rebound(std::size_t a, double time, double left_s, const Pose& pose, const Velocity& after, const Velocity& at_end);
  Velocity velocity_after(const Segment& segment, std::size_t a, float share) const;
  void handle(const Event& event);
  ContactPoints& points_of(std::size_t a, std::size_t b, int body, float share);
  double moved(std::size_t a, float share) const;
  void hit_world(const Event& event);
  void hit_drone(const Event& event);
  void push(std::size_t a);
  void move_out(std::size_t a);
  float known_range(const Vec3& origin) const;
  std::span<const collision::MovingSolid> bodies_near(const Vec3& origin, float range_m);
  std::span<const collision::MovingSolid> solids_near(std::size_t a, float range_m);
  Vec3 surface_velocity(std::size_t a, double time, const Vec3& point) const;

  const collision::Hull& hull_;
  const collision::Corners& corners_;
  const trace::HullPlanes planes_;
  std::span<GroupMember* const> drones_;
  const collision::Obstacles* obstacles_ = nullptr;
  collision::MovingBodies bodies_;
  const DynamicsConfig* config_ = nullptr;
  bool stops_ = false;     // drones stop at contacts
  float farthest_ = 0.0F;  // m, largest reach of all drones so far
  std::vector<std::size_t> order_;
  std::vector<Segment> segments_;
  std::vector<Event> events_;
  std::vector<collision::MovingSolid> solids_;
  collision::NearSolids near_;
  std::span<const collision::MovingSolid> near_bodies_;  // all within near_range_m_ of a hull at near_origin_
  Vec3 near_origin_ = Vec3::Zero();
  float near_range_m_ = -1.0F;
  std::vector<Manifold> manifolds_;
};

// Writes a contact with the static world.
void write_contact(State& state, DroneIndex drone, const collision::Contact& contact);
// Writes contact and other of a drone.
void write_contact(State& state, DroneIndex drone, const GroupMember& member);

}  // namespace flockstep::dynamics
