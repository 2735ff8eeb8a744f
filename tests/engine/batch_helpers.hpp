// What the tests of batches share: small worlds, a navigation batch, comparing bits.
#pragma once

#include <gtest/gtest.h>

#include <cstddef>
#include <cstring>
#include <filesystem>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "batch/arrays.hpp"
#include "flockstep/batch.hpp"

namespace flockstep::testing {

inline std::shared_ptr<const World> playground(const std::string& name) {
  return World::load(std::filesystem::path(FLOCKSTEP_SCENES) / "playground" / (name + ".json"));
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

// Small enough that a random flight ends soon, in every way.
inline std::shared_ptr<const World> closet() {
  return make_world({primitive(PrimitiveKind::room, {1, 1, 0.75F}, {1.25F, 1.25F, 0.75F}),
                     primitive(PrimitiveKind::cylinder, {1.9F, 1.9F, 0.75F}, {0.125F, 0.125F, 0.75F})},
                    {.start = Vec3(1, 1, 0.75F),
                     .waypoints = {{1, 0.5F, 0.75F}},
                     .goal = Vec3(1, 1.25F, 0.75F),
                     .spawn_box = Aabb{.min = Vec3(0.75F, 0.5F, 0.5F), .max = Vec3(1.25F, 1, 1)}});
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

// All that is written of one drone: its rows of the state (but the number of its world), and of the outputs of the task. Its
// final observation counts where there is one.
inline std::vector<std::span<const std::byte>> rows_of(const Batch& batch, std::size_t drone) {
  std::vector<std::span<const std::byte>> rows;
  const auto add = [&](const auto& array, std::size_t columns) { rows.push_back(std::as_bytes(row(array, drone, columns))); };
  const State& state = batch.state();
  for_each_array(state, state.lidar_ranges.size() / state.active.size(), [&](const auto& array, std::size_t columns) {
    if (static_cast<const void*>(&array) != &state.world_index) add(array, columns);
  });
  if (batch.config().task == TaskKind::none) return rows;
  const Outputs& out = batch.outputs();
  const auto image_size = static_cast<std::size_t>(batch.image_size());
  for_each_output(static_cast<std::size_t>(batch.observation_size()), image_size, [&](auto member, std::size_t columns) {
    const auto* const array = static_cast<const void*>(&(out.*member));
    const bool is_final = array == &out.final_observation || array == &out.final_image;
    if (!is_final || out.terminated[drone] || out.truncated[drone]) add(out.*member, columns);
  });
  rows.push_back(std::as_bytes(batch.goal_index().subspan(drone, 1)));
  return rows;
}

inline std::vector<std::byte> bytes_of(const Batch& batch, std::size_t drone) {
  std::vector<std::byte> bytes;
  for (const auto& row : rows_of(batch, drone)) bytes.insert(bytes.end(), row.begin(), row.end());
  return bytes;
}

// Drone i of one batch is drone j of another, bit for bit, and in the same world.
inline ::testing::AssertionResult same_drone(const Batch& a, std::size_t i, const Batch& b, std::size_t j) {
  const auto world_of = [](const Batch& batch, std::size_t drone) {
    return batch.worlds()[static_cast<std::size_t>(batch.state().world_index[drone])].get();
  };
  if (world_of(a, i) != world_of(b, j)) return ::testing::AssertionFailure() << "drone " << i << " is in another world";
  const auto x = rows_of(a, i);
  const auto y = rows_of(b, j);
  if (x.size() != y.size()) return ::testing::AssertionFailure() << "one of drone " << i << " and " << j << " has ended";
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (!same_bits(x[k], y[k]))
      return ::testing::AssertionFailure() << "drone " << i << ": array " << k << " of arrays.hpp differs";
  }
  return ::testing::AssertionSuccess();
}

inline ::testing::AssertionResult same_drones(const Batch& a, const Batch& b) {
  for (std::size_t drone = 0; drone < a.state().active.size(); ++drone) {
    if (const auto same = same_drone(a, drone, b, drone); !same) return same;
  }
  return ::testing::AssertionSuccess();
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

}  // namespace flockstep::testing

// The statement throws std::invalid_argument and its message names the field.
#define EXPECT_REFUSED(statement, field)                                                             \
  do {                                                                                               \
    EXPECT_THROW(statement, std::invalid_argument);                                                  \
    const std::string refusal = flockstep::testing::message_of([&] { statement; });                  \
    EXPECT_NE(refusal.find(field), std::string::npos) << "expected " << field << " in: " << refusal; \
  } while (false)
