#include "batch/flying.hpp"

#include <algorithm>
#include <array>
#include <iterator>
#include <limits>

#include "base/interrupt.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "batch/bad_states.hpp"
#include "collision/sweep.hpp"
#include "dynamics/impact.hpp"
#include "dynamics/rows.hpp"
#include "dynamics/setpoint.hpp"

namespace flockstep {
namespace {

using dynamics::Flock;
using dynamics::kLanes;

constexpr float kClearance = 1e-3F;      // m: more than the sweep keeps away from anything, float32's steps aside
constexpr float kOpenBeyond = 0.5F;      // m: how much farther than it has to a look for obstacles goes, to last for some steps
constexpr float kFloatSteps = 0x1p-18F;  // of a coordinate: some of these
constexpr float kGroundRadii = 16.0F;    // of a rotor: farther below, the ground's effect is less than 0.03 %

template <std::size_t kCount>
void load(const std::vector<float>& values, std::size_t drone, dynamics::Lanes<kCount>& lanes, std::size_t lane) {
  for (std::size_t k = 0; k < kCount; ++k) lanes[k][lane] = values[kCount * drone + k];
}

template <std::size_t kCount>
void store(const dynamics::Lanes<kCount>& lanes, std::size_t lane, std::vector<float>& values, std::size_t drone) {
  for (std::size_t k = 0; k < kCount; ++k) values[kCount * drone + k] = lanes[k][lane];
}

Vec3 of_row(const std::vector<float>& values, std::size_t drone) {
  return {values[3 * drone], values[3 * drone + 1], values[3 * drone + 2]};
}

float margin(float coordinate) { return kClearance + kFloatSteps * coordinate; }
float margin(const Vec3& place) { return margin(place.cwiseAbs().maxCoeff()); }

Vec3 vec3(const dynamics::Lanes<3>& lanes, std::size_t lane) { return {lanes[0][lane], lanes[1][lane], lanes[2][lane]}; }

void set(const Vec3& v, dynamics::Lanes<3>& lanes, std::size_t lane) {
  for (int axis = 0; axis < 3; ++axis) lanes[static_cast<std::size_t>(axis)][lane] = v[axis];
}

void write_contact(State& state, std::size_t drone, const collision::Contact& contact) {
  state.contact.hit[drone] = contact.hit;
  state.contact.inside[drone] = contact.inside;
  state.contact.fraction[drone] = contact.fraction;
  for (std::size_t axis = 0; axis < 3; ++axis) {
    state.contact.point[3 * drone + axis] = contact.point[static_cast<Eigen::Index>(axis)];
    state.contact.normal[3 * drone + axis] = contact.normal[static_cast<Eigen::Index>(axis)];
  }
}

// Up to kLanes drones, on their way through one leg, each in a lane. Other lanes are filled with drones that stay
// what they are.
class Group {
 public:
  // Takes as many drones from the front of the list as it has lanes for. Where all of a row of kLanes drones that follow each
  // other are a thread's own, their arrays are read and written as a piece.
  Group(Simulation& sim, std::span<const std::uint32_t>& drones, Row own, Scratch& scratch)
      : sim_(sim), scratch_(scratch), flock_(scratch.flock) {
    is_row_ = own.count >= kLanes;
    if (is_row_) {
      const std::size_t first = std::min(std::size_t{drones[0]}, own.first + own.count - kLanes);
      for (std::size_t lane = 0; lane < kLanes; ++lane) drones_[lane] = static_cast<std::uint32_t>(first + lane);
      for (; count_ < drones.size() && drones[count_] < first + kLanes; ++count_) is_here_[drones[count_] - first] = true;
    } else {
      count_ = std::min(kLanes, drones.size());
      for (std::size_t lane = 0; lane < kLanes; ++lane) drones_[lane] = drones[std::min(lane, count_ - 1)];
      std::fill_n(is_here_.begin(), count_, true);
    }
    drones = drones.subspan(count_);
  }

