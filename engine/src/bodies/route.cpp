#include "bodies/route.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>

namespace flockstep::bodies {
namespace {

constexpr double kSharp = 1e-6;      // rad; corners closer than this to straight or to a reversal have no arc
constexpr double kVertical = 1e-6;   // horizontal part of a direction that counts as vertical
constexpr double kBeforeEnd = 1e-5;  // rad; an arc whose end is vertical has the heading of the place that far before it

std::vector<Eigen::Vector3d> points_of(const BodyMotion& motion) {
  std::vector<Eigen::Vector3d> points;
  for (const auto& [x, y, z] : motion.points_m) points.emplace_back(x, y, z);
  if (motion.route == BodyRoute::back_and_forth) {
    for (std::size_t i = points.size() - 1; i-- > 1;) points.push_back(points[i]);
  }
  return points;
}

// A corner between two directions.
struct Corner {
  double radius = 0.0;   // m; 0: sharp
  double angle = 0.0;    // rad, of the turn
  double tangent = 0.0;  // m, from the point to the ends of the arc
  Eigen::Vector3d inward = Eigen::Vector3d::Zero();
};

Corner corner_of(const Eigen::Vector3d& before, const Eigen::Vector3d& after, double shorter_leg, double radius) {
  Corner corner;
  const Eigen::Vector3d across = after - before.dot(after) * before;
  corner.angle = std::atan2(across.norm(), before.dot(after));
  if (radius == 0.0 || corner.angle < kSharp || corner.angle > std::numbers::pi - kSharp) return corner;
  const double slope = std::tan(corner.angle / 2.0);
  corner.radius = std::min(radius, shorter_leg / 2.0 / slope);
  corner.tangent = corner.radius * slope;
  corner.inward = across.normalized();
  return corner;
}

}  // namespace

Route::Route(const BodyMotion& motion) {
  const std::vector<Eigen::Vector3d> points = points_of(motion);
  const bool is_loop = motion.route != BodyRoute::once;
  const std::size_t num_points = points.size(), num_legs = is_loop ? num_points : num_points - 1;
  std::vector<Eigen::Vector3d> directions(num_legs);
  std::vector<double> lengths(num_legs);
  for (std::size_t leg = 0; leg < num_legs; ++leg) {
    const Eigen::Vector3d way = points[(leg + 1) % num_points] - points[leg];
    lengths[leg] = way.norm();
    directions[leg] = way / lengths[leg];
  }
  std::vector<Corner> corners(num_points);  // one at the start of each leg
  for (std::size_t leg = is_loop ? 0 : 1; leg < num_legs; ++leg) {
    const std::size_t before = (leg + num_legs - 1) % num_legs;
    corners[leg] = corner_of(directions[before], directions[leg], std::min(lengths[before], lengths[leg]),
                             static_cast<double>(motion.corner_radius_m));
  }
  for (const Corner& corner : corners) {
    if (corner.radius > 0.0) {
      curvature_ = std::max(curvature_, 1.0 / corner.radius);
    } else {
      sharpest_ = std::max(sharpest_, std::sin(corner.angle / 2.0));
    }
  }
  if (!is_loop) sharpest_ = std::max(sharpest_, 0.5);  // it stops at its end within a part
  for (std::size_t leg = 0; leg < num_legs; ++leg) {
    const Corner& first = corners[leg];
    const Corner& last = corners[(leg + 1) % num_points];
    const Eigen::Vector3d& direction = directions[leg];
    add_line(points[leg] + first.tangent * direction, direction, lengths[leg] - first.tangent - last.tangent);
    if (last.radius == 0.0) continue;
    const Eigen::Vector3d start = points[(leg + 1) % num_points] - last.tangent * direction;
    add_arc(start, direction, last.inward, last.radius, last.angle);
  }
  set_headings(is_loop);
}

void Route::add_line(const Eigen::Vector3d& start, const Eigen::Vector3d& direction, double length) {
  if (!(length > 0.0)) return;  // arcs use the whole leg
  pieces_.push_back({length_, 0.0, start, direction, Eigen::Vector3d::Zero(), Eigen::Vector2d::Zero()});
  length_ += length;
}

void Route::add_arc(const Eigen::Vector3d& start, const Eigen::Vector3d& direction, const Eigen::Vector3d& inward, double radius,
                    double angle) {
  pieces_.push_back({length_, radius, start, direction, inward, Eigen::Vector2d::Zero()});
  length_ += radius * angle;
}

void Route::set_headings(bool is_loop) {
  Eigen::Vector2d heading = Eigen::Vector2d::Zero();
  const auto pass = [&] {
    for (std::size_t i = 0; i < pieces_.size(); ++i) {
      Piece& piece = pieces_[i];
      piece.heading = heading;
      const double end = i + 1 < pieces_.size() ? pieces_[i + 1].begin : length_;
      heading = place_on(piece, std::max(piece.begin, end - kBeforeEnd * piece.radius)).heading;
    }
  };
  pass();
  if (is_loop) pass();  // the first pieces keep the heading of the last ones
  // A route that begins vertically faces its first horizontal direction.
  const auto first = std::ranges::find_if(pieces_, [](const Piece& piece) { return !piece.heading.isZero(0.0); });
  if (heading.isZero(0.0)) heading = Eigen::Vector2d::UnitX();
  const Eigen::Vector2d begin = first == pieces_.end() ? heading : first->heading;
  for (auto piece = pieces_.begin(); piece != first; ++piece) piece->heading = begin;
}

// Half the part lies on each side of a corner in the worst case. An arc leaves its chord by an eighth of its curvature.
double Route::bend(double part_m) const { return std::max(part_m / 2.0 * sharpest_, part_m * part_m / 8.0 * curvature_); }

Route::Place Route::at(double distance_m) const {
  const auto next = std::upper_bound(pieces_.begin() + 1, pieces_.end(), distance_m,
                                     [](double s, const Piece& piece) { return s < piece.begin; });
  return place_on(*(next - 1), distance_m);
}

Route::Place Route::place_on(const Piece& piece, double distance_m) {
  const double along = distance_m - piece.begin;
  Place place{piece.start + along * piece.direction, piece.direction, piece.heading, 0.0};
  Eigen::Vector3d bend = Eigen::Vector3d::Zero();  // derivative of the direction
  if (piece.radius > 0.0) {
    const double angle = along / piece.radius, sine = std::sin(angle), cosine = std::cos(angle), half = std::sin(angle / 2.0);
    place.position = piece.start + piece.radius * (sine * piece.direction + 2.0 * half * half * piece.inward);
    place.direction = cosine * piece.direction + sine * piece.inward;
    bend = (cosine * piece.inward - sine * piece.direction) / piece.radius;
  }
  const Eigen::Vector2d level = place.direction.head<2>();
  const double horizontal = level.norm();
  if (horizontal < kVertical) return place;
  place.heading = level / horizontal;
  place.turn = (level.x() * bend.y() - level.y() * bend.x()) / (horizontal * horizontal);
  return place;
}

}  // namespace flockstep::bodies
