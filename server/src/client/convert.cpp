#include "client/convert.hpp"

#include <algorithm>
#include <array>
#include <cmath>

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

}  // namespace

void refuse(const char* field, const std::string& expected, const std::string& got) {
  throw Error(ErrorCode::invalid_argument, std::string(field) + ": expected " + expected + ", got " + got);
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

std::vector<std::size_t> shape_of(const char* name, std::size_t size, std::initializer_list<std::int64_t> row) {
  std::size_t in_row = 1;
  for (const std::int64_t length : row) in_row *= static_cast<std::size_t>(length);
  if (in_row == 0 || size % in_row != 0) {
    refuse(name, "rows of " + std::to_string(in_row) + " values", std::to_string(size) + " values");
  }
  std::vector<std::size_t> shape{size / in_row};
  for (const std::int64_t length : row) shape.push_back(static_cast<std::size_t>(length));
  return shape;
}
void add_flags(protocol::FrameWriter& writer, const char* name, std::span<const std::uint8_t> flags,
               std::initializer_list<std::int64_t> row) {
  for (const std::uint8_t flag : flags) {
    if (flag > 1) refuse(name, "0 or 1", std::to_string(flag));
  }
  writer.add(name, protocol::DType::kDtypeBool, std::as_bytes(flags), shape_of(name, flags.size(), row));
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

}  // namespace detail
}  // namespace flockstep::client