  void load(Scratch& scratch) {
    const FlightState& flight = sim_.state.flight;
    if (is_row_) {
      load_row(flight.remainder, flock_.travelled);
      load_row(flight.velocity, flock_.velocity);
      load_row(sim_.state.quat_wxyz, flock_.rotation);
      load_row(flight.angular_velocity, flock_.turn);
      load_row(flight.rotor_speed, flock_.rotor);
      load_row(flight.rotor_command, flock_.rotor_told);
      load_row(flight.error_integral, flock_.error_integral);
      load_row(flight.wind, flock_.wind);
      load_row(sim_.state.position, base_);
      return find_ground(scratch);
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t drone = drones_[lane];
      flockstep::load(flight.remainder, drone, flock_.travelled, lane);
      flockstep::load(flight.velocity, drone, flock_.velocity, lane);
      flockstep::load(sim_.state.quat_wxyz, drone, flock_.rotation, lane);
      flockstep::load(flight.angular_velocity, drone, flock_.turn, lane);
      flockstep::load(flight.rotor_speed, drone, flock_.rotor, lane);
      flockstep::load(flight.rotor_command, drone, flock_.rotor_told, lane);
      flockstep::load(flight.error_integral, drone, flock_.error_integral, lane);
      flockstep::load(flight.wind, drone, flock_.wind, lane);
      flockstep::load(sim_.state.position, drone, base_, lane);
    }
    find_ground(scratch);
  }

  void load_setpoints(const Told& told) {
    const Control control = sim_.config.dynamics.control;
    if (is_row_ && (control == Control::body_rates || control == Control::velocity || control == Control::heading_velocity)) {
      alignas(64) dynamics::Lanes<4> numbers;
      dynamics::load_rows(told.command.data() + 4 * std::size_t{drones_[0]}, numbers);
      return void(std::copy(numbers.begin(), numbers.end(), flock_.setpoint.begin()));
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::size_t drone = drones_[lane];
      const auto setpoint = dynamics::setpoint_of(sim_.config.dynamics, *sim_.drone_model.airframe(), wish(told, drone));
      for (std::size_t k = 0; k < setpoint.size(); ++k) flock_.setpoint[k][lane] = setpoint[k];
    }
  }

  // The accelerations of a tick, which is thrown away.
  void feel(const dynamics::Physics& coasting, Scratch& scratch) {
    load(scratch);
    for (std::size_t i = 0; i < kRotors; ++i) flock_.setpoint[i] = flock_.rotor[i];
    dynamics::fly(coasting, flock_, 0, 1);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (!is_here_[lane] || !is_good(lane)) continue;
      store(flock_.acceleration, lane, sim_.state.flight.acceleration, drones_[lane]);
      store(flock_.angular_acceleration, lane, sim_.state.flight.angular_acceleration, drones_[lane]);
    }
  }

  // In the open, all ticks at once: nothing is within reach of where the drone has been. Others are left as they were.
  void fly_free(int first_tick, int ticks) {
    dynamics::fly(*sim_.physics, flock_, first_tick, ticks);
    look_around();
    std::array<bool, kLanes> flies{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const bool held = !is_here_[lane] || holds(lane);
      flies[lane] = !held && is_good(lane) && (is_open_[lane] != 0 || find_open(lane));
      is_done_[lane] = flies[lane] || held;
    }
    if (is_row_) return keep_row(flies);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (flies[lane]) keep(lane);
    }
  }

  bool is_done() const {
    return std::ranges::all_of(is_done_, [](bool done) { return done; });
  }

