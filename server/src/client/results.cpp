// Results of operations, from messages of the protocol.
#include <cstddef>
#include <limits>

#include "client/convert.hpp"

namespace flockstep::client::detail {
namespace {

static_assert(static_cast<int>(CaptureMode::on_demand) == static_cast<int>(protocol::CaptureModeName::kOnDemand));

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
          .location = value_of(required(impact.location, "location")),
          .rotation = value_of(required(impact.rotation, "rotation")),
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
  data.origin = value_of(required(reply.message().origin, "origin"));
  data.rotation = value_of(required(reply.message().rotation, "rotation"));
  return data;
}

template <>
Vector3 read<Vector3>(Call& call) {
  return value_of(ReplyOf<protocol::Vector3>(call).message());
}

template <>
bool read<bool>(Call& call) {
  return ReplyOf<protocol::Visible>(call).message().visible;
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
