#include "batch/step.hpp"

#include <algorithm>
#include <exception>
#include <initializer_list>
#include <utility>

#include "base/indices.hpp"
#include "base/pose_access.hpp"
#include "batch/bad_states.hpp"
#include "batch/checks.hpp"
#include "batch/episodes.hpp"
#include "batch/flying.hpp"
#include "batch/selected.hpp"
#include "dynamics/setpoint.hpp"

namespace flockstep {
namespace {

using List = EnvList Block::*;

// ------------------------------------------------------------------------------------------------------------------ stages

// Reads every kind of sensor except the cameras, which render for all blocks at once.
void read_all(Simulation& sim, std::span<const DroneIndex> drones, Scratch& scratch) {
  const sensors::Surroundings surroundings = surroundings_of(sim, scratch);
  for (const auto& sensor : sim.suite) sensor->read(drones, surroundings);
}

// Reads the sensors that are due, in the middle of a step or at its end. `drones` are the flying drones of `envs`.
void read_due(Simulation& sim, std::span<const EnvIndex> envs, std::span<const DroneIndex> drones, bool step_is_over,
              Scratch& scratch) {
  const sensors::Surroundings surroundings = surroundings_of(sim, scratch);
  for (const auto& sensor : sim.suite) {
    const std::int64_t period = sensor->period();
    if (period == 0) {
      if (step_is_over) sensor->read(drones, surroundings);
      continue;
    }
    scratch.envs.clear();
    for (const EnvIndex env : envs) {
      if (sensors::is_due(period, sim.state.tick[env], step_is_over)) scratch.envs.push_back(env);
    }
    sensor->read(sim.drones_of(scratch.envs, Part::flying, scratch.drones), surroundings);
    if (step_is_over) sensor->publish(drones, sim.state);
  }
}

void count_step(Simulation& sim, Block& block, Scratch&) {
  for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
    const std::size_t rows = sim.rows_per_env();
    if (sim.episodes_mode() == Episodes::each) {
      for (std::size_t row = first * rows; row < (first + count) * rows; ++row) {
        sim.episodes.steps[row] += sim.takes_part(DroneIndex(row), Part::flying) ? 1 : 0;
      }
    } else {
      for (std::size_t row = first * rows; row < (first + count) * rows; ++row) ++sim.episodes.steps[row];
    }
    std::fill_n(sim.task_state->score.truncated.data() + first * rows, count * rows, std::uint8_t{0});
  });
}

// Moves kinematic drones by one substep. The last substep of a step ends at the setpoint, unless a drone hits something.
void move(Simulation& sim, std::span<const DroneIndex> drones, int substep, Scratch& scratch) {
  const int substeps = sim.config.clock.substeps();
  const auto request_of = [&](DroneIndex drone) {
    const Pose& target = sim.task_state->setpoints.target[drone];
    if (substeps == 1) return MoveRequest{drone, target, false};
    return MoveRequest{drone, dynamics::integrate_kinematic(sim.task_state->step_start[drone], target, substep, substeps),
                       sim.state.contact.hit[drone] != 0};  // after a hit the drone stays until the next step
  };
  if (sim.drones_touch()) {
    for_each_env(sim, drones, [&](EnvIndex env, std::span<const DroneIndex> of_env) {
      scratch.moves.clear();
      for (const DroneIndex drone : of_env) scratch.moves.push_back(request_of(drone));
      move_tick(sim, env, scratch.moves, scratch);
    });
    return;
  }
  for (std::size_t i = 0; i < drones.size(); ++i) {
    sim.fetch_ahead(drones, i);
    move_tick(sim, request_of(drones[i]), scratch);
  }
}

// Writes the positions of drones to the entries of their paths from `first` on.
void record_path(Simulation& sim, std::span<const DroneIndex> drones, int first) {
  std::vector<float>& path = sim.task_state->path;
  const std::size_t row = path.size() / sim.num_drones();
  for (const DroneIndex drone : drones) {
    for (std::size_t i = 3 * static_cast<std::size_t>(first); i < row; i += 3) {
      std::copy_n(sim.state.position.data() + 3 * drone, 3, path.data() + row * drone + i);
    }
  }
}

