#include "dynamics/crowd.hpp"

#include <algorithm>
#include <array>
#include <numeric>
#include <tuple>

#include "base/interrupt.hpp"
#include "collision/convex.hpp"
#include "collision/moving_bodies.hpp"
#include "dynamics/impact.hpp"
#include "dynamics/rebound.hpp"

namespace flockstep::dynamics {
namespace {

using collision::MovingContact;
using collision::MovingSolid;

// Sorts by what drones do, not by their numbers, which only decide between equal motions.
auto order_of(const Neighbor& drone) {
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

Crowd::Crowd(const collision::Hull& hull, const collision::Corners& corners)
    : hull_(hull), corners_(corners), planes_(vertices_of(hull)) {}

void Crowd::resolve(std::span<Neighbor* const> drones, const collision::Obstacles& obstacles,
                    const collision::MovingBodies& bodies, const DynamicsConfig& config) {
  drones_ = drones;
  obstacles_ = &obstacles;
  bodies_ = bodies;
  config_ = &config;
  stops_ = config.is_kinematic() || config.on_contact == OnContact::terminate;
  meetings_.clear();
  touched_.resize(std::max(touched_.size(), drones.size()));
  order_.resize(drones.size());
  std::iota(order_.begin(), order_.end(), std::size_t{0});
  std::ranges::sort(order_, [&](std::size_t a, std::size_t b) {
    const float x = drones[a]->motion.from.position.x(), other_x = drones[b]->motion.from.position.x();
    return x != other_x ? x < other_x : order_of(*drones[a]) < order_of(*drones[b]);
  });
  legs_.assign(drones.size(), {});
  farthest_ = 0.0F;
  for (std::size_t i = 0; i < drones.size(); ++i) {
    Neighbor& each = drone(i);
    touched_[i].points.clear();
    const TickMotion& motion = each.motion;
    legs_[i] = {.from = motion.from, .to = motion.to, .first = motion.begin, .last = motion.end};
    legs_[i].stands = each.has_contact;
    set_box(legs_[i]);
    each.is_deflected = false;
    each.contact = {};
    each.other = -1;
    each.reach = (motion.to.position - motion.from.position).norm();
    farthest_ = std::max(farthest_, each.reach);
  }
  // From here on drones are numbered by the order, which is that of their x.
  for (std::size_t a = 0; a < legs_.size(); ++a) {
    Interrupt::poll();  // a dense crowd takes seconds
    find_with_world(a);
    const float end = began(a).x() + widest_gap(a);
    for (std::size_t b = a + 1; b < legs_.size() && began(b).x() <= end; ++b) find_with_drone(a, b);
  }
  while (!meetings_.empty()) {
    Interrupt::poll();
    const auto first = std::ranges::min_element(meetings_, [](const Meeting& x, const Meeting& y) {
      return std::tuple(x.time, x.a, x.b) < std::tuple(y.time, y.a, y.b);
    });
    meet(Meeting(*first));
  }
  for (std::size_t a = 0; a < legs_.size(); ++a) {
    if (bodies_.count != 0 && (legs_[a].stands || legs_[a].rests())) push(a);
  }
  for (std::size_t a = 0; a < legs_.size(); ++a) {
    if (!stops_ && !drone(a).holds && !drone(a).has_contact && drone(a).contact.inside) move_out(a);
  }
  for (std::size_t a = 0; a < legs_.size(); ++a) {
    Neighbor& each = drone(a);
    each.pose = legs_[a].to;
    each.velocity = legs_[a].last;
    if (each.contact.body >= 0) each.contact.velocity /= static_cast<float>(each.motion.duration_s);  // that of drones is in m/s
    each.reach = std::max(each.reach, (each.pose.position - each.motion.from.position).norm());
  }
}

// Returns a distance (m) of the beginnings of two drones beyond which they cannot touch so far.
float Crowd::widest_gap(std::size_t a) const {
  return 2.0F * (hull_.radius() + farthest_ + margin(began(a).cwiseAbs().maxCoeff()));
}

void Crowd::set_box(Leg& leg) const {
  constexpr float kTurnPerChange =
      2.25F;  // an upper bound of a turn (rad) over the distance of the quaternions, at most pi / sqrt(2)
  const auto &from = leg.from.rotation.coeffs(), &to = leg.to.rotation.coeffs();
  const float turn = kTurnPerChange * std::min((to - from).norm(), (to + from).norm());
  const Vec3 half = leg.from.rotation.toRotationMatrix().cwiseAbs() * planes_.half_extents +
                    Vec3::Constant(turn * hull_.radius() + margin(leg.from.position.cwiseAbs().maxCoeff()));
  leg.low = leg.from.position.cwiseMin(leg.to.position) - half;
  leg.high = leg.from.position.cwiseMax(leg.to.position) + half;
}

// Returns true if a point is nearer than `reach` (m) to the planes of all faces of a drone, or on their inner sides.
bool Crowd::is_near(const Pose& pose, const Vec3& point, float reach) const {
  const Vec3 local = pose.rotation.conjugate() * (point - pose.position);
  for (std::size_t i = 0; i < planes_.count; ++i) {
    if (planes_.x[i] * local.x() + planes_.y[i] * local.y() + planes_.z[i] * local.z() - planes_.offset[i] >= reach) return false;
  }
  return true;
}

Pose Crowd::pose_at(std::size_t a, double time) const {
  const Leg& leg = legs_[a];
  if (leg.rests() || time <= leg.begin) return leg.from;
  return collision::interpolate(leg.from, leg.to, static_cast<float>((time - leg.begin) / (1.0 - leg.begin)));
}

// Velocity in m/s of the point of a drone that is at `point` at a time.
Vec3 Crowd::surface_velocity(std::size_t a, double time, const Vec3& point) const {
  const Leg& leg = legs_[a];
  if (leg.rests() || !(leg.begin < 1.0)) return Vec3::Zero();
  const double share = (time - leg.begin) / (1.0 - leg.begin);
  const MovingSolid solid(corners_, leg.from, leg.to, 0);
  return (solid.velocity(point.cast<double>(), share) / left_s(leg.begin)).cast<float>();
}

void Crowd::find_with_world(std::size_t a) {
  const Leg& leg = legs_[a];
  if (leg.stands || (leg.is_first && drone(a).is_open)) return;
  if (leg.rests() && bodies_.count == 0 && !leg.is_first) return;
  const auto solids = solids_near(a, (leg.to.position - leg.from.position).norm(), false);
  const MovingContact contact = collision::first_contact(*obstacles_, solids, hull_, leg.from, leg.to, leg.begin);
  if (!contact.hit) return;
  if (contact.inside && contact.fraction == 1.0F) return note(a, contact, -1);
  const double time = leg.begin + static_cast<double>(contact.fraction) * (1.0 - leg.begin);
  meetings_.push_back({time, leg.begin, a, kNone, contact});
}

void Crowd::find_with_drone(std::size_t a, std::size_t b) {
  const Leg &first = legs_[a], &second = legs_[b];
  if (first.rests() && second.rests()) return;
  if ((first.low.array() > second.high.array()).any() || (second.low.array() > first.high.array()).any()) return;
  const double begin = std::max(first.begin, second.begin);
  const float apart = (first.from.position - second.from.position).norm();
  const float ways = (first.to.position - first.from.position).norm() + (second.to.position - second.from.position).norm();
  const float near = margin(first.from.position.cwiseAbs().maxCoeff() + second.from.position.cwiseAbs().maxCoeff());
  if (apart > ways + 2.0F * hull_.radius() + near) return;
  const Pose from = pose_at(a, begin);
  const MovingSolid other(corners_, pose_at(b, begin), second.to, 0);
  MovingContact contact = collision::first_contact(other, hull_, from, first.to);
  if (!contact.hit) return;
  contact.body = -1;
  const double time = begin + static_cast<double>(contact.fraction) * (1.0 - begin);
  if (!(contact.inside && contact.fraction == 1.0F)) return meetings_.push_back({time, begin, a, b, contact});
  contact.velocity = surface_velocity(b, begin, contact.point);
  note(a, contact, number(b));
  contact.velocity = surface_velocity(a, begin, contact.point);
  contact.normal = -contact.normal;
  note(b, contact, number(a));
}

// Finds what a drone meets on its leg, except one drone.
void Crowd::find_all(std::size_t a, std::size_t except) {
  find_with_world(a);
  const float gap = widest_gap(a), first_x = began(a).x() - gap, last_x = began(a).x() + gap;
  std::size_t first = a;
  while (first > 0 && began(first - 1).x() >= first_x) --first;
  for (std::size_t b = first; b < legs_.size() && began(b).x() <= last_x; ++b) {
    if (b != a && b != except) find_with_drone(std::min(a, b), std::max(a, b));
  }
}

void Crowd::note(std::size_t a, const MovingContact& contact, std::int32_t other) {
  Neighbor& each = drone(a);
  if (each.has_contact || (stops_ && each.contact.hit)) return;
  each.contact = contact;
  each.other = other;
}

void Crowd::stop(std::size_t a, double time, const Pose& pose, const Velocity& velocity) {
  Leg& leg = legs_[a];
  leg = {.begin = time, .from = pose, .to = pose, .first = velocity, .last = velocity, .contacts = leg.contacts};
  leg.is_first = false;
  leg.stands = true;
  set_box(leg);
  drone(a).is_deflected = true;
}

void Crowd::fly_on(std::size_t a, double time, const Pose& pose, const Velocity& after, const Velocity& at_end) {
  Leg& leg = legs_[a];
  Neighbor& each = drone(a);
  const int contacts = leg.contacts + 1;
  if (each.contact.inside && contacts >= kMaxContacts) return stop(a, time, pose, {});
  if (contacts > kMaxContacts) return stop(a, time, pose, after);
  leg = {.begin = time,
         .from = pose,
         .to = pose_after(pose, after, at_end, left_s(time)),
         .first = after,
         .last = at_end,
         .contacts = contacts};
  leg.is_first = false;
  if (contacts == kMaxContacts) {
    const float range = 2.0F * static_cast<float>(largest_move(hull_, pose, leg.to));
    leg.to = moved_aside(*obstacles_, solids_near(a, range, true), hull_, pose, leg.to);
    leg.last = velocity_after(leg, a, 1.0F);
  }
  set_box(leg);
  each.is_deflected = true;
  const float came = (pose.position - each.motion.from.position).norm();
  each.reach = std::max(each.reach, came + (leg.to.position - pose.position).norm());
  farthest_ = std::max(farthest_, each.reach);
}

// The velocity of a drone that has flown a share of its leg, a motion aside.
Velocity Crowd::velocity_after(const Leg& leg, std::size_t a, float share) const {
  const Neighbor& each = drone(a);
  if (each.other >= 0) return share < 1.0F ? leg.first : leg.last;  // the momentum of both drones stays
  const Pose pose = collision::interpolate(leg.from, leg.to, share);
  if (is_same(pose, each.motion.from)) return {};
  const float climb = pose.position.z() - leg.from.position.z();
  return velocity_aside(leg.first, leg.last, share, climb, each.motion, left_s(leg.begin), *each.airframe);
}

void Crowd::meet(const Meeting& meeting) {
  std::erase_if(meetings_, [&](const Meeting& other) {
    const auto is_one_of = [&](std::size_t drone) { return drone != kNone && (drone == meeting.a || drone == meeting.b); };
    return is_one_of(other.a) || is_one_of(other.b);
  });
  if (meeting.b == kNone) {
    meet_world(meeting);
  } else {
    meet_drone(meeting);
    find_all(meeting.b, meeting.a);
  }
  find_all(meeting.a, kNone);
}

// The points at which a drone touches something, to add to: none, if it touched something else before, or has moved since.
ContactPoints& Crowd::points_of(std::size_t a, std::size_t b, int body, float share) {
  Touched& touched = touched_[a];
  const bool has_moved = moved(a, share) > collision::kStandoff || (b != kNone && moved(b, share) > collision::kStandoff);
  if (touched.b != b || touched.body != body || has_moved) touched.points.clear();
  touched.b = b;
  touched.body = body;
  return touched.points;
}

// Returns how far (m) a point of a drone moved in a share of its leg.
double Crowd::moved(std::size_t a, float share) const {
  const Leg& leg = legs_[a];
  return share > 0.0F ? static_cast<double>(share) * largest_move(hull_, leg.from, leg.to) : 0.0;
}

void Crowd::meet_world(const Meeting& meeting) {
  const Leg leg = legs_[meeting.a];
  const Pose pose = collision::interpolate(leg.from, leg.to, meeting.contact.fraction);
  note(meeting.a, meeting.contact, -1);
  const Neighbor& each = drone(meeting.a);
  if (stops_ || each.holds) return stop(meeting.a, meeting.time, pose, leg.last);
  const MovingContact& contact = meeting.contact;
  if (leg.contacts == kMaxContacts && !contact.inside) {
    return stop(meeting.a, meeting.time, pose, velocity_after(leg, meeting.a, contact.fraction));
  }
  const auto solids = solids_near(meeting.a, (leg.to.position - leg.from.position).norm(), false);
  const auto touches = [&](const Vec3& point, float reach) {
    if (contact.body < 0) return obstacles_->touches(point, reach);
    const collision::Vec3d center = point.cast<double>();
    return std::ranges::any_of(solids, [&](const MovingSolid& solid) {
      return solid.index() == contact.body &&
             (collision::closest_point(solid.at(meeting.time), center) - center).norm() < static_cast<double>(reach);
    });
  };
  ContactPoints& touching = points_of(meeting.a, kNone, contact.body, contact.fraction);
  touching.add(touches, hull_, pose, contact);
  Velocity hit = velocity_between(leg.first, leg.last, contact.fraction), end = leg.last;
  const Vec3 surface =
      contact.body >= 0 ? Vec3(contact.velocity / static_cast<float>(each.motion.duration_s)) : Vec3(Vec3::Zero());
  hit.linear -= surface;
  end.linear -= surface;
  Rebound rebound = thrown_back(hit, end, left_s(meeting.time), pose, touching.points(), *each.airframe, surface_of(*config_));
  rebound.after.linear += surface;
  rebound.at_end.linear += surface;
  fly_on(meeting.a, meeting.time, pose, rebound.after, rebound.at_end);
}

void Crowd::meet_drone(const Meeting& meeting) {
  const std::array both{meeting.a, meeting.b};
  const MovingContact& contact = meeting.contact;
  std::array<Pose, 2> poses;
  std::array<Velocity, 2> hits, ends;
  for (std::size_t i = 0; i < 2; ++i) {
    const Leg& leg = legs_[both[i]];
    poses[i] = leg.rests() ? leg.from : collision::interpolate(pose_at(both[i], meeting.begin), leg.to, contact.fraction);
    const auto share = static_cast<float>(leg.begin < 1.0 ? (meeting.time - leg.begin) / (1.0 - leg.begin) : 1.0);
    hits[i] = velocity_between(leg.first, leg.last, share);
    ends[i] = leg.last;
  }
  const double at = contact.inside ? meeting.begin : meeting.time;
  std::array<MovingContact, 2> contacts{contact, contact};
  contacts[1].normal = -contact.normal;
  for (std::size_t i = 0; i < 2; ++i) {
    contacts[i].fraction = static_cast<float>(meeting.time);
    contacts[i].velocity = surface_velocity(both[1 - i], at, contact.point);
    note(both[i], contacts[i], number(both[1 - i]));
  }
  if (stops_) {
    for (std::size_t i = 0; i < 2; ++i) stop(both[i], meeting.time, poses[i], ends[i]);
    return;
  }
  const auto touches = [&](std::size_t i) {
    return [this, &pose = poses[i]](const Vec3& point, float reach) { return is_near(pose, point, reach); };
  };
  ContactPoints& touching = points_of(both[0], both[1], -1, contact.fraction);
  touching.add(touches(1), hull_, poses[0], contact);
  touching.add_vertices(touches(0), hull_, poses[1], contact, -1.0F);
  const Surface surface = surface_of(*config_);
  const double left = left_s(meeting.time);
  for (std::size_t i = 0; i < 2; ++i) {
    if (!drone(both[i]).holds) continue;
    const std::size_t free = 1 - i;
    if (free == 1) touching.turn_round();
    touched_[both[0]].b = kNone;  // another contact of these drones starts with none
    const Rebound rebound =
        thrown_back(hits[free], ends[free], left, poses[free], touching.points(), *drone(both[free]).airframe, surface);
    return fly_on(both[free], meeting.time, poses[free], rebound.after, rebound.at_end);
  }
  const Airframe &first = *drone(both[0]).airframe, &second = *drone(both[1]).airframe;
  auto rebounds =
      thrown_apart({poses[0], first, hits[0], ends[0]}, {poses[1], second, hits[1], ends[1]}, left, touching.points(), surface);
  const auto is_stuck = [&](std::size_t i) {
    return legs_[both[i]].contacts >= kMaxContacts && is_same(poses[i], drone(both[i]).motion.from);
  };
  if (is_stuck(0) || is_stuck(1)) {
    const auto joined = moved_together({poses[0], first, rebounds[0].after, {}}, {poses[1], second, rebounds[1].after, {}});
    for (std::size_t i = 0; i < 2; ++i) rebounds[i] = {joined[i], joined[i]};
  }
  for (std::size_t i = 0; i < 2; ++i) fly_on(both[i], meeting.time, poses[i], rebounds[i].after, rebounds[i].at_end);
}

// The bodies, and on request also the other drones at the end of their motions, that a drone may meet within range. Valid until
// the next call.
std::span<const MovingSolid> Crowd::solids_near(std::size_t a, float range_m, bool with_drones) {
  const Vec3& origin = legs_[a].from.position;
  const float around = hull_.radius() + margin(origin.cwiseAbs().maxCoeff()) + range_m;
  const auto of_bodies = near_.gather(bodies_, origin, around);
  if (!with_drones) return of_bodies;
  solids_.assign(of_bodies.begin(), of_bodies.end());
  for (std::size_t b = 0; b < legs_.size(); ++b) {
    const Pose& pose = legs_[b].to;
    if (b == a || (pose.position - origin).norm() > around + hull_.radius()) continue;
    solids_.emplace_back(corners_, pose, pose, static_cast<int>(bodies_.count + b));
  }
  return solids_;
}

// Lets bodies push a drone that stands until the end of the tick. The other drones are at the end of their motions and act as
// obstacles.
void Crowd::push(std::size_t a) {
  Leg& leg = legs_[a];
  Neighbor& each = drone(a);
  collision::Push pushed;
  for (float range = 0.0F;;) {
    const auto solids = solids_near(a, range, true);
    pushed = collision::push(*obstacles_, solids, hull_, leg.from, leg.begin);
    if (!(pushed.farthest > range)) break;
    range = 2.0F * pushed.farthest;
  }
  each.reach = std::max(each.reach, (leg.from.position - each.motion.from.position).norm() + pushed.farthest);
  if (pushed.pushed) {
    const auto solids = solids_near(a, pushed.farthest, false);
    const double most = fastest_of(solids) * (1.0 - leg.begin);
    leg.last.linear = pushed_along(leg.last.linear, pushed.pose.position - leg.from.position, most, left_s(leg.begin));
    each.is_deflected = true;
  }
  leg.to = pushed.pose;
  if (!pushed.jammed) return;
  each.contact.inside = true;
  leg.last = {};
  each.is_deflected = true;
}

// Moves a drone that is inside something at the end of the tick towards the way out.
void Crowd::move_out(std::size_t a) {
  Leg& leg = legs_[a];
  Neighbor& each = drone(a);
  const float outwards = each.contact.normal.dot(leg.to.position - each.motion.from.position);
  const double most = kSpeedOut * each.motion.duration_s - static_cast<double>(std::max(outwards, 0.0F));
  leg.from = leg.to;
  const auto solids = solids_near(a, static_cast<float>(kSpeedOut * each.motion.duration_s), true);
  const Pose target = collision::cleared(*obstacles_, solids, hull_, leg.from, 1.0, most);
  const MovingContact contact = collision::first_contact(*obstacles_, solids, hull_, leg.from, target, 1.0);
  leg.to = collision::interpolate(leg.from, target, contact.hit ? contact.fraction : 1.0F);
  each.is_deflected = true;
}

void write_contact(State& state, DroneIndex drone, const Neighbor& neighbor) {
  write_contact(state, drone, neighbor.contact, 1.0);
  state.contact.drone[drone] = neighbor.other;
}

}  // namespace flockstep::dynamics
