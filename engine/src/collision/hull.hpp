// Hull: the drone's convex hull, laid out for its only query: the vertex farthest along a direction.
#pragma once

#include <array>
#include <cstddef>

#include "flockstep/drone_model.hpp"

namespace flockstep::collision {

class Hull {
 public:
  explicit Hull(const DroneModel& drone);
  Hull();  // a single vertex at the origin

  // Returns the index of a vertex farthest along the direction (body frame, any length). Compares in float32: the vertex may
  // fall short of the farthest one by at most 1e-7 m.
  int support(const Vec3& direction) const;

  Eigen::Vector3d vertex(int index) const {  // m, body frame
    const auto i = static_cast<std::size_t>(index);
    return {static_cast<double>(x_[i]), static_cast<double>(y_[i]), static_cast<double>(z_[i])};
  }
  int count() const { return count_; }
  float radius() const { return radius_; }  // m, of the ball around the body origin that contains the hull

 private:
  using Lane = std::array<float, kMaxHullVertices>;
  // (kMaxHullVertices,) m, body frame; padded with the last vertex
  alignas(64) Lane x_;
  alignas(64) Lane y_;
  alignas(64) Lane z_;
  int count_ = 0;
  float radius_ = 0.0F;
};

}  // namespace flockstep::collision
