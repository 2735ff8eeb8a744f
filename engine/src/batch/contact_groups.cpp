#include "batch/contact_groups.hpp"

#include <algorithm>
#include <cmath>
#include <cstring>

#include "base/pose_access.hpp"
#include "batch/flying.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "dynamics/rotor_motion.hpp"
#include "flockstep/arrays.hpp"

namespace flockstep {
namespace {

// Calls f(values, columns) for each array of a state that motion of drones changes.
template <class S, class F>
void for_each_moved(S& state, const F& f) {
  f(state.position, std::size_t{3});
  f(state.quat_wxyz, std::size_t{4});
  const auto each = [&](const auto&, auto& values) {
    if (!values.empty()) f(values, values.size() / state.active.size());
  };
  for_each_listed(state.contact, each);
  for_each_listed(state.flight, each);
}

// Returns the distance of two segments. C. Ericson, "Real-Time Collision Detection", 2005, 5.1.9.
float distance_of_segments(const Vec3& p, const Vec3& way_p, const Vec3& q, const Vec3& way_q) {
  constexpr float kPoint = 1e-12F;  // m^2; shorter segments are points
  const Vec3 apart = p - q;
  const float a = way_p.squaredNorm(), e = way_q.squaredNorm(), f = way_q.dot(apart), c = way_p.dot(apart);
  const float b = way_p.dot(way_q), parallel = a * e - b * b;
  float s = a > kPoint && parallel > kPoint * a * e ? std::clamp((b * f - c * e) / parallel, 0.0F, 1.0F) : 0.0F;
  const float t = e > kPoint ? std::clamp((b * s + f) / e, 0.0F, 1.0F) : 0.0F;
  s = a > kPoint ? std::clamp((b * t - c) / a, 0.0F, 1.0F) : 0.0F;
  return (apart + s * way_p - t * way_q).norm();
}

// Returns the share of their time at which two drones on paths may first come nearer than near_m; above 1: never. Both move at
// the same time, so one moves uniformly past the other.
float first_time_near(const LinearPath& a, const LinearPath& b, float near_m) {
  constexpr float kEarlier = 1e-3F;  // more than the rounding
  constexpr float kNever = 2.0F;
  const Vec3 apart = a.from - b.from, way = a.way - b.way;
  const float excess = apart.squaredNorm() - near_m * near_m, closing = -apart.dot(way), length2 = way.squaredNorm();
  if (!(excess > 0.0F)) return 0.0F;
  const float square = closing * closing - length2 * excess;
  if (!(closing > 0.0F && square >= 0.0F)) return kNever;
  return excess / (closing + std::sqrt(square)) - kEarlier;
}

// The drones of one env.
class EnvGroup {
 public:
  EnvGroup(Simulation& sim, EnvIndex env, Scratch& scratch)
      : sim_(sim), env_(env), work_(*scratch.contact_groups), contacts_(scratch.flight.contacts), count_(sim.drones_per_env()) {
    work_.is_in_group.assign(count_, 0);
    work_.paths.assign(count_, {});
    work_.centers.resize(3 * count_);
    work_.radii.resize(count_);
    work_.found.resize(count_ + trace::BallColumns::kPadding);
    work_.members.resize(count_);
    work_.group.reserve(count_);
    work_.movers.reserve(count_);
    work_.joining.reserve(count_);
  }

  std::size_t count() const { return count_; }
  DroneIndex drone(std::size_t member) const { return sim_.drone_of(env_, member); }
  std::size_t member_of(DroneIndex of) const { return std::size_t{of} - std::size_t{drone(0)}; }
  bool is_active(std::size_t member) const { return sim_.state.active[drone(member)] != 0; }

  // Returns a distance (m) of two drones beyond which they cannot touch.
  float near_m(const Vec3& p, const Vec3& q) const {
    return 2.0F * sim_.hull.radius() + dynamics::margin(p.cwiseAbs().maxCoeff() + q.cwiseAbs().maxCoeff());
  }

  // Calls f(a, b, near_m) for each pair of active drones that may touch on their paths; near_m includes the deviations.
  template <class F>
  void for_each_near_pair(const F& f) {
    for (std::size_t member = 0; member < count_; ++member) {
      const LinearPath& path = work_.paths[member];
      const Vec3 center = path.from + 0.5F * path.way;
      Vec3::Map(work_.centers.data() + 3 * member) = center;
      work_.radii[member] = is_active(member) ? sim_.hull.radius() + 0.5F * path.way.norm() + path.deviation +
                                                    dynamics::margin(center.cwiseAbs().maxCoeff())
                                              : -1.0F;
    }
    work_.balls.sort({work_.centers.data(), work_.radii.data(), count_});
    work_.balls.for_each_pair([&](std::size_t a, std::size_t b) {
      const LinearPath &first = work_.paths[a], &second = work_.paths[b];
      f(a, b, near_m(first.from, second.from) + (first.deviation + second.deviation));
    });
  }

