#include "client/convert.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <limits>

namespace flockstep::client {

Error::Error(ErrorCode code, const std::string& text) : std::runtime_error(text), code_(code) {}
Error::~Error() = default;

void Array::require_type(DType type) const {
  if (type == dtype) return;
  constexpr std::array<const char*, 9> kNames{"none",  "bool",   "uint8",   "uint16", "int32",
                                              "int64", "uint64", "float32", "float64"};
  const auto name = [&](DType of) { return kNames.at(static_cast<std::size_t>(of)); };
  throw Error(ErrorCode::invalid_argument, std::string("values(): expected ") + name(dtype) + ", got " + name(type));
}

const Array& Readings::array(std::string_view name) const {
  const auto found = arrays.find(name);
  if (found != arrays.end()) return found->second;
  std::string known;
  for (const auto& [other, array] : arrays) known += (known.empty() ? "" : ", ") + other;
  throw Error(ErrorCode::not_found, "array: expected one of " + known + ", got \"" + std::string(name) + '"');
}

std::vector<Vector3> LidarData::points() const {
  if (directions.size() != ranges.size()) {
    throw Error(ErrorCode::invalid_argument, "points(): expected a scan with directions, got one without");
  }
  const auto [w, x, y, z] = rotation;
  const std::array<Vector3, 3> rows{Vector3{1 - 2 * (y * y + z * z), 2 * (x * y - w * z), 2 * (x * z + w * y)},
                                    Vector3{2 * (x * y + w * z), 1 - 2 * (x * x + z * z), 2 * (y * z - w * x)},
                                    Vector3{2 * (x * z - w * y), 2 * (y * z + w * x), 1 - 2 * (x * x + y * y)}};
  std::vector<Vector3> points;
  for (std::size_t beam = 0; beam < ranges.size(); ++beam) {
    if (!std::isfinite(ranges[beam])) continue;
    const Vector3& d = directions[beam];
    Vector3& point = points.emplace_back(origin);
    for (std::size_t i = 0; i < 3; ++i) point[i] += ranges[beam] * (rows[i][0] * d[0] + rows[i][1] * d[1] + rows[i][2] * d[2]);
  }
  return points;
}

namespace detail {
namespace {

static_assert(static_cast<int>(DType::boolean) == static_cast<int>(protocol::DType::kDtypeBool) &&
              static_cast<int>(DType::float64) == static_cast<int>(protocol::DType::kDtypeFloat64));
static_assert(static_cast<int>(ImageFormat::raw) == static_cast<int>(protocol::ImageFormat::kRaw));

[[noreturn]] void refuse(const char* field, const std::string& expected, const std::string& got) {
  throw Error(ErrorCode::invalid_argument, std::string(field) + ": expected " + expected + ", got " + got);
}

void require_flags(std::span<const std::uint8_t> mask) {
  for (const std::uint8_t flag : mask) {
    if (flag > 1) refuse("mask", "0 or 1", std::to_string(flag));
  }
}

void require_bodies(const char* field, std::size_t size, std::size_t row, std::int64_t per_env) {
  if (row > 0 && size % row == 0) return;
  refuse(field, "values of " + std::to_string(per_env) + " bodies in each env", std::to_string(size) + " values");
}

template <class Real>
Real finite_number(Real value, const char* field) {
  if (!std::isfinite(value)) refuse(field, "finite numbers", std::to_string(value));
  return value;
}

}  // namespace

float finite(float value, const char* field) { return finite_number(value, field); }
double finite(double value, const char* field) { return finite_number(value, field); }
std::optional<float> finite(std::optional<float> value, const char* field) {
  if (value) finite_number(*value, field);
  return value;
}

protocol::Vector3 message_of(const Vector3& v, const char* field) {
  return {.x = finite(v[0], field), .y = finite(v[1], field), .z = finite(v[2], field)};
}
protocol::Quaternion message_of(const Quaternion& q, const char* field) {
  return {.w = finite(q[0], field), .x = finite(q[1], field), .y = finite(q[2], field), .z = finite(q[3], field)};
}
protocol::Angles message_of(const Angles& angles, const char* field) {
  return {.roll_deg = finite(angles.roll_deg, field),
          .pitch_deg = finite(angles.pitch_deg, field),
          .yaw_deg = finite(angles.yaw_deg, field)};
}

protocol::GetCameraData message_of(const ImageRequest& request, std::int64_t drone) {
  constexpr int kBest = 100;
  if (request.quality < 1 || request.quality > kBest)
    refuse("quality", "an integer in [1, 100]", std::to_string(request.quality));
  return {.drone = drone,
          .camera = request.camera,
          .format = static_cast<protocol::ImageFormat>(request.format),
          .quality = static_cast<std::uint32_t>(request.quality),
          .output = request.output};
}
protocol::GetLidarData message_of(const ScanRequest& request, std::int64_t drone) {
  return {.drone = drone, .lidar = request.lidar, .without_directions = request.without_directions};
}

void add_rows(protocol::FrameWriter& writer, const char* name, std::span<const float> values, std::size_t columns) {
  if (values.size() % columns != 0) {
    refuse(name, "rows of " + std::to_string(columns) + " numbers", std::to_string(values.size()) + " numbers");
  }
  writer.add(name, values, {values.size() / columns, columns});
}
void add_mask(protocol::FrameWriter& writer, std::span<const std::uint8_t> mask) {
  if (mask.empty()) return;
  require_flags(mask);
  const std::size_t size = mask.size();
  writer.add("mask", protocol::DType::kDtypeBool, std::as_bytes(mask), std::span(&size, 1));
}
void add_bodies(protocol::FrameWriter& writer, const char* name, std::span<const float> values, std::size_t columns,
                std::int64_t per_env) {
  if (values.empty()) return;
  const auto bodies = static_cast<std::size_t>(per_env);
  require_bodies(name, values.size(), bodies * columns, per_env);
  writer.add(name, values, {values.size() / (bodies * columns), bodies, columns});
}
void add_body_mask(protocol::FrameWriter& writer, std::span<const std::uint8_t> mask, std::int64_t per_env) {
  if (mask.empty()) return;
  require_flags(mask);
  const auto bodies = static_cast<std::size_t>(per_env);
  require_bodies("mask", mask.size(), bodies, per_env);
  writer.add("mask", protocol::DType::kDtypeBool, std::as_bytes(mask), std::array{mask.size() / bodies, bodies});
}
void add_array(protocol::FrameWriter& writer, const char* name, const Array& array) {
  const auto type = static_cast<protocol::DType>(array.dtype);
  std::size_t bytes = protocol::size_of(type);
  for (const std::size_t size : array.shape) bytes *= size;
  if (bytes != array.bytes.size()) {
    refuse(name, std::to_string(bytes) + " bytes for its shape", std::to_string(array.bytes.size()));
  }
  writer.add(name, type, array.bytes, array.shape);
}

void refuse_reply(const std::string& text) {
  throw Error(ErrorCode::bad_reply, "the server does not speak this client's protocol: " + text);
}

Vector3 value_of(const protocol::Vector3& v) { return {v.x, v.y, v.z}; }
Quaternion value_of(const protocol::Quaternion& q) { return {q.w, q.x, q.y, q.z}; }
std::optional<Vector3> value_of(const std::optional<protocol::Vector3>& v) {
  return v ? std::optional(value_of(*v)) : std::nullopt;
}
std::optional<Quaternion> value_of(const std::optional<protocol::Quaternion>& q) {
  return q ? std::optional(value_of(*q)) : std::nullopt;
}
Array value_of(const protocol::ReceivedArray& array) {
  Array value{.dtype = static_cast<DType>(array.array->dtype),
              .shape = {array.array->shape.begin(), array.array->shape.end()},
              .bytes = {array.bytes.begin(), array.bytes.end()}};
  const auto is_flag = [](std::byte byte) { return byte <= std::byte{1}; };
  if (value.dtype == DType::boolean && !std::ranges::all_of(value.bytes, is_flag)) {
    refuse_reply("the array \"" + array.array->name + "\" has flags other than 0 and 1");
  }
  return value;
}

void read_done(Call& call) { ReplyOf<protocol::Done> reply(call); }

std::string read_config(Call& call) { return std::move(ReplyOf<protocol::Config>(call).message().config_json); }

namespace {

Time value_of(const protocol::Time& time) {
  return {.step = time.step, .time_s = time.time_s, .num_envs = time.num_envs, .generation = time.generation};
}

}  // namespace

Time read_time(Call& call) {
  ReplyOf<protocol::Time> reply(call);
  return value_of(reply.message());
}

Readings read_readings(Call& call) {
  ReplyOf<protocol::Time> reply(call);
  Readings readings{.time = value_of(reply.message()), .arrays = {}};
  for (const protocol::ReceivedArray& array : reply.arrays())
    readings.arrays.insert_or_assign(array.array->name, value_of(array));
  return readings;
}

Impact read_impact(Call& call) {
  ReplyOf<protocol::Impact> reply(call);
  const protocol::Impact& impact = reply.message();
  return {.hit = impact.hit,
          .fraction = impact.fraction,
          .location = required(impact.location, "location"),
          .rotation = required(impact.rotation, "rotation"),
          .point = value_of(impact.point).value_or(Vector3{}),
          .normal = value_of(impact.normal).value_or(Vector3{})};
}

CameraData read_image(Call& call) {
  ReplyOf<protocol::CameraData> reply(call);
  const protocol::CameraData& data = reply.message();
  constexpr auto kMost = static_cast<std::uint32_t>(std::numeric_limits<int>::max());
  if (data.width_px > kMost || data.height_px > kMost) refuse_reply("the size of an image is too large");
  return {.step = data.step,
          .width_px = static_cast<int>(data.width_px),
          .height_px = static_cast<int>(data.height_px),
          .image = value_of(reply.array("image"))};
}

LidarData read_scan(Call& call) {
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

Fps read_fps(Call& call) {
  ReplyOf<protocol::Fps> reply(call);
  return {.fps = reply.message().fps, .real_time_factor = reply.message().real_time_factor};
}

}  // namespace detail
}  // namespace flockstep::client
