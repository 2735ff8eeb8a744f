#include "dynamics/contact.hpp"

#include <algorithm>
#include <cstddef>
#include <span>

#include "collision/convex.hpp"
#include "collision/moving_solid.hpp"
#include "dynamics/impact.hpp"
#include "dynamics/rebound.hpp"

namespace flockstep::dynamics {
namespace {

// The static world. It answers what resolve() asks.
class StaticWorld {
 public:
  StaticWorld(const collision::Obstacles& obstacles, const collision::Hull& hull) : obstacles_(obstacles), hull_(hull) {}

  collision::MovingContact meet(const Pose& from, const Pose& to) { return {collision::sweep(obstacles_, hull_, from, to)}; }
  bool touches(const collision::MovingContact&, const Vec3& point, float reach) const { return obstacles_.touches(point, reach); }
  void end(ContactResult&, double) {}

 private:
  const collision::Obstacles& obstacles_;
  const collision::Hull& hull_;
};

// The static world and bodies, whose time goes on with the drone's.
class MovingWorld {
 public:
  MovingWorld(const collision::Obstacles& obstacles, std::span<const collision::MovingSolid> solids, const collision::Hull& hull)
      : obstacles_(obstacles), solids_(solids), hull_(hull) {}

  collision::MovingContact meet(const Pose& from, const Pose& to) {
    const collision::MovingContact contact = collision::first_contact(obstacles_, solids_, hull_, from, to, time_);
    time_ += static_cast<double>(contact.hit ? contact.fraction : 1.0F) * (1.0 - time_);
    return contact;
  }

  bool touches(const collision::MovingContact& contact, const Vec3& point, float reach) const {
    if (contact.body < 0) return obstacles_.touches(point, reach);
    const collision::Vec3d center = point.cast<double>();
    return std::ranges::any_of(solids_, [&](const collision::MovingSolid& solid) {
      return solid.index() == contact.body &&
             (collision::closest_point(solid.at(time_), center) - center).norm() < static_cast<double>(reach);
    });
  }

  // Lets bodies push the drone until the end of the tick.
  void end(ContactResult& result, double left_s) {
    const collision::Push push = collision::push(obstacles_, solids_, hull_, result.pose, time_);
    result.farthest += push.farthest;
    if (push.pushed) {
      const double most = fastest_of(solids_) * (1.0 - time_);  // a push also restores the standoff
      result.velocity.linear = pushed_along(result.velocity.linear, push.pose.position - result.pose.position, most, left_s);
    }
    result.pose = push.pose;
    if (!push.jammed) return;
    result.contact.inside = true;
    result.velocity = {};
  }

