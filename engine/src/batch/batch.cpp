#include "flockstep/batch.hpp"

#include <algorithm>
#include <utility>

#include "base/interrupt.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "batch/call_lock.hpp"
#include "batch/checks.hpp"
#include "batch/episodes.hpp"
#include "batch/flying.hpp"
#include "batch/growth.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "batch/snapshot.hpp"
#include "batch/step.hpp"
#include "dynamics/setpoint.hpp"

namespace flockstep {
namespace {

// The pose given by a row. A missing position or quaternion keeps its current value; quaternions are normalised.
Pose requested_pose(const Simulation& sim, DroneIndex drone, std::size_t row, std::span<const float> position,
                    std::span<const float> quat_wxyz) {
  return given_pose(pose_of(sim.state, drone), row, position, quat_wxyz);
}

// The pose at which a drone is placed. Without a quaternion, a drone with rotors is level and faces +x: a new episode must not
// begin with the tilt of the last crash.
Pose placed_pose(const Simulation& sim, DroneIndex drone, std::size_t row, std::span<const float> position,
                 std::span<const float> quat_wxyz) {
  Pose pose = requested_pose(sim, drone, row, position, quat_wxyz);
  if (quat_wxyz.empty() && !sim.config.dynamics.is_kinematic()) pose.rotation = Quat::Identity();
  return pose;
}

// Draws the numbers of envs or drones, a row for each, from a user stream.
template <class KeyOf>
void draw_rows(const State& state, std::uint32_t stream, int count, std::size_t rows, const KeyOf& key_of, std::span<float> out) {
  checks::random(stream, count);
  const auto columns = static_cast<std::uint32_t>(count);
  checks::size(out.size(), rows * columns, "out");
  for (std::size_t row = 0; row < rows; ++row) {
    const RandomKey key = key_of(row);
    for (std::uint32_t k = 0; k < columns; ++k) out[row * columns + k] = draw_uniform(state, key, stream, k);
  }
}

// Puts a drone at a pose, at rest.
void put_drone(Simulation& sim, DroneIndex drone, const Pose& pose) {
  set_pose_of(sim.state, drone, pose);
  if (sim.drones_touch()) sim.unplaced[drone] = 0;
  clear_contact(sim.state, drone);
  start_flight(sim, drone, {});
  sim.move_lines.begin(drone);
}

// Moves the listed drones, sorted by env, in one step of substeps while the bodies of their envs move. Other drones of these envs
// hold still, unless a body pushes them.
template <class TargetOf>
void move_by_ticks(Simulation& sim, std::span<const DroneIndex> drones, const TargetOf& target_of, Scratch& scratch) {
  const int ticks = sim.config.clock.substeps();
  for_each_env(sim, drones, [&](EnvIndex env, std::span<const DroneIndex> of_env) {
    scratch.poses.clear();
    for (const DroneIndex drone : of_env) {
      scratch.poses.push_back(pose_of(sim.state, drone));
      scratch.poses.push_back(target_of(drone));
      clear_contact(sim.state, drone);
    }
    for (int tick = 1; tick <= ticks; ++tick) {
      Interrupt::poll();  // between ticks the state is consistent
      ++sim.state.tick[env];
      if (sim.bodies) sim.bodies->advance(env, sim.state.tick[env]);
      scratch.moves.clear();
      for (std::size_t i = 0; i < of_env.size(); ++i) {
        const Pose &from = scratch.poses[2 * i], &to = scratch.poses[2 * i + 1];
        scratch.moves.push_back({of_env[i], ticks == 1 ? to : dynamics::integrate_kinematic(from, to, tick, ticks),
                                 sim.state.contact.hit[of_env[i]] != 0});
      }
      move_tick(sim, env, scratch.moves, scratch);
    }
  });
}

// Writes a row of each array that is not empty to the flight of a drone.
void put_velocity(Simulation& sim, DroneIndex drone, std::size_t row, std::span<const float> velocity,
                  std::span<const float> angular_velocity, std::span<const float> rotor_speed) {
  const auto put = [&](std::span<const float> from, std::vector<float>& to, std::size_t columns) {
    if (!from.empty()) std::copy_n(from.data() + columns * row, columns, to.data() + columns * drone);
  };
  FlightState& flight = sim.state.flight;
  put(velocity, flight.velocity, 3);
  put(angular_velocity, flight.angular_velocity, 3);
  put(rotor_speed, flight.rotor_speed, sim.fleet->num_rotors());
  put(rotor_speed, flight.rotor_command, sim.fleet->num_rotors());
  sim.fleet->clear_absent_rotors(sim.state, drone);
}

// Deactivates a drone and sets its readings and outputs to those of an absent one.
void mark_absent(Simulation& sim, DroneIndex drone) {
  sim.state.active[drone] = 0;
  if (sim.episodes_mode() == Episodes::last) {
    sim.state.own.finished[drone] = 0;
    end_rest(sim, sim.env_of(drone));
  }
  clear_contact(sim.state, drone);
  for (const auto& sensor : sim.suite) sensor->clear(drone);
  sim.cameras.clear(drone);
  if (!sim.task_state) return;
  const std::size_t row = sim.row_of(drone);
  if (sim.rows_per_env() < sim.drones_per_env() && is_active(sim, sim.env_of(drone))) return;  // its env still has other drones
  sim.outputs.mark_absent(sim.task_state->spec(), row);
  Score& score = sim.task_state->score;
  std::ranges::fill(score.terms_of(row), 0.0);
  score.terminated[row] = score.truncated[row] = score.success[row] = score.left_area[row] = 0;
}

// Makes the move lines and beams of removed drones invisible.
void hide_absent(Simulation& sim) {
  std::vector<DroneIndex> absent;
  const FlagArray& shown = sim.move_lines.flags().beams_visible;
  for (std::size_t i = 0; i < shown.size(); ++i) {
    if (shown[i] && is_removed(sim, DroneIndex(i))) absent.emplace_back(i);
  }
  sim.move_lines.set_beams_visible(false, absent);
  absent.clear();
  for (const DroneIndex drone : sim.move_lines.visible()) {
    if (is_removed(sim, drone)) absent.push_back(drone);
  }
  sim.move_lines.set_visible(false, absent);
}

// Restarts the clock of an env, clears its readings and draws light and gusts from its seed and episode.
void begin_time(Simulation& sim, EnvIndex env) {
  forget_readings(sim, env);
  draw_light(sim, env);
  for (std::size_t member = 0; member < sim.drones_per_env(); ++member) begin_gusts(sim, sim.drone_of(env, member));
  if (sim.bodies) sim.bodies->begin(env);
}

}  // namespace

Batch::Batch(BatchConfig config, Worlds worlds, std::unique_ptr<Task> task, DroneModel drone,
             std::span<const std::int32_t> world_index)
    : lock_(std::make_unique<CallLock>()),
      sim_(std::make_shared<Simulation>(std::move(config), std::move(worlds), std::move(task), std::move(drone), world_index)) {
  sim_->cameras.start_backend(sim_->config.camera_backend, sim_->workers);
}

Batch::Batch(BatchConfig config, WorldPool pool, std::unique_ptr<Task> task, DroneModel drone)
    : lock_(std::make_unique<CallLock>()),
      sim_(std::make_shared<Simulation>(std::move(config), Worlds(), std::move(task), std::move(drone),
                                        std::span<const std::int32_t>(), std::move(pool))) {
  sim_->cameras.start_backend(sim_->config.camera_backend, sim_->workers);
}

Batch::~Batch() = default;

const BatchConfig& Batch::config() const { return sim_->config; }
const Batch::Worlds& Batch::worlds() const {
  static const Worlds kNone;
  return sim_->pool ? kNone : sim_->worlds;
}
const World& Batch::unlit_world_of(EnvIndex env) const { return *sim_->world_pointers[sim_->slot_of(env)]; }
std::shared_ptr<const World> Batch::world_of(EnvIndex env) const { return sim_->lights.world(env, sim_->slot_of(env)); }
const DroneModel& Batch::drone() const { return sim_->drone_model; }
std::size_t Batch::num_rotors() const { return sim_->fleet ? sim_->fleet->num_rotors() : kMinRotors; }
std::size_t Batch::num_rotors(DroneIndex drone) const {
  return sim_->fleet ? sim_->fleet->airframe_of(drone).num_rotors() : kMinRotors;
}
std::size_t Batch::command_size(std::optional<Control> control) const {
  return tells_rotors(control.value_or(config().dynamics.control)) ? num_rotors() : 4;
}
int Batch::num_threads() const { return sim_->workers.num_threads(); }
EmbreeCounts Batch::embree() const { return {.rays = sim_->embree_use().rays, .packets = sim_->embree_use().packets}; }
const State& Batch::state() const { return sim_->state; }

// ------------------------------------------------------------------------------------------------------------------ growth

void Batch::replace(std::shared_ptr<Simulation> next) {
  lock_->move_arrays([&] {
    next->take_over(*sim_);
    sim_.swap(next);
  });
}

// ------------------------------------------------------------------------------------------------------ motion and sensing

void Batch::set_pose(std::span<const float> position, std::span<const float> quat_wxyz, DroneMask mask) {
  const CallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  checks::poses(position, quat_wxyz, sim_->num_drones());
  for_each_selected(*sim_, mask,
                    [&](DroneIndex drone) { put_drone(*sim_, drone, placed_pose(*sim_, drone, drone, position, quat_wxyz)); });
}

void Batch::set_pose(std::span<const std::int64_t> drones, std::span<const float> position, std::span<const float> quat_wxyz) {
  const CallGuard guard(*lock_);
  checks::indices(drones, sim_->num_drones(), "rows");
  checks::poses(position, quat_wxyz, drones.size());
  for (std::size_t row = 0; row < drones.size(); ++row) {
    const DroneIndex drone(drones[row]);
    if (sim_->state.active[drone]) put_drone(*sim_, drone, placed_pose(*sim_, drone, row, position, quat_wxyz));
  }
}

void Batch::move(std::span<const float> position, std::span<const float> quat_wxyz, DroneMask mask) {
  const LongCallGuard guard(*lock_);
  checks::is_kinematic(*sim_, "move");
  checks::mask(*sim_, mask);
  checks::poses(position, quat_wxyz, sim_->num_drones());
  sim_->for_each_block([&](Block& block, Scratch& scratch, std::size_t) {
    const std::span<const DroneIndex> drones = selected_drones(*sim_, block.envs, Part::active, mask, scratch);
    const auto target_of = [&](DroneIndex drone) { return requested_pose(*sim_, drone, drone, position, quat_wxyz); };
    if (sim_->bodies || sim_->drones_touch()) return move_by_ticks(*sim_, drones, target_of, scratch);
    EnvIndex before(sim_->num_envs());  // none
    for (const DroneIndex drone : drones) {
      sweep_to(*sim_, drone, target_of(drone), scratch);
      const EnvIndex env = sim_->env_of(drone);
      if (env != std::exchange(before, env)) sim_->state.tick[env] += sim_->config.clock.substeps();
    }
  });
  for (const DroneIndex drone : sim_->move_lines.visible()) sim_->move_lines.add(drone);
}

void Batch::set_velocity(std::span<const float> velocity, std::span<const float> angular_velocity,
                         std::span<const float> rotor_speed, DroneMask mask) {
  const CallGuard guard(*lock_);
  checks::flies_by_rotors(*sim_, "set_velocity");
  checks::mask(*sim_, mask);
  checks::velocity(velocity, sim_->num_drones());
  checks::angular_velocity(*sim_, angular_velocity, sim_->num_drones());
  checks::rotor_speeds(*sim_, rotor_speed, {});
  for_each_selected(*sim_, mask,
                    [&](DroneIndex drone) { put_velocity(*sim_, drone, drone, velocity, angular_velocity, rotor_speed); });
}

void Batch::set_velocity(std::span<const std::int64_t> drones, std::span<const float> velocity,
                         std::span<const float> angular_velocity, std::span<const float> rotor_speed) {
  const CallGuard guard(*lock_);
  checks::flies_by_rotors(*sim_, "set_velocity");
  checks::indices(drones, sim_->num_drones(), "rows");
  checks::velocity(velocity, drones.size());
  checks::angular_velocity(*sim_, angular_velocity, drones.size());
  checks::rotor_speeds(*sim_, rotor_speed, drones);
  for (std::size_t row = 0; row < drones.size(); ++row) {
    const DroneIndex drone(drones[row]);
    if (sim_->state.active[drone]) put_velocity(*sim_, drone, row, velocity, angular_velocity, rotor_speed);
  }
}

void Batch::set_params(std::span<const float> params, DroneMask mask) {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "set_params");
  require(sim_->fleet && sim_->fleet->has_parameters(), "set_params", "a batch with variations", "one without");
  checks::mask(*sim_, mask);
  checks::size(params.size(), kNumParameters * sim_->num_drones(), "params");
  const auto row_of = [&](DroneIndex drone) { return params.subspan(kNumParameters * drone, kNumParameters); };
  for_each_selected(*sim_, mask, [&](DroneIndex drone) { sim_->fleet->check_parameters(row_of(drone)); });
  sim_->fleet->part();
  for_each_selected(*sim_, mask, [&](DroneIndex drone) {
    std::ranges::copy(row_of(drone), sim_->state.parameters.params.data() + kNumParameters * drone);
    sim_->fleet->apply_parameters(sim_->state, drone);
  });
}

