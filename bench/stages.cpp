// Profiles a step of three tasks, stage by stage, on one thread. A batch flies a random policy, and every few steps each stage is
// timed separately on the current state. The stages run in turns. Prints a JSON list of figures. Arguments: numbers of drones.
#include <algorithm>
#include <array>
#include <cstdint>
#include <cstdio>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "base/platform.hpp"
#include "batch/episodes.hpp"
#include "batch/flying.hpp"
#include "batch/simulation.hpp"
#include "batch/snapshot.hpp"
#include "bench.hpp"
#include "collision/sweep.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/tasks.hpp"

namespace {

using namespace flockstep;

// Steps before the first measurement, until the drones are spread out and episodes end at different times, states to measure,
// and steps between them. An image takes as long as fifty steps without one.
struct Pace {
  int warm_up, runs, between;
};

struct Case {
  std::string name;
  BatchConfig config;
  std::function<std::unique_ptr<Task>()> task;
  DroneModel drone;
  Batch::Worlds worlds;
  std::int64_t num_actions;  // 0: four numbers in [-1, 1]
  Pace pace;
};

Batch::Worlds worlds_of(const std::vector<std::string>& names) {
  Batch::Worlds worlds;
  for (const std::string& name : names) worlds.push_back(World::load(FLOCKSTEP_SCENES "/" + name + ".json"));
  return worlds;
}

BatchConfig config_of(int num_envs) {
  BatchConfig config;
  config.num_envs = num_envs;
  config.num_threads = 1;
  return config;
}

Case lidar_case(int num_envs) {
  BatchConfig config = config_of(num_envs);
  config.lidars = {LidarConfig()};
  std::vector<std::string> names;
  for (int i = 1; i <= 5; ++i) names.push_back("playground/train-" + std::to_string(i));
  return {"lidar", config,       [] { return make_task(NavigationConfig{}); }, DroneModel::quadrotor650(), worlds_of(names),
          6,       {500, 15, 20}};
}

Case camera_case(int num_envs) {
  BatchConfig config = config_of(num_envs);
  LidarConfig lidar;
  lidar.beams = 20;
  lidar.hfov_deg = 180.0F;
  config.lidars = {lidar};
  CameraConfig camera;
  camera.width_px = 64;
  camera.height_px = 48;
  config.cameras = {camera};
  NavigationConfig task;
  task.action = ActionKind::discrete_forward;
  task.observation = ObservationKind::blob;
  return {"camera",
          config,
          [task] { return make_task(task); },
          DroneModel::quadrotor650(),
          worlds_of({"playground/camera-train-1", "playground/camera-train-2"}),
          3,
          {30, 5, 2}};
}

Case hover_case(int num_envs) {
  BatchConfig config = config_of(num_envs);
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::rotor_thrusts;
  config.clock.policy_hz = 50.0;
  config.episode.max_episode_steps = 300;
  return {
      "hover", config,       [] { return make_task(HoverConfig{}); }, DroneModel::load("crazyflie"), worlds_of({"arena/hall"}),
      0,       {300, 15, 10}};
}

class RandomPolicy {
 public:
  RandomPolicy(const Case& of, int num_envs)
      : num_actions_(of.num_actions), choices_(static_cast<std::size_t>(num_envs)), numbers_(4 * choices_.size()) {}

  void step(Batch& batch) {
    if (num_actions_ == 0) {
      for (float& number : numbers_) number = std::uniform_real_distribution<float>(-1.0F, 1.0F)(random_);
      batch.step(std::span<const float>(numbers_));
      return;
    }
    for (std::int64_t& choice : choices_) choice = static_cast<std::int64_t>(random_()) % num_actions_;
    batch.step(std::span<const std::int64_t>(choices_));
  }

