// Converts the structs of client.hpp to messages of the protocol, and replies to results.
#pragma once

#include <concepts>
#include <cstddef>
#include <optional>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "client/link.hpp"
#include "flockstep/client.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"

namespace flockstep::client::detail {

// ----------------------------------------------------------------------------------------------------------------- requests

// Throws Error if a number is not finite; a server would end the connection.
float finite(float value, const char* field);
double finite(double value, const char* field);
std::optional<float> finite(std::optional<float> value, const char* field);

protocol::Vector3 message_of(const Vector3& v, const char* field);
protocol::Quaternion message_of(const Quaternion& q, const char* field);
protocol::Angles message_of(const Angles& angles, const char* field);

template <class T>
auto message_of(const std::optional<T>& value, const char* field) {
  return value ? std::optional(message_of(*value, field)) : std::nullopt;
}

// Sets a message's field that is a quaternion or angles.
template <class Rotation>
void set(Rotation& rotation, const Orientation& to) {
  std::visit([&](const auto& form) { rotation = message_of(form, "rotation"); }, to);
}

protocol::GetCameraData message_of(const ImageRequest& request, std::int64_t drone);
protocol::GetLidarData message_of(const ScanRequest& request, std::int64_t drone);

// Adds the array of N rows; throws Error if the values do not divide into rows.
void add_rows(protocol::FrameWriter& writer, const char* name, std::span<const float> values, std::size_t columns);
// Adds flags, if there are any.
void add_mask(protocol::FrameWriter& writer, std::span<const std::uint8_t> mask);
// Add an array (E, B, columns) or flags (E, B) of bodies, if there are any; throw Error if they do not divide into envs. per_env:
// B.
void add_bodies(protocol::FrameWriter& writer, const char* name, std::span<const float> values, std::size_t columns,
                std::int64_t per_env);
void add_body_mask(protocol::FrameWriter& writer, std::span<const std::uint8_t> mask, std::int64_t per_env);
// Adds an array; throws Error if its shape is not that of its values.
void add_array(protocol::FrameWriter& writer, const char* name, const Array& array);

template <class Operation>
protocol::Request request_of(Operation operation) {
  protocol::Request request;
  request.operation = std::move(operation);
  return request;
}

// ------------------------------------------------------------------------------------------------------------------ replies

[[noreturn]] void refuse_reply(const std::string& text);

// The reply of a call, whose result is a message of this type.
template <class Message>
class ReplyOf {
 public:
  explicit ReplyOf(Call& call)
      : link_(call.link()), reply_(link_.take(call)), message_(std::get_if<Message>(&reply_->header.result)) {
    if (message_ == nullptr) refuse_reply("a reply is that of another operation");
  }
  ~ReplyOf() { link_.reuse(std::move(reply_->bytes)); }
  ReplyOf(const ReplyOf&) = delete;
  ReplyOf& operator=(const ReplyOf&) = delete;
  Message& message() { return *message_; }
  const std::vector<protocol::ReceivedArray>& arrays() const { return reply_->arrays; }

  // An array of any size.
  const protocol::ReceivedArray& array(std::string_view name) const {
    for (const protocol::ReceivedArray& array : reply_->arrays) {
      if (array.array->name == name) return array;
    }
    refuse_reply("a reply lacks the array \"" + std::string(name) + '"');
  }
  // An array of this type and number of dimensions.
  template <class T>
  const protocol::ReceivedArray& array(std::string_view name, std::size_t dimensions) const {
    const protocol::ReceivedArray& found = array(name);
    if (found.array->dtype != protocol::dtype_of<T>() || found.array->shape.size() != dimensions) {
      refuse_reply("the array \"" + std::string(name) + "\" has another type or shape");
    }
    return found;
  }
  // Values of an array of rows.
  template <class T>
  std::vector<T> values(std::string_view name) const {
    return array<T>(name, 1).template values<T>();
  }
  template <class T, std::size_t kColumns>
  std::vector<std::array<T, kColumns>> rows(std::string_view name) const {
    const protocol::ReceivedArray& found = array<T>(name, 2);
    if (found.array->shape[1] != kColumns) refuse_reply("the array \"" + std::string(name) + "\" has another shape");
    return found.template values<std::array<T, kColumns>>();
  }

 private:
  Link& link_;
  std::unique_ptr<ReceivedReply> reply_;
  Message* message_;
};

Vector3 value_of(const protocol::Vector3& v);
Quaternion value_of(const protocol::Quaternion& q);
Array value_of(const protocol::ReceivedArray& array);
std::optional<Vector3> value_of(const std::optional<protocol::Vector3>& v);
std::optional<Quaternion> value_of(const std::optional<protocol::Quaternion>& q);
// Values of fields that replies always have.
template <class T>
auto required(const std::optional<T>& message, const char* field) {
  if (!message) refuse_reply(std::string("a reply lacks ") + field);
  return value_of(*message);
}

// Results of calls.
void read_done(Call& call);
std::string read_config(Call& call);
Time read_time(Call& call);
Readings read_readings(Call& call);
Impact read_impact(Call& call);
CameraData read_image(Call& call);
LidarData read_scan(Call& call);
Fps read_fps(Call& call);

}  // namespace flockstep::client::detail
