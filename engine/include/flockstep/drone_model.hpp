// DroneModel: what a drone is made of; its convex hull is its collision body.
#pragma once

#include <span>
#include <vector>

#include "flockstep/pose.hpp"

namespace flockstep {

inline constexpr int kMaxHullVertices = 32;

class DroneModel {
 public:
  // The default 650-class quadrotor, extents exactly 0.93 x 0.59 x 0.20 m, centred on the body origin.
  static DroneModel quadrotor650();

  // hull: 4 to 32 points in the body frame (m); their convex hull is the body and must have a volume.
  explicit DroneModel(std::vector<Vec3> hull);

  std::span<const Vec3> hull() const { return hull_; }
  float radius() const { return radius_; }          // m, of the smallest ball about the body origin that holds the hull
  const Aabb& extents() const { return extents_; }  // m, body frame

 private:
  std::vector<Vec3> hull_;
  float radius_ = 0.0F;
  Aabb extents_;
};

}  // namespace flockstep
