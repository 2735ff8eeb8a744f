// A served batch, and operations that are sent and fetched later.
#pragma once

#include <chrono>

#include "batch_helpers.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/client.hpp"
#include "flockstep/served_batch.hpp"
#include "flockstep/server.hpp"

namespace flockstep::server::operating {

using namespace testing;
using namespace std::chrono_literals;
using client::Connection;
using client::DroneController;
using client::GameModeController;
using client::later;

inline BatchConfig kinematic() {
  BatchConfig config = lidar_batch(1, {.beams = 35, .max_range_m = 20});
  config.drones_per_env = 8;
  CameraConfig camera{.width_px = 32, .height_px = 24, .capture_mode = CaptureMode::on_demand};
  config.cameras = {camera};
  return config;
}

inline constexpr std::size_t kFleet = 64;

inline BatchConfig rotors() {
  BatchConfig config = lidar_batch(kFleet);
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::velocity;
  return config;
}

struct Served {
  explicit Served(const BatchConfig& config, int max_clients = 2000)
      : batch(config, Batch::Worlds{closet()}, nullptr, DroneModel::quadrotor650()), server(batch, any_port(max_clients)) {}
  static ServerConfig any_port(int max_clients) {
    ServerConfig config;
    config.port = 0;
    config.max_clients = max_clients;
    return config;
  }
  Connection connect() const { return Connection({.address = server.address(), .timeout = 60s}); }
  void wait_for_clients(int count) const {
    for (int i = 0; i < 10000 && server.num_clients() != count; ++i) std::this_thread::sleep_for(1ms);
    EXPECT_EQ(server.num_clients(), count);
  }

  Batch batch;
  Server server;
};

// Some pings take longer than a request on its way to the server.
inline bool answers_pings(GameModeController& client) {
  for (int i = 0; i < 50; ++i) {
    if (!client.ping(later).get_for(5s)) return false;
  }
  return true;
}

// An operation that is sent and whose result is fetched later.
using Sent = std::function<void()>;
using Operation = std::function<Sent(const Connection&)>;

template <class Begin>
Operation operation(Begin begin) {
  return [begin](const Connection& connection) {
    const auto future = std::make_shared<decltype(begin(connection))>(begin(connection));
    return [future] { future->get(); };
  };
}

inline std::vector<std::pair<std::string, Operation>> operations() {
  const auto drone = [](const Connection& to) { return DroneController(to, 3); };
  return {
      {"SetLocation", operation([=](const Connection& to) { return drone(to).set_location(later, {1, 1, 0.75F}, true); })},
      {"GetLidarData", operation([=](const Connection& to) { return drone(to).get_lidar_data(later); })},
      {"GetCameraData", operation([=](const Connection& to) { return drone(to).get_camera_data(later); })},
      {"GetLocation", operation([=](const Connection& to) { return drone(to).get_location(later); })},
      {"GetArrays", operation([=](const Connection& to) { return GameModeController(to).get_array(later, "position"); })},
      {"SetPoses", operation([](const Connection& to) { return GameModeController(to).set_poses(later, {}, true); })},
      {"Sense", operation([](const Connection& to) { return GameModeController(to).sense(later); })},
      {"Step", operation([](const Connection& to) { return GameModeController(to).step(later); })},
      {"Snapshot", operation([](const Connection& to) { return GameModeController(to).snapshot(later); })},
      {"SetLidarConfig",
       operation([=](const Connection& to) { return drone(to).set_lidar_config(later, R"({"hfov_deg": 90})"); })},
  };
}

}  // namespace flockstep::server::operating
