// Helpers for tests of batches: small worlds, a navigation batch, bitwise comparison, edited snapshots.
#pragma once

#include <type_traits>

#include "base/hash.hpp"
#include "flockstep/array_visitor.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/tasks.hpp"
#include "random.hpp"

namespace flockstep::testing {

inline std::shared_ptr<const World> playground(const std::string& name) {
  return World::load(std::filesystem::path(FLOCKSTEP_SCENES) / "playground" / (name + ".json"));
}

inline Batch::Worlds training_playgrounds() {
  Batch::Worlds worlds;
  for (int i = 1; i <= 5; ++i) worlds.push_back(playground("train-" + std::to_string(i)));
  return worlds;
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

// (N, 3) positions and (N, 4) rotations.
struct Poses {
  std::vector<float> position, quat_wxyz;
};

// Random rotations at random positions in the box from -reach to reach.
inline Poses random_poses(Random& random, int count, const Vec3& reach) {
  Poses poses;
  for (int i = 0; i < count; ++i) {
    for (Eigen::Index axis = 0; axis < 3; ++axis) poses.position.push_back(random.within(-reach[axis], reach[axis]));
    const Quat q = random.rotation();
    poses.quat_wxyz.insert(poses.quat_wxyz.end(), {q.w(), q.x(), q.y(), q.z()});
  }
  return poses;
}

// A world so small that random flights soon end in every possible way.
inline std::shared_ptr<const World> closet() {
  return make_world({primitive(PrimitiveKind::room, {1, 1, 0.75F}, {1.25F, 1.25F, 0.75F}),
                     primitive(PrimitiveKind::cylinder, {1.9F, 1.9F, 0.75F}, {0.125F, 0.125F, 0.75F})},
                    {.start = Vec3(1, 1, 0.75F),
                     .waypoints = {{1, 0.5F, 0.75F}},
                     .goal = Vec3(1, 1.25F, 0.75F),
                     .spawn_box = Aabb{.min = Vec3(0.75F, 0.5F, 0.5F), .max = Vec3(1.25F, 1, 1)}});
}

inline BatchConfig lidar_batch(int num_envs, const LidarConfig& lidar = {}) {
  return {.num_envs = num_envs, .num_threads = 1, .lidars = {lidar}};
}

// The configuration of a navigation batch.
struct NavigationBatch : BatchConfig {
  NavigationConfig navigation;

  Batch make(Batch::Worlds worlds) const { return Batch(*this, std::move(worlds), make_task(navigation)); }
};

inline NavigationBatch navigation_batch(int num_envs, const LidarConfig& lidar = {}) {
  return {lidar_batch(num_envs, lidar), {}};
}

inline std::vector<std::uint64_t> seeds_from(std::uint64_t first, std::size_t count) {
  std::vector<std::uint64_t> seeds(count);
  std::iota(seeds.begin(), seeds.end(), first);
  return seeds;
}

// Random actions of each step and drone, which depend neither on the number of steps nor on that of the drones.
inline std::vector<std::vector<std::int64_t>> discrete_actions(std::size_t steps, std::size_t num_drones) {
  std::vector<std::vector<std::int64_t>> actions(steps, std::vector<std::int64_t>(num_drones));
  for (std::size_t step = 0; step < steps; ++step) {
    for (std::size_t drone = 0; drone < num_drones; ++drone) {
      actions[step][drone] = static_cast<std::int64_t>(std::mt19937(static_cast<unsigned>(1000 * drone + step))() % 6);
    }
  }
  return actions;
}

template <class T, class Allocator>
std::span<const T> row(const std::vector<T, Allocator>& array, std::size_t drone, std::size_t columns) {
  return std::span(array).subspan(drone * columns, columns);
}

// Compares bytes: -0 differs from 0, and a NaN equals itself.
template <class A, class B>
bool same_bits(const A& a, const B& b) {
  const std::span x(a);
  const std::span y(b);
  return x.size() == y.size() && (x.empty() || std::memcmp(x.data(), y.data(), x.size_bytes()) == 0);
}

// Returns the values of an observation, row after row.
template <class T = float>
std::vector<T> values_of(const Buffer& buffer) {
  const auto* const first = reinterpret_cast<const T*>(buffer.bytes().data());
  return {first, first + buffer.bytes().size() / sizeof(T)};
}

// Calls f(name, array) for every array of a struct and of its nested structs.
template <HasFields T, class F>
void for_each_array(const T& arrays, const F& f) {
  for_each_field(arrays, [&](const auto& field, const auto& value) {
    if constexpr (HasFields<std::remove_cvref_t<decltype(value)>>) {
      for_each_array(value, f);
    } else {
      f(std::string(field.name), value);
    }
  });
}

// Compares all arrays of two structs of one kind.
template <HasFields T>
::testing::AssertionResult same_arrays(const T& a, const T& b) {
  std::string different;
  for_each_array(a, [&](const std::string& name, const auto& x) {
    for_each_array(b, [&](const std::string& other, const auto& y) {
      if constexpr (std::is_same_v<decltype(x), decltype(y)>) {
        if (name == other && !same_bits(x, y)) different += ' ' + name;
      }
    });
  });
  return different.empty() ? ::testing::AssertionSuccess() : ::testing::AssertionFailure() << "differ:" << different;
}

// Calls f(name, bytes) for every array of the batch's task.
template <class F>
void for_each_task_array(const Batch& batch, const F& f) {
  struct Visitor final : ArrayVisitor {
    explicit Visitor(const F& to) : f(to) {}
    void bytes(std::string_view name, std::span<std::byte> bytes, std::optional<DType>) override {
      f(std::string(name), std::span<const std::byte>(bytes));
    }
    void blob(std::string_view, std::string&) override {}
    const F& f;
  } visitor(f);
  batch.visit_task(visitor);
}

// Returns one array of the batch's task, or an empty span if there is none with that name.
template <class T>
std::span<const T> task_array(const Batch& batch, std::string_view name) {
  std::span<const T> found;
  for_each_task_array(batch, [&](const std::string& array, std::span<const std::byte> bytes) {
    if (array == name) found = {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
  });
  return found;
}

struct NamedRow {
  std::string name;
  std::span<const std::byte> bytes;
};

// Returns all rows that the batch writes for an env with one drone: state (except world_index), sensors, outputs and task. The
// final observation is included only if the episode ended.
inline std::vector<NamedRow> rows_of(const Batch& batch, std::size_t env) {
  std::vector<NamedRow> rows;
  const auto add = [&](const std::string& name, std::span<const std::byte> array) {
    const std::size_t size = array.size() / batch.state().active.size();
    rows.push_back({name, array.subspan(env * size, size)});
  };
  for_each_array(batch.state(), [&](const std::string& name, const auto& array) {
    if (name != "world_index") add(name, std::as_bytes(std::span(array)));
  });
  add("lidar_ranges", std::as_bytes(std::span(batch.lidar().readings().ranges)));
  add("sensed_position", std::as_bytes(std::span(batch.pose_readings().position)));
  add("sensed_quat_wxyz", std::as_bytes(std::span(batch.pose_readings().quat_wxyz)));
  if (batch.task() == nullptr) return rows;
  const Outputs& out = batch.outputs();
  for_each_array(out, [&](const std::string& name, const auto& array) {
    if constexpr (std::is_same_v<std::remove_cvref_t<decltype(array)>, std::vector<Buffer>>) {
      if (name == "final_observation" && !out.terminated[env] && !out.truncated[env]) return;
      for (const Buffer& buffer : array) add(name, buffer.bytes());
    } else {
      add(name, std::as_bytes(std::span(array)));
    }
  });
  for_each_task_array(batch, add);
  return rows;
}

inline std::vector<std::byte> bytes_of(const Batch& batch, std::size_t env) {
  std::vector<std::byte> bytes;
  for (const NamedRow& row : rows_of(batch, env)) bytes.insert(bytes.end(), row.bytes.begin(), row.bytes.end());
  return bytes;
}

// Checks that drone i of one batch and drone j of another are identical bit for bit and in the same world.
inline ::testing::AssertionResult same_drone(const Batch& a, std::size_t i, const Batch& b, std::size_t j) {
  const auto world_of = [](const Batch& batch, std::size_t env) {
    return batch.worlds()[static_cast<std::size_t>(batch.state().world_index[env])].get();
  };
  if (world_of(a, i) != world_of(b, j)) return ::testing::AssertionFailure() << "drone " << i << " is in another world";
  const auto x = rows_of(a, i);
  const auto y = rows_of(b, j);
  if (x.size() != y.size()) return ::testing::AssertionFailure() << "one of drone " << i << " and " << j << " has ended";
  for (std::size_t k = 0; k < x.size(); ++k) {
    if (!same_bits(x[k].bytes, y[k].bytes))
      return ::testing::AssertionFailure() << "drone " << i << ": " << x[k].name << " differs";
  }
  return ::testing::AssertionSuccess();
}

inline ::testing::AssertionResult same_drones(const Batch& a, const Batch& b) {
  for (std::size_t env = 0; env < a.state().active.size(); ++env) {
    if (const auto same = same_drone(a, env, b, env); !same) return same;
  }
  return ::testing::AssertionSuccess();
}

// Flies a batch on one thread, and its first envs again by themselves, in blocks of 3 on four threads: they are the same.
inline void expect_envs_alone(NavigationBatch config, const Batch::Worlds& worlds, std::size_t few, std::size_t steps) {
  const auto count = static_cast<std::size_t>(config.num_envs);
  Batch many = config.make(worlds);
  config.num_envs = static_cast<int>(few);
  config.block_size = 3;
  config.num_threads = 4;
  Batch alone = config.make(worlds);
  const std::vector<std::uint64_t> seeds = seeds_from(11, count);
  many.reset(seeds);
  alone.reset(std::span(seeds).first(few));
  for (const auto& actions : discrete_actions(steps, count)) {
    many.step(actions);
    alone.step(std::span(actions).first(few));
    for (std::size_t env = 0; env < few; ++env) ASSERT_TRUE(same_drone(alone, env, many, env));
  }
}

// The header of a snapshot, see batch/snapshot.cpp. The arrays follow, each preceded by its length in 8 bytes.
struct SnapshotHeader {
  std::uint64_t magic, format, config, length, checksum;
};

// Returns an edited snapshot with its length and checksum updated, so that the checks behind them are reached.
inline std::string mended(std::string blob) {
  SnapshotHeader header{};
  std::memcpy(&header, blob.data(), sizeof(header));
  const std::string_view body = std::string_view(blob).substr(sizeof(header));
  header.length = body.size();
  header.checksum = 0;
  Hash hash;
  hash.add(std::as_bytes(std::span(&header, 1)));
  hash.add(body);
  header.checksum = hash.value();
  std::memcpy(blob.data(), &header, sizeof(header));
  return blob;
}

}  // namespace flockstep::testing
