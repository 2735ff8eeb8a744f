// Profiles a step, stage by stage, on one thread. A batch flies a random policy through the training playgrounds, and every few
// steps each stage is timed separately on the current state. The stages run in turns. Prints a JSON list of figures.
#include <cstdint>
#include <cstdio>
#include <functional>
#include <random>
#include <string>
#include <vector>

#include "base/platform.hpp"
#include "batch/episodes.hpp"
#include "batch/simulation.hpp"
#include "batch/snapshot.hpp"
#include "bench.hpp"
#include "collision/sweep.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/tasks.hpp"

namespace {

using namespace flockstep;

constexpr int kDrones = 1024;
constexpr int kWarmUp = 1000;  // steps, until the drones are spread out and episodes end at different times
constexpr int kRuns = 25;      // states to measure
constexpr int kStepsBetween = 20;

BatchConfig lidar_config(int num_envs) {
  BatchConfig config;
  config.num_envs = num_envs;
  config.num_threads = 1;
  config.lidars = {LidarConfig()};
  return config;
}

class RandomPolicy {
 public:
  explicit RandomPolicy(int num_envs) : actions_(static_cast<std::size_t>(num_envs)) {}

  std::span<const std::int64_t> next() {
    for (std::int64_t& action : actions_) action = static_cast<std::int64_t>(random_() % 6);
    return actions_;
  }

 private:
  std::mt19937 random_{7};
  std::vector<std::int64_t> actions_;
};

void profile(bench::Figures& figures) {
  Batch::Worlds worlds;
  for (int i = 1; i <= 5; ++i) {
    worlds.push_back(World::load(FLOCKSTEP_SCENES "/playground/train-" + std::to_string(i) + ".json"));
  }
  const BatchConfig config = lidar_config(kDrones);
  Batch batch(config, worlds, make_task(NavigationConfig{}));
  RandomPolicy policy(kDrones);
  batch.reset({});
  const FlushDenormals flush;

  // The same stages as in the batch, on a simulation that copies its state.
  Simulation sim(config, worlds, make_task(NavigationConfig{}), DroneModel::quadrotor650(), {});
  Task& task = *sim.task_state->task;
  std::vector<EnvIndex> envs;  // grouped by world, as in the batch
  for (const Block& block : sim.schedule.blocks()) envs.insert(envs.end(), block.envs.begin(), block.envs.end());
  std::vector<DroneIndex> drones;
  sim.drones_of(envs, Part::active, drones);
  const TaskBlock all{*sim.context, envs, drones, 0};
  for (const DroneIndex drone : drones) sim.task_state->actions.row<std::int64_t>(drone)[0] = drone % 6;
  float sink = 0.0F;

  const sensors::Surroundings surroundings{.state = sim.state,
                                           .scenes = sim.scenes,
                                           .slots = sim.slots(),
                                           .drones_per_env = 1,
                                           .tracer = sim.scratches[0]->tracer,
                                           .slices = sim.scratches[0]->slices};
  const std::vector<bench::Variant> stages{
      {"command", [&] { task.command(all, sim.task_state->actions, sim.task_state->setpoints); }},
      {"sweep",
       [&] {
         for (const DroneIndex drone : drones) {
           const collision::Obstacles& obstacles = *sim.obstacles[sim.slot_of(sim.env_of(drone))];
           sink +=
               collision::sweep(obstacles, sim.hull, pose_of(sim.state, drone), sim.task_state->setpoints.target[drone]).fraction;
         }
       }},
      {"lidar", [&] { sim.suite.lidars()[0]->read(drones, surroundings); }},
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
  std::vector<std::vector<double>> ns(stages.size());  // per drone: the median of each stage, for every state
  for (int i = 0; i < kWarmUp; ++i) batch.step(policy.next());
  for (int run = 0; run < kRuns; ++run) {
    for (int i = 0; i < kStepsBetween; ++i) batch.step(policy.next());
    restore_snapshot(sim, batch.snapshot());
    const bench::Times times = bench::interleave(stages, 3, 0.002);
    for (std::size_t i = 0; i < ns.size(); ++i) ns[i].push_back(1e9 * bench::median(times[i]) / kDrones);
  }
  for (std::size_t i = 0; i < ns.size(); ++i) figures.add("step/stage/" + stages[i].label, bench::median(ns[i]), "ns", kRuns);
  if (sink < 0.0F) std::fprintf(stderr, "%f", static_cast<double>(sink));  // keeps the result in use

  // A whole step, including resets.
  const auto seconds_per_step = [](Batch& of, RandomPolicy& by, int steps) {
    std::vector<double> times;
    for (int run = 0; run < kRuns; ++run) {
      times.push_back(bench::seconds([&] {
                        for (int i = 0; i < steps; ++i) of.step(by.next());
                      }) /
                      steps);
    }
    return bench::median(times);
  };
  figures.add("step/stage/all", 1e9 * seconds_per_step(batch, policy, 40) / kDrones, "ns", kRuns);
  Batch single(lidar_config(1), worlds, make_task(NavigationConfig{}));
  RandomPolicy single_policy(1);
  single.reset({});
  figures.add("step/n1/microseconds_cpp", 1e6 * seconds_per_step(single, single_policy, 2000), "us", kRuns);
}

}  // namespace

int main() {
  bench::Figures figures;
  profile(figures);
  figures.print();
}
