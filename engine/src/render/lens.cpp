#include "render/lens.hpp"

#include <Eigen/LU>
#include <algorithm>
#include <cmath>
#include <numbers>

namespace flockstep::render {
namespace {

constexpr double kMinSlope = 0.01;  // below it, a lens nearly folds the image

}  // namespace

Lens::Lens(Projection projection, std::span<const float> distortion, double corner)
    : fisheye_(projection == Projection::fisheye) {
  const auto k = [&](std::size_t i) { return i < distortion.size() ? static_cast<double>(distortion[i]) : 0.0; };
  if (fisheye_) {
    k_ = {k(0), k(1), k(2), k(3)};
  } else {
    k_ = {k(0), k(1), k(4), 0.0};
    q_ = {k(3), k(2)};
  }
  reach_ = find_reach(corner);
}

double Lens::radial(double s) const { return 1.0 + s * (k_[0] + s * (k_[1] + s * (k_[2] + s * k_[3]))); }
double Lens::radial_slope(double s) const { return k_[0] + s * (2.0 * k_[1] + s * (3.0 * k_[2] + s * 4.0 * k_[3])); }

// to_image() is the gradient of a potential, and injective where that is convex: where the derivatives of the radial part along
// and across the radius exceed the tangential part's, which are at most 6 |q| r. The image of a disc of radius r then includes a
// disc whose radius is the radial part's less 3 |q| r^2.
double Lens::find_reach(double corner) const {
  constexpr double kSteps = 512.0;
  constexpr int kMaxSteps = 200'000;
  const double most = fisheye_ ? 0.999 * std::numbers::pi : 115.0;
  const double q = q_.norm();
  double r = 0.0;
  for (int i = 0; i < kMaxSteps && r < most; ++i) {
    const double s = r * r, across = radial(s), along = across + 2.0 * s * radial_slope(s);
    if (!(std::min(across, along) - 6.0 * q * r >= kMinSlope)) return 0.0;
    if (r * across - 3.0 * q * s >= corner) return r;
    r += corner / (kSteps * std::max(along, 1.0));
  }
  return 0.0;
}

Lens::Point Lens::to_image(const Point& ideal) const {
  const double s = ideal.squaredNorm();
  return ideal * (radial(s) + 2.0 * q_.dot(ideal)) + s * q_;
}

Lens::Point Lens::to_ideal(const Point& image, const Point& start) const {
  constexpr int kMaxSteps = 100;
  Point ideal = start;
  Point miss = image - to_image(ideal);
  for (int i = 0; i < kMaxSteps && miss.squaredNorm() > 1e-24 * (1.0 + image.squaredNorm()); ++i) {
    const double s = ideal.squaredNorm();
    const Eigen::Matrix2d outer = ideal * (2.0 * (radial_slope(s) * ideal + q_)).transpose() + 2.0 * q_ * ideal.transpose();
    const Eigen::Matrix2d slopes = outer + (radial(s) + 2.0 * q_.dot(ideal)) * Eigen::Matrix2d::Identity();
    Point step = slopes.inverse() * miss;
    Point next = ideal + step, next_miss = image - to_image(next);
    // Shorter steps always come nearer within the reach, where the slopes are positive.
    while (!(next.norm() <= 1.01 * reach_ && next_miss.squaredNorm() < miss.squaredNorm())) {
      step *= 0.5;
      if (step.squaredNorm() < 1e-32) return ideal;  // as near as rounding allows
      next = ideal + step;
      next_miss = image - to_image(next);
    }
    ideal = next;
    miss = next_miss;
  }
  return ideal;
}

std::optional<Lens::Point> Lens::ideal_of(const Vec3d& direction) const {
  const Point side(-direction.y(), -direction.z());
  const double across = side.norm();
  if (!fisheye_ && direction.x() <= 0.0) return std::nullopt;
  const double radius = fisheye_ ? std::atan2(across, direction.x()) : across / direction.x();
  if (radius > reach_) return std::nullopt;
  return across == 0.0 ? Point(Point::Zero()) : Point(side * (radius / across));
}

Lens::Vec3d Lens::direction_of(const Point& ideal) const {
  if (!fisheye_) return {1.0, -ideal.x(), -ideal.y()};
  const double angle = ideal.norm();
  const double share = angle == 0.0 ? 1.0 : std::sin(angle) / angle;
  return {std::cos(angle), -ideal.x() * share, -ideal.y() * share};
}

}  // namespace flockstep::render