// Prepares drones for the ticks of a step.
void begin_flight(Simulation& sim, std::span<const DroneIndex> drones, Scratch& scratch) {
  if (!sim.task_state->step_start.empty()) {
    for (const DroneIndex drone : drones) sim.task_state->step_start[drone] = pose_of(sim.state, drone);
  }
  if (!sim.task_state->path.empty()) record_path(sim, drones, 0);
  for_each_contiguous(drones, [&](std::size_t first, std::size_t count) {
    if (sim.fleet) {
      if (!is_any(sim.state.contact.hit.data() + first, count)) return;  // the usual case
      for (std::size_t i = first; i < first + count; ++i) {
        if (sim.state.contact.hit[i]) clear_contact(sim.state, DroneIndex(i));
      }
    } else if (sim.config.clock.substeps() > 1) {
      std::fill_n(sim.state.contact.hit.data() + first, count, std::uint8_t{0});
    }
  });
  if (sim.fleet) {
    sim.fleet->redraw_parameters(sim.state, drones, 0);
    sim.fleet->update_wind(sim.state, drones, 0);
    sim.fleet->drain_batteries(sim.state, drones);
    sim.fleet->send_commands(sim.state, drones, sim.task_state->setpoints.command);
    scratch.flight.downwash.update(*sim.fleet, sim.state, drones);
  }
}

// Flies the ticks of a step from `begin` up to `end`: moves the drones, with contacts, and reads the sensors that are due between
// ticks. sense() reads those that are due at the end of the step.
void fly_part(Simulation& sim, Block& block, const dynamics::Commands& commands, int begin, int end, Scratch& scratch) {
  const int ticks = sim.config.clock.substeps();
  const auto drones = sim.drones_of(block.flying, scratch.flying);
  if (begin == 0) begin_flight(sim, drones, scratch);
  // Kinematic drones move by ticks.
  const int leg = sim.fleet && !sim.suite.reads_between_ticks() && !sim.bodies ? end - begin : 1;
  for (int flown = begin + leg; flown <= end; flown += leg) {
    if (sim.bodies) {
      for (const EnvIndex env : block.flying) sim.bodies->advance(env, sim.state.tick[env] + leg);
    }
    if (sim.fleet) {
      fly_by_rotors(sim, block, drones, commands, flown - leg, leg, scratch);
    } else {
      move(sim, drones, flown, scratch);
      if (!sim.task_state->path.empty()) record_path(sim, drones, flown);
    }
    for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
      for (std::size_t env = first; env < first + count; ++env) sim.state.tick[env] += leg;
    });
    if (flown < ticks) read_due(sim, block.flying, drones, false, scratch);
  }
  if (end < ticks) return;
  for_each_contiguous(block.flying, [&](std::size_t first, std::size_t count) {
    for (std::size_t env = first; env < first + count; ++env) ++sim.state.sensed[env];
  });
}

// Flies a step by the built-in controller.
void fly(Simulation& sim, Block& block, Scratch& scratch) {
  const Setpoints& setpoints = sim.task_state->setpoints;
  const dynamics::Commands commands{setpoints.command, setpoints.target, sim.task_state->step_start};
  fly_part(sim, block, commands, 0, sim.config.clock.substeps(), scratch);
}

// Flies a step by the batch's own controller.
template <class Executor>
void fly_by_controller(Simulation& sim, Executor& executor) {
  for (int tick = 0; tick < sim.config.clock.substeps(); ++tick) {
    const std::span<const float> speeds = sim.controller(sim.task_state->setpoints.command, tick);
    checks::command(sim, speeds, Control::rotor_speeds);
    const dynamics::Commands commands{.command = speeds, .target = {}, .step_start = {}, .control = Control::rotor_speeds};
    executor.each([&](Simulation& s, Block& block, Scratch& scratch) { fly_part(s, block, commands, tick, tick + 1, scratch); });
  }
}

void sense(Simulation& sim, Block& block, Scratch& scratch) {
  read_due(sim, block.flying, sim.drones_of(block.flying, scratch.flying), true, scratch);
}

// Reads all sensors of the listed envs, whether due or not, as at the start of an episode.
template <List kList>
void sense_all(Simulation& sim, Block& block, Scratch& scratch) {
  read_all(sim, sim.drones_of(block.*kList, scratch), scratch);
}

// ------------------------------------------------------------------------------------------------- two executors of the stages

// Runs all stages of a block on one thread, without waiting for other blocks.
class BlockByBlock {
 public:
  BlockByBlock(Simulation& sim, Block& block, Scratch& scratch, std::size_t thread)
      : sim_(sim), block_(block), scratch_(scratch), thread_(thread) {}

