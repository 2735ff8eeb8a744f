// A served batch beside its twin, which tests call directly.
#pragma once

#include <chrono>
#include <nlohmann/json.hpp>

#include "batch_helpers.hpp"
#include "flockstep/client.hpp"
#include "flockstep/server.hpp"
#include "flockstep/survey.hpp"
#include "flockstep/version.hpp"
#include "recipe/config_json.hpp"

namespace flockstep::serving {

using namespace testing;
using namespace std::chrono_literals;
using client::Connection;
using client::DroneController;
using client::ErrorCode;
using client::GameModeController;
using client::later;
using client::Vector3;

inline std::shared_ptr<const World> room() {
  return make_world(
      {primitive(PrimitiveKind::room, {0, 0, 2}, {5, 4, 2}), primitive(PrimitiveKind::box, {3, 0, 1}, {0.5F, 0.5F, 1})},
      {.start = Vec3(-1, 0, 1), .goal = Vec3(4, 1, 1)});
}

// Two envs with a drone and a free slot each, a LiDAR and a camera.
inline BatchConfig kinematic() {
  BatchConfig config = lidar_batch(2, {.beams = 35, .max_range_m = 20});
  config.drones_per_env = 2;
  CameraConfig camera{.width_px = 32, .height_px = 24};
  camera.outputs.depth = true;
  config.cameras = {camera};
  return config;
}

inline BatchConfig rotors() {
  BatchConfig config = lidar_batch(2);
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::velocity;
  return config;
}

inline std::unique_ptr<Batch> make(const BatchConfig& config) {
  auto batch = std::make_unique<Batch>(config, Batch::Worlds{room(), closet()}, nullptr, DroneModel::quadrotor650(),
                                       std::vector<std::int32_t>{0, 0});
  return batch;
}

// A served batch, and its twin.
struct Served {
  explicit Served(const BatchConfig& config, ServerConfig server_config = {})
      : batch(make(config)), twin(make(config)), server(*batch, with_any_port(std::move(server_config))) {}

  static ServerConfig with_any_port(ServerConfig config) {
    config.port = 0;
    return config;
  }
  Connection connect(std::string token = {}) const {
    return Connection({.address = server.address(), .token = std::move(token)});
  }

  std::unique_ptr<Batch> batch, twin;
  Server server;
};

template <class Call>
client::Error error_of(const Call& call) {
  try {
    call();
  } catch (const client::Error& error) {
    return error;
  }
  return {ErrorCode::internal, "no error"};
}

}  // namespace flockstep::serving