  // Takes all drones into the group that may touch another one, if each may stop anywhere on its path. Returns false if none is
  // new.
  bool gather() {
    bool is_new = false;
    for_each_near_pair([&](std::size_t a, std::size_t b, float near) {
      const LinearPath &first = work_.paths[a], &second = work_.paths[b];
      if (work_.is_in_group[a] && work_.is_in_group[b]) return;
      if (distance_of_segments(first.from, first.way, second.from, second.way) > near) return;
      work_.is_in_group[a] = work_.is_in_group[b] = 1;
      is_new = true;
    });
    return is_new;
  }

  // Adds a drone to the group. It stands.
  void prepare(std::size_t member) {
    const DroneIndex d = drone(member);
    dynamics::GroupMember& each = work_.members[member];
    const Pose pose = pose_of(sim_.state, d);
    each.number = static_cast<std::uint32_t>(member);
    each.airframe = sim_.fleet ? &sim_.fleet->true_airframe_of(d) : nullptr;
    each.motion = dynamics::standing(pose, sim_.config.clock.dt_s());
    each.is_open = each.has_contact = false;
    each.is_fixed = true;
    work_.group.push_back(&each);
  }

  void resolve() {
    contacts_.resolve(work_.group, *sim_.obstacles[sim_.slot_of(env_)],
                      sim_.bodies ? sim_.bodies->moving().of_env(env_, sim_.bodies->per_env()) : collision::MovingBodies(),
                      sim_.config.dynamics);
  }

 private:
  Simulation& sim_;
  EnvIndex env_;
  ContactGroups& work_;
  dynamics::ContactResolver& contacts_;
  std::size_t count_;
};

// Drones of one env that have flown a leg, some of which fly again as a contact group.
class ContactFlight {
 public:
  // drones: those of the env that have flown. copy: of drone 0. context: for drones in any order.
  ContactFlight(Simulation& sim, EnvIndex env, std::span<const DroneIndex> drones, std::size_t copy,
                const dynamics::FlightContext& context, const dynamics::Commands& commands, int first_tick, int ticks,
                Scratch& scratch)
      : sim_(sim),
        group_(sim, env, scratch),
        drones_(drones),
        copy_(copy),
        context_(context),
        commands_(commands),
        first_tick_(first_tick),
        ticks_(ticks),
        work_(*scratch.contact_groups) {}

  void fly() {
    if (!find_first_near()) return;
    for (int tick = *std::ranges::min_element(work_.first_near); tick < ticks_; ++tick) {
      work_.group.clear();
      work_.movers.clear();
      work_.joining.clear();
      for (std::size_t member = 0; member < group_.count(); ++member) {
        if (work_.is_in_group[member]) {
          prepare(member);
        } else if (work_.first_near[member] <= tick) {
          work_.is_in_group[member] = 1;
          work_.joining.push_back(static_cast<std::uint32_t>(member));
        }
      }
      record(tick);
      do {
        join(tick);
        group_.resolve();
      } while (find_joining(tick));
      for (const dynamics::GroupMember* const each : work_.group) {
        dynamics::write_result(context_, group_.drone(each->number), *each, first_tick_ + tick);
      }
    }
  }

 private:
  // Returns false if no drones may have touched.
  bool find_first_near() {
    for (std::size_t member = 0; member < group_.count(); ++member) {
      const Vec3 from = work_.saved.position(copy_ + member);
      const DroneIndex drone = group_.drone(member);
      work_.paths[member] = {from, Vec3::Map(sim_.state.position.data() + 3 * drone) - from, sim_.deviation[drone]};
    }
    work_.first_near.assign(group_.count(), ticks_);
    bool is_any = false;
    group_.for_each_near_pair([&](std::size_t a, std::size_t b, float near) {
      const float time = first_time_near(work_.paths[a], work_.paths[b], near);
      if (time > 1.0F) return;
      const int tick = std::clamp(static_cast<int>(std::floor(time * static_cast<float>(ticks_))), 0, ticks_ - 1);
      for (const std::size_t member : {a, b}) work_.first_near[member] = std::min(work_.first_near[member], tick);
      is_any = true;
    });
    return is_any;
  }

