// LinePainter: draws lines of the world into a camera's image, where the scene does not hide them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/pose.hpp"
#include "render/render_request.hpp"
#include "trace/ray_block.hpp"
#include "trace/tracer.hpp"

namespace flockstep::render {

using LineColor = std::array<std::uint8_t, 3>;  // sRGB
inline constexpr LineColor kMoveLineColor{0, 230, 60}, kBeamColor{250, 130, 70};

// Lines are two pixels wide in an image of 640 pixels, wider in wider images, and have smooth edges. For each pixel of a line
// the painter traces one ray from the camera to the line's nearest point. It sees what the camera sees: markers, bodies, and
// the world through masks, between the near and the far plane.
class LinePainter {
 public:
  // view: the request of the frame; only its pose, scene, bodies and optics are read. It must outlive the painter. width_px,
  // height_px: size of the image, which may be resized. tracer: not in use elsewhere meanwhile.
  LinePainter(const RenderRequest& view, int width_px, int height_px, trace::Tracer& tracer);

  // Adds a line through points in m, world frame. A point that is NaN separates two lines.
  void add(std::span<const Vec3> points);
  // Draws the added lines into rgb, (height, width, 3), and forgets them.
  void draw(std::span<std::uint8_t> rgb, const LineColor& line = kMoveLineColor);

 private:
  using Vec3d = Eigen::Vector3d;
  // A point of a line: the direction of its ray in the camera's frame, its inverse distance in lengths of that direction, and its
  // place in the image.
  struct Point {
    Vec3d ray;
    double inverse_depth;  // depth in m
    double x, y;           // px, from the upper left corner
  };
  Point project(const Vec3d& local) const;
  std::optional<Point> project_by_lens(
      const Vec3d& local) const;  // none if it is outside of the image, or not between the planes
  void add(const Point& a, const Point& b);
  void add_bent(const Vec3d& a, const Vec3d& b, int halvings);  // in straight parts
  void cover(std::size_t pixel, float share, const Point& at);
  void trace();  // the pending pixels

  const RenderRequest& view_;
  trace::Tracer& tracer_;
  std::size_t width_, height_;
  double scale_x_, scale_y_;  // image pixels per rendered pixel
  double half_width_;         // px
  std::vector<float> cover_;  // (height, width) share of each pixel that visible lines cover
  // Pixels that wait for their rays.
  struct Pending {
    std::size_t pixel;
    float share, depth;
  };
  std::array<Pending, trace::kMaxRays> pending_;
  std::size_t num_pending_ = 0;
  alignas(64) trace::RayFloats ahead_, left_, up_;
};

}  // namespace flockstep::render
