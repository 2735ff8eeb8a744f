// Helpers for tests of direct tracing: sets of directions with their frustum, and bundles of them.
#pragma once

#include "flockstep/world.hpp"
#include "random.hpp"
#include "standard.hpp"
#include "trace/frustum.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::testing {

// Unit directions in the sensor's frame in the layout of a bundle: structure of arrays, padded, with their frustum.
class Directions {
 public:
  explicit Directions(const std::vector<Vec3>& directions) : count_(directions.size()) {
    for (const Vec3& direction : directions) {
      const Eigen::Vector3d unit = direction.cast<double>().normalized();
      x_.push_back(static_cast<float>(unit.x()));
      y_.push_back(static_cast<float>(unit.y()));
      z_.push_back(static_cast<float>(unit.z()));
    }
    frustum_ = trace::make_frustum(x_, y_, z_);
    for (auto* component : {&x_, &y_, &z_}) component->resize(count_ + trace::kRayPadding);
  }
  std::size_t size() const { return count_; }
  Vec3 operator[](std::size_t i) const { return {x_[i], y_[i], z_[i]}; }
  const trace::Frustum& frustum() const { return frustum_; }
  // Points the bundle at the directions from `first` on. This object must outlive the bundle.
  void aim(trace::RayBundle& rays, std::size_t first = 0) const {
    rays.x = x_.data() + first;
    rays.y = y_.data() + first;
    rays.z = z_.data() + first;
    rays.frustum = &frustum_;
    rays.count = count_ - first;
  }

 private:
  std::size_t count_;
  std::vector<float> x_, y_, z_;
  trace::Frustum frustum_;
};

// Returns a single channel centred on the sensor's x axis.
inline std::vector<Vec3> fan(std::size_t beams, float degrees) {
  std::vector<Vec3> directions;
  for (std::size_t i = 0; i < beams; ++i) {
    const double part = beams == 1 ? 0.0 : static_cast<double>(i) / static_cast<double>(beams - 1) - 0.5;
    const double angle = static_cast<double>(degrees) * part * std::numbers::pi / 180.0;
    directions.emplace_back(static_cast<float>(std::cos(angle)), static_cast<float>(std::sin(angle)), 0.0F);
  }
  return directions;
}

// Returns directions within `degrees` of a random axis.
inline std::vector<Vec3> cone(Random& random, std::size_t count, float degrees) {
  const Quat turn = random.rotation();
  std::vector<Vec3> directions;
  for (std::size_t i = 0; i < count; ++i) {
    const float least = std::cos(degrees * std::numbers::pi_v<float> / 180.0F);
    const float z = random.within(least, 1.0F);
    const float angle = random.within(0.0F, 2.0F * std::numbers::pi_v<float>);
    const float across = std::sqrt(std::max(0.0F, 1.0F - z * z));
    directions.push_back(turn * Vec3(across * std::cos(angle), across * std::sin(angle), z));
  }
  return directions;
}

// Returns triangles of about 1 m at random places.
inline TriangleMesh soup(Random& random, int count) {
  TriangleMesh mesh;
  for (std::int32_t i = 0; i < 3 * count; i += 3) {
    const Vec3 center = random.point(4.0F);
    for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(center + random.point(1.0F));
    mesh.triangles.push_back({i, i + 1, i + 2});
  }
  return mesh;
}

// A frustum without planes, which contains everything.
inline const trace::Frustum& everywhere() {
  static const trace::Frustum frustum{};
  return frustum;
}

// Copies the rays of a bundle to a block, in the world frame.
inline void copy(const trace::RayBundle& bundle, trace::RayBlock& block) {
  block.count = bundle.count;
  for (std::size_t i = 0; i < bundle.count; ++i) {
    const Vec3 direction = bundle.direction(i);
    block.org_x[i] = bundle.origin.x();
    block.org_y[i] = bundle.origin.y();
    block.org_z[i] = bundle.origin.z();
    block.dir_x[i] = direction.x();
    block.dir_y[i] = direction.y();
    block.dir_z[i] = direction.z();
    block.range[i] = bundle.range;
  }
}

}  // namespace flockstep::testing