  // The others, tick by tick, the hull swept along.
  void fly_carefully(const Told& told, int first_tick, int ticks, Scratch& scratch) {
    load(scratch);
    load_setpoints(told);
    for (int tick = first_tick; tick < first_tick + ticks; ++tick) {
      Interrupt::poll();  // between two ticks: the state is that of drones in flight
      dynamics::fly(*sim_.physics, flock_, tick, 1);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        if (is_done_[lane]) continue;
        if (!is_good(lane)) {
          give_up(lane);
        } else {
          sweep(lane);
        }
      }
    }
  }

 private:
  dynamics::Wish wish(const Told& told, std::size_t drone) const {
    const Control control = sim_.config.dynamics.control;
    dynamics::Wish wish{.step_s = static_cast<float>(sim_.config.clock.step_s())};
    if (control == Control::position) wish.now = pose_of(sim_.state, drone);
    if (control == Control::pose) {
      wish.from = told.step_start[drone];
      wish.target = told.target[drone];
    } else {
      std::copy_n(told.command.data() + 4 * drone, 4, wish.command.data());
    }
    return wish;
  }

  std::size_t slot_of(std::size_t lane) const { return sim_.slot_of(sim_.env_of(drones_[lane])); }
  std::int32_t world_of(std::size_t lane) const { return sim_.state.world_index[sim_.env_of(drones_[lane])]; }
  const collision::Obstacles& obstacles(std::size_t lane) const { return *sim_.obstacles[slot_of(lane)]; }

  void find_ground(Scratch& scratch) {
    flock_.height.fill(std::numeric_limits<float>::infinity());
    if (!sim_.physics->ground_effect) return;
    trace::RayBlock& rays = scratch.tracer.block();
    rays.near = 0.0F;
    for (std::size_t first = 0; first < kLanes; first += rays.count) {  // those that follow each other in one world
      rays.count = 0;
      for (std::size_t lane = first; lane < kLanes && slot_of(lane) == slot_of(first); ++lane, ++rays.count) {
        rays.org_x[rays.count] = base_[0][lane];
        rays.org_y[rays.count] = base_[1][lane];
        rays.org_z[rays.count] = base_[2][lane];
        rays.dir_x[rays.count] = rays.dir_y[rays.count] = 0.0F;
        rays.dir_z[rays.count] = -1.0F;
        rays.range[rays.count] = kGroundRadii * 4.0F * sim_.physics->numbers.ground_quarter;
      }
      scratch.tracer.trace_block(*sim_.scenes[slot_of(first)]);
      std::copy_n(rays.t_hit, rays.count, flock_.height.data() + first);
    }
  }

  // Where contacts end the episode, a drone stays where it hit until its step is over.
  bool holds(std::size_t lane) const {
    const std::uint32_t drone = drones_[lane];
    return (sim_.config.dynamics.on_contact == OnContact::terminate && sim_.state.contact.hit[drone]) ||
           (sim_.task_state && sim_.episodes.bad[sim_.env_of(drone)]);
  }

  Vec3 position(std::size_t lane) const { return vec3(base_, lane) + vec3(flock_.travelled, lane); }

  Pose pose(std::size_t lane) const {
    const auto& q = flock_.rotation;
    return {position(lane), Quat(q[0][lane], q[1][lane], q[2][lane], q[3][lane])};
  }

  bool is_good(std::size_t lane) const { return flock_.is_good[lane] != 0.0F && is_in_world(position(lane)); }

  // How much around where they began has to be free, and whose has been found to be. Loops without branches, for vectors.
  void look_around() {
    alignas(64) dynamics::Lanes<3> center;
    dynamics::Lane radius;
    std::array<std::int32_t, kLanes> is_same_world;
    if (is_row_) {
      load_row(sim_.open.center, center);
      std::copy_n(sim_.open.radius.data() + drones_[0], kLanes, radius.begin());
    } else {
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        flockstep::load(sim_.open.center, drones_[lane], center, lane);
        radius[lane] = sim_.open.radius[drones_[lane]];
      }
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) is_same_world[lane] = sim_.open.world[drones_[lane]] == world_of(lane);
    const float hull = sim_.hull.radius();
    const Eigen::Array<float, kLanes, 1> reach = Eigen::Map<const Eigen::Array<float, kLanes, 1>>(flock_.reach2.data()).sqrt();
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const float x = base_[0][lane], y = base_[1][lane], z = base_[2][lane];
      const float farthest = std::max(std::max(std::abs(x), std::abs(y)), std::abs(z));
      around_[lane] = reach[static_cast<Eigen::Index>(lane)] + hull + margin(farthest);
      const float left = radius[lane] - around_[lane];
      const float dx = x - center[0][lane], dy = y - center[1][lane], dz = z - center[2][lane];
      const bool is_inside = dx * dx + dy * dy + dz * dz <= left * left;
      is_open_[lane] = is_same_world[lane] & (left >= 0.0F) & is_inside;
    }
  }

  // Whether all of what has to be free is; if so, that is remembered for some more.
  bool find_open(std::size_t lane) {
    const Vec3 center = vec3(base_, lane);
    for (const float beyond : {kOpenBeyond, 0.0F}) {
      if (!obstacles(lane).is_clear(center, around_[lane] + beyond)) continue;
      const std::uint32_t drone = drones_[lane];
      std::copy_n(center.data(), 3, sim_.open.center.data() + 3 * drone);
      sim_.open.radius[drone] = around_[lane] + beyond;
      sim_.open.world[drone] = world_of(lane);
      return true;
    }
    return false;
  }

  void keep(std::size_t lane) {
    const std::uint32_t drone = drones_[lane];
    FlightState& flight = sim_.state.flight;
    const Pose at = pose(lane);
    set_pose_of(sim_.state, drone, at);
    for (std::size_t k = 0; k < 3; ++k) {  // as dynamics::add() has it, to the bit
      const float from = base_[k][lane], way = flock_.travelled[k][lane];
      const float sum = at.position[static_cast<Eigen::Index>(k)];
      const float part = sum - from;
      flight.remainder[3 * drone + k] = (from - (sum - part)) + (way - part);
    }
    store(flock_.velocity, lane, flight.velocity, drone);
    store(flock_.turn, lane, flight.angular_velocity, drone);
    store(flock_.acceleration, lane, flight.acceleration, drone);
    store(flock_.angular_acceleration, lane, flight.angular_acceleration, drone);
    store(flock_.rotor, lane, flight.rotor_speed, drone);
    store(flock_.rotor_told, lane, flight.rotor_command, drone);
    store(flock_.error_integral, lane, flight.error_integral, drone);
  }

  // All lanes, of drones that follow each other. Those that do not fly stay what they are.
  void keep_row(const std::array<bool, kLanes>& flies) {
    FlightState& flight = sim_.state.flight;
    alignas(64) dynamics::Lanes<3> position, remainder;
    dynamics::add(base_, flock_.travelled, position, remainder);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (flies[lane]) continue;
      const std::uint32_t drone = drones_[lane];
      flockstep::load(sim_.state.position, drone, position, lane);
      flockstep::load(flight.remainder, drone, remainder, lane);
      flockstep::load(sim_.state.quat_wxyz, drone, flock_.rotation, lane);
      flockstep::load(flight.velocity, drone, flock_.velocity, lane);
      flockstep::load(flight.angular_velocity, drone, flock_.turn, lane);
      flockstep::load(flight.acceleration, drone, flock_.acceleration, lane);
      flockstep::load(flight.angular_acceleration, drone, flock_.angular_acceleration, lane);
      flockstep::load(flight.rotor_speed, drone, flock_.rotor, lane);
      flockstep::load(flight.rotor_command, drone, flock_.rotor_told, lane);
      flockstep::load(flight.error_integral, drone, flock_.error_integral, lane);
    }
    store_row(position, sim_.state.position);
    store_row(remainder, flight.remainder);
    store_row(flock_.rotation, sim_.state.quat_wxyz);
    store_row(flock_.velocity, flight.velocity);
    store_row(flock_.turn, flight.angular_velocity);
    store_row(flock_.acceleration, flight.acceleration);
    store_row(flock_.angular_acceleration, flight.angular_acceleration);
    store_row(flock_.rotor, flight.rotor_speed);
    store_row(flock_.rotor_told, flight.rotor_command);
    store_row(flock_.error_integral, flight.error_integral);
  }

  template <std::size_t kCount>
  void load_row(const std::vector<float>& values, dynamics::Lanes<kCount>& lanes) const {
    dynamics::load_rows(values.data() + kCount * drones_[0], lanes);
  }
  template <std::size_t kCount>
  void store_row(const dynamics::Lanes<kCount>& lanes, std::vector<float>& values) const {
    dynamics::store_rows(lanes, values.data() + kCount * drones_[0]);
  }

  // The state has left the range that can be integrated: the drone stays where it was, at rest. A task's episode ends as a bad
  // state; without a task the caller is warned.
  void give_up(std::size_t lane) {
    start_flight(sim_, drones_[lane], {});
    if (sim_.task_state) {
      mark_bad(sim_, sim_.env_of(drones_[lane]));
    } else {
      scratch_.lost.add(drones_[lane]);
    }
    is_done_[lane] = true;
  }

  // The tick's motion, as far as nothing is in the way. What hits is thrown back, and flies the rest of the tick from there,
  // until it hits again. A drone that begins inside something is not in the way of itself: it flies out, with a contact.
  void sweep(std::size_t lane) {
    constexpr int kMostContacts = 3;  // of a tick: a wall, another, and where they meet
    const std::uint32_t drone = drones_[lane];
    const bool terminates = sim_.config.dynamics.on_contact == OnContact::terminate;
    Pose from = pose_of(sim_.state, drone);
    Pose to = pose(lane);
    // At the beginning of the motion that is swept, and at its end.
    Velocity begin{of_row(sim_.state.flight.velocity, drone), of_row(sim_.state.flight.angular_velocity, drone)};
    Velocity end{vec3(flock_.velocity, lane), vec3(flock_.turn, lane)};
    keep(lane);
    double left = sim_.config.clock.dt_s();
    bool is_held = true;
    bool is_inside = false;
    for (int contacts = 0; contacts < kMostContacts; ++contacts) {
      const collision::Contact contact = collision::sweep(obstacles(lane), sim_.hull, from, to);
      if (contact.hit) write_contact(sim_.state, drone, contact);
      is_inside = contact.inside;
      if (!contact.hit || (contact.inside && contact.fraction == 1.0F && !terminates)) {
        if (contacts == 0) return;
        from = to;
        is_held = false;
        break;
      }
      from = collision::interpolate(from, to, contact.fraction);
      if (terminates) {
        is_done_[lane] = true;
        break;
      }
      const float share = contact.fraction;
      const Velocity hit{begin.linear + share * (end.linear - begin.linear),
                         begin.angular + share * (end.angular - begin.angular)};
      left *= 1.0 - static_cast<double>(share);
      Touching touching;
      find_touching(lane, from, contact, touching);
      const dynamics::Rebound rebound =
          dynamics::thrown_back(hit, end, left, from, touching.points(), contact.normal, *sim_.drone_model.airframe(), surface());
      begin = rebound.after;
      end = rebound.at_end;
      const auto time = static_cast<float>(0.5 * left);
      const Vec3 turn = time * (begin.angular + end.angular);
      const float angle = turn.norm();
      to = {from.position + time * (begin.linear + end.linear),
            angle > 0.0F ? (from.rotation * Quat(Eigen::AngleAxisf(angle, turn / angle))).normalized() : from.rotation};
    }
    set_pose_of(sim_.state, drone, from);
    FlightState& flight = sim_.state.flight;
    for (std::size_t k = 3 * drone; k < 3 * drone + 3; ++k) {
      flight.acceleration[k] = flight.angular_acceleration[k] = flight.remainder[k] = 0.0F;
    }
    if (is_done_[lane]) return;
    if (is_held) end = is_inside ? Velocity{Vec3::Zero(), Vec3::Zero()} : begin;  // no force gives it speed where it is
    set(end.linear, flock_.velocity, lane);
    set(end.angular, flock_.turn, lane);
    store(flock_.velocity, lane, flight.velocity, drone);
    store(flock_.turn, lane, flight.angular_velocity, drone);
    fly_on_from(lane, from);
  }

  static_assert(dynamics::kMostPoints == kMaxHullVertices + 1);

  // The points of the hull, m, world frame, that touch what was hit: a face that lies flat does so at all its corners.
  struct Touching {
    std::array<Vec3, dynamics::kMostPoints> at;
    std::size_t count = 0;

    void add(const Vec3& point) { at[count++] = point; }
    std::span<const Vec3> points() const { return std::span(at).first(count); }
  };

  // Each on the surface that was hit, and none of them twice: points out of its plane, or a millimetre apart, would keep the body
  // from turning by the tiniest of levers. Inside something, the deepest vertices are those that must not go on.
  void find_touching(std::size_t lane, const Pose& pose, const collision::Contact& contact, Touching& touching) const {
    const auto above_surface = [&](const Vec3& vertex) {
      return contact.normal.dot(pose.position + pose.rotation * vertex - contact.point);
    };
    float level = 0.0F;
    if (contact.inside) {
      for (const Vec3& vertex : sim_.drone_model.hull()) level = std::min(level, above_surface(vertex));
    } else {
      touching.add(contact.point);
    }
    const float near = margin(pose.position);
    for (const Vec3& vertex : sim_.drone_model.hull()) {
      const float above = above_surface(vertex) - level;
      if (above >= near) continue;
      const Vec3 point = pose.position + pose.rotation * vertex;
      if (!contact.inside && !obstacles(lane).touches(point, near)) continue;
      const Vec3 on_surface = point - above * contact.normal;
      if (touching.count > 0 && (on_surface - touching.at[0]).norm() < near) {
        touching.at[0] = on_surface;
      } else {
        touching.add(on_surface);
      }
    }
  }

  dynamics::Surface surface() const {
    const DynamicsConfig& config = sim_.config.dynamics;
    if (config.on_contact == OnContact::stop) return {0.0, std::numeric_limits<double>::infinity()};
    return {static_cast<double>(config.restitution), static_cast<double>(config.friction)};
  }

  void fly_on_from(std::size_t lane, const Pose& at) {
    const Vec3 moved = at.position - vec3(base_, lane);
    set(at.position, base_, lane);
    set(Vec3::Zero(), flock_.travelled, lane);
    const auto& q = at.rotation;
    for (const auto& [k, value] : {std::pair(0, q.w()), {1, q.x()}, {2, q.y()}, {3, q.z()}}) {
      flock_.rotation[static_cast<std::size_t>(k)][lane] = value;
    }
    flock_.height[lane] += moved.z();
    if (sim_.physics->stage == dynamics::Stage::position) {
      for (std::size_t k = 0; k < 3; ++k) flock_.setpoint[k][lane] -= moved[static_cast<Eigen::Index>(k)];
    }
  }

  Simulation& sim_;
  Scratch& scratch_;
  Flock& flock_;
  std::array<std::uint32_t, kLanes> drones_{};  // by lane
  std::array<bool, kLanes> is_here_{};          // the lane's drone is one of those that fly
  std::size_t count_ = 0;                       // that do
  bool is_row_ = false;                         // kLanes drones that follow each other, all of them the thread's own
  alignas(64) dynamics::Lanes<3> base_{};       // m: where the leg began, or the last contact was
  alignas(64) dynamics::Lane around_{};         // m: how much around where the leg began it has to be free, to be flown at once
  std::array<std::int32_t, kLanes> is_open_{};  // it is known to be
  std::array<bool, kLanes> is_done_{};
};