  template <class Stage>
  void each(const Stage& stage) {
    stage(sim_, block_, scratch_);
  }
  template <class Call>
  void task(std::initializer_list<List> lists, const Call& call) {
    for (const List list : lists) {
      const auto drones = sim_.drones_of(block_.*list, scratch_);
      if (!drones.empty()) call(TaskBlock{*sim_.context, block_.*list, drones, thread_});
    }
  }
  void start_frames(List) {}  // there are no cameras
  void finish_frames() {}

 private:
  Simulation& sim_;
  Block& block_;
  Scratch& scratch_;
  std::size_t thread_;
};

// Runs each stage for all blocks before the next stage begins. Cameras that render all drones at once need this, and so do
// tasks and controllers that take all envs at once.
class StageByStage {
 public:
  explicit StageByStage(Simulation& sim) : sim_(sim) {}

  template <class Stage>
  void each(const Stage& stage) {
    sim_.for_each_block([&](Block& block, Scratch& scratch, std::size_t) { stage(sim_, block, scratch); });
  }
  template <class Call>
  void task(std::initializer_list<List> lists, const Call& call) {
    if (!sim_.task_state->task->takes_all_envs_at_once()) {
      sim_.for_each_block([&](Block& block, Scratch& scratch, std::size_t thread) {
        BlockByBlock(sim_, block, scratch, thread).task(lists, call);
      });
      return;
    }
    sim_.listed.clear();
    sim_.listed_drones.clear();
    const bool is_each = sim_.episodes_mode() == Episodes::each;
    for (const Block& block : sim_.schedule.blocks()) {
      for (const List list : lists) {
        const auto drones = sim_.drones_of(block.*list, *sim_.scratches[0]);
        sim_.listed_drones.insert(sim_.listed_drones.end(), drones.begin(), drones.end());
        if (is_each && list != *lists.begin()) continue;  // all envs are flown: those that reset are among them
        sim_.listed.insert(sim_.listed.end(), (block.*list).begin(), (block.*list).end());
      }
    }
    if (!sim_.listed_drones.empty()) call(TaskBlock{*sim_.context, sim_.listed, sim_.listed_drones, 0});
  }
  // A backend with a separate thread renders until finish_frames().
  void start_frames(List list, DroneMask mask = {}) {
    if (sim_.cameras.empty()) return;
    sim_.cameras.ask([&](const auto& ask) {
      for (const Block& block : sim_.schedule.blocks()) {
        for (const DroneIndex drone : selected_drones(sim_, block.*list, (block.*list).part(), mask, *sim_.scratches[0]))
          ask(drone);
      }
    });
    sim_.cameras.start();
  }
  void finish_frames() { sim_.cameras.finish(sim_.workers); }

 private:
  Simulation& sim_;
};

// ----------------------------------------------------------------------------------------------- the stages of a step in order

bool resets_at_once(const Simulation& sim) { return sim.config.episode.autoreset_mode == AutoresetMode::same_step; }
// A world and its light belong to an env, whose episode does not end with those of its drones.
bool changes_worlds(const Simulation& sim) { return sim.pool && sim.episodes_mode() != Episodes::each; }

void check_flown(Simulation& sim, Block& block, Scratch&) { check_observations(sim, block.flown, true); }
void check_first_observations(Simulation& sim, Block& block, Scratch&) { check_observations(sim, block.resetting, false); }

// Notes that the drones that begin an episode have no place yet, or have one.
template <std::uint8_t kUnplaced>
void mark_places(Simulation& sim, Block& block, Scratch& scratch) {
  if (!sim.drones_touch()) return;
  for (const DroneIndex drone : sim.drones_of(block.resetting, scratch)) sim.unplaced[drone] = kUnplaced;
}

// Begins an episode in each env of Block::resetting. The caller has already set the counters of these envs. Places the drones
// if `place` is true, and reads the sensors.
template <class Executor>
void begin_program(Simulation& sim, Executor& executor, bool place) {
  Task& task = *sim.task_state->task;
  if (place) {
    executor.each(mark_places<std::uint8_t{1}>);
    executor.task({&Block::resetting}, [&](const TaskBlock& envs) { task.place(envs); });
  }
  executor.task({&Block::resetting}, [&](const TaskBlock& envs) { task.begin(envs); });  // a Python task places drones here
  executor.each(mark_places<std::uint8_t{0}>);
  executor.each([](Simulation& s, Block& block, Scratch& scratch) {
    initial_readings(s, block, scratch);
    if (s.fleet) update_accelerations(s, block, s.drones_of(block.resetting, scratch), scratch);
  });
  executor.start_frames(&Block::resetting);
  executor.each(sense_all<&Block::resetting>);
  executor.finish_frames();
}

