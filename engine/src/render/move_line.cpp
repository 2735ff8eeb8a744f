#include "render/move_line.hpp"

#include <algorithm>
#include <cmath>
#include <utility>

#include "base/platform.hpp"
#include "trace/frustum.hpp"

namespace flockstep::render {
namespace {

constexpr double kUsualWidth = 640.0;  // px
constexpr float kBias = 1e-4F;         // share of the depth by which a surface must be nearer than the line to hide it
constexpr std::size_t kRow = 16;       // rays in a row of a tile
constexpr int kHalvings = 8;           // of a line that a lens bends

}  // namespace

LinePainter::LinePainter(const RenderRequest& view, int width_px, int height_px, trace::Tracer& tracer)
    : view_(view),
      tracer_(tracer),
      width_(static_cast<std::size_t>(width_px)),
      height_(static_cast<std::size_t>(height_px)),
      scale_x_(static_cast<double>(width_px) / view.camera->width_px),
      scale_y_(static_cast<double>(height_px) / view.camera->height_px),
      half_width_(std::max(width_px / kUsualWidth, 0.5)),
      cover_(width_ * height_) {
  tracer_.set_viewpoint(*view.scene, {.origin = view.position,
                                      .rotation = view.rotation,
                                      .range = view.camera->far_m,
                                      .longest = 2.0F * view.optics->corner,  // rays may pass beside the image
                                      .near = view.camera->near_m,
                                      .sees_markers = true,
                                      .bodies = &view.bodies.shapes,
                                      .drones = &view.drones.shapes,
                                      .asked = {.normals = false, .weights = false}});
}

LinePainter::Point LinePainter::project(const Vec3d& local) const {
  const CameraOptics& optics = *view_.optics;
  const double left = local.y() / local.x(), up = local.z() / local.x();
  return {Vec3d(1.0, left, up), 1.0 / local.x(),
          (static_cast<double>(optics.cx) - left * static_cast<double>(optics.fx)) * scale_x_,
          (static_cast<double>(optics.cy) - up * static_cast<double>(optics.fy)) * scale_y_};
}

std::optional<LinePainter::Point> LinePainter::project_by_lens(const Vec3d& local) const {
  const CameraOptics& optics = *view_.optics;
  const double depth = optics.lens->is_fisheye() ? local.norm() : local.x();
  if (depth < static_cast<double>(view_.camera->near_m) || depth > static_cast<double>(view_.camera->far_m)) return std::nullopt;
  const auto ideal = optics.lens->ideal_of(local);
  if (!ideal) return std::nullopt;
  const Lens::Point image = optics.lens->to_image(*ideal);
  return Point{local / depth, 1.0 / depth,
               (static_cast<double>(optics.cx) + image.x() * static_cast<double>(optics.fx)) * scale_x_,
               (static_cast<double>(optics.cy) + image.y() * static_cast<double>(optics.fy)) * scale_y_};
}

void LinePainter::add_bent(const Vec3d& a, const Vec3d& b, int halvings) {
  constexpr double kStraight = 8.0;  // px
  constexpr double kTiny = 0.02;     // rad
  const auto from = project_by_lens(a), to = project_by_lens(b);
  const bool is_straight = from && to && std::hypot(from->x - to->x, from->y - to->y) < kStraight;
  const bool is_outside = !from && !to && (b - a).norm() < kTiny * std::min(a.norm(), b.norm());
  if (halvings == 0 || is_straight || is_outside) {
    if (from && to) add(*from, *to);
    return;
  }
  const Vec3d middle = 0.5 * (a + b);
  add_bent(a, middle, halvings - 1);
  add_bent(middle, b, halvings - 1);
}

void LinePainter::add(std::span<const Vec3> points) {
  const auto to_camera = [&](const Vec3& point) -> Vec3d {
    return view_.rotation.cast<double>().transpose() * (point.cast<double>() - view_.position.cast<double>());
  };
  const auto near = static_cast<double>(view_.camera->near_m), far = static_cast<double>(view_.camera->far_m);
  for (std::size_t i = 1; i < points.size(); ++i) {
    if (!points[i - 1].allFinite() || !points[i].allFinite()) continue;
    const Vec3d from = to_camera(points[i - 1]), way = to_camera(points[i]) - from;
    if (view_.optics->lens) {
      add_bent(from, from + way, kHalvings);
      continue;
    }
    // The part from `first` to `last` lies between the near and the far plane.
    double first = 0.0, last = 1.0;
    if (way.x() == 0.0) {
      if (from.x() < near || from.x() > far) continue;
    } else {
      const double to_near = (near - from.x()) / way.x(), to_far = (far - from.x()) / way.x();
      first = std::max(first, std::min(to_near, to_far));
      last = std::min(last, std::max(to_near, to_far));
      if (first > last) continue;
    }
    add(project(from + first * way), project(from + last * way));
  }
}

void LinePainter::add(const Point& a, const Point& b) {
  const double dx = b.x - a.x, dy = b.y - a.y;
  const double edge = half_width_ + 1.0;
  // The part from `first` to `last` lies in the image or next to it.
  double first = 0.0, last = 1.0;
  const auto clip = [&](double from, double by, double size) {
    if (by == 0.0) {
      if (from < -edge || from > size + edge) last = -1.0;
      return;
    }
    const double to_low = (-edge - from) / by, to_high = (size + edge - from) / by;
    first = std::max(first, std::min(to_low, to_high));
    last = std::min(last, std::max(to_low, to_high));
  };
  clip(a.x, dx, static_cast<double>(width_));
  clip(a.y, dy, static_cast<double>(height_));
  if (first > last) return;
  const double square = dx * dx + dy * dy;
  const bool is_steep = std::abs(dy) > std::abs(dx);
  // Visits the pixels along the longer side, and at each of them those across the line.
  const double from = is_steep ? a.y : a.x, by = is_steep ? dy : dx;
  const double cross = is_steep ? a.x : a.y, cross_by = is_steep ? dx : dy;
  const auto pixels = [](double low, double high, std::size_t size) {
    const auto clamped = [&](double value) {
      return static_cast<std::size_t>(std::clamp(std::floor(value), 0.0, static_cast<double>(size)));
    };
    return std::pair(clamped(low), clamped(high + 1.0));
  };
  const double begin = from + first * by, end = from + last * by;
  const auto [along_first, along_end] =
      pixels(std::min(begin, end) - edge, std::max(begin, end) + edge, is_steep ? height_ : width_);
  for (std::size_t along = along_first; along < along_end; ++along) {
    const double middle = static_cast<double>(along) + 0.5;
    const double share = by == 0.0 ? first : std::clamp((middle - from) / by, first, last);
    const double center = cross + share * cross_by, reach = 1.5 * edge;  // at most sqrt(2) times as wide across the diagonal
    const auto [across_first, across_end] = pixels(center - reach, center + reach, is_steep ? width_ : height_);
    for (std::size_t across = across_first; across < across_end; ++across) {
      const std::size_t column = is_steep ? across : along, row = is_steep ? along : across;
      const double px = static_cast<double>(column) + 0.5 - a.x, py = static_cast<double>(row) + 0.5 - a.y;
      const double nearest = square == 0.0 ? 0.0 : std::clamp((px * dx + py * dy) / square, first, last);
      const double distance = std::hypot(px - nearest * dx, py - nearest * dy);
      const auto covered = static_cast<float>(std::min(half_width_ + 0.5 - distance, 1.0));
      if (covered <= cover_[row * width_ + column]) continue;
      // The ray and the inverse depth are linear in the image.
      cover(row * width_ + column, covered,
            {a.ray + nearest * (b.ray - a.ray), a.inverse_depth + nearest * (b.inverse_depth - a.inverse_depth), 0.0, 0.0});
    }
  }
}

void LinePainter::cover(std::size_t pixel, float share, const Point& at) {
  pending_[num_pending_] = {pixel, share, static_cast<float>(1.0 / at.inverse_depth)};
  ahead_[num_pending_] = static_cast<float>(at.ray.x());
  left_[num_pending_] = static_cast<float>(at.ray.y());
  up_[num_pending_] = static_cast<float>(at.ray.z());
  if (++num_pending_ == trace::kMaxRays) trace();
}

void LinePainter::trace() {
  if (num_pending_ == 0) return;
  const auto [left_min, left_max] = std::minmax_element(left_, left_ + num_pending_);
  const auto [up_min, up_max] = std::minmax_element(up_, up_ + num_pending_);
  const auto pending = [&](const float* values) { return std::span(values, num_pending_); };
  const bool fisheye = view_.optics->lens && view_.optics->lens->is_fisheye();
  const trace::Frustum frustum = fisheye ? trace::make_frustum(pending(ahead_), pending(left_), pending(up_))
                                         : trace::make_pyramid(*left_min, *left_max, *up_min, *up_max);
  std::fill(ahead_ + num_pending_, std::end(ahead_), ahead_[0]);
  std::fill(left_ + num_pending_, std::end(left_), left_[0]);
  std::fill(up_ + num_pending_, std::end(up_), up_[0]);
  const trace::RayBundle* rays = nullptr;
  {
    const FlushDenormals flush;
    rays = &tracer_.trace(
        {.x = ahead_, .y = left_, .z = up_, .rows = (num_pending_ + kRow - 1) / kRow, .width = kRow, .frustum = &frustum});
  }
  for (std::size_t i = 0; i < num_pending_; ++i) {
    const Pending& pending = pending_[i];
    if (rays->t_hit[i] < pending.depth * (1.0F - kBias)) continue;
    cover_[pending.pixel] = std::max(cover_[pending.pixel], pending.share);
  }
  num_pending_ = 0;
}

void LinePainter::draw(std::span<std::uint8_t> rgb, const LineColor& line) {
  trace();
  for (std::size_t pixel = 0; pixel < cover_.size(); ++pixel) {
    if (cover_[pixel] <= 0.0F) continue;
    for (std::size_t c = 0; c < 3; ++c) {
      const auto below = static_cast<float>(rgb[3 * pixel + c]), color = static_cast<float>(line[c]);
      rgb[3 * pixel + c] = static_cast<std::uint8_t>(std::lround(below + cover_[pixel] * (color - below)));
    }
  }
  std::ranges::fill(cover_, 0.0F);
}

}  // namespace flockstep::render
