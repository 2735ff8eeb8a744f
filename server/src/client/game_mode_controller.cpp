#include <limits>
#include <stdexcept>

#include "client/convert.hpp"

namespace flockstep::client {

using namespace detail;

namespace {

static_assert(static_cast<int>(CaptureMode::on_demand) == static_cast<int>(protocol::CaptureModeName::kOnDemand));

Drone value_of(const protocol::Drone& drone) { return {.drone = drone.drone, .env = drone.env, .owner = drone.owner}; }

Field value_of(protocol::Field& field) {
  return {.name = std::move(field.name),
          .dtype = static_cast<DType>(field.dtype),
          .shape = {field.shape.begin(), field.shape.end()},
          .low = std::move(field.low),
          .high = std::move(field.high)};
}

Drone read_drone(Call& call) { return value_of(ReplyOf<protocol::Drone>(call).message()); }

std::vector<Drone> read_drones(Call& call) {
  ReplyOf<protocol::Drones> reply(call);
  std::vector<Drone> drones;
  for (const protocol::Drone& drone : reply.message().drones) drones.push_back(value_of(drone));
  return drones;
}

CaptureMode read_capture_mode(Call& call) {
  return static_cast<CaptureMode>(ReplyOf<protocol::CaptureMode>(call).message().mode);
}

std::vector<std::uint8_t> read_snapshot(Call& call) { return ReplyOf<protocol::Done>(call).values<std::uint8_t>("snapshot"); }

std::vector<World> read_worlds(Call& call) {
  ReplyOf<protocol::Worlds> reply(call);
  std::vector<World> worlds;
  for (protocol::World& world : reply.message().worlds) {
    worlds.push_back({.name = std::move(world.name),
                      .content_hash = world.content_hash,
                      .min = required(world.min, "min"),
                      .max = required(world.max, "max"),
                      .start = detail::value_of(world.start),
                      .goal = detail::value_of(world.goal)});
  }
  return worlds;
}

Mesh read_mesh(Call& call) {
  const ReplyOf<protocol::Done> reply(call);
  Mesh mesh{.vertices = reply.rows<float, 3>("vertices"),
            .triangles = reply.rows<std::int32_t, 3>("triangles"),
            .objects = reply.values<std::int32_t>("objects")};
  for (const auto& triangle : mesh.triangles) {
    for (const std::int32_t vertex : triangle) {
      if (vertex < 0 || static_cast<std::size_t>(vertex) >= mesh.vertices.size()) refuse_reply("a triangle has no such vertex");
    }
  }
  if (mesh.objects.size() != mesh.triangles.size()) refuse_reply("the arrays of a mesh have different sizes");
  return mesh;
}

PointCloud read_point_cloud(Call& call) {
  const ReplyOf<protocol::Done> reply(call);
  PointCloud cloud{.points = reply.rows<float, 3>("points"),
                   .normals = reply.rows<float, 3>("normals"),
                   .semantic = reply.values<std::uint16_t>("semantic"),
                   .objects = reply.values<std::int32_t>("objects")};
  const std::size_t size = cloud.points.size();
  if (cloud.normals.size() != size || cloud.semantic.size() != size || cloud.objects.size() != size) {
    refuse_reply("the arrays of a point cloud have different sizes");
  }
  return cloud;
}

Boxes read_boxes(Call& call) {
  const ReplyOf<protocol::Done> reply(call);
  Boxes boxes{.min = reply.rows<float, 3>("min"),
              .max = reply.rows<float, 3>("max"),
              .materials = reply.values<std::int32_t>("materials")};
  if (boxes.min.size() != boxes.max.size() || boxes.min.size() != boxes.materials.size()) {
    refuse_reply("the arrays of boxes have different sizes");
  }
  return boxes;
}

Task read_task(Call& call) {
  ReplyOf<protocol::Task> reply(call);
  protocol::Task& message = reply.message();
  if (!message.action) refuse_reply("a reply lacks action");
  Task task{.action = value_of(*message.action),
            .observation = {},
            .reward_terms = std::move(message.reward_terms),
            .num_rows = message.num_rows,
            .row_is_env = message.row_is_env,
            .autoreset_mode = std::move(message.autoreset_mode),
            .policy_hz = message.policy_hz,
            .frame_skip = message.frame_skip,
            .episodes = std::move(message.episodes)};
  for (protocol::Field& field : message.observation) task.observation.push_back(value_of(field));
  return task;
}

std::vector<std::int64_t> read_slots(Call& call) { return ReplyOf<protocol::Time>(call).values<std::int64_t>("slot"); }

BodyConfigs read_body_configs(Call& call) {
  ReplyOf<protocol::Configs> reply(call);
  BodyConfigs bodies{.configs = std::move(reply.message().config_json),
                     .numbers = reply.array<std::int32_t>("config", 2).values<std::int32_t>()};
  for (const std::int32_t number : bodies.numbers) {
    if (number < -1 || number >= std::ssize(bodies.configs)) refuse_reply("a body has no such configuration");
  }
  return bodies;
}

AddArrays commands(const Commands& commands) {
  return [&commands](protocol::FrameWriter& writer) {
    add_rows(writer, "command", commands.command, 4);
    add_mask(writer, commands.mask);
  };
}

}  // namespace

GameModeController::GameModeController(Connection connection) : link_(std::move(connection.link_)) {}

// ------------------------------------------------------------------------------------------------------------------- session

Future<void> GameModeController::ping(Later) { return {link_->send(request_of(protocol::Ping{})), read_done}; }

Future<void> GameModeController::claim(Later, std::span<const std::int64_t> drones) {
  return {link_->send(request_of(protocol::Claim{.drones = {drones.begin(), drones.end()}})), read_done};
}

Future<void> GameModeController::release(Later, std::span<const std::int64_t> drones) {
  return {link_->send(request_of(protocol::Release{.drones = {drones.begin(), drones.end()}})), read_done};
}

// -------------------------------------------------------------------------------------------------------------------- drones

Future<std::vector<Drone>> GameModeController::get_drones(Later) {
  return {link_->send(request_of(protocol::GetDrones{})), read_drones};
}

Future<Drone> GameModeController::spawn_drone(Later, const Spawn& spawn) {
  return {link_->send(request_of(protocol::SpawnDrone{.location = message_of(spawn.location, "location"),
                                                      .rotation = message_of(spawn.rotation, "rotation"),
                                                      .env = spawn.env,
                                                      .claim = spawn.claim})),
          read_drone};
}

Future<void> GameModeController::remove_drone(Later, std::int64_t drone) {
  return {link_->send(request_of(protocol::RemoveDrone{.drone = drone})), read_done};
}

Future<CaptureMode> GameModeController::get_camera_capture_mode(Later, std::string_view camera) {
  return {link_->send(request_of(protocol::GetCameraCaptureMode{.camera = std::string(camera)})), read_capture_mode};
}

Future<void> GameModeController::set_camera_capture_mode(Later, CaptureMode mode, std::string_view camera) {
  return {link_->send(request_of(protocol::SetCameraCaptureMode{.camera = std::string(camera),
                                                                .mode = static_cast<protocol::CaptureModeName>(mode)})),
          read_done};
}

// --------------------------------------------------------------------------------------------------------- all drones at once

Future<Readings> GameModeController::get_arrays(Later, std::span<const std::string> names, std::string_view sensor) {
  return {link_->send(request_of(protocol::GetArrays{.names = {names.begin(), names.end()}, .sensor = std::string(sensor)})),
          read_readings};
}

Future<Readings> GameModeController::get_array(Later, std::string_view name, std::string_view sensor) {
  const std::string names[]{std::string(name)};
  return get_arrays(later, names, sensor);
}

Stream<Readings> GameModeController::stream_arrays(std::span<const std::string> names, double rate_hz, std::string_view sensor,
                                                   bool only_new) {
  protocol::GetArrays arrays{.names = {names.begin(), names.end()}, .sensor = std::string(sensor)};
  return {link_->subscribe({.rate_hz = finite(rate_hz, "rate_hz"), .what = std::move(arrays), .only_new = only_new}),
          read_readings};
}

Future<Readings> GameModeController::set_poses(Later, const Poses& poses, bool teleport) {
  return {link_->send(request_of(protocol::SetPoses{.teleport = teleport}),
                      [&](protocol::FrameWriter& writer) {
                        if (!poses.position.empty()) add_rows(writer, "position", poses.position, 3);
                        if (!poses.quat_wxyz.empty()) add_rows(writer, "quat_wxyz", poses.quat_wxyz, 4);
                        add_mask(writer, poses.mask);
                      }),
          read_readings};
}

Future<Time> GameModeController::fly(Later, const Commands& of_all, int ticks) {
  if (ticks < 0)
    throw Error(ErrorCode::invalid_argument, "ticks: expected an integer of at least 0, got " + std::to_string(ticks));
  return {link_->send(request_of(protocol::Fly{.ticks = static_cast<std::uint32_t>(ticks), .control = of_all.control}),
                      commands(of_all)),
          read_time};
}

Future<void> GameModeController::set_command(Later, const Commands& of_all) {
  return {link_->send(request_of(protocol::SetCommand{.drone = {}, .control = of_all.control}), commands(of_all)), read_done};
}

// -------------------------------------------------------------------------------------------------------------------- bodies

Future<std::vector<std::int64_t>> GameModeController::spawn_bodies(Later, std::string_view config, const BodySpawn& spawn) {
  return {link_->send(request_of(protocol::SpawnBodies{.config_json = std::string(config)}),
                      [&](protocol::FrameWriter& writer) {
                        if (!spawn.position.empty()) add_rows(writer, "position", spawn.position, 3);
                        if (!spawn.quat_wxyz.empty()) add_rows(writer, "quat_wxyz", spawn.quat_wxyz, 4);
                        if (!spawn.velocity.empty()) add_rows(writer, "velocity", spawn.velocity, 3);
                        if (!spawn.angular_velocity.empty()) add_rows(writer, "angular_velocity", spawn.angular_velocity, 3);
                        add_mask(writer, spawn.mask);
                      }),
          read_slots};
}

Future<Time> GameModeController::remove_bodies(Later, std::span<const std::uint8_t> mask) {
  return {link_->send(request_of(protocol::RemoveBodies{}),
                      [&](protocol::FrameWriter& writer) { add_body_mask(writer, mask, link_->server().bodies_per_env); }),
          read_time};
}

Future<Time> GameModeController::set_body_poses(Later, const BodyPoses& poses) {
  return {link_->send(request_of(protocol::SetBodyPoses{}),
                      [&](protocol::FrameWriter& writer) {
                        add_bodies(writer, "position", poses.position, 3, link_->server().bodies_per_env);
                        add_bodies(writer, "quat_wxyz", poses.quat_wxyz, 4, link_->server().bodies_per_env);
                        add_body_mask(writer, poses.mask, link_->server().bodies_per_env);
                      }),
          read_time};
}

Future<Time> GameModeController::set_body_velocities(Later, const BodyVelocities& velocities) {
  return {link_->send(request_of(protocol::SetBodyVelocities{}),
                      [&](protocol::FrameWriter& writer) {
                        add_bodies(writer, "velocity", velocities.velocity, 3, link_->server().bodies_per_env);
                        add_bodies(writer, "angular_velocity", velocities.angular_velocity, 3, link_->server().bodies_per_env);
                        add_body_mask(writer, velocities.mask, link_->server().bodies_per_env);
                      }),
          read_time};
}

Future<BodyConfigs> GameModeController::get_body_configs(Later, std::span<const std::int64_t> envs) {
  return {link_->send(request_of(protocol::GetBodyConfigs{.envs = {envs.begin(), envs.end()}})), read_body_configs};
}

// ---------------------------------------------------------------------------------------------------------------------- time

Future<Fps> GameModeController::get_fps(Later) { return {link_->send(request_of(protocol::GetFps{})), read_fps}; }

Stream<Fps> GameModeController::stream_fps(double rate_hz) {
  return {link_->subscribe({.rate_hz = finite(rate_hz, "rate_hz"), .what = protocol::GetFps{}, .only_new = false}), read_fps};
}

Future<Time> GameModeController::step(Later) { return {link_->send(request_of(protocol::Step{})), read_time}; }

Future<Time> GameModeController::set_clock(Later, double rate_hz) {
  return {link_->send(request_of(protocol::SetClock{.rate_hz = finite(rate_hz, "rate_hz")})), read_time};
}

Future<Time> GameModeController::join_lockstep(Later) { return {link_->send(request_of(protocol::JoinLockstep{})), read_time}; }

Future<void> GameModeController::leave_lockstep(Later) { return {link_->send(request_of(protocol::LeaveLockstep{})), read_done}; }

Future<Time> GameModeController::sense(Later) { return {link_->send(request_of(protocol::Sense{})), read_time}; }

Future<std::vector<std::uint8_t>> GameModeController::snapshot(Later) {
  return {link_->send(request_of(protocol::Snapshot{})), read_snapshot};
}

Future<void> GameModeController::restore(Later, std::span<const std::uint8_t> snapshot) {
  return {link_->send(request_of(protocol::Restore{}),
                      [&](protocol::FrameWriter& writer) { writer.add("snapshot", snapshot, {snapshot.size()}); }),
          read_done};
}

// -------------------------------------------------------------------------------------------------------------------- worlds

Future<std::vector<World>> GameModeController::get_worlds(Later) {
  return {link_->send(request_of(protocol::GetWorlds{})), read_worlds};
}

Future<void> GameModeController::set_world(Later, std::int64_t env, std::uint32_t world) {
  return {link_->send(request_of(protocol::SetWorld{.env = env, .world = world})), read_done};
}

Future<std::string> GameModeController::get_light(Later, std::uint32_t world) {
  return {link_->send(request_of(protocol::GetLight{.world = world, .env = {}})), read_config};
}

Future<void> GameModeController::set_light(Later, std::string_view fields, std::uint32_t world) {
  return {link_->send(request_of(protocol::SetLight{.world = world, .config_json = std::string(fields), .envs = {}})), read_done};
}

Future<std::string> GameModeController::get_env_light(Later, std::int64_t env) {
  return {link_->send(request_of(protocol::GetLight{.world = 0, .env = env})), read_config};
}

Future<void> GameModeController::set_env_lights(Later, std::span<const std::int64_t> envs, std::string_view fields) {
  if (envs.empty()) throw Error(ErrorCode::invalid_argument, "envs: expected at least one index, got none");
  return {link_->send(
              request_of(protocol::SetLight{.world = 0, .config_json = std::string(fields), .envs = {envs.begin(), envs.end()}})),
          read_done};
}

Future<Mesh> GameModeController::get_mesh(Later, std::uint32_t world) {
  return {link_->send(request_of(protocol::GetMesh{.world = world})), read_mesh};
}

Future<PointCloud> GameModeController::get_point_cloud(Later, float spacing_m, std::uint32_t world) {
  return {link_->send(request_of(protocol::GetPointCloud{.world = world, .spacing_m = finite(spacing_m, "spacing_m")})),
          read_point_cloud};
}

Future<Boxes> GameModeController::get_boxes(Later, std::uint32_t world) {
  return {link_->send(request_of(protocol::GetBoxes{.world = world})), read_boxes};
}

// ---------------------------------------------------------------------------------------------------------------------- task

Future<Task> GameModeController::get_task(Later) { return {link_->send(request_of(protocol::GetTask{})), read_task}; }

Future<Readings> GameModeController::reset_envs(Later, std::span<const std::uint64_t> seeds, std::span<const std::uint8_t> mask) {
  return {link_->send(request_of(protocol::ResetEnvs{}),
                      [&](protocol::FrameWriter& writer) {
                        if (!seeds.empty()) writer.add("seeds", seeds, {seeds.size()});
                        add_mask(writer, mask);
                      }),
          read_readings};
}

Future<Readings> GameModeController::step_envs(Later, const Array& actions) {
  return {link_->send(request_of(protocol::StepEnvs{}),
                      [&](protocol::FrameWriter& writer) { add_array(writer, "actions", actions); }),
          read_readings};
}

}  // namespace flockstep::client