// Writes what agents observe, if it is not just what the task observes.
template <List kList>
void show(Simulation& sim, Block& block, Scratch& scratch) {
  TaskState& task_state = *sim.task_state;
  if (!task_state.memory) return;
  const auto show_row = [&](std::size_t row, RandomKey key) {
    task_state.memory->show(sim.state, key, row, sim.episodes.steps[row], task_state.actions, sim.outputs.now().observation);
  };
  if (task_state.spec().row == Row::env) {
    for (const EnvIndex env : block.*kList) show_row(env, RandomKey::of(env));
  } else {
    for (const DroneIndex drone : sim.drones_of(block.*kList, scratch)) show_row(drone, sim.random_key(drone));
  }
}

void keep(Simulation& sim, Block& block, Scratch&) { keep_final(sim, block); }
void show_rest(Simulation& sim, Block& block, Scratch&) { show_finished(sim, block); }

// Lets the pilot choose the actions of a block.
void pilot_block(Simulation& sim, Block& block, Scratch& scratch, Pilot& pilot) {
  const std::size_t rows = sim.rows_per_env();
  for_each_contiguous(block.envs, [&](std::size_t first, std::size_t count) {
    pilot.act({sim.outputs.before().observation, first * rows, count * rows, scratch.thread}, sim.task_state->actions);
  });
}

// A step runs two programs: fly_program flies the envs, turn_program begins episodes. In between, the envs that begin an
// episode may change their worlds.
template <class Executor>
void fly_program(Simulation& sim, Executor& executor, Pilot* pilot) {
  Task& task = *sim.task_state->task;
  if (pilot != nullptr) {
    executor.each([pilot](Simulation& s, Block& block, Scratch& scratch) { pilot_block(s, block, scratch, *pilot); });
  }
  executor.each([](Simulation& s, Block& block, Scratch&) { select_envs(s, block); });
  for (int flown = 1; flown <= sim.config.episode.frame_skip; ++flown) {
    const bool is_last = flown == sim.config.episode.frame_skip;
    executor.each(count_step);
    executor.task({&Block::flying},
                  [&](const TaskBlock& envs) { task.command(envs, sim.task_state->actions, sim.task_state->setpoints); });
    executor.each([](Simulation& s, Block& block, Scratch&) { check_setpoints(s, block); });
    if (sim.controller) {
      fly_by_controller(sim, executor);
    } else {
      executor.each(fly);
    }
    if (is_last) executor.start_frames(&Block::flown);
    executor.each(sense);
    if (is_last) executor.finish_frames();
    executor.task({&Block::flying}, [&](const TaskBlock& envs) { task.score(envs, sim.task_state->score); });
    executor.each([](Simulation& s, Block& block, Scratch&) { finish_step(s, block); });
  }
  // With same-step autoreset an env is observed twice: at the end of its episode and at the start of the next.
  if (resets_at_once(sim)) {
    executor.task({&Block::flown}, [&](const TaskBlock& envs) { task.observe(envs, sim.observed()); });
    executor.each(check_flown);
    executor.each(show<&Block::flown>);
    executor.each(keep);
  }
  executor.each([](Simulation& s, Block& block, Scratch&) { list_resetting(s, block); });
}

template <class Executor>
void turn_program(Simulation& sim, Executor& executor) {
  const auto observe = [&](const TaskBlock& envs) { sim.task_state->task->observe(envs, sim.observed()); };
  executor.each(advance_episodes);
  begin_program(sim, executor, true);
  if (resets_at_once(sim)) {
    executor.task({&Block::resetting}, observe);
    executor.each(check_first_observations);
    executor.each(show<&Block::resetting>);
    if (sim.episodes_mode() == Episodes::last) executor.each(show_rest);
  } else {
    executor.task({&Block::flown, &Block::resetting}, observe);
    executor.each(check_flown);
    executor.each(check_first_observations);
    executor.each(show<&Block::flown>);
    executor.each(show<&Block::resetting>);
    executor.each(keep);
  }
}

