#include "dynamics/contact.hpp"

#include <algorithm>
#include <array>
#include <cstddef>
#include <limits>
#include <span>

#include "dynamics/impact.hpp"

namespace flockstep::dynamics {
namespace {

static_assert(kMostPoints == kMaxHullVertices + 1);

// Points of the hull that touch the obstacle, m, world frame. If a face lies flat, these are all its corners.
class ContactPoints {
 public:
  // Inside an obstacle the points are the deepest vertices. All points are projected onto the hit surface and deduplicated:
  // points off its plane, or a millimetre apart, would act as tiny levers that keep the body from turning.
  ContactPoints(const collision::Obstacles& obstacles, const collision::Hull& hull, const Pose& pose,
                const collision::Contact& contact) {
    const auto vertex = [&](int i) { return Vec3(hull.vertex(i).cast<float>()); };
    const auto above_surface = [&](int i) {
      return contact.normal.dot(pose.position + pose.rotation * vertex(i) - contact.point);
    };
    float level = 0.0F;
    if (contact.inside) {
      for (int i = 0; i < hull.count(); ++i) level = std::min(level, above_surface(i));
    } else {
      add(contact.point);
    }
    const float near = margin(pose.position.cwiseAbs().maxCoeff());
    for (int i = 0; i < hull.count(); ++i) {
      const float above = above_surface(i) - level;
      if (above >= near) continue;
      const Vec3 point = pose.position + pose.rotation * vertex(i);
      if (!contact.inside && !obstacles.touches(point, near)) continue;
      const Vec3 on_surface = point - above * contact.normal;
      if (count_ > 0 && (on_surface - points_[0]).norm() < near) {
        points_[0] = on_surface;
      } else {
        add(on_surface);
      }
    }
  }

  std::span<const Vec3> points() const { return std::span(points_).first(count_); }

 private:
  void add(const Vec3& point) { points_[count_++] = point; }

  std::array<Vec3, kMostPoints> points_;
  std::size_t count_ = 0;
};

Surface surface_of(const DynamicsConfig& config) {
  if (config.on_contact == OnContact::stop) return {0.0, std::numeric_limits<double>::infinity()};
  return {static_cast<double>(config.restitution), static_cast<double>(config.friction)};
}

}  // namespace

ContactResult resolve_contacts(const collision::Obstacles& obstacles, const Body& body, const DynamicsConfig& config,
                               const TickMotion& motion) {
  constexpr int kMostContacts = 3;  // per tick: two walls and their corner
  const bool terminates = config.on_contact == OnContact::terminate;
  Pose from = motion.from, to = motion.to;
  Velocity begin = motion.begin, end = motion.end;
  double left_s = motion.duration_s;
  ContactResult result;
  for (int contacts = 0; contacts < kMostContacts; ++contacts) {
    const collision::Contact contact = collision::sweep(obstacles, body.hull, from, to);
    if (contact.hit) result.contact = contact;
    if (!contact.hit || (contact.inside && contact.fraction == 1.0F && !terminates)) {
      if (contacts > 0) result.pose = to, result.velocity = end;
      return result;
    }
    result.is_deflected = true;
    from = collision::interpolate(from, to, contact.fraction);
    if (terminates) {
      result.pose = from;
      result.velocity = end;
      return result;
    }
    const float share = contact.fraction;
    const Velocity hit{begin.linear + share * (end.linear - begin.linear), begin.angular + share * (end.angular - begin.angular)};
    left_s *= 1.0 - static_cast<double>(share);
    const ContactPoints touching(obstacles, body.hull, from, contact);
    const Rebound rebound =
        thrown_back(hit, end, left_s, from, touching.points(), contact.normal, body.airframe, surface_of(config));
    begin = rebound.after;
    end = rebound.at_end;
    const auto time = static_cast<float>(0.5 * left_s);
    const Vec3 turn = time * (begin.angular + end.angular);
    const float angle = turn.norm();
    to = {from.position + time * (begin.linear + end.linear),
          angle > 0.0F ? (from.rotation * Quat(Eigen::AngleAxisf(angle, turn / angle))).normalized() : from.rotation};
  }
  // After kMostContacts the drone stays at the last contact. Inside an obstacle its velocity is 0, since forces must not
  // accelerate it there.
  result.pose = from;
  result.velocity = result.contact.inside ? Velocity{} : begin;
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
  const Vec3 velocity = contact.velocity / static_cast<float>(duration_s);
  std::copy_n(velocity.data(), 3, state.contact.surface_velocity.data() + 3 * drone);
}

}  // namespace flockstep::dynamics
