// Converts vectors, quaternions and configurations between the engine and messages.
#pragma once

#include <array>
#include <cmath>
#include <nlohmann/json.hpp>
#include <string>

#include "base/json_document.hpp"
#include "base/require.hpp"
#include "flockstep/pose.hpp"
#include "protocol/messages.hpp"
#include "recipe/config_json.hpp"

namespace flockstep::server {

inline protocol::Vector3 message_of(const Vec3& v) { return {.x = v.x(), .y = v.y(), .z = v.z()}; }
inline protocol::Vector3 message_of(const std::array<float, 3>& v) { return {.x = v[0], .y = v[1], .z = v[2]}; }
inline protocol::Vector3 vector_at(const float* v) { return {.x = v[0], .y = v[1], .z = v[2]}; }
inline protocol::Quaternion quaternion_at(const float* q) { return {.w = q[0], .x = q[1], .y = q[2], .z = q[3]}; }

inline std::array<float, 3> array_of(const protocol::Vector3& v) { return {v.x, v.y, v.z}; }
// Returns the quaternion with length 1. Throws std::invalid_argument if the length is 0.
inline std::array<float, 4> array_of(const protocol::Quaternion& q) {
  const double length = std::hypot(std::hypot(double{q.w}, double{q.x}), std::hypot(double{q.y}, double{q.z}));
  require(length > 0.0, "rotation", "a quaternion of a length above 0", length);
  const auto part = [&](float value) { return static_cast<float>(value / length); };
  return {part(q.w), part(q.x), part(q.y), part(q.z)};
}

// Reads the fields of a configuration that a text of JSON has; others keep their values. The name stands in messages.
template <class Config>
void read_json(const std::string& text, const char* name, Config& config) {
  if (text.empty()) return;
  const auto document = json::Document::parse(text, name);
  read_config(document->root().value, name, config);
}

}  // namespace flockstep::server