void Batch::set_variations(const std::vector<Variation>& variations) {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "set_variations");
  require(sim_->fleet && sim_->fleet->has_parameters(), "set_variations", "a batch with variations", "one without");
  for (const Variation& variation : variations) variation.validate();
  sim_->fleet->set_variations(dynamics::Variations(variations, sim_->fleet->airframes, sim_->fleet->clock));
  sim_->config.variations = variations;
}

void Batch::fly(std::span<const float> command, int ticks, DroneMask mask, std::optional<Control> control) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "fly");
  checks::flies_by_rotors(*sim_, "fly");
  checks::mask(*sim_, mask);
  const std::optional<std::size_t> far = checks::command(*sim_, command, control);
  if (far && !std::exchange(sim_->has_far_yaw, true)) sim_->warning = checks::far_yaw("command", command, *far);
  require(ticks >= 0 && ticks <= 1000000, "ticks", "an integer in [0, 1000000]", ticks);
  const int flown = ticks == 0 ? sim_->config.clock.substeps() : ticks;
  list_selected(*sim_, mask, &Block::selected);
  std::ranges::fill(sim_->lost, std::uint8_t{0});
  constexpr int kLeg = 1000;  // ticks; interrupts are polled between legs
  for (int first = 0; first < flown; first += kLeg) {
    Interrupt::poll();
    const int leg = std::min(kLeg, flown - first);
    sim_->for_each_block([&](Block& block, Scratch& scratch, std::size_t) {
      if (first == 0) {
        for (const DroneIndex drone : selected_drones(*sim_, block.selected, Part::active, mask, scratch))
          clear_contact(sim_->state, drone);
      }
      fly_ticks(*sim_, block, block.selected, mask, {.command = command, .target = {}, .step_start = {}, .control = control}, leg,
                scratch);
    });
  }
  for (const DroneIndex drone : sim_->move_lines.visible()) sim_->move_lines.add(drone);
  sim_->warn_of_lost_drones();
}

