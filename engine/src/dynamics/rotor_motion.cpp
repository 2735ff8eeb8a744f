#include "dynamics/rotor_motion.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>
#include <vector>

#include "base/interrupt.hpp"
#include "base/pose_access.hpp"
#include "dynamics/contact.hpp"
#include "dynamics/lane_group.hpp"

namespace flockstep::dynamics {
namespace {

constexpr float kSearchBeyond = 0.5F;  // m, added to the required free radius so that the ball lasts for some steps
constexpr float kGroundRadii = 16.0F;  // in rotor radii; beyond this height the ground effect is below 0.03 %

float* path_of(const FlightContext& context, std::size_t drone, int tick) {
  const std::size_t row = context.path.size() / context.fleet.open.world.size();
  return context.path.data() + row * drone + 3 * static_cast<std::size_t>(tick);
}

// Stores the drone's position as that after this tick and, in case the drone stays there, after all later ones.
void store_rest_of_path(const FlightContext& context, DroneIndex drone, int tick) {
  if (context.path.empty()) return;
  float* const end = path_of(context, drone + std::size_t{1}, 0);
  for (float* to = path_of(context, drone, tick + 1); to < end; to += 3) {
    std::copy_n(context.state.position.data() + 3 * drone, 3, to);
  }
}

// The flight of one group of drones.
class GroupFlight {
 public:
  // Removes the group's drones from the list.
  GroupFlight(const FlightContext& context, const Physics& physics, std::span<const DroneIndex>& drones)
      : context_(context),
        fleet_(context.fleet),
        physics_(physics),
        state_(context.state),
        flock_(context.scratch.flock),
        group_(drones, context.own, context.fleet.num_rotors()),
        numbers_(fleet_.lane_numbers.empty() ? fleet_.physics.lanes : own_numbers()) {}

  void update_accelerations() {
    load();
    for (std::size_t i = 0; i < kMaxRotors; ++i) flock_.setpoint[i] = flock_.rotor[i];
    advance(0, 1);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (group_.is_listed(lane) && is_good(lane)) group_.store_accelerations(lane, flock_, state_);
    }
  }