template <std::size_t kCount>
std::array<float, kCount> row(const std::vector<float>& values, std::size_t drone) {
  std::array<float, kCount> row;
  std::copy_n(values.data() + kCount * drone, kCount, row.data());
  return row;
}

// Of a drone at a time of its episode.
dynamics::GustNoise gust_noise(const Simulation& sim, std::size_t drone, std::int64_t time) {
  constexpr std::uint32_t kDraws = 3;  // of two numbers each
  const std::size_t env = sim.env_of(drone);
  const auto m = static_cast<std::uint32_t>(drone - env * sim.drones_per_env());
  const std::uint32_t index = kDraws * (static_cast<std::uint32_t>(time) * static_cast<std::uint32_t>(sim.drones_per_env()) + m);
  const auto [a, b] = normal_pair(draw(sim.state, env, Stream::gust, index));
  const auto [c, d] = normal_pair(draw(sim.state, env, Stream::gust, index + 1));
  const auto [e, unused] = normal_pair(draw(sim.state, env, Stream::gust, index + 2));
  return {a, b, c, d, e};
}

void set_gust(Simulation& sim, std::size_t drone, const dynamics::GustState& gust) {
  FlightState& flight = sim.state.flight;
  std::copy(gust.begin(), gust.end(), flight.gust.data() + dynamics::kGustStates * drone);
  const Vec3 wind = sim.wind.at(gust);
  std::copy_n(wind.data(), 3, flight.wind.data() + 3 * drone);
}

