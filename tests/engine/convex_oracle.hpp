// An independent distance between convex sets, slow and simple: Wolfe's nearest point algorithm on their Minkowski difference.
// It shares no code with the engine's geometry or its library. Both of its bounds are certificates.
#pragma once

#include <Eigen/Dense>

#include "flockstep/drone_model.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "standard.hpp"

namespace flockstep::oracle {

using Vec3d = Eigen::Vector3d;

// Support function: the farthest point of a convex set along a direction, in the world frame.
using Support = std::function<Vec3d(const Vec3d& direction)>;

inline Support polytope(std::vector<Vec3d> points) {
  return [points = std::move(points)](const Vec3d& d) {
    Vec3d best = points.front();
    for (const Vec3d& p : points) best = p.dot(d) > best.dot(d) ? p : best;
    return best;
  };
}

inline Support hull_at(const DroneModel& drone, const Vec3d& position, const Eigen::Quaterniond& rotation) {
  std::vector<Vec3d> points;
  for (const Vec3& p : drone.hull()) points.push_back(position + rotation.normalized() * p.cast<double>());
  return polytope(std::move(points));
}
inline Support hull_at(const DroneModel& drone, const Pose& pose) {
  return hull_at(drone, pose.position.cast<double>(), pose.rotation.cast<double>());
}

inline Support solid(const Primitive& primitive) {
  const Vec3d c = primitive.center.cast<double>();
  const Eigen::Quaterniond r = primitive.rotation.cast<double>().normalized();
  const Vec3d h = primitive.half_extents.cast<double>();
  if (primitive.kind == PrimitiveKind::sphere) {
    return [=](const Vec3d& d) -> Vec3d { return c + h.x() * d.normalized(); };
  }
  if (primitive.kind == PrimitiveKind::capsule) {
    return [=](const Vec3d& d) -> Vec3d {
      const Vec3d up = (h.z() - h.x()) * (r * Vec3d::UnitZ());
      return c + (up.dot(d) > 0 ? up : Vec3d(-up)) + h.x() * d.normalized();
    };
  }
  if (primitive.kind == PrimitiveKind::plane) {
    return polytope({c + r * Vec3d(h.x(), h.y(), 0), c + r * Vec3d(-h.x(), h.y(), 0), c + r * Vec3d(-h.x(), -h.y(), 0),
                     c + r * Vec3d(h.x(), -h.y(), 0)});
  }
  if (primitive.kind == PrimitiveKind::disc) {
    return [=](const Vec3d& d) -> Vec3d {
      const Vec3d axis = r * Vec3d::UnitZ();
      const Vec3d across = d - axis.dot(d) * axis;
      return across.norm() > 1e-12 ? Vec3d(c + h.x() * across.normalized()) : c;
    };
  }
  if (primitive.kind == PrimitiveKind::cylinder) {
    return [=](const Vec3d& d) -> Vec3d {
      const Vec3d axis = r * Vec3d::UnitZ();
      const Vec3d across = d - axis.dot(d) * axis;
      const Vec3d rim = across.norm() > 1e-12 ? Vec3d(h.x() * across.normalized()) : Vec3d::Zero();
      return c + rim + (axis.dot(d) > 0 ? 1.0 : -1.0) * h.z() * axis;
    };
  }
  std::vector<Vec3d> corners;
  for (int i = 0; i < 8; ++i) {
    corners.push_back(c + r * Vec3d((i & 1 ? 1 : -1) * h.x(), (i & 2 ? 1 : -1) * h.y(), (i & 4 ? 1 : -1) * h.z()));
  }
  return polytope(std::move(corners));
}

struct Distance {
  double lower = 0.0;  // m; a separating plane with this gap exists
  double upper = 0.0;  // m; two points at this distance exist
};

// P. Wolfe, "Finding the nearest point in a polytope", Mathematical Programming 11 (1976), with a support function for the
// vertices. For overlapping sets `upper` is 0 and `lower` is not positive.
inline Distance distance(const Support& a, const Support& b) {
  const auto farthest = [&](const Vec3d& d) -> Vec3d { return a(d) - b(-d); };
  std::vector<Vec3d> points{farthest(Vec3d(1, 0.5, 0.25))};
  std::vector<double> weights{1.0};
  Vec3d x = points[0];
  Distance result{-1.0, x.norm()};
  for (int major = 0; major < 500; ++major) {
    const double length = x.norm();
    result.upper = std::min(result.upper, length);
    if (length < 1e-9) {
      return {std::min(result.lower, 0.0), 0.0};
    }
    const Vec3d q = farthest(-x);
    result.lower = std::max(result.lower, x.dot(q) / length);
    const bool known = std::any_of(points.begin(), points.end(), [&q](const Vec3d& p) { return p == q; });
    if (known || length - x.dot(q) / length < 1e-9) break;
    points.push_back(q);
    weights.push_back(0.0);
    while (true) {  // nearest point of the affine hull, or of a smaller face if it lies outside
      // Least squares over differences: normal equations would square the condition of points that are near each other.
      const auto n = static_cast<Eigen::Index>(points.size());
      Eigen::MatrixXd away(3, n - 1);
      for (Eigen::Index i = 1; i < n; ++i) away.col(i - 1) = points[static_cast<std::size_t>(i)] - points[0];
      Eigen::VectorXd affine(n);
      if (n > 1) affine.tail(n - 1) = away.colPivHouseholderQr().solve(-points[0]);
      affine(0) = 1.0 - affine.tail(n - 1).sum();
      double step = 1.0;
      for (std::size_t i = 0; i < points.size(); ++i) {
        const double target = affine(static_cast<Eigen::Index>(i));
        if (target < 1e-13 && weights[i] > target) step = std::min(step, weights[i] / (weights[i] - target));
      }
      bool dropped = false;
      for (std::size_t i = points.size(); i-- > 0;) {
        weights[i] += step * (affine(static_cast<Eigen::Index>(i)) - weights[i]);
        if (step < 1.0 && weights[i] < 1e-13) {
          points.erase(points.begin() + static_cast<std::ptrdiff_t>(i));
          weights.erase(weights.begin() + static_cast<std::ptrdiff_t>(i));
          dropped = true;
        }
      }
      if (!dropped || points.size() == 1) break;
    }
    double total = 0.0;
    for (const double w : weights) total += w;
    x.setZero();
    for (std::size_t i = 0; i < points.size(); ++i) {
      weights[i] /= total;
      x += weights[i] * points[i];
    }
  }
  return result;
}

// Returns the distance of a convex set from a solid, or from the walls of the room around it. Not positive if they overlap.
inline double distance_from(const Support& hull, const Primitive& primitive) {
  if (primitive.kind != PrimitiveKind::room) return distance(hull, solid(primitive)).lower;
  double least = std::numeric_limits<double>::infinity();
  for (int axis = 0; axis < 3; ++axis) {
    const Vec3d d = Vec3d::Unit(axis);
    const auto center = static_cast<double>(primitive.center[axis]), half = static_cast<double>(primitive.half_extents[axis]);
    least = std::min({least, center + half - hull(d)[axis], hull(-d)[axis] - (center - half)});
  }
  return least;
}

// A motion in double precision: the position along the segment and the rotation along the shortest arc.
struct Way {
  Pose from, to;

