#include "dynamics/contact.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <span>

#include "collision/convex.hpp"
#include "collision/moving_bodies.hpp"
#include "dynamics/impact.hpp"
#include "dynamics/rebound.hpp"

namespace flockstep::dynamics {
namespace {

// The static world. It answers what resolve() asks.
class StaticWorld {
 public:
  StaticWorld(const collision::Obstacles& obstacles, const collision::Hull& hull) : obstacles_(obstacles), hull_(hull) {}

  collision::MovingContact meet(const Pose& from, const Pose& to) { return {collision::sweep(obstacles_, hull_, from, to)}; }
  std::span<const collision::MovingSolid> solids() const { return {}; }
  bool touches(const collision::MovingContact&, const Vec3& point, float reach) const { return obstacles_.touches(point, reach); }
  void end(ContactResult&, double) {}
  const collision::Obstacles& obstacles() const { return obstacles_; }

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

  const collision::Obstacles& obstacles() const { return obstacles_; }
  std::span<const collision::MovingSolid> solids() const { return solids_; }

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
    time_ = 1.0;
    if (!push.jammed) return;
    result.contact.inside = true;
    result.velocity = {};
  }

 private:
  const collision::Obstacles& obstacles_;
  std::span<const collision::MovingSolid> solids_;
  const collision::Hull& hull_;
  double time_ = 0.0;  // time in the bodies' motion
};

// Moves a drone that is inside something at the end of a tick towards the way out.
template <class World>
void move_out(World& world, const collision::Hull& hull, const TickMotion& motion, const Pose& pose, const Velocity& velocity,
              ContactResult& result) {
  const double outwards = static_cast<double>(result.contact.normal.dot(pose.position - motion.from.position));
  const double most = kSpeedOut * motion.duration_s - std::max(outwards, 0.0);
  const Pose target = collision::cleared(world.obstacles(), world.solids(), hull, pose, 1.0, most);
  const collision::MovingContact contact = world.meet(pose, target);
  result.is_deflected = true;
  result.pose = collision::interpolate(pose, target, contact.hit ? contact.fraction : 1.0F);
  result.velocity = velocity;
  result.farthest = std::max(result.farthest, (target.position - motion.from.position).norm());
}

template <class World>
ContactResult resolve(World& world, const Body& body, const DynamicsConfig& config, const TickMotion& motion) {
  const bool terminates = config.on_contact == OnContact::terminate;
  Pose from = motion.from, to = motion.to;
  Velocity begin = motion.begin, end = motion.end;
  double left_s = motion.duration_s;
  ContactPoints touching;
  int touched = -1;  // the body that they touch
  ContactResult result;
  const auto comes_to = [&](const Pose& pose) {
    result.farthest = std::max(result.farthest, (pose.position - motion.from.position).norm());
  };
  for (int contacts = 0; contacts < kMaxContacts; ++contacts) {
    const collision::MovingContact contact = world.meet(from, to);
    if (contact.hit) result.contact = contact;
    const bool is_flown = !contact.hit || (contact.inside && contact.fraction == 1.0F && !terminates);
    if (is_flown) {
      if (contacts > 0) result.pose = to, result.velocity = end;
      comes_to(to);
      if (contact.inside) move_out(world, body.hull, motion, to, end, result);
      return result;
    }
    result.is_deflected = true;
    const float share = contact.fraction;
    const double moved = share > 0.0F ? static_cast<double>(share) * largest_move(body.hull, from, to) : 0.0;
    from = collision::interpolate(from, to, share);
    comes_to(from);
    left_s *= 1.0 - static_cast<double>(share);
    if (terminates) {
      result.pose = from;
      result.velocity = end;
      world.end(result, left_s);
      return result;
    }
    Velocity hit = velocity_between(begin, end, share);
    const auto touches = [&](const Vec3& point, float reach) { return world.touches(contact, point, reach); };
    if (contact.body != touched || moved > collision::kStandoff) touching.clear();
    touched = contact.body;
    touching.add(touches, body.hull, from, contact);
    const bool is_moving = contact.body >= 0;  // then the drone rebounds in the frame of the surface
    const Vec3 surface = contact.velocity / static_cast<float>(motion.duration_s);
    if (is_moving) hit.linear -= surface, end.linear -= surface;
    const Rebound rebound = thrown_back(hit, end, left_s, from, touching.points(), body.airframe, surface_of(config));
    begin = rebound.after;
    end = rebound.at_end;
    if (is_moving) begin.linear += surface, end.linear += surface;
    to = pose_after(from, begin, end, left_s);
  }
  // Impulses cannot finish every tick. Inside an obstacle the drone stays, at rest, since forces must not accelerate it there.
  if (result.contact.inside) {
    result.pose = from;
  } else {
    const Pose target = moved_aside(world.obstacles(), world.solids(), body.hull, from, to);
    const collision::MovingContact last = world.meet(from, target);
    if (last.hit) result.contact = last;
    const float share = last.hit ? last.fraction : 1.0F;
    comes_to(target);
    result.pose = collision::interpolate(from, target, share);
    if (!is_same(result.pose, motion.from)) {
      const float climb = result.pose.position.z() - from.position.z();
      result.velocity = velocity_aside(begin, end, share, climb, motion, left_s, body.airframe);
    }
    left_s *= 1.0 - static_cast<double>(share);
  }
  if (left_s > 0.0) world.end(result, left_s);
  if (result.contact.inside) move_out(world, body.hull, motion, result.pose, result.velocity, result);
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