template <class Function>
void for_each_group(Simulation& sim, std::span<const std::uint32_t> drones, Row own, Scratch& scratch, const Function& function) {
  while (!drones.empty()) {
    Group group(sim, drones, own, scratch);
    function(group);
  }
}

}  // namespace

void start_flight(Simulation& sim, std::size_t drone, const Velocity& velocity) {
  if (!sim.physics) return;
  begin_gusts(sim, drone);
  FlightState& flight = sim.state.flight;
  const float hovering = static_cast<float>(sim.drone_model.airframe()->hover_speed());
  for (std::size_t k = 0; k < 3; ++k) {
    flight.velocity[3 * drone + k] = velocity.linear[static_cast<Eigen::Index>(k)];
    flight.angular_velocity[3 * drone + k] = velocity.angular[static_cast<Eigen::Index>(k)];
    flight.acceleration[3 * drone + k] = flight.angular_acceleration[3 * drone + k] = flight.error_integral[3 * drone + k] =
        flight.remainder[3 * drone + k] = 0.0F;
  }
  for (std::size_t i = 0; i < kRotors; ++i)
    flight.rotor_speed[kRotors * drone + i] = flight.rotor_command[kRotors * drone + i] = hovering;
}

void begin_gusts(Simulation& sim, std::size_t drone) {
  if (!sim.physics) return;
  set_gust(sim, drone, sim.wind.has_gusts() ? sim.wind.begin(gust_noise(sim, drone, 0)) : dynamics::GustState{});
}

