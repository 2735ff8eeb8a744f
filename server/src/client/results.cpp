// Results of operations, from messages of the protocol.
#include <cstddef>
#include <limits>

#include "client/convert.hpp"

namespace flockstep::client::detail {
namespace {

static_assert(static_cast<int>(CaptureMode::on_demand) == static_cast<int>(protocol::CaptureModeName::kOnDemand));

Angles value_of(const protocol::Angles& angles) {
  return {.roll_deg = angles.roll_deg, .pitch_deg = angles.pitch_deg, .yaw_deg = angles.yaw_deg};
}

Drone value_of(const protocol::Drone& drone) { return {.drone = drone.drone, .env = drone.env, .owner = drone.owner}; }

Field value_of(protocol::Field& field) {
  return {.name = std::move(field.name),
          .dtype = static_cast<DType>(field.dtype),
          .shape = {field.shape.begin(), field.shape.end()},
          .low = std::move(field.low),
          .high = std::move(field.high)};
}

Time value_of(const protocol::Time& time) {
  return {.step = time.step, .time_s = time.time_s, .num_envs = time.num_envs, .generation = time.generation};
}

}  // namespace

template <>
void read<void>(Call& call) {
  ReplyOf<protocol::Done> reply(call);
}

template <>
std::string read<std::string>(Call& call) {
  return std::move(ReplyOf<protocol::Config>(call).message().config_json);
}

template <>
Time read<Time>(Call& call) {
  ReplyOf<protocol::Time> reply(call);
  return value_of(reply.message());
}

template <>
Readings read<Readings>(Call& call) {
  ReplyOf<protocol::Time> reply(call);
  Readings readings{.time = value_of(reply.message()), .arrays = {}};
  for (const protocol::ReceivedArray& array : reply.arrays())
    readings.arrays.insert_or_assign(array.array->name, value_of(array));
  return readings;
}

template <>
Impact read<Impact>(Call& call) {
  ReplyOf<protocol::Impact> reply(call);
  const protocol::Impact& impact = reply.message();
  return {.hit = impact.hit,
          .fraction = impact.fraction,
          .location = required(impact.location, "location"),
          .rotation = required(impact.rotation, "rotation"),
          .point = value_of(impact.point).value_or(Vector3{}),
          .normal = value_of(impact.normal).value_or(Vector3{})};
}

template <>
CameraData read<CameraData>(Call& call) {
  ReplyOf<protocol::CameraData> reply(call);
  const protocol::CameraData& data = reply.message();
  constexpr auto kMost = static_cast<std::uint32_t>(std::numeric_limits<int>::max());
  if (data.width_px > kMost || data.height_px > kMost) refuse_reply("the size of an image is too large");
  return {.step = data.step,
          .width_px = static_cast<int>(data.width_px),
          .height_px = static_cast<int>(data.height_px),
          .image = value_of(reply.array("image"))};
}

template <>
LidarData read<LidarData>(Call& call) {
  ReplyOf<protocol::LidarData> reply(call);
  const protocol::ReceivedArray& ranges = reply.array<float>("ranges", 2);
  LidarData data;
  data.channels = static_cast<int>(ranges.array->shape[0]);
  data.beams = static_cast<int>(ranges.array->shape[1]);
  data.ranges = ranges.values<float>();
  for (const protocol::ReceivedArray& array : reply.arrays()) {
    if (array.array->name != "directions") continue;
    const protocol::ReceivedArray& directions = reply.array<float>("directions", 3);
    const std::vector<std::uint64_t>& shape = directions.array->shape;
    if (shape[0] != ranges.array->shape[0] || shape[1] != ranges.array->shape[1] || shape[2] != 3) {
      refuse_reply("the array \"directions\" has another shape");
    }
    data.directions = directions.values<Vector3>();
  }
  data.origin = required(reply.message().origin, "origin");
  data.rotation = required(reply.message().rotation, "rotation");
  return data;
}

template <>
Fps read<Fps>(Call& call) {
  ReplyOf<protocol::Fps> reply(call);
  return {.fps = reply.message().fps, .real_time_factor = reply.message().real_time_factor};
}

template <>
Vector3 read<Vector3>(Call& call) {
  return value_of(ReplyOf<protocol::Vector3>(call).message());
}

template <>
Rotation read<Rotation>(Call& call) {
  ReplyOf<protocol::Rotation> reply(call);
  if (!reply.message().angles) refuse_reply("a reply lacks angles");
  return {.quaternion = required(reply.message().quaternion, "quaternion"), .angles = value_of(*reply.message().angles)};
}

template <>
bool read<bool>(Call& call) {
  return ReplyOf<protocol::MoveLineVisible>(call).message().visible;
}

template <>
Drone read<Drone>(Call& call) {
  return value_of(ReplyOf<protocol::Drone>(call).message());
}

template <>
std::vector<Drone> read<std::vector<Drone>>(Call& call) {
  ReplyOf<protocol::Drones> reply(call);
  std::vector<Drone> drones;
  for (const protocol::Drone& drone : reply.message().drones) drones.push_back(value_of(drone));
  return drones;
}

template <>
CaptureMode read<CaptureMode>(Call& call) {
  return static_cast<CaptureMode>(ReplyOf<protocol::CaptureMode>(call).message().mode);
}

template <>
Snapshot read<Snapshot>(Call& call) {
  return ReplyOf<protocol::Done>(call).values<std::uint8_t>("snapshot");
}

template <>
std::vector<World> read<std::vector<World>>(Call& call) {
  ReplyOf<protocol::Worlds> reply(call);
  std::vector<World> worlds;
  for (protocol::World& world : reply.message().worlds) {
    worlds.push_back({.name = std::move(world.name),
                      .content_hash = world.content_hash,
                      .min = required(world.min, "min"),
                      .max = required(world.max, "max"),
                      .start = value_of(world.start),
                      .goal = value_of(world.goal)});
  }
  return worlds;
}

template <>
Mesh read<Mesh>(Call& call) {
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

template <>
PointCloud read<PointCloud>(Call& call) {
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

template <>
Boxes read<Boxes>(Call& call) {
  const ReplyOf<protocol::Done> reply(call);
  Boxes boxes{.min = reply.rows<float, 3>("min"),
              .max = reply.rows<float, 3>("max"),
              .materials = reply.values<std::int32_t>("materials")};
  if (boxes.min.size() != boxes.max.size() || boxes.min.size() != boxes.materials.size()) {
    refuse_reply("the arrays of boxes have different sizes");
  }
  return boxes;
}

template <>
Task read<Task>(Call& call) {
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

template <>
Slots read<Slots>(Call& call) {
  return ReplyOf<protocol::Time>(call).values<std::int64_t>("slot");
}

template <>
BodyConfigs read<BodyConfigs>(Call& call) {
  ReplyOf<protocol::Configs> reply(call);
  BodyConfigs bodies{.configs = std::move(reply.message().config_json),
                     .numbers = reply.array<std::int32_t>("config", 2).values<std::int32_t>()};
  for (const std::int32_t number : bodies.numbers) {
    if (number < -1 || number >= std::ssize(bodies.configs)) refuse_reply("a body has no such configuration");
  }
  return bodies;
}

}  // namespace flockstep::client::detail