  Vec3d position(double time) const { return (1.0 - time) * from.position.cast<double>() + time * to.position.cast<double>(); }
  Eigen::Quaterniond rotation(double time) const {
    return from.rotation.cast<double>().normalized().slerp(time, to.rotation.cast<double>().normalized());
  }
  Vec3d shift() const { return (to.position - from.position).cast<double>(); }
  double turn() const {
    return from.rotation.cast<double>().normalized().angularDistance(to.rotation.cast<double>().normalized());
  }
};

// Returns the first time from 0 to 1 at which distance(time) is at most `gap` (m), or 2 if there is none. Steps by 20 um or by
// the current distance, whichever is larger. speed: m per motion, at least that of any point.
template <class Distance>
double first_time_within(double gap, double speed, const Distance& distance) {
  for (double time = 0.0; time <= 1.0;) {
    const double beyond = distance(time) - gap;
    if (beyond <= 0.0) return time;
    time = time < 1.0 ? std::min(1.0, time + std::max(beyond, 2e-5) / speed) : 2.0;
  }
  return 2.0;
}

inline std::vector<Vec3> corners_of_box(const Vec3& half) {
  std::vector<Vec3> corners;
  for (const float x : {-1.0F, 1.0F}) {
    for (const float y : {-1.0F, 1.0F}) {
      for (const float z : {-1.0F, 1.0F}) corners.emplace_back(Vec3(x, y, z).cwiseProduct(half));
    }
  }
  return corners;
}

}  // namespace flockstep::oracle