void Batch::require_command(std::span<const float> command, std::optional<Control> control) const {
  const CallGuard guard(*lock_);
  checks::flies_by_rotors(*sim_, "fly");
  checks::command(*sim_, command, control);
}

void Batch::sense(DroneMask mask) {
  const LongCallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  list_selected(*sim_, mask, &Block::selected);
  read_sensors(*sim_, mask);
}

// ------------------------------------------------------------------------------------------------------------------- slots

std::vector<std::int64_t> Batch::spawn(std::span<const std::int64_t> indices, std::span<const float> position,
                                       std::span<const float> quat_wxyz, std::span<const std::int32_t> world_index,
                                       std::span<const std::int64_t> env_index) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "spawn");
  require(indices.empty() || env_index.empty(), "env", "none beside indices", std::to_string(env_index.size()) + " of them");
  const std::size_t rows = !indices.empty() ? indices.size() : !env_index.empty() ? env_index.size() : position.size() / 3;
  checks::poses(position, quat_wxyz, rows);
  checks::world_index(*sim_, world_index, rows);
  checks::require_not_interrupted(*sim_);
  const SpawnPlan plan = plan_spawn(*sim_, indices, env_index, rows);
  std::shared_ptr<Simulation> grown;
  if (plan.num_envs > sim_->num_envs() || plan.drones_per_env > sim_->drones_per_env()) {
    checks::can_grow(*lock_, "spawn");
    BatchConfig config = sim_->config;
    config.num_envs = static_cast<int>(plan.num_envs);
    config.drones_per_env = static_cast<int>(plan.drones_per_env);
    grown = resized(*sim_, std::move(config));
  }
  Simulation& sim = grown ? *grown : *sim_;
  State& state = sim.state;
  std::vector<std::uint8_t> spawned(sim.num_drones()), begins(sim.num_envs(), 1);
  for (const std::int64_t index : plan.indices) spawned[static_cast<std::size_t>(index)] = 1;
  for (std::size_t i = 0; i < sim.num_drones(); ++i) {
    const DroneIndex drone(i);
    if (!is_removed(sim, drone) && !spawned[i]) begins[sim.env_of(drone)] = 0;  // its clock goes on
  }
  checks::spawns(sim, plan.indices, begins, world_index);
  const bool is_each = sim.episodes_mode() == Episodes::each;
  const std::shared_ptr<const void> before = sim_;  // the arguments may be views of its arrays
  if (grown) replace(std::move(grown));
  for (std::size_t row = 0; row < rows; ++row) {
    const DroneIndex drone(plan.indices[row]);
    const EnvIndex env = sim.env_of(drone);
    if (!world_index.empty()) state.world_index[env] = world_index[row];
    state.active[drone] = 1;
    for (const auto& sensor : sim.suite) sensor->use_default_settings(drone);  // not those of the drone before
    for (std::size_t camera = 0; camera < sim.cameras.size(); ++camera) sim.cameras[camera].use_default_settings(drone);
    if (!state.own.finished.empty()) state.own.finished[drone] = 0;
    if (begins[env]) {
      forget_readings(sim, env);
      if (sim.bodies) sim.bodies->begin(env);
    } else if (is_each) {
      start_next_episode(sim, drone);
    } else {
      forget_readings(sim, drone);
    }
    put_drone(sim, drone, placed_pose(sim, drone, row, position, quat_wxyz));
    if (!sim.task_state) continue;
    if (begins[env]) start_counts(sim, env);
    sim.outputs.clear(sim.row_of(drone));
  }
  sim.rebuild_schedule();
  if (sim.task_state) {
    list_selected(sim, DroneMask(spawned), &Block::resetting);
    if (is_each) std::ranges::copy(spawned, sim.begins.begin());
    begin_episodes(sim, false);
  } else {
    list_selected(sim, DroneMask(spawned), &Block::selected);
    read_sensors(sim, spawned);
  }
  return plan.indices;
}

