#include "dynamics/contact.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <tuple>
#include <utility>

#include "base/interrupt.hpp"
#include "collision/clearing.hpp"
#include "collision/path.hpp"
#include "collision/sweep.hpp"

namespace flockstep::dynamics {
namespace {

using collision::MovingContact;
using collision::MovingSolid;

// Sorts by what drones do, not by their numbers, which only decide between equal motions.
auto order_of(const GroupMember& drone) {
  const auto key = [](const Pose& pose) {
    const Vec3& p = pose.position;
    const Quat& q = pose.rotation;
    return std::tuple(p.x(), p.y(), p.z(), q.w(), q.x(), q.y(), q.z());
  };
  return std::tuple(key(drone.motion.from), key(drone.motion.to), drone.number);
}

std::vector<Vec3> vertices_of(const collision::Hull& hull) {
  std::vector<Vec3> vertices;
  for (int i = 0; i < hull.count(); ++i) vertices.emplace_back(hull.vertex(i).cast<float>());
  return vertices;
}

}  // namespace

ContactResolver::ContactResolver(const collision::Hull& hull, const collision::Corners& corners)
    : hull_(hull), corners_(corners), planes_(vertices_of(hull)), manifolds_(1) {
  order_.reserve(1);
  segments_.reserve(1);
  events_.reserve(1);
}

void ContactResolver::resolve(std::span<GroupMember* const> drones, const collision::Obstacles& obstacles,
                              const collision::MovingBodies& bodies, const DynamicsConfig& config) {
  drones_ = drones;
  obstacles_ = &obstacles;
  bodies_ = bodies;
  config_ = &config;
  near_range_m_ = -1.0F;
  stops_ = config.is_kinematic() || config.on_contact == OnContact::terminate;
  for (GroupMember* const each : drones) {
    each->pose = each->motion.to;
    each->velocity = each->motion.end;
    each->is_deflected = false;
    each->contact = {};
    each->other = -1;
    each->reach = (each->motion.to.position - each->motion.from.position).norm();
  }
  if (drones.size() == 1 && !drones[0]->has_contact) {  // most often it touches nothing, and there is no more to do
    const MovingContact contact = hit_on(drones[0]->motion.from, drones[0]->motion.to, 0.0);
    if (!contact.hit) return;
    if (stops_ && bodies.count == 0) {  // nothing will push it
      GroupMember& only = *drones[0];
      only.contact = contact;
      only.pose = collision::interpolate(only.motion.from, only.motion.to, contact.fraction);
      only.is_deflected = true;
      only.reach = (only.pose.position - only.motion.from.position).norm();
      return;
    }
    begin();
    add_with_world(0, contact);
  } else {
    begin();
    for (std::size_t a = 0; a < segments_.size(); ++a) {
      if (segments_.size() > 1) Interrupt::poll();  // a dense group takes seconds
      find_with_world(a);
      const float end = began(a).x() + widest_gap(a);
      for (std::size_t b = a + 1; b < segments_.size() && began(b).x() <= end; ++b) find_with_drone(a, b);
    }
  }
  while (!events_.empty()) {
    if (segments_.size() > 1) Interrupt::poll();
    const auto first = std::ranges::min_element(
        events_, [](const Event& x, const Event& y) { return std::tuple(x.time, x.a, x.b) < std::tuple(y.time, y.a, y.b); });
    handle(Event(*first));
  }
  for (std::size_t a = 0; a < segments_.size(); ++a) {
    if (bodies_.count != 0 && segments_[a].stands) push(a);
  }
  for (std::size_t a = 0; a < segments_.size(); ++a) {
    if (!stops_ && !drone(a).is_fixed && !drone(a).has_contact && segments_[a].is_inside) move_out(a);
    GroupMember& each = drone(a);
    each.pose = segments_[a].to;
    each.velocity = segments_[a].last;
    if (each.contact.body >= 0) each.contact.velocity /= static_cast<float>(each.motion.duration_s);  // drones' are in m/s
    reach(a, each.pose);
  }
}

// Sorts the drones, which are numbered by that order from here on, that of their x, and begins their paths.
void ContactResolver::begin() {
  events_.clear();
  manifolds_.resize(std::max(manifolds_.size(), drones_.size()));
  order_.resize(drones_.size());
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  std::ranges::sort(order_, [&](std::size_t a, std::size_t b) {
    const float x = drones_[a]->motion.from.position.x(), other_x = drones_[b]->motion.from.position.x();
    return x != other_x ? x < other_x : order_of(*drones_[a]) < order_of(*drones_[b]);
  });
  segments_.clear();
  farthest_ = 0.0F;
  for (std::size_t a = 0; a < drones_.size(); ++a) {
    const TickMotion& motion = drone(a).motion;
    manifolds_[a].points.clear();
    segments_.push_back({.left_s = motion.duration_s,
                         .from = motion.from,
                         .to = motion.to,
                         .first = motion.begin,
                         .last = motion.end,
                         .stands = drone(a).has_contact});
    set_box(segments_[a]);
    farthest_ = std::max(farthest_, std::exchange(drone(a).reach, 0.0F));
  }
}

// Returns a distance (m) of the beginnings of two drones beyond which they cannot touch so far.
float ContactResolver::widest_gap(std::size_t a) const {
  return 2.0F * (hull_.radius() + farthest_ + margin(began(a).cwiseAbs().maxCoeff()));
}

void ContactResolver::set_box(Segment& segment) const {
  if (drones_.size() == 1) return;
  constexpr float kTurnPerChange = 2.25F;  // bound of a turn (rad) over the distance of the quaternions: above pi / sqrt(2)
  const auto &from = segment.from.rotation.coeffs(), &to = segment.to.rotation.coeffs();
  const float turn = kTurnPerChange * std::min((to - from).norm(), (to + from).norm());
  const Vec3 half = segment.from.rotation.toRotationMatrix().cwiseAbs() * planes_.half_extents +
                    Vec3::Constant(turn * hull_.radius() + margin(segment.from.position.cwiseAbs().maxCoeff()));
  segment.low = segment.from.position.cwiseMin(segment.to.position) - half;
  segment.high = segment.from.position.cwiseMax(segment.to.position) + half;
}

// Returns true if a point is nearer than `reach` (m) to the planes of all faces of a drone, or on their inner sides.
bool ContactResolver::is_near(const Pose& pose, const Vec3& point, float reach) const {
  const Vec3 local = pose.rotation.conjugate() * (point - pose.position);
  for (std::size_t i = 0; i < planes_.count; ++i) {
    if (planes_.x[i] * local.x() + planes_.y[i] * local.y() + planes_.z[i] * local.z() - planes_.offset[i] >= reach) return false;
  }
  return true;
}

Pose ContactResolver::pose_at(std::size_t a, double time) const {
  const Segment& segment = segments_[a];
  if (segment.rests() || time <= segment.begin) return segment.from;
  return collision::interpolate(segment.from, segment.to, static_cast<float>((time - segment.begin) / (1.0 - segment.begin)));
}

// Velocity in m/s of the point of a drone that is at `point` at a time.
Vec3 ContactResolver::surface_velocity(std::size_t a, double time, const Vec3& point) const {
  const Segment& segment = segments_[a];
  if (segment.rests() || !(segment.begin < 1.0)) return Vec3::Zero();
  const double share = (time - segment.begin) / (1.0 - segment.begin);
  const MovingSolid solid(corners_, segment.from, segment.to, 0);
  return (solid.velocity(point.cast<double>(), share) / segment.left_s).cast<float>();
}

// Returns the first contact with the world or a moving object on a path that begins at a fraction of the tick.
MovingContact ContactResolver::hit_on(const Pose& from, const Pose& to, double begin) {
  const auto solids = bodies_near(from.position, (to.position - from.position).norm());
  return collision::first_contact(*obstacles_, solids, hull_, from, to, begin);
}

void ContactResolver::find_with_world(std::size_t a) {
  const Segment& segment = segments_[a];
  if (segment.stands || (segment.is_first && drone(a).is_open)) return;
  const MovingContact contact = hit_on(segment.from, segment.to, segment.begin);
  if (contact.hit) add_with_world(a, contact);
}

void ContactResolver::add_with_world(std::size_t a, const MovingContact& contact) {
  Segment& segment = segments_[a];
  const double time = segment.begin + static_cast<double>(contact.fraction) * (1.0 - segment.begin);
  segment.is_inside |= contact.inside;
  if (contact.inside && contact.fraction == 1.0F) {
    record(a, contact, time, -1);
    if (!stops_) return;
  }
  events_.push_back({time, segment.begin, a, kNone, contact});
}

void ContactResolver::find_with_drone(std::size_t a, std::size_t b) {
  Segment &first = segments_[a], &second = segments_[b];
  if (first.rests() && second.rests()) return;
  if ((first.low.array() > second.high.array()).any() || (second.low.array() > first.high.array()).any()) return;
  const double begin = std::max(first.begin, second.begin);
  const float apart = (first.from.position - second.from.position).norm();
  const float lengths = (first.to.position - first.from.position).norm() + (second.to.position - second.from.position).norm();
  const float near = margin(first.from.position.cwiseAbs().maxCoeff() + second.from.position.cwiseAbs().maxCoeff());
  if (apart > lengths + 2.0F * hull_.radius() + near) return;
  const Pose from = pose_at(a, begin);
  const MovingSolid other(corners_, pose_at(b, begin), second.to, 0);
  MovingContact contact = collision::first_contact(other, hull_, from, first.to);
  if (!contact.hit) return;
  contact.body = -1;
  const double time = begin + static_cast<double>(contact.fraction) * (1.0 - begin);
  if (!(contact.inside && contact.fraction == 1.0F)) return events_.push_back({time, begin, a, b, contact});
  first.is_inside = second.is_inside = true;
  contact.velocity = surface_velocity(b, begin, contact.point);
  record(a, contact, time, number(b));
  contact.velocity = surface_velocity(a, begin, contact.point);
  contact.normal = -contact.normal;
  record(b, contact, time, number(a));
}

// Finds what a drone hits on its segment, except one drone.
void ContactResolver::find_all(std::size_t a, std::size_t except) {
  find_with_world(a);
  const float gap = widest_gap(a), first_x = began(a).x() - gap, last_x = began(a).x() + gap;
  std::size_t first = a;
  while (first > 0 && began(first - 1).x() >= first_x) --first;
  for (std::size_t b = first; b < segments_.size() && began(b).x() <= last_x; ++b) {
    if (b != a && b != except) find_with_drone(std::min(a, b), std::max(a, b));
  }
}

void ContactResolver::record(std::size_t a, const MovingContact& contact, double time, std::int32_t other) {
  GroupMember& each = drone(a);
  if (each.has_contact || (stops_ && each.contact.hit)) return;
  each.contact = contact;
  each.contact.fraction = static_cast<float>(time);
  each.other = other;
}

void ContactResolver::reach(std::size_t a, const Pose& pose) {
  drone(a).reach = std::max(drone(a).reach, (pose.position - began(a)).norm());
}

void ContactResolver::stop(std::size_t a, double time, double left_s, const Pose& pose, Velocity velocity) {
  Segment& segment = segments_[a];
  segment = {.begin = time,
             .left_s = left_s,
             .from = pose,
             .to = pose,
             .first = velocity,
             .last = velocity,
             .contacts = segment.contacts,
             .is_first = false,
             .stands = true,
             .is_inside = drone(a).contact.inside};
  set_box(segment);
  drone(a).is_deflected = true;
  reach(a, pose);
}

void ContactResolver::rebound(std::size_t a, double time, double left_s, const Pose& pose, const Velocity& after,
                              const Velocity& at_end) {
  Segment& segment = segments_[a];
  GroupMember& each = drone(a);
  const int contacts = segment.contacts + 1;
  // Impulses cannot finish every tick. Inside something the drone then stays, at rest, since forces must not accelerate it there.
  if (each.contact.inside && contacts >= kMaxContacts) return stop(a, time, left_s, pose, {});
  if (contacts > kMaxContacts) return stop(a, time, left_s, pose, after);
  segment = {.begin = time,
             .left_s = left_s,
             .from = pose,
             .to = pose_after(pose, after, at_end, left_s),
             .first = after,
             .last = at_end,
             .contacts = contacts,
             .is_first = false};
  if (contacts == kMaxContacts) {
    // A face that turns about an edge while it slides along it comes nearer to the edge by the second order of time, though the
    // point of contact does not: the surface moves the drone aside, by no more than that.
    const collision::Path path(pose, segment.to);
    const double move = path.fastest(static_cast<double>(hull_.radius())), most = path.angle * move + collision::kStandoff;
    segment.to = collision::cleared(*obstacles_, solids_near(a, 2.0F * static_cast<float>(move)), hull_, segment.to, 1.0, most);
    segment.last = velocity_after(segment, a, 1.0F);
  }
  set_box(segment);
  each.is_deflected = true;
  reach(a, pose);
  farthest_ = std::max({farthest_, each.reach, (segment.to.position - began(a)).norm()});
}

// The velocity of a drone that has flown a share of its segment, a motion aside.
Velocity ContactResolver::velocity_after(const Segment& segment, std::size_t a, float share) const {
  const GroupMember& each = drone(a);
  if (each.other >= 0) return share < 1.0F ? segment.first : segment.last;  // the momentum of both drones stays
  const Pose pose = collision::interpolate(segment.from, segment.to, share);
  if (is_same(pose, each.motion.from)) return {};
  const float climb = pose.position.z() - segment.from.position.z();
  return velocity_aside(segment.first, segment.last, share, climb, each.motion, segment.left_s, *each.airframe);
}

void ContactResolver::handle(const Event& event) {
  if (segments_.size() == 1) events_.clear();
  std::erase_if(events_, [&](const Event& other) {
    const auto is_one_of = [&](std::size_t drone) { return drone != kNone && (drone == event.a || drone == event.b); };
    return is_one_of(other.a) || is_one_of(other.b);
  });
  if (event.b == kNone) {
    hit_world(event);
  } else {
    hit_drone(event);
    find_all(event.b, event.a);
  }
  find_all(event.a, kNone);
}

// The points at which a drone touches something, to add to: none, if it touched something else before, or has moved since.
ContactPoints& ContactResolver::points_of(std::size_t a, std::size_t b, int body, float share) {
  Manifold& manifold = manifolds_[a];
  const bool has_moved = moved(a, share) > collision::kStandoff || (b != kNone && moved(b, share) > collision::kStandoff);
  if (manifold.b != b || manifold.body != body || has_moved) manifold.points.clear();
  manifold.b = b;
  manifold.body = body;
  return manifold.points;
}

// Returns how far (m) a point of a drone moved in a share of its segment.
double ContactResolver::moved(std::size_t a, float share) const {
  const Segment& segment = segments_[a];
  return share > 0.0F ? static_cast<double>(share) * largest_move(hull_, segment.from, segment.to) : 0.0;
}

void ContactResolver::hit_world(const Event& event) {
  const std::size_t a = event.a;
  const Segment& segment = segments_[a];
  const MovingContact& contact = event.contact;
  const Pose pose = collision::interpolate(segment.from, segment.to, contact.fraction);
  const double left_s = segment.left_s * (1.0 - static_cast<double>(contact.fraction));
  record(a, contact, event.time, -1);
  const GroupMember& each = drone(a);
  if (stops_ || each.is_fixed) return stop(a, event.time, left_s, pose, segment.last);
  if (segment.contacts == kMaxContacts) {
    return stop(a, event.time, left_s, pose, velocity_after(segment, a, contact.fraction));
  }
  const bool is_moving = contact.body >= 0;  // then the drone rebounds in the frame of the surface
  const auto solids = is_moving ? bodies_near(segment.from.position, (segment.to.position - segment.from.position).norm())
                                : std::span<const MovingSolid>();
  const auto touches = [&](const Vec3& point, float reach) {
    if (!is_moving) return obstacles_->touches(point, reach);
    const collision::Vec3d center = point.cast<double>();
    return std::ranges::any_of(solids, [&](const MovingSolid& solid) {
      return solid.index() == contact.body &&
             (collision::closest_point(solid.at(event.time), center) - center).norm() < static_cast<double>(reach);
    });
  };
  ContactPoints& touching = points_of(a, kNone, contact.body, contact.fraction);
  touching.add(touches, hull_, pose, contact);
  Velocity hit = velocity_between(segment.first, segment.last, contact.fraction), end = segment.last;
  const Vec3 surface = contact.velocity / static_cast<float>(each.motion.duration_s);
  if (is_moving) hit.linear -= surface, end.linear -= surface;
  Rebound result = thrown_back(hit, end, left_s, pose, touching.points(), *each.airframe, surface_of(*config_));
  if (is_moving) result.after.linear += surface, result.at_end.linear += surface;
  rebound(a, event.time, left_s, pose, result.after, result.at_end);
}

void ContactResolver::hit_drone(const Event& event) {
  const std::array both{event.a, event.b};
  const MovingContact& contact = event.contact;
  const double left_s = (1.0 - event.time) * drone(event.a).motion.duration_s;
  std::array<Pose, 2> poses;
  std::array<Velocity, 2> hits, ends;
  for (std::size_t i = 0; i < 2; ++i) {
    const Segment& segment = segments_[both[i]];
    poses[i] =
        segment.rests() ? segment.from : collision::interpolate(pose_at(both[i], event.begin), segment.to, contact.fraction);
    const auto share = static_cast<float>(segment.begin < 1.0 ? (event.time - segment.begin) / (1.0 - segment.begin) : 1.0);
    hits[i] = velocity_between(segment.first, segment.last, share);
    ends[i] = segment.last;
  }
  const double at = contact.inside ? event.begin : event.time;
  std::array<MovingContact, 2> contacts{contact, contact};
  contacts[1].normal = -contact.normal;
  for (std::size_t i = 0; i < 2; ++i) {
    contacts[i].velocity = surface_velocity(both[1 - i], at, contact.point);
    record(both[i], contacts[i], event.time, number(both[1 - i]));
  }
  if (stops_) {
    for (std::size_t i = 0; i < 2; ++i) stop(both[i], event.time, left_s, poses[i], ends[i]);
    return;
  }
  const auto touches = [&](std::size_t i) {
    return [this, &pose = poses[i]](const Vec3& point, float reach) { return is_near(pose, point, reach); };
  };
  ContactPoints& touching = points_of(both[0], both[1], -1, contact.fraction);
  touching.add(touches(1), hull_, poses[0], contact);
  touching.add_vertices(touches(0), hull_, poses[1], contact, -1.0F);
  const ContactMaterial surface = surface_of(*config_);
  for (std::size_t i = 0; i < 2; ++i) {
    if (!drone(both[i]).is_fixed) continue;
    const std::size_t free = 1 - i;
    if (free == 1) touching.turn_round();
    manifolds_[both[0]].b = kNone;  // another contact of these drones starts with none
    const Rebound result =
        thrown_back(hits[free], ends[free], left_s, poses[free], touching.points(), *drone(both[free]).airframe, surface);
    return rebound(both[free], event.time, left_s, poses[free], result.after, result.at_end);
  }
  const Airframe &first = *drone(both[0]).airframe, &second = *drone(both[1]).airframe;
  auto results =
      thrown_apart({poses[0], first, hits[0], ends[0]}, {poses[1], second, hits[1], ends[1]}, left_s, touching.points(), surface);
  const auto is_stuck = [&](std::size_t i) {
    return segments_[both[i]].contacts >= kMaxContacts && is_same(poses[i], drone(both[i]).motion.from);
  };
  if (is_stuck(0) || is_stuck(1)) {
    const auto joined = moved_together({poses[0], first, results[0].after, {}}, {poses[1], second, results[1].after, {}});
    for (std::size_t i = 0; i < 2; ++i) results[i] = {joined[i], joined[i]};
  }
  for (std::size_t i = 0; i < 2; ++i) rebound(both[i], event.time, left_s, poses[i], results[i].after, results[i].at_end);
}

// Returns up to which range (m) around a hull at this position the gathered moving objects are all.
float ContactResolver::known_range(const Vec3& origin) const {
  const float farther = margin(origin.cwiseAbs().maxCoeff()) - margin(near_origin_.cwiseAbs().maxCoeff());
  return near_range_m_ - (origin - near_origin_).norm() - farther;
}

// At least the moving objects within range of a hull at this position. Valid until the next call.
std::span<const MovingSolid> ContactResolver::bodies_near(const Vec3& origin, float range_m) {
  if (bodies_.count != 0 && !(known_range(origin) >= range_m)) {
    near_origin_ = origin;
    near_range_m_ = range_m;
    near_bodies_ = near_.gather(bodies_, origin, hull_.radius() + margin(origin.cwiseAbs().maxCoeff()) + range_m);
  }
  return bodies_.count != 0 ? near_bodies_ : std::span<const MovingSolid>();
}

// The same for a drone at the beginning of its segment, and also the other drones at the end of their motions.
std::span<const MovingSolid> ContactResolver::solids_near(std::size_t a, float range_m) {
  const Vec3& origin = segments_[a].from.position;
  const auto bodies = bodies_near(origin, range_m);
  if (segments_.size() == 1) return bodies;
  const float around = 2.0F * hull_.radius() + margin(origin.cwiseAbs().maxCoeff()) + range_m;
  solids_.assign(bodies.begin(), bodies.end());
  for (std::size_t b = 0; b < segments_.size(); ++b) {
    const Pose& pose = segments_[b].to;
    if (b == a || (pose.position - origin).norm() > around) continue;
    solids_.emplace_back(corners_, pose, pose, static_cast<int>(bodies_.count + b));
  }
  return solids_;
}

// Lets moving objects push a drone that stands until the end of the tick. The other drones are at the end of their motions and
// act as obstacles.
void ContactResolver::push(std::size_t a) {
  Segment& segment = segments_[a];
  GroupMember& each = drone(a);
  collision::Push pushed;
  for (float range = std::max(known_range(segment.from.position), 0.0F);; range = 2.0F * pushed.farthest) {
    pushed = collision::push(*obstacles_, solids_near(a, range), hull_, segment.from, segment.begin);
    if (!(pushed.farthest > range)) break;
  }
  each.reach = std::max(each.reach, (segment.from.position - each.motion.from.position).norm() + pushed.farthest);
  if (pushed.pushed) {
    near_range_m_ = -1.0F;  // exactly those in range, whatever was gathered for other drones
    const double most = fastest_of(bodies_near(segment.from.position, pushed.farthest)) * (1.0 - segment.begin);
    segment.last.linear = pushed_along(segment.last.linear, pushed.pose.position - segment.from.position, most, segment.left_s);
    each.is_deflected = true;
  }
  segment.to = pushed.pose;
  if (!pushed.jammed) return;
  each.contact.inside = segment.is_inside = true;
  segment.last = {};
  each.is_deflected = true;
}

// Moves a drone that is inside something at the end of the tick towards the way out.
void ContactResolver::move_out(std::size_t a) {
  Segment& segment = segments_[a];
  GroupMember& each = drone(a);
  const float outwards = each.contact.normal.dot(segment.to.position - each.motion.from.position);
  const double most = kSpeedOut * each.motion.duration_s - static_cast<double>(std::max(outwards, 0.0F));
  segment.from = segment.to;
  const auto solids = solids_near(a, static_cast<float>(kSpeedOut * each.motion.duration_s));
  segment.to = collision::led_out(*obstacles_, solids, hull_, segment.from, most);
  each.is_deflected = true;
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

void write_contact(State& state, DroneIndex drone, const GroupMember& member) {
  write_contact(state, drone, static_cast<const collision::Contact&>(member.contact));
  state.contact.body[drone] = member.contact.body;
  state.contact.drone[drone] = member.other;
  std::copy_n(member.contact.velocity.data(), 3, state.contact.surface_velocity.data() + 3 * drone);
}

}  // namespace flockstep::dynamics
