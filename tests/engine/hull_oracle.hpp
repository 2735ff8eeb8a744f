// An independent reference for rays that hit convex hulls, in double precision: clips each ray to the half spaces below all
// planes through three of the points. It shares no code with the engine.
#pragma once

#include <Eigen/Dense>

#include "flockstep/pose.hpp"
#include "ray_oracle.hpp"
#include "standard.hpp"

namespace flockstep::oracle {

class Hull {
 public:
  explicit Hull(std::span<const Vec3> points) {
    std::vector<Vec3d> exact;
    for (const Vec3& point : points) exact.emplace_back(point.cast<double>());
    double size = 0.0;
    for (const Vec3d& point : exact) size = std::max(size, point.norm());
    for (std::size_t i = 0; i < exact.size(); ++i) {
      for (std::size_t j = 0; j < exact.size(); ++j) {
        for (std::size_t k = j + 1; k < exact.size(); ++k) {
          if (i == j || i == k) continue;
          const Vec3d across = (exact[j] - exact[i]).cross(exact[k] - exact[i]);
          if (across.norm() < 1e-6 * size * size) continue;  // nearly on one line: the plane is uncertain
          for (const Vec3d& normal : {Vec3d(across.normalized()), Vec3d(-across.normalized())}) {
            double farthest = -kNever;
            for (const Vec3d& point : exact) farthest = std::max(farthest, normal.dot(point));
            if (farthest <= normal.dot(exact[i]) + 1e-7 * size) planes_.push_back({normal, farthest});
          }
        }
      }
    }
  }

  // Returns the nearest hit from outside or inside; the normal is that of the face, outwards.
  Hit hit(const Pose& pose, const Vec3d& origin, const Vec3d& direction) const {
    const Eigen::Matrix3d rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
    const Vec3d o = rotation.transpose() * (origin - pose.position.cast<double>());
    const Vec3d d = rotation.transpose() * direction;
    Hit enter, leave;
    enter.t = -kNever;
    for (const Plane& plane : planes_) {
      const double ahead = plane.offset - plane.normal.dot(o), speed = plane.normal.dot(d);
      if (speed == 0.0 && ahead < 0.0) return {};
      if (speed < 0.0 && ahead / speed > enter.t) enter = {ahead / speed, 0, plane.normal};
      if (speed > 0.0 && ahead / speed < leave.t) leave = {ahead / speed, 0, plane.normal};
    }
    if (enter.t > leave.t || leave.t < 0.0) return {};
    Hit& found = enter.t >= 0.0 ? enter : leave;
    found.normal = rotation * found.normal;
    return found;
  }

 private:
  struct Plane {
    Vec3d normal;
    double offset;
  };
  std::vector<Plane> planes_;
};

}  // namespace flockstep::oracle