void Batch::remove(std::span<const std::int64_t> indices) {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "remove");
  checks::indices(*sim_, indices);
  for (const std::int64_t index : indices) mark_absent(*sim_, DroneIndex(index));
  hide_absent(*sim_);
  sim_->rebuild_schedule();
}

void Batch::set_world(std::span<const std::int32_t> world_index, EnvMask mask) {
  const CallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  checks::size(world_index.size(), sim_->num_envs(), "world_index");
  checks::world_index(*sim_, world_index, sim_->num_envs());
  for (std::size_t i = 0; i < sim_->num_envs(); ++i) {
    if (const EnvIndex env(i); mask.selects(env)) {
      sim_->state.world_index[env] = world_index[env];
      if (sim_->bodies) sim_->bodies->begin(env);
    }
  }
  if (sim_->is_stepping) {
    sim_->scratches[0]->moved_world = true;  // the blocks are rebuilt after the step
  } else {
    sim_->rebuild_schedule();
  }
}

// ---------------------------------------------------------------------------------------------------------- random numbers

void Batch::seed(std::span<const std::uint64_t> seeds, EnvMask mask) {
  const CallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  checks::size(seeds.size(), sim_->num_envs(), "seeds");
  for_each_selected(*sim_, mask, [&](EnvIndex env) {
    sim_->state.seed[env] = seeds[env];
    sim_->state.episode[env] = 0;
    forget_own_episodes(*sim_, env);
    begin_time(*sim_, env);
  });
}

