// fly_square.cpp: flies a drone of a server along a square and prints the ranges of its LiDAR at each corner.
//
//   python -m flockstep serve
//   fly_square [HOST:PORT]
#include <array>
#include <cstdio>
#include <exception>
#include <vector>

#include "flockstep/client.hpp"

using namespace flockstep;

int main(int argc, char** argv) try {
  const client::Connection connection({.address = argc > 1 ? argv[1] : "127.0.0.1:41451"});
  client::GameModeController simulation(connection);

  // The first drone of the simulation, or a new one.
  const std::vector<client::Drone> drones = simulation.get_drones();
  client::DroneController drone(connection, drones.empty() ? simulation.spawn_drone().drone : drones.front().drone);

  const client::Vector3 start = drone.get_location();
  constexpr std::array<std::array<float, 2>, 4> kCorners{{{1, 0}, {1, 1}, {0, 1}, {0, 0}}};
  for (const auto& [x, y] : kCorners) {
    // A drone flies straight to the location, or until it touches something.
    const client::Impact impact = drone.set_location({start[0] + x, start[1] + y, start[2]});
    std::printf("at %.2f %.2f %.2f%s:", static_cast<double>(impact.location[0]), static_cast<double>(impact.location[1]),
                static_cast<double>(impact.location[2]), impact.hit ? " (hit)" : "");

    const client::LidarData scan = drone.get_lidar_data();
    for (const float range : scan.ranges) std::printf(" %.2f", static_cast<double>(range));  // m; inf: no hit
    std::printf("\n");
  }
} catch (const std::exception& error) {
  std::fprintf(stderr, "fly_square: %s\n", error.what());
  return 1;
}
