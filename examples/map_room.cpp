// map_room.cpp: flies a drone of a server through a room, and writes what its LiDAR hits as a point cloud in a PLY file.
//
//   python -m flockstep serve
//   map_room room.ply [HOST:PORT]
#include <array>
#include <cmath>
#include <cstdio>
#include <exception>
#include <fstream>
#include <random>
#include <stdexcept>
#include <string>
#include <vector>

#include "flockstep/client.hpp"

using namespace flockstep;

namespace {

constexpr int kFlights = 40;
constexpr float kFlightM = 2.0F;

void write_ply(const std::string& path, const std::vector<client::Vector3>& points) {
  std::ofstream file(path);
  file << "ply\nformat ascii 1.0\nelement vertex " << points.size()
       << "\nproperty float x\nproperty float y\nproperty float z\nend_header\n";
  for (const client::Vector3& point : points) file << point[0] << ' ' << point[1] << ' ' << point[2] << '\n';
  if (!file.flush()) throw std::runtime_error("cannot write " + path);
}

}  // namespace

int main(int argc, char** argv) try {
  if (argc < 2) throw std::invalid_argument("expected the name of the PLY file to write");
  const client::Connection connection({.address = argc > 2 ? argv[2] : "127.0.0.1:41451"});
  client::GameModeController simulation(connection);
  client::DroneController drone(connection, simulation.spawn_drone({.claim = true}).drone);

  // A LiDAR that sees all around. The number of beams changes for the drones of other clients, too.
  drone.set_lidar_config(R"({"channels": 16, "beams": 90, "hfov_deg": 360, "vfov_deg": 60, "max_range_m": 20})");

  std::mt19937 random(1);
  std::uniform_real_distribution<float> direction(-1, 1);
  std::vector<client::Vector3> points;
  client::Vector3 location = drone.get_location();
  for (int flight = 0; flight < kFlights; ++flight) {
    // The request for the scan follows at once; the server answers both in their order.
    const std::array<float, 3> d{direction(random), direction(random), 0.25F * direction(random)};
    const float scale = kFlightM / std::hypot(d[0], d[1], d[2]);
    auto flown =
        drone.set_location(client::later, {location[0] + scale * d[0], location[1] + scale * d[1], location[2] + scale * d[2]});
    auto scan = drone.get_lidar_data(client::later);
    location = flown.get().location;
    const std::vector<client::Vector3> hits = scan.get().points();
    points.insert(points.end(), hits.begin(), hits.end());
  }
  simulation.remove_drone(drone.drone());
  write_ply(argv[1], points);
  std::printf("%zu points in %s\n", points.size(), argv[1]);
} catch (const std::exception& error) {
  std::fprintf(stderr, "map_room: %s\n", error.what());
  return 1;
}
