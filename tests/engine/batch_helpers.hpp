// What the tests of batches share: small worlds, a navigation batch, comparing bits.
#pragma once

#include <cstring>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "swiftlet/batch.hpp"

namespace swiftlet::testing {

inline std::shared_ptr<const World> playground(const std::string& name) {
  return World::load(std::filesystem::path(SWIFTLET_SCENES) / "playground" / (name + ".json"));
}

inline Primitive primitive(PrimitiveKind kind, const Vec3& center, const Vec3& half_extents,
                           const Quat& rotation = Quat::Identity()) {
  return {.kind = kind, .center = center, .rotation = rotation, .half_extents = half_extents};
}

inline std::shared_ptr<const World> make_world(std::vector<Primitive> primitives, Markers markers = {}, TriangleMesh mesh = {}) {
  SceneDescription description;
  description.primitives = std::move(primitives);
  description.markers = std::move(markers);
  description.mesh = std::move(mesh);
  return std::make_shared<const World>(std::move(description));
}

inline BatchConfig lidar_batch(int num_drones, const LidarConfig& lidar = {}) {
  BatchConfig config;
  config.num_drones = num_drones;
  config.num_threads = 1;
  config.has_lidar = true;
  config.lidar = lidar;
  return config;
}

inline BatchConfig navigation_batch(int num_drones) {
  BatchConfig config = lidar_batch(num_drones);
  config.task = TaskKind::navigation;
  return config;
}

template <class T>
std::span<const T> row(const std::vector<T>& array, std::size_t drone, std::size_t columns) {
  return std::span(array).subspan(drone * columns, columns);
}

// Equal as bytes: -0 differs from 0, a NaN equals itself.
template <class A, class B>
bool same_bits(const A& a, const B& b) {
  const std::span x(a);
  const std::span y(b);
  return x.size() == y.size() && (x.empty() || std::memcmp(x.data(), y.data(), x.size_bytes()) == 0);
}

template <class F>
std::string message_of(const F& f) {
  try {
    f();
  } catch (const std::exception& error) {
    return error.what();
  }
  return "nothing was thrown";
}

}  // namespace swiftlet::testing

// The statement throws std::invalid_argument and its message names the field.
#define EXPECT_REFUSED(statement, field)                                                             \
  do {                                                                                               \
    EXPECT_THROW(statement, std::invalid_argument);                                                  \
    const std::string refusal = swiftlet::testing::message_of([&] { statement; });                   \
    EXPECT_NE(refusal.find(field), std::string::npos) << "expected " << field << " in: " << refusal; \
  } while (false)