 private:
  const collision::Obstacles& obstacles_;
  std::span<const collision::MovingSolid> solids_;
  const collision::Hull& hull_;
  double time_ = 0.0;  // of the bodies' motion
};

template <class World>
ContactResult resolve(World& world, const Body& body, const DynamicsConfig& config, const TickMotion& motion) {
  constexpr int kMostContacts = 3;  // per tick: two walls and their corner
  const bool terminates = config.on_contact == OnContact::terminate;
  Pose from = motion.from, to = motion.to;
  Velocity begin = motion.begin, end = motion.end;
  double left_s = motion.duration_s;
  ContactResult result;
  const auto comes_to = [&](const Pose& pose) {
    result.farthest = std::max(result.farthest, (pose.position - motion.from.position).norm());
  };
  for (int contacts = 0; contacts < kMostContacts; ++contacts) {
    const collision::MovingContact contact = world.meet(from, to);
    if (contact.hit) result.contact = contact;
    if (!contact.hit || (contact.inside && contact.fraction == 1.0F && !terminates)) {
      if (contacts > 0) result.pose = to, result.velocity = end;
      comes_to(to);
      return result;
    }
    result.is_deflected = true;
    from = collision::interpolate(from, to, contact.fraction);
    comes_to(from);
    const float share = contact.fraction;
    left_s *= 1.0 - static_cast<double>(share);
    if (terminates) {
      result.pose = from;
      result.velocity = end;
      world.end(result, left_s);
      return result;
    }
    Velocity hit = velocity_between(begin, end, share);
    const auto touches = [&](const Vec3& point, float reach) { return world.touches(contact, point, reach); };
    const ContactPoints touching(touches, body.hull, from, contact);
    const bool is_moving = contact.body >= 0;  // then the drone rebounds in the frame of the surface
    const Vec3 surface = contact.velocity / static_cast<float>(motion.duration_s);
    if (is_moving) hit.linear -= surface, end.linear -= surface;
    const Rebound rebound =
        thrown_back(hit, end, left_s, from, touching.points(), contact.normal, body.airframe, surface_of(config));
    begin = rebound.after;
    end = rebound.at_end;
    if (is_moving) begin.linear += surface, end.linear += surface;
    to = pose_after(from, begin, end, left_s);
  }
  // After kMostContacts the drone stays at the last contact. Inside an obstacle its velocity is 0, since forces must not
  // accelerate it there.
  result.pose = from;
  result.velocity = result.contact.inside ? Velocity{} : begin;
  world.end(result, left_s);
  return result;
}

// Calls resolve(solids), which returns how far from the origin (m) the drone came, until the solids are all that it can meet.
template <class F>
void among_near(const Traffic& traffic, const collision::Hull& hull, const Vec3& origin, float expected_m, const F& resolve) {
  const float around = hull.radius() + margin(origin.cwiseAbs().maxCoeff());
  for (float range = expected_m;;) {
    const float came = resolve(traffic.near.gather(traffic.bodies, origin, around + range));
    if (!(came > range)) return;
    range = 2.0F * came;
  }
}

}  // namespace

ContactResult resolve_contacts(const collision::Obstacles& obstacles, const Body& body, const DynamicsConfig& config,
                               const TickMotion& motion) {
  StaticWorld world(obstacles, body.hull);
  return resolve(world, body, config, motion);
}

ContactResult resolve_contacts(const collision::Obstacles& obstacles, const Traffic& traffic, const Body& body,
                               const DynamicsConfig& config, const TickMotion& motion) {
  ContactResult result;
  const Vec3& origin = motion.from.position;
  among_near(traffic, body.hull, origin, (motion.to.position - origin).norm(), [&](std::span<const collision::MovingSolid> near) {
    MovingWorld world(obstacles, near, body.hull);
    result = resolve(world, body, config, motion);
    return result.farthest;
  });
  return result;
}

collision::MovingSweep sweep_among(const collision::Obstacles& obstacles, const Traffic& traffic, const collision::Hull& hull,
                                   const Pose& from, const Pose& to) {
  collision::MovingSweep result;
  const float way = (to.position - from.position).norm();
  among_near(traffic, hull, from.position, way, [&](std::span<const collision::MovingSolid> near) {
    result = collision::sweep(obstacles, near, hull, from, to);
    return result.contact.hit ? result.contact.fraction * way + result.end.farthest : way;
  });
  return result;
}

collision::Push push_standing(const collision::Obstacles& obstacles, const Traffic& traffic, const collision::Hull& hull,
                              const Pose& pose) {
  collision::Push result;
  result.pose = pose;
  among_near(traffic, hull, pose.position, 0.0F, [&](std::span<const collision::MovingSolid> near) {
    if (near.empty()) return 0.0F;
    result = collision::push(obstacles, near, hull, pose);
    return result.farthest;
  });
  return result;
}

void write_contact(State& state, DroneIndex drone, const collision::Contact& contact) {
  state.contact.hit[drone] = contact.hit;
  state.contact.inside[drone] = contact.inside;
  state.contact.fraction[drone] = contact.fraction;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    state.contact.point[3 * drone + axis] = contact.point[static_cast<Eigen::Index>(axis)];
    state.contact.normal[3 * drone + axis] = contact.normal[static_cast<Eigen::Index>(axis)];
  }
}

void write_contact(State& state, DroneIndex drone, const collision::MovingContact& contact, double duration_s) {
  write_contact(state, drone, static_cast<const collision::Contact&>(contact));
  state.contact.body[drone] = contact.body;
  state.contact.drone[drone] = -1;
  const Vec3 velocity = contact.velocity / static_cast<float>(duration_s);
  std::copy_n(velocity.data(), 3, state.contact.surface_velocity.data() + 3 * drone);
}

}  // namespace flockstep::dynamics