  void prepare(std::size_t member) {
    group_.prepare(member);
    const DroneIndex drone = group_.drone(member);
    const bool is_mover = std::ranges::binary_search(drones_, drone);
    const bool keeps_contact = !is_mover || sim_.config.dynamics.on_contact == OnContact::terminate;
    work_.members[member].has_contact = keeps_contact && sim_.state.contact.hit[drone];
    if (is_mover) work_.movers.push_back(drone);
  }

  // Flies the prepared drones through a tick, without contacts with each other.
  void record(int tick) {
    dynamics::record_motions(context_, work_.movers, commands_, first_tick_ + tick, {group_.drone(0), work_.members});
    work_.movers.clear();
  }

  // Puts the joining drones back and flies them until the tick, and through it.
  void join(int tick) {
    for (const std::uint32_t member : work_.joining) {
      const DroneIndex drone = group_.drone(member);
      work_.saved.restore(sim_.state, drone, copy_ + member);
      if (std::ranges::binary_search(drones_, drone)) work_.movers.push_back(drone);
    }
    if (tick > 0 && !work_.movers.empty()) dynamics::fly(context_, work_.movers, commands_, first_tick_, tick);
    work_.movers.clear();
    for (const std::uint32_t member : work_.joining) prepare(member);
    record(tick);
  }

  // Finds the drones that one of the group may touch in this tick, but that do not belong to it.
  bool find_joining(int tick) {
    const float per_tick = 1.0F / static_cast<float>(ticks_);
    work_.joining.clear();
    for (const dynamics::GroupMember* const each : work_.group) {
      const Vec3& from = each->motion.from.position;
      const float range = sim_.hull.radius() + each->reach + dynamics::margin(from.cwiseAbs().maxCoeff());
      const std::size_t count = work_.balls.find(from, range, work_.found.data());
      for (const std::uint32_t member : std::span(work_.found).first(count)) {
        if (work_.is_in_group[member]) continue;
        const LinearPath& path = work_.paths[member];
        const Vec3 there = path.from + (static_cast<float>(tick) + 0.5F) * per_tick * path.way;
        const float near = group_.near_m(from, there) + each->reach + path.deviation + 0.5F * per_tick * path.way.norm();
        if ((from - there).norm() > near) continue;
        work_.is_in_group[member] = 1;
        work_.joining.push_back(member);
      }
    }
    std::ranges::sort(work_.joining);
    return !work_.joining.empty();
  }