  void fly(const Commands& commands, int first_tick, int ticks) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      is_done_[lane] = !group_.is_listed(lane) || is_held(lane);
      if (has_deviation() && group_.is_listed(lane)) context_.deviation[group_[lane]] = 0.0F;
    }
    if (has_bodies()) push_held(first_tick);
    if (is_done()) return;
    load();
    load_setpoints(commands, first_tick, ticks);
    fly_free(first_tick, ticks);
    if (is_done()) return;
    load();
    load_setpoints(commands, first_tick, ticks);
    const Lanes<3> began = flock_.origin;
    LaneFlags flies{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) flies[lane] = !is_done_[lane];
    for (int tick = first_tick; tick < first_tick + ticks && (has_deviation() || !is_done()); ++tick) {
      if (!is_done()) {
        Interrupt::poll();  // between ticks the state is consistent
        fly_tick(tick);
      }
      if (has_deviation()) record_positions(began, tick - first_tick);
    }
    if (has_deviation()) write_deviations(flies, ticks);
  }

  void record(const Commands& commands, int tick, const MemberTable& table) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) is_done_[lane] = !group_.is_listed(lane) || is_held(lane);
    if (is_done()) return;
    load();
    load_setpoints(commands, tick, 1);
    advance(tick, 1);
    check_open_space();
    LaneFlags flies{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (is_done_[lane]) continue;
      flies[lane] = is_good(lane);
      if (!flies[lane]) {
        give_up(lane);
        continue;
      }
      GroupMember& member = table.members[group_[lane] - table.first];
      member.motion = motion_of(lane);
      member.is_fixed = false;
      member.is_open = !(has_bodies() && is_near_body(lane)) && (is_open_[lane] != 0 || find_open_space(lane));
    }
    group_.store(flies, flock_, state_);
  }

 private:
  // The coefficients of the lanes' drones.
  const LaneNumbers& own_numbers() {
    if (group_.is_row() && group_[0] % kLanes == 0) return fleet_.lane_numbers[group_[0] / kLanes];
    LaneNumbers& numbers = context_.scratch.numbers;
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const DroneIndex drone = group_[lane];
      copy_lane(fleet_.lane_numbers[drone / kLanes], drone % kLanes, numbers, lane, fleet_.num_rotors());
    }
    return numbers;
  }

  void load() {
    group_.load(state_, flock_);
    find_ground();
    if (fleet_.physics.downwash) group_.load(fleet_.thrust_share, flock_.thrust_share);
    flock_.arrivals = {};
    if (physics_.pushed) {
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const DroneParameters parameters = Fleet::parameters_of(state_, group_[lane]);
        set(Vec3::Map(parameters.push_mps2.data()), lane, flock_.push);
        set(Vec3::Map(parameters.twist_radps2.data()), lane, flock_.twist);
      }
    }
    for (std::size_t lane = 0; physics_.drains && lane < kLanes; ++lane) {
      const auto shares = fleet_.speed_share(state_, group_[lane], step_start(lane));
      for (std::size_t i = 0; i < fleet_.num_rotors(); ++i) flock_.speed_share[i][lane] = shares[i];
    }
  }

  // Tick of the lane's episode at which the current step began.
  std::int64_t step_start(std::size_t lane) const {
    const std::int64_t now = state_.tick[env_of(lane)] + context_.scratch.ticks_ahead;
    return now - now % fleet_.clock.substeps();
  }

  // Loads the commands of a leg: those that are given, or the ones that arrive.
  void load_setpoints(const Commands& commands, int first_tick, int ticks) {
    if (!fleet_.commands.empty()) return load_arrivals(commands, first_tick, ticks);
    if (!has_integral(physics_.stage)) flock_.error_integral = {};  // otherwise it could be from before a change of control
    const Control control = control_of(commands);
    if (group_.is_row() &&
        (control == Control::body_rates || control == Control::velocity || control == Control::heading_velocity)) {
      return load_rows4(commands.command.data() + 4 * group_[0], flock_.setpoint.data());
    }
    const std::size_t size = fleet_.command_size(control);
    const auto step_s = static_cast<float>(fleet_.clock.step_s());
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const DroneIndex drone = group_[lane];
      const Setpoint setpoint = control == Control::pose
                                    ? setpoint_of(commands.step_start[drone], commands.target[drone], step_s)
                                    : command_setpoint(lane, control, commands.command.data() + size * drone);
      for (std::size_t k = 0; k < setpoint.size(); ++k) flock_.setpoint[k][lane] = setpoint[k];
    }
  }

  void load_arrivals(const Commands& commands, int first_tick, int ticks) {
    if (!has_integral(physics_.stage)) flock_.error_integral = {};
    Arrivals& arrivals = context_.scratch.arrivals;
    arrivals.clear();
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const std::int64_t start = step_start(lane);
      std::size_t count = 0;
      const auto add = [&](const float* command, std::int64_t at, std::size_t) {
        arrivals.add(command_setpoint(lane, control_of(commands), command), static_cast<float>(at - start), lane, count++,
                     flock_);
      };
      fleet_.commands.for_each(group_[lane], start + first_tick, start + first_tick + ticks, add);
    }
    flock_.arrivals = arrivals.rows();
  }

  Control control_of(const Commands& commands) const { return commands.control.value_or(fleet_.config.control); }
  Setpoint command_setpoint(std::size_t lane, Control control, const float* command) const {
    return setpoint_of(control, fleet_.airframe_of(group_[lane]), command, state_.position.data() + 3 * group_[lane]);
  }

  std::size_t env_of(std::size_t lane) const { return fleet_.env_of(group_[lane]); }
  std::size_t slot_of(std::size_t lane) const { return static_cast<std::size_t>(context_.slot[env_of(lane)]); }
  std::int32_t world_of(std::size_t lane) const { return state_.world_index[env_of(lane)]; }
  const collision::Obstacles& obstacles(std::size_t lane) const { return *context_.obstacles[slot_of(lane)]; }

  void find_ground() {
    flock_.height.fill(std::numeric_limits<float>::infinity());
    if (!fleet_.physics.ground_effect) return;
    trace::RayBlock& rays = context_.tracer.block();
    rays.near = 0.0F;
    for (std::size_t first = 0; first < kLanes; first += rays.count) {  // consecutive drones in one world
      rays.count = 0;
      for (std::size_t lane = first; lane < kLanes && slot_of(lane) == slot_of(first); ++lane, ++rays.count) {
        rays.org_x[rays.count] = flock_.origin[0][lane];
        rays.org_y[rays.count] = flock_.origin[1][lane];
        rays.org_z[rays.count] = flock_.origin[2][lane];
        rays.dir_x[rays.count] = rays.dir_y[rays.count] = 0.0F;
        rays.dir_z[rays.count] = -1.0F;
        rays.range[rays.count] = kGroundRadii * 4.0F * numbers_.ground_quarter[lane];
      }
      context_.tracer.trace_block(*context_.scenes[slot_of(first)]);
      std::copy_n(rays.t_hit, rays.count, flock_.height.data() + first);
    }
  }

  void advance(int first_tick, int ticks, Lanes<3>* path = nullptr) {
    dynamics::fly(physics_, numbers_, flock_, first_tick, ticks, path);
    update_position(flock_);
  }

  bool is_good(std::size_t lane) const { return flock_.is_good[lane] != 0.0F; }

  // True if the drone stays in place until the end of its step.
  bool is_held(std::size_t lane) const {
    return (fleet_.config.on_contact == OnContact::terminate && state_.contact.hit[group_[lane]]) || context_.bad[group_[lane]];
  }

  bool has_deviation() const { return !context_.deviation.empty(); }
  bool has_bodies() const { return context_.bodies.count != 0; }
  collision::MovingBodies bodies(std::size_t lane) const { return context_.bodies.of_env(env_of(lane), context_.bodies_per_env); }

  // Lets bodies push a drone that stays in place.
  void push(std::size_t lane, int tick) {
    const DroneIndex drone = group_[lane];
    GroupMember& member = context_.scratch.member;
    member.motion = standing(pose_of(state_, drone), fleet_.clock.dt_s());
    member.has_contact = member.is_fixed = true;
    context_.scratch.contacts.resolve(member, obstacles(lane), bodies(lane), fleet_.config);
    note_detour(lane, member.reach);
    if (member.is_deflected) write_result(context_, drone, member, tick);
  }

  void push_held(int tick) {
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (!group_.is_listed(lane) || !is_held(lane)) continue;
      push(lane, tick);
      if (has_deviation()) context_.deviation[group_[lane]] = 2.0F * detour_[lane];
    }
  }

  // Notes that a drone came this far (m) from the position where it began a tick, and not straight to where it ended.
  void note_detour(std::size_t lane, float distance) { detour_[lane] = std::max(detour_[lane], distance); }

  // Records the stored positions after a tick of the leg.
  void record_positions(const Lanes<3>& began, int tick) {
    Lanes<3>& travelled = context_.scratch.path[static_cast<std::size_t>(tick)];
    for (std::size_t lane = 0; lane < kLanes; ++lane)
      set(vec3(state_.position, group_[lane]) - vec3(began, lane), lane, travelled);
  }

  // Writes the deviations of drones whose leg has been recorded.
  void write_deviations(const LaneFlags& lanes, int ticks) {
    const std::span<const Lanes<3>> path = std::span(context_.scratch.path).first(static_cast<std::size_t>(ticks));
    const Lanes<3>& whole = path.back();
    Lane deviation2{};
    for (std::size_t tick = 0; tick < path.size(); ++tick) {
      const float share = static_cast<float>(tick + 1) / static_cast<float>(ticks);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        const float x = path[tick][0][lane] - share * whole[0][lane], y = path[tick][1][lane] - share * whole[1][lane],
                    z = path[tick][2][lane] - share * whole[2][lane];
        deviation2[lane] = std::max(deviation2[lane], x * x + y * y + z * z);
      }
    }
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (!lanes[lane]) continue;
      float deviation = std::sqrt(deviation2[lane]);
      if (detour_[lane] > 0.0F) deviation += detour_[lane] + vec3(whole, lane).norm() / static_cast<float>(ticks);
      context_.deviation[group_[lane]] = deviation;
    }
  }

  bool is_done() const { return std::ranges::count(is_done_, true) == kLanes; }

  // Flies all ticks at once and stores the drones that have no obstacle within their reach.
  void fly_free(int first_tick, int ticks) {
    advance(first_tick, ticks, path_of_leg());
    check_open_space();
    LaneFlags flies{};
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (is_done_[lane]) continue;
      flies[lane] = is_done_[lane] =
          is_good(lane) && !(has_bodies() && is_near_body(lane)) && (is_open_[lane] != 0 || find_open_space(lane));
      if (flies[lane] && !context_.path.empty()) store_path(lane, first_tick, ticks);
    }
    if (has_deviation()) write_deviations(flies, ticks);
    group_.store(flies, flock_, state_);
  }

  // Memory for the path of a leg; null if it is not recorded.
  Lanes<3>* path_of_leg() { return context_.path.empty() && !has_deviation() ? nullptr : context_.scratch.path.data(); }

  // Stores the recorded leg of a drone.
  void store_path(std::size_t lane, int first_tick, int ticks) {
    float* to = path_of(context_, group_[lane], first_tick + 1);
    for (int tick = 0; tick < ticks; ++tick) {
      const Lanes<3>& travelled = context_.scratch.path[static_cast<std::size_t>(tick)];
      for (std::size_t axis = 0; axis < 3; ++axis) *to++ = flock_.origin[axis][lane] + travelled[axis][lane];
    }
  }

  // Computes the free radius that each drone needs and checks it against the cached open space. The loops have no branches, so
  // that they vectorise.
  void check_open_space() {
    const OpenSpace& open = fleet_.open;
    alignas(64) Lanes<3> center;
    Lane radius;
    group_.load(open.center, center);
    group_.load(open.radius, radius);
    std::array<std::int32_t, kLanes> is_same_world;
    for (std::size_t lane = 0; lane < kLanes; ++lane) is_same_world[lane] = open.world[group_[lane]] == world_of(lane);
    const float hull_radius = context_.hull.radius();
    const Eigen::Array<float, kLanes, 1> reach = Eigen::Map<const Eigen::Array<float, kLanes, 1>>(flock_.reach2.data()).sqrt();
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      const float x = flock_.origin[0][lane], y = flock_.origin[1][lane], z = flock_.origin[2][lane];
      const float farthest = std::max(std::max(std::abs(x), std::abs(y)), std::abs(z));
      space_[lane] = reach[static_cast<Eigen::Index>(lane)] + hull_radius + margin(farthest);
      const float left = radius[lane] - space_[lane];
      const float dx = x - center[0][lane], dy = y - center[1][lane], dz = z - center[2][lane];
      const bool is_inside = dx * dx + dy * dy + dz * dz <= left * left;
      is_open_[lane] = is_same_world[lane] & (left >= 0.0F) & is_inside;
    }
  }

  // True if a body reaches into the space that the drone needs.
  bool is_near_body(std::size_t lane) {
    return !context_.scratch.near.gather(bodies(lane), vec3(flock_.origin, lane), space_[lane]).empty();
  }

  // Checks the world for the free space that the drone needs, and caches it if it is open.
  bool find_open_space(std::size_t lane) {
    const Vec3 center = vec3(flock_.origin, lane);
    for (const float beyond : {kSearchBeyond, 0.0F}) {
      const float radius = space_[lane] + beyond;
      if (!obstacles(lane).is_clear(center, radius)) continue;
      const DroneIndex drone = group_[lane];
      std::copy_n(center.data(), 3, fleet_.open.center.data() + 3 * drone);
      fleet_.open.radius[drone] = radius;
      fleet_.open.world[drone] = world_of(lane);
      return true;
    }
    return false;
  }

  // Flies one tick of the remaining drones, with contacts.
  void fly_tick(int tick) {
    advance(tick, 1);
    for (std::size_t lane = 0; lane < kLanes; ++lane) {
      if (is_done_[lane]) continue;
      if (is_good(lane)) {
        end_tick(lane);
      } else {
        give_up(lane);
        if (has_bodies()) push(lane, tick);
      }
      store_rest_of_path(context_, group_[lane], tick);
    }
  }

  // The motion of a tick, which has not been stored yet.
  TickMotion motion_of(std::size_t lane) const {
    const DroneIndex drone = group_[lane];
    const auto& q = flock_.rotation;
    return {
        .from = pose_of(state_, drone),
        .to = {vec3(flock_.position, lane), Quat(q[0][lane], q[1][lane], q[2][lane], q[3][lane])},
        .begin = {vec3(state_.flight.velocity, drone), vec3(state_.flight.angular_velocity, drone)},
        .end = {vec3(flock_.velocity, lane), vec3(flock_.turn, lane)},
        .duration_s = fleet_.clock.dt_s(),
    };
  }

  void end_tick(std::size_t lane) {
    const DroneIndex drone = group_[lane];
    GroupMember& member = context_.scratch.member;
    member.airframe = &fleet_.true_airframe_of(drone);
    member.motion = motion_of(lane);
    member.has_contact = member.is_fixed = false;
    context_.scratch.contacts.resolve(member, obstacles(lane), bodies(lane), fleet_.config);
    if (member.contact.hit) write_contact(state_, drone, member);
    if (member.is_deflected) {
      note_detour(lane, member.reach);
      set(member.pose.position, lane, flock_.position);
      set(member.pose.rotation, lane, flock_.rotation);
      set(member.velocity.linear, lane, flock_.velocity);
      set(member.velocity.angular, lane, flock_.turn);
      for (Lanes<3>* const lanes : {&flock_.remainder, &flock_.acceleration, &flock_.angular_acceleration}) {
        set(Vec3::Zero(), lane, *lanes);
      }
    }
    group_.store(lane, flock_, state_);
    if (!member.is_deflected) return;
    if (fleet_.config.on_contact == OnContact::terminate) {
      is_done_[lane] = true;
    } else {
      move_origin(lane, member.pose.position);
    }
  }

  // Continues the leg from a new origin.
  void move_origin(std::size_t lane, const Vec3& to) {
    const Vec3 moved = to - vec3(flock_.origin, lane);
    set(to, lane, flock_.origin);
    set(Vec3::Zero(), lane, flock_.travelled);
    flock_.height[lane] += moved.z();
    if (physics_.stage != Stage::position) return;
    for (std::size_t k = 0; k < 3; ++k) {
      const float by = moved[static_cast<Eigen::Index>(k)];
      flock_.setpoint[k][lane] -= by;
      for (Arrival& arrival : flock_.arrivals) arrival.setpoint[k][lane] -= by;
    }
  }

  // Stops a drone whose state left the range that can be integrated: it rests at its last position.
  void give_up(std::size_t lane) {
    fleet_.start(state_, group_[lane], {});
    context_.bad[group_[lane]] = 1;
    is_done_[lane] = true;
  }

  const FlightContext& context_;
  Fleet& fleet_;
  const Physics& physics_;
  State& state_;
  Flock& flock_;
  LaneGroup group_;
  const LaneNumbers& numbers_;
  alignas(64) Lane space_{};                    // m, free radius around the origin that flying the leg at once requires
  std::array<std::int32_t, kLanes> is_open_{};  // the cached open space is large enough
  LaneFlags is_done_{};                         // the lane has finished the leg
  Lane detour_{};                               // m, see note_detour()
};