// Keeps the blocks unchanged during a step, even if the task changes worlds. The schedule is rebuilt afterwards.
class Stepping {
 public:
  explicit Stepping(Simulation& sim) : sim_(sim) { sim_.is_stepping = true; }
  ~Stepping() {
    sim_.is_stepping = false;
    sim_.is_cut_short |= std::uncaught_exceptions() > exceptions_;
    bool moved = false;
    for (const auto& scratch : sim_.scratches) moved |= std::exchange(scratch->moved_world, false);
    if (moved && sim_.sorts_by_world) sim_.rebuild_schedule();
  }
  Stepping(const Stepping&) = delete;
  Stepping& operator=(const Stepping&) = delete;

 private:
  Simulation& sim_;
  const int exceptions_ = std::uncaught_exceptions();
};

}  // namespace

void step(Simulation& sim, Pilot* pilot) {
  const Stepping stepping(sim);
  sim.outputs.turn();
  if (!sim.cameras.empty() || sim.task_state->task->takes_all_envs_at_once() || sim.controller) {
    StageByStage executor(sim);
    fly_program(sim, executor, pilot);
    if (changes_worlds(sim)) change_worlds(sim);
    turn_program(sim, executor);
  } else {
    sim.for_each_block([&](Block& block, Scratch& scratch, std::size_t thread) {
      BlockByBlock executor(sim, block, scratch, thread);
      fly_program(sim, executor, pilot);
      if (!changes_worlds(sim)) turn_program(sim, executor);
    });
    if (changes_worlds(sim)) {
      change_worlds(sim);
      sim.for_each_block([&](Block& block, Scratch& scratch, std::size_t thread) {
        BlockByBlock executor(sim, block, scratch, thread);
        turn_program(sim, executor);
      });
    }
  }
  if (changes_worlds(sim)) look_ahead(sim);
  for (const DroneIndex drone : sim.move_lines.visible()) {
    if (sim.episodes.steps[sim.row_of(drone)] == 0) {
      sim.move_lines.begin(drone);
    } else {
      sim.move_lines.add(drone);
    }
  }
}

void begin_episodes(Simulation& sim, bool place) {
  const Stepping stepping(sim);
  StageByStage executor(sim);
  begin_program(sim, executor, place);
  executor.task({&Block::resetting}, [&](const TaskBlock& envs) { sim.task_state->task->observe(envs, sim.observed()); });
  executor.each(check_first_observations);
  executor.each(show<&Block::resetting>);
  if (sim.pool) look_ahead(sim);
}

std::span<const DroneIndex> Simulation::drones_of(std::span<const EnvIndex> envs, Part part,
                                                  std::vector<DroneIndex>& list) const {
  const std::size_t m = drones_per_env();
  if (m == 1) {  // lists hold active envs only
    list.resize(envs.size());
    std::ranges::transform(envs, list.begin(), [](EnvIndex env) { return DroneIndex(std::size_t{env}); });
    return list;
  }
  list.clear();
  for (const EnvIndex env : envs) {
    for (std::size_t member = 0; member < m; ++member) {
      if (const DroneIndex drone = drone_of(env, member); takes_part(drone, part)) list.push_back(drone);
    }
  }
  return list;
}

sensors::Surroundings surroundings_of(const Simulation& sim, Scratch& scratch) {
  return {.state = sim.state,
          .scenes = sim.scenes,
          .slots = sim.slots(),
          .drones_per_env = sim.drones_per_env(),
          .tracer = scratch.tracer,
          .slices = scratch.slices,
          .bodies = sim.bodies ? sim.bodies->visible() : render::VisibleBodies(),
          .bodies_per_env = sim.bodies ? sim.bodies->per_env() : 0,
          .drones = sim.hulls()};
}

void read_sensors(Simulation& sim, DroneMask mask) {
  StageByStage executor(sim);
  executor.each([](Simulation& s, Block& block, Scratch&) {
    for (const EnvIndex env : block.selected) ++s.state.sensed[env];
  });
  executor.start_frames(&Block::selected, mask);
  executor.each([mask](Simulation& s, Block& block, Scratch& scratch) {
    read_all(s, selected_drones(s, block.selected, Part::active, mask, scratch), scratch);
  });
  executor.finish_frames();
}

}  // namespace flockstep
