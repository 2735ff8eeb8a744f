#include "batch/meetings.hpp"

#include <algorithm>
#include <cstring>
#include <tuple>

#include "base/pose_access.hpp"
#include "batch/flying.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "dynamics/rotor_motion.hpp"
#include "flockstep/arrays.hpp"
#include "trace/near_balls.hpp"

namespace flockstep {
namespace {

// Calls f(values, columns) for each array of a state that motion of drones changes.
template <class S, class F>
void for_each_moved(S& state, const F& f) {
  f(state.position, std::size_t{3});
  f(state.quat_wxyz, std::size_t{4});
  const auto each = [&](const auto& entry, auto& values) {
    if (!values.empty()) f(values, entry.info.columns == 0 ? std::size_t{1} : static_cast<std::size_t>(entry.info.columns));
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

// The drones of one env.
class EnvMeeting {
 public:
  EnvMeeting(Simulation& sim, EnvIndex env, Meetings& work, std::size_t copy)
      : sim_(sim), env_(env), work_(work), copy_(copy), count_(sim.drones_per_env()) {
    work_.is_in_crowd.assign(count_, 0);
    work_.sorted.reserve(count_);
    work_.center.resize(3 * count_);
    work_.radius.resize(count_);
    work_.found.resize(count_);
    work_.neighbors.resize(count_);
  }

  // Takes all drones into the crowd that may have touched another one outside of it or in it. Returns false if none is new.
  // reach(member): largest distance from the saved position so far. are_apart(a, b): the ways of two drones are known to be so.
  template <class Reach, class AreApart>
  bool gather(const Reach& reach, const AreApart& are_apart) {
    // Sorted by x, the drones that may be near follow each other.
    work_.sorted.clear();
    float largest = 0.0F;
    for (std::size_t member = 0; member < count_; ++member) {
      if (!sim_.state.active[drone(member)]) continue;
      const Vec3 center = work_.saved.position(copy_ + member);
      const float radius = sim_.hull.radius() + reach(member) + dynamics::margin(center.cwiseAbs().maxCoeff());
      largest = std::max(largest, radius);
      work_.sorted.push_back({center.x(), radius, static_cast<std::uint32_t>(member)});
    }
    std::ranges::sort(work_.sorted, [](const Meetings::Ball& a, const Meetings::Ball& b) {
      return std::tuple(a.x, a.member) < std::tuple(b.x, b.member);
    });
    const std::size_t count = work_.sorted.size();
    for (std::size_t i = 0; i < count; ++i) {
      Vec3::Map(work_.center.data() + 3 * i) = work_.saved.position(copy_ + work_.sorted[i].member);
      work_.radius[i] = work_.sorted[i].radius;
    }
    bool is_new = false;
    std::size_t end = 0;  // of those that may be near
    for (std::size_t i = 0; i < count; ++i) {
      const Meetings::Ball& ball = work_.sorted[i];
      while (end < count && work_.sorted[end].x - ball.x <= ball.radius + largest) ++end;
      end = std::max(end, i + 1);
      const trace::Balls others{work_.center.data() + 3 * (i + 1), work_.radius.data() + i + 1, end - i - 1, count - i - 1};
      const std::size_t member = ball.member;
      const std::size_t near =
          trace::find_near_balls(others, work_.saved.position(copy_ + member), ball.radius, work_.found.data());
      for (const std::uint32_t found : std::span(work_.found).first(near)) {
        const std::size_t other = work_.sorted[i + 1 + found].member;
        if ((work_.is_in_crowd[member] && work_.is_in_crowd[other]) || are_apart(member, other)) continue;
        work_.is_in_crowd[member] = work_.is_in_crowd[other] = 1;
        is_new = true;
      }
    }
    return is_new;
  }

  // Puts the crowd back to the beginning.
  void restore() {
    for (std::size_t member = 0; member < count_; ++member) {
      if (work_.is_in_crowd[member]) work_.saved.restore(sim_.state, drone(member), copy_ + member);
    }
  }

  // Prepares the neighbours of the crowd, which stand.
  void prepare() {
    work_.crowd_of_env.clear();
    for (std::size_t member = 0; member < count_; ++member) {
      if (!work_.is_in_crowd[member]) continue;
      const DroneIndex d = drone(member);
      dynamics::Neighbor& neighbor = work_.neighbors[member];
      const Pose pose = pose_of(sim_.state, d);
      neighbor.number = static_cast<std::uint32_t>(member);
      neighbor.airframe = sim_.fleet ? &sim_.fleet->airframe_of(d) : nullptr;
      neighbor.motion = {pose, pose, {}, {}, sim_.config.clock.dt_s()};
      neighbor.is_open = neighbor.has_contact = false;
      neighbor.holds = true;
      work_.crowd_of_env.push_back(&neighbor);
    }
  }

  void resolve() {
    work_.crowd.resolve(work_.crowd_of_env, *sim_.obstacles[sim_.slot_of(env_)],
                        sim_.bodies ? sim_.bodies->moving().of_env(env_, sim_.bodies->per_env()) : collision::MovingBodies(),
                        sim_.config.dynamics);
  }

  DroneIndex drone(std::size_t member) const { return sim_.drone_of(env_, member); }
  std::size_t member_of(DroneIndex of) const { return std::size_t{of} - std::size_t{drone(0)}; }

 private:
  Simulation& sim_;
  EnvIndex env_;
  Meetings& work_;
  std::size_t copy_;  // of drone 0
  std::size_t count_;
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

void move_meeting(Simulation& sim, EnvIndex env, std::span<const MoveRequest> moves, Scratch& scratch) {
  Meetings& work = *scratch.meetings;
  const std::size_t count = sim.drones_per_env();
  work.saved.clear();
  EnvMeeting meeting(sim, env, work, work.saved.save(sim.state, sim.drone_of(env, 0), count));
  work.reach.assign(count, 0.0F);
  work.way.assign(count, Vec3::Zero());
  std::size_t next = 0;
  for (std::size_t member = 0; member < count; ++member) {
    const DroneIndex drone = meeting.drone(member);
    if (next < moves.size() && moves[next].drone == drone) {
      const MoveRequest& move = moves[next++];
      sim.state.contact.drone[drone] = move.has_contact ? sim.state.contact.drone[drone] : -1;
      work.reach[member] = move.has_contact ? give_way(sim, drone, scratch) : sweep_to(sim, drone, move.target, scratch);
      if (!move.has_contact) work.way[member] = move.target.position - work.saved.position(member);
    } else if (sim.state.active[drone]) {
      work.reach[member] = give_way(sim, drone, scratch);
    }
  }
  // Without bodies, which push, a drone stays on the segment to its target, whenever it stops.
  const auto are_apart = [&](std::size_t a, std::size_t b) {
    const Vec3 p = work.saved.position(a), q = work.saved.position(b);
    const float near = 2.0F * sim.hull.radius() + dynamics::margin(p.cwiseAbs().maxCoeff() + q.cwiseAbs().maxCoeff());
    return !sim.bodies && distance_of_segments(p, work.way[a], q, work.way[b]) > near;
  };
  while (meeting.gather([&](std::size_t member) { return work.reach[member]; }, are_apart)) {
    meeting.restore();
    meeting.prepare();
    for (dynamics::Neighbor* const neighbor : work.crowd_of_env) {
      neighbor->has_contact = sim.state.contact.hit[meeting.drone(neighbor->number)] != 0;
    }
    for (const MoveRequest& move : moves) {
      dynamics::Neighbor& neighbor = work.neighbors[meeting.member_of(move.drone)];
      neighbor.has_contact = move.has_contact;
      if (!move.has_contact) neighbor.motion.to = move.target;
    }
    meeting.resolve();
    for (const dynamics::Neighbor* const neighbor : work.crowd_of_env) {
      const DroneIndex drone = meeting.drone(neighbor->number);
      work.reach[neighbor->number] = neighbor->reach;
      set_pose_of(sim.state, drone, neighbor->pose);
      if (neighbor->has_contact) {
        if (neighbor->contact.inside) sim.state.contact.inside[drone] = 1;
      } else {
        dynamics::write_contact(sim.state, drone, *neighbor);
      }
    }
  }
}

void fly_meeting(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                 int first_tick, int ticks, Scratch& scratch) {
  constexpr std::size_t kTogether = 64;  // drones that fly together, at least one env
  Meetings& work = *scratch.meetings;
  const std::size_t count = sim.drones_per_env();
  dynamics::FlightContext context = flight_context(sim, block, scratch);
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
      // With a row for each env a bad state stops all of its drones, also those outside of the crowd.
      work.saved.save(sim.state, sim.drone_of(env, 0), count,
                      context.drones_per_row == 1 ? context.bad : std::span<std::uint8_t>());
      work.envs.push_back(env);
      while (taken < drones.size() && sim.env_of(drones[taken]) == env) ++taken;
    }
    const auto together = drones.first(taken);
    drones = drones.subspan(taken);
    for (const EnvIndex env : work.envs) {
      std::fill_n(sim.reach.data() + sim.drone_of(env, 0), count, 0.0F);
    }
    context.reach = sim.reach;
    dynamics::fly(context, together, commands, first_tick, ticks);
    context.reach = {};
    std::size_t copy = 0;
    for_each_env(sim, together, [&](EnvIndex env, std::span<const DroneIndex> listed) {
      EnvMeeting meeting(sim, env, work, copy);
      copy += count;
      if (sim.bodies) {
        for (std::size_t member = 0; member < count; ++member) {
          const DroneIndex drone = meeting.drone(member);
          if (!sim.state.active[drone] || std::ranges::binary_search(listed, drone)) continue;
          sim.reach[drone] = give_way(sim, drone, scratch);
        }
      }
      const auto reach = [&](std::size_t member) { return sim.reach[meeting.drone(member)]; };
      while (meeting.gather(reach, [](std::size_t, std::size_t) { return false; })) {
        meeting.restore();
        work.movers.clear();
        for (const DroneIndex drone : listed) {
          if (work.is_in_crowd[meeting.member_of(drone)]) work.movers.push_back(drone);
        }
        for (std::size_t member = 0; member < count; ++member) {
          if (work.is_in_crowd[member]) sim.reach[meeting.drone(member)] = 0.0F;
        }
        for (int tick = first_tick; tick < first_tick + ticks; ++tick) {
          meeting.prepare();
          const bool terminates = sim.config.dynamics.on_contact == OnContact::terminate;
          for (dynamics::Neighbor* const neighbor : work.crowd_of_env) {
            neighbor->has_contact = terminates && sim.state.contact.hit[meeting.drone(neighbor->number)];
          }
          dynamics::record_motions(context, work.movers, commands, tick, {meeting.drone(0), work.neighbors});
          meeting.resolve();
          for (const dynamics::Neighbor* const neighbor : work.crowd_of_env) {
            const DroneIndex drone = meeting.drone(neighbor->number);
            dynamics::write_result(context, drone, *neighbor, tick);
            sim.reach[drone] += neighbor->reach;
          }
        }
      }
    });
  }
}

}  // namespace flockstep
