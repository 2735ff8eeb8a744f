// Hills with spheres above them, in which batches scan by different tracers, and an oracle of their scans.
#pragma once

#include <initializer_list>

#include "batch_helpers.hpp"
#include "meshes.hpp"
#include "ray_oracle.hpp"

namespace flockstep::testing {

// Few spheres are traced directly; for many, all primitives go through Embree.
inline std::shared_ptr<const World> hills_under(int spheres, Markers markers = {}) {
  Random random(3);
  std::vector<Primitive> primitives;
  for (int i = 0; i < spheres; ++i) {
    primitives.push_back(primitive(
        PrimitiveKind::sphere, {random.within(-11, 11), random.within(-11, 11), random.within(0.5F, 5)}, Vec3::Constant(0.2F)));
  }
  return make_world(std::move(primitives), std::move(markers), hills(24));
}

inline std::shared_ptr<const World> hills_or_shapes(unsigned seed) {
  Random random(seed);
  std::vector<Primitive> primitives = room_or_shapes(seed, random);
  return make_world(std::move(primitives), {},
                    seed % 2 == 0 ? hills(6 + static_cast<int>(seed % 7)) : loose_triangles(70, random));
}

inline Poses poses_over_hills(int count, unsigned seed = 7) {
  Random random(seed);
  Poses poses = random_poses(random, count, {9, 9, 2});
  for (std::size_t drone = 0; drone < static_cast<std::size_t>(count); ++drone) poses.position[3 * drone + 2] += 3.0F;
  return poses;
}

// Compares one in `every` rays of batches that differ only in their tracer with the oracle. tolerance: relative.
struct ScanTally {
  std::size_t rays = 0, compared = 0, hits = 0;

  void compare(const World& world, std::initializer_list<const Batch*> batches, std::size_t every, double tolerance = 1e-6) {
    const Batch& first = **batches.begin();
    const auto drones = static_cast<std::size_t>(first.config().num_envs);
    for (std::size_t number = 0; number < first.config().lidars.size(); ++number) {
      const LidarConfig& lidar = first.config().lidars[number];
      const std::size_t per_drone = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
      std::vector<float> directions(3 * per_drone * drones);
      first.lidar(number).directions(directions);
      const double range = static_cast<double>(lidar.max_range_m);
      for (std::size_t ray = number; ray < per_drone * drones; ray += every) {
        ++rays;
        const Pose pose = pose_of(first.state(), DroneIndex(ray / per_drone));
        const Eigen::Quaterniond rotation = pose.rotation.cast<double>().normalized();
        const Eigen::Vector3d offset(lidar.offset_m[0], lidar.offset_m[1], lidar.offset_m[2]);
        const Eigen::Vector3d origin = pose.position.cast<double>() + rotation * offset;
        const float* const d = &directions[3 * ray];
        const Eigen::Vector3d direction = rotation * Eigen::Vector3d(d[0], d[1], d[2]);
        const oracle::Hit hit = oracle::nearest(world, origin, direction, range);
        const double steep = oracle::steepness(world, hit, origin, direction, range);
        if (steep > 5.0) continue;
        ++compared;
        hits += hit.element >= 0;
        for (const Batch* const batch : batches) {
          const float found = batch->lidar(number).readings().ranges[ray];
          ASSERT_EQ(std::isinf(found), hit.element < 0) << lidar.name << ", ray " << ray;
          if (hit.element < 0) continue;
          ASSERT_NEAR(found, hit.t, tolerance * (20.0 + hit.t) * std::max(steep, 1.0)) << lidar.name << ", ray " << ray;
        }
      }
    }
  }
};

}  // namespace flockstep::testing
