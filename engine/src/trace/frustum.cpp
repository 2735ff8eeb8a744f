#include "trace/frustum.hpp"

#include <algorithm>
#include <cmath>

namespace flockstep::trace {
namespace {

constexpr float kMargin = 1e-5F;       // fraction of the range, for rounding in rotated normals
constexpr double kNarrow = 0.1736482;  // cosine of 80 degrees

void set_plane(Frustum& frustum, std::size_t plane, const Eigen::Vector3d& normal, double reach) {
  frustum.x[plane] = static_cast<float>(normal.x());
  frustum.y[plane] = static_cast<float>(normal.y());
  frustum.z[plane] = static_cast<float>(normal.z());
  frustum.reach[plane] = static_cast<float>(std::max(reach, 0.0)) + kMargin;
}

}  // namespace

Frustum make_frustum(std::span<const float> x, std::span<const float> y, std::span<const float> z) {
  using Vec3d = Eigen::Vector3d;
  const auto direction = [&](std::size_t i) { return Vec3d(x[i], y[i], z[i]); };
  Vec3d mean = Vec3d::Zero();
  for (std::size_t i = 0; i < x.size(); ++i) mean += direction(i);
  const bool has_mean = mean.norm() > 1e-6 * static_cast<double>(x.size());
  if (has_mean) mean.normalize();
  const Vec3d side = Vec3d::Unit(std::abs(mean.z()) < 0.9 ? 2 : 0).cross(mean).normalized();
  const Vec3d up = mean.cross(side);
  double narrowest = has_mean ? 1.0 : 0.0;
  double slope[4] = {-1e9, -1e9, -1e9, -1e9};  // towards side, -side, up, -up
  double elevation[2] = {-1.0, -1.0};          // towards z, -z
  for (std::size_t i = 0; i < x.size(); ++i) {
    const Vec3d d = direction(i);
    const double ahead = d.dot(mean);
    narrowest = std::min(narrowest, ahead);
    slope[0] = std::max(slope[0], d.dot(side) / ahead);
    slope[1] = std::max(slope[1], -d.dot(side) / ahead);
    slope[2] = std::max(slope[2], d.dot(up) / ahead);
    slope[3] = std::max(slope[3], -d.dot(up) / ahead);
    elevation[0] = std::max(elevation[0], d.z());
    elevation[1] = std::max(elevation[1], -d.z());
  }
  Frustum frustum{};
  if (narrowest > kNarrow) {
    for (std::size_t plane = 0; plane < Frustum::kPlanes; ++plane) {
      const Vec3d across = plane < 2 ? side : up;
      set_plane(frustum, plane, ((plane % 2 == 0 ? 1.0 : -1.0) * across - slope[plane] * mean).normalized(), 0.0);
    }
  } else {
    set_plane(frustum, 0, Vec3d::UnitZ(), elevation[0]);
    set_plane(frustum, 1, -Vec3d::UnitZ(), elevation[1]);
  }
  return frustum;
}

Frustum make_pyramid(float left_min, float left_max, float up_min, float up_max) {
  using Vec3d = Eigen::Vector3d;
  Frustum frustum{};
  set_plane(frustum, 0, Vec3d(-left_max, 1, 0).normalized(), 0.0);
  set_plane(frustum, 1, Vec3d(left_min, -1, 0).normalized(), 0.0);
  set_plane(frustum, 2, Vec3d(-up_max, 0, 1).normalized(), 0.0);
  set_plane(frustum, 3, Vec3d(up_min, 0, -1).normalized(), 0.0);
  return frustum;
}

}  // namespace flockstep::trace
