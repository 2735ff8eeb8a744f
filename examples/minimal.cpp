// minimal.cpp: four drones take one step through a generated office and print their LiDAR ranges.
#include <cstddef>
#include <cstdint>
#include <cstdio>
#include <vector>

#include "flockstep/batch.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/tasks.hpp"

using namespace flockstep;

int main() {
  // A world is immutable, so any number of envs and batches can share it.
  const auto world = office({.seed = 7});

  // Four envs of one drone each. Every drone has a LiDAR with eight beams.
  BatchConfig config;
  config.num_envs = 4;
  config.lidars = {{.beams = 8, .hfov_deg = 360, .max_range_m = 10}};
  Batch batch(config, {world}, make_task(NavigationConfig{.action = ActionKind::displacement}));

  // An env's episode depends only on its seed.
  batch.reset(std::vector<std::uint64_t>{0, 1, 2, 3});

  // One row of actions per env: (x, y, z) in the body frame, in units of 0.1 m.
  batch.step(std::vector<float>{1, 0, 0, -1, 0, 0, 0, 1, 0, 0, -1, 0});

  // Ranges have the shape (drones, channels, beams), in m; inf means no hit.
  const std::vector<float>& ranges = batch.lidar().readings().ranges;
  for (std::size_t drone = 0; drone < 4; ++drone) {
    std::printf("drone %zu:", drone);
    for (std::size_t beam = 0; beam < 8; ++beam) std::printf(" %5.2f", static_cast<double>(ranges[8 * drone + beam]));
    std::printf("\n");
  }
}
