// Lens: how a camera bends rays, by OpenCV's models: Brown and Conrady's distortion of a pinhole, and Kannala and Brandt's
// fisheye.
//
// Both map an ideal point a to the point where the image shows it:
//
//   a (1 + k1 s + k2 s^2 + k3 s^3 + k4 s^4) + s q + 2 (q . a) a,  where s = |a|^2 and q = (p2, p1).
//
// Points are in focal lengths from the centre of the image, x to the right and y down. The ideal point of a pinhole is where the
// ray meets the plane at distance 1, of a fisheye it lies at the ray's angle from the axis, in rad, in the same direction.
#pragma once

#include <Eigen/Core>
#include <array>
#include <optional>
#include <span>

#include "flockstep/sensors/camera.hpp"

namespace flockstep::render {

class Lens {
 public:
  using Point = Eigen::Vector2d;
  using Vec3d = Eigen::Vector3d;

  // corner: distance between the centre and the corners of the image, in focal lengths.
  Lens(Projection projection, std::span<const float> distortion, double corner);

  // False if the image folds, or if it shows rays that no camera of this projection has: at 89.5 degrees from the axis or more
  // for a pinhole, at 180 degrees for a fisheye. The other functions need a lens that shows every pixel.
  bool shows_every_pixel() const { return reach_ > 0.0; }

  Point to_image(const Point& ideal) const;
  // Inverts to_image() for a point of the image, by Newton's method from another ideal point.
  Point to_ideal(const Point& image, const Point& start) const;

  // Returns the ideal point of a direction in the camera frame, unless it is too far outside of the image.
  std::optional<Point> ideal_of(const Vec3d& direction) const;
  // Returns the direction of an ideal point in the camera frame: 1 along the optical axis, of a fisheye of length 1.
  Vec3d direction_of(const Point& ideal) const;
  bool is_fisheye() const { return fisheye_; }

 private:
  double radial(double s) const;        // 1 + k1 s + ...
  double radial_slope(double s) const;  // its derivative
  double find_reach(double corner) const;

  bool fisheye_;
  std::array<double, 4> k_{};
  Point q_ = Point::Zero();
  double reach_;  // within this distance from the centre to_image() is injective, and includes the image; 0 if there is none
};

}  // namespace flockstep::render
