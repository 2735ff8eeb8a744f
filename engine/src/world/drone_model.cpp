#include "flockstep/drone_model.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <string>
#include <utility>

#include "base/require.hpp"

namespace flockstep {

namespace {

// m. Flatter hulls are rejected, because rounding errors would dominate their volume.
constexpr double kMinThickness = 1e-4;

constexpr float kMaxHullReach = 100.0F;  // m; float32 resolves 10 um at this distance

// Returns an upper bound of the points' extent in their thinnest direction: the least extent along the normals of all planes
// through three points.
double thickness(std::span<const Vec3> points) {
  double thinnest = std::numeric_limits<double>::infinity();
  bool spans_a_plane = false;
  for (std::size_t i = 0; i < points.size(); ++i) {
    for (std::size_t j = i + 1; j < points.size(); ++j) {
      for (std::size_t k = j + 1; k < points.size(); ++k) {
        const Eigen::Vector3d origin = points[i].cast<double>();
        const Eigen::Vector3d ij = points[j].cast<double>() - origin;
        const Eigen::Vector3d ik = points[k].cast<double>() - origin;
        const Eigen::Vector3d normal = ij.cross(ik);
        if (normal.norm() <= 1e-9 * std::max(ij.squaredNorm(), ik.squaredNorm())) continue;  // collinear
        spans_a_plane = true;
        const Eigen::Vector3d unit = normal.normalized();
        double low = 0.0;
        double high = 0.0;
        for (const Vec3& point : points) {
          const double height = unit.dot(point.cast<double>() - origin);
          low = std::min(low, height);
          high = std::max(high, height);
        }
        thinnest = std::min(thinnest, high - low);
      }
    }
  }
  return spans_a_plane ? thinnest : 0.0;
}

}  // namespace

DroneModel::DroneModel(std::vector<Vec3> hull, std::optional<Airframe> airframe, std::string name)
    : name_(std::move(name)), airframe_(std::move(airframe)), hull_(std::move(hull)) {
  if (airframe_) airframe_->validate();
  require(hull_.size() >= 4 && hull_.size() <= static_cast<std::size_t>(kMaxHullVertices), "hull",
          "4 to " + std::to_string(kMaxHullVertices) + " points", hull_.size());
  for (std::size_t i = 0; i < hull_.size(); ++i) {
    require(hull_[i].allFinite() && hull_[i].cwiseAbs().maxCoeff() <= kMaxHullReach, "hull[" + std::to_string(i) + ']',
            "finite coordinates of at most " + std::to_string(static_cast<int>(kMaxHullReach)) + " m",
            "a larger or infinite one");
  }
  const double thin = thickness(hull_);
  require(thin >= kMinThickness, "hull", "a body with a volume, at least 0.0001 m thick",
          "one " + std::to_string(thin) + " m thick");
  extents_ = {hull_[0], hull_[0]};
  for (const Vec3& vertex : hull_) {
    extents_.min = extents_.min.cwiseMin(vertex);
    extents_.max = extents_.max.cwiseMax(vertex);
    // Rounded up, so that the ball contains the hull.
    const float distance = std::nextafter(static_cast<float>(vertex.cast<double>().norm()), std::numeric_limits<float>::max());
    radius_ = std::max(radius_, distance);
  }
}

DroneModel DroneModel::scaled(double size, double mass) const {
  require(airframe_.has_value(), "drone", "one with an airframe, to be scaled", "only a hull");
  std::vector<Vec3> hull = hull_;
  for (Vec3& vertex : hull) vertex = (vertex.cast<double>() * size).cast<float>();
  return DroneModel(std::move(hull), airframe_->scaled(size, mass), name_);
}

}  // namespace flockstep
