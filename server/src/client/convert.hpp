// Converts the structs of client.hpp to messages of the protocol, and replies to results.
#pragma once

#include <cmath>
#include <concepts>
#include <cstddef>
#include <cstdint>
#include <initializer_list>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "client/link.hpp"
#include "flockstep/client.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"

namespace flockstep::client::detail {

// ----------------------------------------------------------------------------------------------------------------- requests

[[noreturn]] void refuse(const char* field, const std::string& expected, const std::string& got);
// Throws Error if a number is not finite; a server would end the connection.
template <std::floating_point Real>
Real finite(Real value, const char* field) {
  if (!std::isfinite(value)) refuse(field, "finite numbers", std::to_string(value));
  return value;
}

protocol::Vector3 message_of(const Vector3& v, const char* field);
protocol::Quaternion message_of(const Quaternion& q, const char* field);
protocol::Angles message_of(const Angles& angles, const char* field);

// Sets a field of a message.
template <class To, class From>
void put(To& to, const From& value, const char* field) {
  if constexpr (std::is_same_v<From, Orientation>) {
    std::visit([&](const auto& form) { to = message_of(form, field); }, value);
  } else if constexpr (std::floating_point<From>) {
    to = finite(value, field);
  } else if constexpr (requires { message_of(value, field); }) {
    to = message_of(value, field);
  } else if constexpr (requires { message_of(*value, field); }) {
    if (value) to = message_of(*value, field);
  } else if constexpr (std::is_enum_v<To>) {
    to = static_cast<To>(value);
  } else if constexpr (requires { To(value.begin(), value.end()); }) {
    to = To(value.begin(), value.end());
  } else {
    to = value;
  }
}

// The shape of an array whose rows have these sizes. Throws Error if the values do not divide into rows.
std::vector<std::size_t> shape_of(const char* name, std::size_t size, std::initializer_list<std::int64_t> row);
template <class T>
void add_rows(protocol::FrameWriter& writer, const char* name, std::span<const T> values,
              std::initializer_list<std::int64_t> row) {
  writer.add(name, protocol::dtype_of<T>(), std::as_bytes(values), shape_of(name, values.size(), row));
}
// Numbers of a drone's command. control: empty for that of the batch.
inline std::int64_t command_size(const ServerInfo& server, std::string_view control) {
  const std::string_view name = control.empty() ? std::string_view(server.control) : control;
  return name == "rotor_speeds" || name == "rotor_thrusts" ? server.num_rotors : 4;
}
// Throws Error for flags other than 0 and 1.
void add_flags(protocol::FrameWriter& writer, const char* name, std::span<const std::uint8_t> flags,
               std::initializer_list<std::int64_t> row);
// Throws Error if the shape of the array is not that of its values.
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
// These are made, like those of other results: see server/generate.py.
ServerInfo value_of(const protocol::Welcome& message);
Time value_of(const protocol::Time& message);
// A field that replies always have.
template <class T>
const T& required(const std::optional<T>& message, const char* field) {
  if (!message) refuse_reply(std::string("a reply lacks ") + field);
  return *message;
}

// Returns the result of a call. results.cpp defines one for each type.
template <class T>
T read(Call& call);

}  // namespace flockstep::client::detail