 private:
  std::mt19937 random_{7};
  std::int64_t num_actions_;
  std::vector<std::int64_t> choices_;
  std::vector<float> numbers_;
};

void profile(bench::Figures& figures, const Case& of) {
  const int num_envs = of.config.num_envs;
  const std::string at = of.name + "/n" + std::to_string(num_envs) + "/";
  Batch batch(of.config, of.worlds, of.task(), of.drone);
  RandomPolicy policy(of, num_envs);
  batch.reset({});
  const FlushDenormals flush;

  // The same stages as in the batch, on a simulation that copies its state.
  Simulation sim(of.config, of.worlds, of.task(), of.drone, {});
  sim.cameras.start_backend(of.config.camera_backend, sim.workers);
  Task& task = *sim.task_state->task;
  std::vector<EnvIndex> envs;  // grouped by world, as in the batch
  for (const Block& block : sim.schedule.blocks()) envs.insert(envs.end(), block.envs.begin(), block.envs.end());
  std::vector<DroneIndex> drones;
  sim.drones_of(envs, Part::active, drones);
  const TaskBlock all{*sim.context, envs, drones, 0};
  float sink = 0.0F;
  State before;  // that a flight begins with

  const sensors::Surroundings surroundings{.state = sim.state,
                                           .scenes = sim.scenes,
                                           .slots = sim.slots(),
                                           .drones_per_env = 1,
                                           .tracer = sim.scratches[0]->tracer,
                                           .slices = sim.scratches[0]->slices};
  std::vector<bench::Variant> stages{
      {"command", [&] { task.command(all, sim.task_state->actions, sim.task_state->setpoints); }},
      {"pose_sensor", [&] { sim.suite.pose().read(drones, surroundings); }},
      {"score", [&] { task.score(all, sim.task_state->score); }},
      {"episodes",
       [&] {
         for (Block& block : sim.schedule.blocks()) {
           select_envs(sim, block);
           finish_step(sim, block);
         }
       }},
      {"observe", [&] { task.observe(all, sim.outputs.now().observation); }},
  };
  if (sim.fleet) {
    // A flight changes the state, which is put back each time; the time of that is subtracted.
    stages.push_back({"put_back", [&] { sim.state = before; }});
    stages.push_back({"flight", [&] {
                        sim.state = before;
                        const int ticks = sim.config.clock.substeps();
                        const dynamics::Commands commands{sim.task_state->setpoints.command, sim.task_state->setpoints.target,
                                                          sim.task_state->step_start};
                        for (Block& block : sim.schedule.blocks()) {
                          select_envs(sim, block);
                          Scratch& scratch = *sim.scratches[0];
                          fly_by_rotors(sim, block, sim.drones_of(block.flying, scratch.flying), commands, 0, ticks, scratch);
                        }
                      }});
  } else {
    stages.push_back({"sweep", [&] {
                        for (const DroneIndex drone : drones) {
                          const collision::Obstacles& obstacles = *sim.obstacles[sim.slot_of(sim.env_of(drone))];
                          const Pose& target = sim.task_state->setpoints.target[drone];
                          sink += collision::sweep(obstacles, sim.hull, pose_of(sim.state, drone), target).fraction;
                        }
                      }});
  }
  if (!sim.suite.lidars().empty()) {
    stages.push_back({"lidar", [&] { sim.suite.lidars()[0]->read(drones, surroundings); }});
  }
  if (!sim.cameras.empty()) {
    stages.push_back({"camera", [&] {
                        sim.cameras.ask_now(0, drones);
                        sim.cameras.start();
                        sim.cameras.finish(sim.workers);
                      }});
  }
  std::vector<std::vector<double>> ns(stages.size());  // per drone: the median of each stage, for every state
  for (int i = 0; i < of.pace.warm_up; ++i) policy.step(batch);
  for (int run = 0; run < of.pace.runs; ++run) {
    for (int i = 0; i < of.pace.between; ++i) policy.step(batch);
    restore_snapshot(sim, batch.snapshot());
    before = sim.state;
    const bench::Times times = bench::interleave(stages, 3, 0.002);
    for (std::size_t i = 0; i < ns.size(); ++i) {
      const bool flies = stages[i].label == "flight";
      ns[i].push_back(1e9 * (bench::median(times[i]) - (flies ? bench::median(times[i - 1]) : 0.0)) / num_envs);
    }
  }
  for (std::size_t i = 0; i < ns.size(); ++i) {
    if (stages[i].label != "put_back") figures.add(at + stages[i].label, ns[i], "ns");
  }
  if (sink < 0.0F) std::fprintf(stderr, "%f", static_cast<double>(sink));  // keeps the result in use

  // A whole step, including resets.
  const int steps = std::max(1, 2 * of.pace.between * (num_envs == 1 ? 50 : 1));
  std::vector<double> whole;
  for (int run = 0; run < of.pace.runs; ++run) {
    const double seconds = bench::seconds([&] {
      for (int i = 0; i < steps; ++i) policy.step(batch);
    });
    whole.push_back(1e9 * seconds / steps / num_envs);
  }
  figures.add(at + "whole_step", whole, "ns");
}

}  // namespace

int main(int argc, char** argv) {
  bench::Figures figures;
  std::vector<int> sizes{1, 1024, 16384};
  if (argc > 1) sizes.clear();
  for (int i = 1; i < argc; ++i) sizes.push_back(std::stoi(argv[i]));
  for (const int num_envs : sizes) {
    for (const auto& make : {lidar_case, camera_case, hover_case}) profile(figures, make(num_envs));
  }
  figures.print();
}