void update_wind(Simulation& sim, std::span<const std::uint32_t> drones, int ticks_ahead) {
  if (!sim.wind.has_gusts()) return;
  for (const std::uint32_t drone : drones) {
    const auto gust = row<dynamics::kGustStates>(sim.state.flight.gust, drone);
    // Ticks are counted, since a batch without a task has no steps.
    const std::int64_t tick = sim.state.tick[sim.env_of(drone)] + ticks_ahead;
    set_gust(sim, drone, sim.wind.next(gust, gust_noise(sim, drone, tick + 1)));
  }
}

void sweep_to(Simulation& sim, std::size_t drone, const Pose& target) {
  const Pose from = pose_of(sim.state, drone);
  const collision::Obstacles& obstacles = *sim.obstacles[sim.slot_of(sim.env_of(drone))];
  const collision::Contact contact = collision::sweep(obstacles, sim.hull, from, target);
  set_pose_of(sim.state, drone, contact.hit ? collision::interpolate(from, target, contact.fraction) : target);
  write_contact(sim.state, drone, contact);
}

Row row_of(const Simulation& sim, const Block& block) {
  if (!block.is_contiguous) return {};
  return {block.envs.front() * sim.drones_per_env(), block.envs.size() * sim.drones_per_env()};
}

void feel(Simulation& sim, std::span<const std::uint32_t> drones, Row own, Scratch& scratch) {
  dynamics::Physics coasting = *sim.physics;
  coasting.stage = dynamics::Stage::rotors;
  for_each_group(sim, drones, own, scratch, [&](Group& group) { group.feel(coasting, scratch); });
}