// Calls f(group) for the groups of drones, with the physics of their commands.
template <class F>
void for_each_group(const FlightContext& context, std::span<const DroneIndex> drones, const Commands& commands, const F& f) {
  const auto with = [&](const Physics& physics) {
    while (!drones.empty()) {
      GroupFlight group(context, physics, drones);
      f(group);
    }
  };
  const Control usual = context.fleet.config.control;
  if (const Control control = commands.control.value_or(usual); control != usual) {
    with(context.fleet.physics_for(control));
  } else {
    with(context.fleet.physics);
  }
}

}  // namespace

void update_accelerations(const FlightContext& context, std::span<const DroneIndex> drones) {
  if (drones.empty()) return;  // Physics is large
  Physics coasting = context.fleet.physics;
  coasting.stage = Stage::rotors;
  coasting.drains = false;  // the rotors keep their speed
  coasting.command_keep = 0.0F;
  while (!drones.empty()) GroupFlight(context, coasting, drones).update_accelerations();
}

void fly(const FlightContext& context, std::span<const DroneIndex> drones, const Commands& commands, int first_tick, int ticks) {
  for_each_group(context, drones, commands, [&](GroupFlight& group) { group.fly(commands, first_tick, ticks); });
}

void record_motions(const FlightContext& context, std::span<const DroneIndex> drones, const Commands& commands, int tick,
                    const MemberTable& table) {
  for_each_group(context, drones, commands, [&](GroupFlight& group) { group.record(commands, tick, table); });
}

void write_result(const FlightContext& context, DroneIndex drone, const GroupMember& member, int tick) {
  State& state = context.state;
  if (member.is_deflected) {
    set_pose_of(state, drone, member.pose);
    std::fill_n(state.flight.remainder.data() + 3 * drone, 3, 0.0F);
  }
  if (member.is_deflected && !member.is_fixed) {
    std::copy_n(member.velocity.linear.data(), 3, state.flight.velocity.data() + 3 * drone);
    std::copy_n(member.velocity.angular.data(), 3, state.flight.angular_velocity.data() + 3 * drone);
    std::fill_n(state.flight.acceleration.data() + 3 * drone, 3, 0.0F);
    std::fill_n(state.flight.angular_acceleration.data() + 3 * drone, 3, 0.0F);
  }
  if (member.contact.hit) {
    write_contact(state, drone, member);
  } else if (member.contact.inside && state.contact.hit[drone]) {
    state.contact.inside[drone] = 1;
  }
  store_rest_of_path(context, drone, tick);
}

}  // namespace flockstep::dynamics