void Batch::begin_episode(EnvMask mask) {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "begin_episode");
  checks::mask(*sim_, mask);
  for_each_selected(*sim_, mask, [&](EnvIndex env) {
    ++sim_->state.episode[env];
    begin_time(*sim_, env);
  });
}

void Batch::random(std::uint32_t stream, int count, std::span<float> out) const {
  const CallGuard guard(*lock_);
  const auto key_of = [](std::size_t row) { return RandomKey::of(EnvIndex(row)); };
  draw_rows(sim_->state, stream, count, sim_->num_envs(), key_of, out);
}

void Batch::random(std::uint32_t stream, int count, std::span<const std::int64_t> envs, std::span<float> out) const {
  const CallGuard guard(*lock_);
  checks::indices(envs, sim_->num_envs(), "rows");
  const auto key_of = [&](std::size_t row) { return RandomKey::of(EnvIndex(envs[row])); };
  draw_rows(sim_->state, stream, count, envs.size(), key_of, out);
}

void Batch::random_of_drones(std::uint32_t stream, int count, std::span<const std::int64_t> drones, std::span<float> out) const {
  const CallGuard guard(*lock_);
  checks::indices(drones, sim_->num_drones(), "rows");
  const auto key_of = [&](std::size_t row) { return sim_->random_key(DroneIndex(drones[row])); };
  draw_rows(sim_->state, stream, count, drones.size(), key_of, out);
}

// --------------------------------------------------------------------------------------------------------------- snapshots

std::string Batch::snapshot() const {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "snapshot");
  checks::require_not_interrupted(*sim_);
  return make_snapshot(*sim_);
}

void Batch::restore(const std::string& blob) {
  const LongCallGuard guard(*lock_);
  checks::not_stepping(*sim_, "restore");
  restore_snapshot(*sim_, blob);
  sim_->is_cut_short = false;
  for (std::size_t i = 0; i < sim_->num_drones(); ++i) {
    if (is_removed(*sim_, DroneIndex(i))) mark_absent(*sim_, DroneIndex(i));  // also in the other slot, where it may be active
  }
  hide_absent(*sim_);
  for (const DroneIndex drone : sim_->move_lines.visible()) sim_->move_lines.begin(drone);
  sim_->rebuild_schedule();
  if (sim_->pool) {
    list_selected(*sim_, EnvMask(), &Block::resetting);
    look_ahead(*sim_);
  }
  sim_->cameras.ask_again();
  sim_->cameras.start();
  sim_->cameras.finish(sim_->workers);
}

}  // namespace flockstep