void fly_by_rotors(Simulation& sim, std::span<const std::uint32_t> drones, Row own, const Told& told, int first_tick, int ticks,
                   Scratch& scratch) {
  for_each_group(sim, drones, own, scratch, [&](Group& group) {
    group.load(scratch);
    group.load_setpoints(told);
    group.fly_free(first_tick, ticks);
    if (!group.is_done()) group.fly_carefully(told, first_tick, ticks, scratch);
  });
}

void fly_ticks(Simulation& sim, std::span<const std::uint32_t> envs, Row own, const Told& told, int ticks, Scratch& scratch) {
  const int step = sim.config.clock.substeps();
  const bool has_gusts = sim.wind.has_gusts();
  // Envs may be at different ticks of their step, and each keeps to its own clock: envs of one phase fly together.
  const int phases = has_gusts || sim.physics->control_ticks > 1 ? step : 1;
  for (int phase = 0; phase < phases; ++phase) {
    scratch.envs.clear();
    std::ranges::copy_if(envs, std::back_inserter(scratch.envs),
                         [&](std::uint32_t env) { return sim.state.tick[env] % phases == phase; });
    if (scratch.envs.empty()) continue;
    for (int flown = 0, leg = ticks; flown < ticks; flown += leg) {
      const int tick = (phase + flown) % step;  // of the step
      const auto drones = sim.drones_of(scratch.envs, scratch);
      if (has_gusts) leg = std::min(ticks - flown, step - tick);
      if (tick == 0) update_wind(sim, drones, flown);
      fly_by_rotors(sim, drones, own, told, tick, leg, scratch);
    }
  }
  for (const std::uint32_t env : envs) sim.state.tick[env] += ticks;
}

}  // namespace flockstep