  Simulation& sim_;
  EnvGroup group_;
  std::span<const DroneIndex> drones_;
  std::size_t copy_;
  const dynamics::FlightContext& context_;
  const dynamics::Commands& commands_;
  int first_tick_, ticks_;
  ContactGroups& work_;
};

}  // namespace

std::size_t SavedDrones::save(const State& state, DroneIndex first, std::size_t count, std::span<std::uint8_t> bad) {
  const std::size_t copy = count_;
  count_ += count;
  bad_ = bad;
  saved_bad_.resize(count_);
  if (!bad.empty()) std::copy_n(bad.data() + first, count, saved_bad_.data() + copy);
  std::size_t number = 0;
  for_each_moved(state, [&](const auto& values, std::size_t columns) {
    const std::size_t bytes = columns * sizeof(values[0]);
    if (number == arrays_.size()) arrays_.emplace_back();
    std::vector<std::byte>& to = arrays_[number++];
    if (to.size() < count_ * bytes) to.resize(count_ * bytes);
    std::memcpy(to.data() + copy * bytes, values.data() + columns * first, count * bytes);
  });
  return copy;
}

void SavedDrones::restore(State& state, DroneIndex drone, std::size_t copy) const {
  if (!bad_.empty()) bad_[drone] = saved_bad_[copy];
  std::size_t number = 0;
  for_each_moved(state, [&](auto& values, std::size_t columns) {
    const std::size_t bytes = columns * sizeof(values[0]);
    std::memcpy(values.data() + columns * drone, arrays_[number++].data() + copy * bytes, bytes);
  });
}

Vec3 SavedDrones::position(std::size_t copy) const {
  Vec3 position;
  std::memcpy(position.data(), arrays_[0].data() + copy * sizeof(position), sizeof(position));
  return position;
}

void move_in_groups(Simulation& sim, EnvIndex env, std::span<const MoveRequest> moves, Scratch& scratch) {
  ContactGroups& work = *scratch.contact_groups;
  EnvGroup group(sim, env, scratch);
  for (std::size_t member = 0; member < group.count(); ++member) {
    work.paths[member].from = pose_of(sim.state, group.drone(member)).position;
  }
  // Without bodies, which push, a drone stays on the segment to its target, whenever it stops. With them it must be moved to find
  // out how far it comes.
  bool is_touching = false;
  work.saved.clear();
  if (sim.bodies) {
    work.saved.save(sim.state, group.drone(0), group.count());
  } else {
    for (const MoveRequest& move : moves) {
      LinearPath& path = work.paths[group.member_of(move.drone)];
      if (!move.has_contact) path.way = move.target.position - path.from;
    }
    is_touching = group.gather();
  }
  std::size_t next = 0;
  for (std::size_t member = 0; member < group.count(); ++member) {
    const DroneIndex drone = group.drone(member);
    float& deviation = work.paths[member].deviation;
    if (next < moves.size() && moves[next].drone == drone) {
      const MoveRequest& move = moves[next++];
      sim.state.contact.drone[drone] = move.has_contact ? sim.state.contact.drone[drone] : -1;
      if (work.is_in_group[member]) continue;
      const float reach = move.has_contact ? give_way(sim, drone, scratch) : sweep_to(sim, drone, move.target, scratch);
      if (sim.bodies) deviation = reach;
    } else if (sim.bodies && sim.state.active[drone]) {
      deviation = give_way(sim, drone, scratch);
    }
  }
  if (sim.bodies) is_touching = group.gather();
  while (is_touching) {
    work.group.clear();
    for (std::size_t member = 0; member < group.count(); ++member) {
      if (!work.is_in_group[member]) continue;
      if (sim.bodies) work.saved.restore(sim.state, group.drone(member), member);
      group.prepare(member);
      work.members[member].has_contact = sim.state.contact.hit[group.drone(member)] != 0;
    }
    for (const MoveRequest& move : moves) {
      dynamics::GroupMember& each = work.members[group.member_of(move.drone)];
      each.has_contact = move.has_contact;
      if (!move.has_contact) each.motion.to = move.target;
    }
    group.resolve();
    for (const dynamics::GroupMember* const each : work.group) {
      write_moved(sim, group.drone(each->number), *each);
      if (sim.bodies) work.paths[each->number].deviation = each->reach;
    }
    is_touching = sim.bodies && group.gather();
  }
}

void fly_in_groups(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                   int first_tick, int ticks, Scratch& scratch) {
  constexpr std::size_t kTogether = 64;  // drones that fly together, at least one env
  ContactGroups& work = *scratch.contact_groups;
  const std::size_t count = sim.drones_per_env();
  dynamics::FlightContext context = flight_context(sim, block, scratch);
  const dynamics::DroneRange own = context.own;  // the drones of a group do not follow each other
  while (!drones.empty()) {
    // Some whole envs of the list
    std::size_t taken = 0;
    EnvIndex last = sim.env_of(drones.front());
    work.saved.clear();
    work.envs.clear();
    while (taken < drones.size()) {
      const EnvIndex env = sim.env_of(drones[taken]);
      if (taken > 0 && env != last && taken + count > kTogether) break;
      last = env;
      work.saved.save(sim.state, sim.drone_of(env, 0), count, context.bad);
      work.envs.push_back(env);
      while (taken < drones.size() && sim.env_of(drones[taken]) == env) ++taken;
    }
    const auto together = drones.first(taken);
    drones = drones.subspan(taken);
    for (const EnvIndex env : work.envs) {
      std::fill_n(sim.deviation.data() + sim.drone_of(env, 0), count, 0.0F);
    }
    try {
      context.deviation = sim.deviation;
      context.own = own;
      dynamics::fly(context, together, commands, first_tick, ticks);
      context.deviation = {};
      context.own = {};
      std::size_t copy = 0;
      for_each_env(sim, together, [&](EnvIndex env, std::span<const DroneIndex> listed) {
        if (sim.bodies) {
          for (std::size_t member = 0; member < count; ++member) {
            const DroneIndex drone = sim.drone_of(env, member);
            if (!sim.state.active[drone] || std::ranges::binary_search(listed, drone)) continue;
            sim.deviation[drone] = 2.0F * give_way(sim, drone, scratch);
          }
        }
        ContactFlight(sim, env, listed, copy, context, commands, first_tick, ticks, scratch).fly();
        copy += count;
      });
    } catch (...) {  // an interrupt: some drones may have flown through others
      for (std::size_t i = 0; i < count * work.envs.size(); ++i) {
        work.saved.restore(sim.state, sim.drone_of(work.envs[i / count], i % count), i);
      }
      throw;
    }
  }
}

}  // namespace flockstep
