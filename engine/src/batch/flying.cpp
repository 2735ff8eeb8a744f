#include "batch/flying.hpp"

#include <algorithm>
#include <iterator>
#include <utility>

#include "base/pose_access.hpp"
#include "batch/bad_states.hpp"
#include "batch/episodes.hpp"
#include "batch/selected.hpp"
#include "collision/sweep.hpp"
#include "dynamics/contact.hpp"
#include "dynamics/rotor_motion.hpp"

namespace flockstep {
namespace {

const collision::Obstacles& obstacles_of(const Simulation& sim, DroneIndex drone) {
  return *sim.obstacles[sim.slot_of(sim.env_of(drone))];
}

collision::MovingBodies bodies_of(const Simulation& sim, DroneIndex drone) {
  return sim.bodies->moving().of_env(sim.env_of(drone), sim.bodies->per_env());
}

// Moves a drone by a tick of the moving objects, which may push it. If it has a contact, it keeps that one.
float move_among_bodies(Simulation& sim, DroneIndex drone, const Pose& target, bool has_contact, Scratch& scratch) {
  dynamics::GroupMember& member = scratch.flight.member;
  member.motion = {pose_of(sim.state, drone), target, {}, {}, sim.config.clock.dt_s()};
  member.has_contact = has_contact;
  member.is_fixed = true;
  scratch.flight.contacts.resolve(member, obstacles_of(sim, drone), bodies_of(sim, drone), sim.config.dynamics);
  write_moved(sim, drone, member);
  return member.reach;
}

// True if several drones share a row of the task.
bool has_team_rows(const Simulation& sim) { return sim.task_state && sim.rows_per_env() < sim.drones_per_env(); }

}  // namespace

dynamics::FlightContext flight_context(Simulation& sim, const Block& block, Scratch& scratch) {
  const std::size_t m = sim.drones_per_env();
  return {
      .fleet = *sim.fleet,
      .state = sim.state,
      .hull = sim.hull,
      .slot = sim.slots(),
      .scenes = sim.scenes,
      .obstacles = sim.obstacles,
      .bad = sim.task_state && !has_team_rows(sim) ? std::span(sim.episodes.bad) : std::span(sim.lost),
      .path = sim.task_state ? std::span(sim.task_state->path) : std::span<float>(),
      .own = block.is_contiguous ? dynamics::DroneRange{DroneIndex(block.envs.front() * m), block.envs.size() * m}
                                 : dynamics::DroneRange{},
      .tracer = scratch.tracer,
      .scratch = scratch.flight,
      .bodies = sim.bodies ? sim.bodies->moving() : collision::MovingBodies(),
      .bodies_per_env = sim.bodies ? sim.bodies->per_env() : 0,
  };
}

void start_flight(Simulation& sim, DroneIndex drone, const Velocity& velocity) {
  if (sim.fleet) sim.fleet->start(sim.state, drone, velocity);
}

void place_at_start(Simulation& sim, DroneIndex drone) {
  set_pose_of(sim.state, drone, {sim.world_pointers[sim.slot_of(sim.env_of(drone))]->drone_start(), Quat::Identity()});
  clear_contact(sim.state, drone);
  start_flight(sim, drone, {});
}

void begin_gusts(Simulation& sim, DroneIndex drone) {
  if (sim.fleet) sim.fleet->begin_gusts(sim.state, drone);
}

float sweep_to(Simulation& sim, DroneIndex drone, const Pose& target, Scratch& scratch) {
  if (sim.bodies) return move_among_bodies(sim, drone, target, false, scratch);
  const Pose from = pose_of(sim.state, drone);
  const collision::Contact contact = collision::sweep(obstacles_of(sim, drone), sim.hull, from, target);
  set_pose_of(sim.state, drone, contact.hit ? collision::interpolate(from, target, contact.fraction) : target);
  dynamics::write_contact(sim.state, drone, contact);
  return (target.position - from.position).norm();
}

float give_way(Simulation& sim, DroneIndex drone, Scratch& scratch) {
  if (!sim.bodies) return 0.0F;
  return move_among_bodies(sim, drone, pose_of(sim.state, drone), sim.state.contact.hit[drone] != 0, scratch);
}

void write_moved(Simulation& sim, DroneIndex drone, const dynamics::GroupMember& member) {
  set_pose_of(sim.state, drone, member.pose);
  if (!member.has_contact) {
    dynamics::write_contact(sim.state, drone, member);
  } else if (member.contact.inside) {
    sim.state.contact.inside[drone] = 1;
  }
}

void move_tick(Simulation& sim, const MoveRequest& move, Scratch& scratch) {
  if (!move.has_contact) {
    sweep_to(sim, move.drone, move.target, scratch);
  } else {
    give_way(sim, move.drone, scratch);
  }
}

void move_tick(Simulation& sim, EnvIndex env, std::span<const MoveRequest> moves, Scratch& scratch) {
  if (sim.drones_touch()) return move_in_groups(sim, env, moves, scratch);
  for (const MoveRequest& move : moves) move_tick(sim, move, scratch);
  if (!sim.bodies || moves.size() == sim.drones_per_env()) return;
  std::size_t next = 0;
  for (std::size_t member = 0; member < sim.drones_per_env(); ++member) {
    const DroneIndex drone = sim.drone_of(env, member);
    if (next < moves.size() && moves[next].drone == drone) {
      ++next;
    } else if (sim.state.active[drone]) {
      give_way(sim, drone, scratch);
    }
  }
}

void update_accelerations(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, Scratch& scratch) {
  scratch.flight.downwash.update(*sim.fleet, sim.state, drones);
  dynamics::update_accelerations(flight_context(sim, block, scratch), drones);
}

void fly_by_rotors(Simulation& sim, const Block& block, std::span<const DroneIndex> drones, const dynamics::Commands& commands,
                   int first_tick, int ticks, Scratch& scratch) {
  if (has_team_rows(sim)) {
    for (const DroneIndex drone : drones) sim.lost[drone] = sim.episodes.bad[sim.row_of(drone)];
  }
  if (sim.drones_touch()) {
    fly_in_groups(sim, block, drones, commands, first_tick, ticks, scratch);
  } else {
    dynamics::fly(flight_context(sim, block, scratch), drones, commands, first_tick, ticks);
  }
  if (!has_team_rows(sim)) return;
  // Only now does a lost drone stop the others of its row: which of them fly later depends on the envs that fly together.
  for (const DroneIndex drone : drones) {
    if (std::exchange(sim.lost[drone], std::uint8_t{0})) mark_bad(sim, sim.row_of(drone));
  }
}

void fly_ticks(Simulation& sim, const Block& block, std::span<const EnvIndex> envs, DroneMask mask,
               const dynamics::Commands& commands, int ticks, Scratch& scratch) {
  const int step = sim.config.clock.substeps();
  dynamics::Fleet& fleet = *sim.fleet;
  const bool follows_steps = fleet.wind.has_gusts() || fleet.physics.downwash || fleet.has_parameters();
  // Envs may be at different ticks of their step, and each follows its own clock: envs at the same tick fly together.
  const int phases = follows_steps || fleet.physics.control_ticks > 1 ? step : 1;
  for (int phase = 0; phase < phases; ++phase) {
    scratch.envs.clear();
    std::ranges::copy_if(envs, std::back_inserter(scratch.envs),
                         [&](EnvIndex env) { return phases == 1 || sim.state.tick[env] % phases == phase; });
    if (scratch.envs.empty()) continue;
    for (int flown = 0, leg = ticks; flown < ticks; flown += leg) {
      const int tick = (phase + flown) % step;  // index in the step
      const auto drones = selected_drones(sim, scratch.envs, Part::active, mask, scratch);
      if (follows_steps || sim.drones_touch()) leg = std::min(ticks - flown, step - tick);
      scratch.flight.ticks_ahead = flown;
      if (flown == 0) fleet.send_commands(sim.state, drones, commands.command);
      if (tick == 0) {
        fleet.redraw_parameters(sim.state, drones, flown);
        fleet.update_wind(sim.state, drones, flown);
        fleet.drain_batteries(sim.state, drones);
      }
      if (tick == 0 || flown == 0) scratch.flight.downwash.update(fleet, sim.state, drones);
      if (sim.bodies) {
        leg = 1;
        for (const EnvIndex env : scratch.envs) sim.bodies->advance(env, sim.state.tick[env] + flown + 1);
      }
      fly_by_rotors(sim, block, drones, commands, tick, leg, scratch);
      if (!sim.bodies || mask.empty() || sim.drones_touch()) continue;
      for (const DroneIndex drone : sim.drones_of(scratch.envs, Part::active, scratch.drones)) {
        if (!mask.selects(drone)) give_way(sim, drone, scratch);  // the others hold still
      }
    }
    scratch.flight.ticks_ahead = 0;
  }
  for (const EnvIndex env : envs) sim.state.tick[env] += ticks;
}

}  // namespace flockstep
