#include "tasks/formation_path.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <iterator>
#include <numbers>
#include <numeric>
#include <optional>
#include <string>

#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/tasks/formation.hpp"
#include "planning/navigable.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {

std::vector<Vec3> formation_places(FormationShape shape, std::size_t count, float spacing_m) {
  constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;
  const auto number = static_cast<float>(count);
  const float radius = count < 2 ? spacing_m : std::max(spacing_m, spacing_m / (2.0F * std::sin(kTurn / 2.0F / number)));
  std::vector<Vec3> places;
  places.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float pair = spacing_m * static_cast<float>(i / 2 + 1), side = i % 2 == 0 ? 1.0F : -1.0F;
    const float slant = pair / std::numbers::sqrt2_v<float>, angle = kTurn * static_cast<float>(i) / number;
    switch (shape) {
      case FormationShape::line:
        places.emplace_back(0.0F, side * pair, 0.0F);
        break;
      case FormationShape::column:
        places.emplace_back(-spacing_m * static_cast<float>(i + 1), 0.0F, 0.0F);
        break;
      case FormationShape::v:
        places.emplace_back(-slant, side * slant, 0.0F);
        break;
      case FormationShape::circle:
        places.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 0.0F);
        break;
    }
  }
  return places;
}

}  // namespace flockstep

namespace flockstep::task {
namespace {

constexpr double kRoom = 0.2;            // m, to be free around the drone
constexpr double kWindow = 2.0 * kRoom;  // m; a route that is rounded by at most the room touches nothing
constexpr float kPathCell = 0.2F;        // m, of the plan
constexpr double kShareStep = 0.1;       // m along the route between two shares, less than the room
constexpr int kSmoothSteps = 10;         // before and after one, over which shares are smoothed
constexpr double kClosest = 0.7;         // least distance of places, in units of their spacing
constexpr double kFastest = 1.0;         // greatest speed of a place that turns or narrows, in units of the leader's speed

// An upright prism around the drone at any heading, and the room around it.
DroneModel with_room(const DroneModel& drone) {
  constexpr int kSides = kMaxHullVertices / 2;
  constexpr double kTurn = 2.0 * std::numbers::pi;
  double radius = 0.0;
  for (const Vec3& vertex : drone.hull()) radius = std::max(radius, vertex.head<2>().cast<double>().norm());
  radius = (radius + kRoom) / std::cos(kTurn / 2.0 / kSides);
  std::vector<Vec3> hull;
  for (int i = 0; i < kSides; ++i) {
    const double x = radius * std::cos(kTurn * i / kSides), y = radius * std::sin(kTurn * i / kSides);
    for (const double z :
         {static_cast<double>(drone.extents().min.z()) - kRoom, static_cast<double>(drone.extents().max.z()) + kRoom}) {
      hull.push_back(Eigen::Vector3d(x, y, z).cast<float>());
    }
  }
  return DroneModel(hull);
}

// The largest share up to which two places keep their distance, if they move by their shares from `column` apart to `shape`
// apart.
double share_apart(const Eigen::Vector3d& column, const Eigen::Vector3d& shape, double distance) {
  const Eigen::Vector3d change = shape - column;
  const double a = change.squaredNorm(), b = column.dot(change), c = column.squaredNorm() - distance * distance;
  if (c <= 0.0) return 0.0;
  const double root = b * b - a * c;  // of |column + share * change|^2 = distance^2
  return b >= 0.0 || root <= 0.0 ? 1.0 : std::min((-b - std::sqrt(root)) / a, 1.0);
}

// The largest share of the shape at a way of the leader: with it, and with any smaller one, the drone is free at all places, and
// these keep their distance.
double largest_share(const Leader& leader, const FormationPlaces& places, const collision::Obstacles& obstacles,
                     const collision::Hull& hull, double distance) {
  const std::size_t count = places.shape.size();
  std::vector<Eigen::Vector3d> columns, shapes;
  double share = 1.0;
  for (std::size_t i = 0; i < count; ++i) {
    columns.push_back(leader.in_column(places.column[i]));
    shapes.push_back(leader.in_shape(places.shape[i]));
    const Pose from{.position = columns[i].cast<float>()}, to{.position = shapes[i].cast<float>()};
    share = std::min(share, static_cast<double>(collision::sweep(obstacles, hull, from, to).fraction));
    for (std::size_t j = 0; j < i; ++j) {
      share = std::min(share, share_apart(columns[i] - columns[j], shapes[i] - shapes[j], distance));
    }
  }
  return share;
}

// Applies a function to the window around each value.
template <class Function>
std::vector<double> over_windows(const std::vector<double>& values, const Function& function) {
  const std::ptrdiff_t end = std::ssize(values);
  std::vector<double> results;
  for (std::ptrdiff_t i = 0; i < end; ++i) {
    const std::ptrdiff_t from = std::max<std::ptrdiff_t>(i - kSmoothSteps, 0),
                         to = std::min<std::ptrdiff_t>(i + kSmoothSteps + 1, end);
    results.push_back(function(values.begin() + from, values.begin() + to));
  }
  return results;
}

}  // namespace

FormationPath::FormationPath(const World& world, const DroneModel& drone, const FormationPlaces& places, float spacing_m) {
  require_navigable(world, drone);
  const std::string name = "world \"" + world.name() + "\"";
  std::vector<Vec3> goals = world.markers().waypoints;
  goals.push_back(*world.markers().goal);
  const DroneModel wide = with_room(drone);
  const std::optional<std::vector<Vec3>> path = plan(world, wide, *world.markers().start, goals, kPathCell);
  require(path && path->size() > 1, "worlds", "a path from the start to the goal with 0.2 m of room around the drone",
          name + " without one");
  for (const Vec3& corner : *path) corners_.insert(corners_.end(), corner.data(), corner.data() + 3);

  const double radius = places.radius();
  reach_ = std::max(radius, kWindow);
  const LeaderRoute route = this->route();
  const auto [back, front] = std::minmax_element(places.column.begin(), places.column.end());
  first_ = kWindow - std::min(*back, 0.0);
  last_ = route.length() - kWindow - std::max(*front, 0.0);
  require(first_ < last_, "worlds",
          "a path of more than " + std::to_string(first_ + route.length() - last_) + " m, for the column",
          name + " with a path of " + std::to_string(route.length()) + " m");

  if (places.is_column) {
    shares_.assign(2, 0.0);
    return;
  }
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  const collision::Hull hull(wide);
  const auto steps = static_cast<std::size_t>(std::ceil((last_ - first_) / kShareStep));
  std::vector<double> largest;
  for (std::size_t i = 0; i <= steps; ++i) {
    Interrupt::poll();
    const double way = first_ + kShareStep * static_cast<double>(i);
    const double turn = std::remainder(route.heading(way + kShareStep) - route.heading(way), 2.0 * std::numbers::pi) / kShareStep;
    const double share =
        largest_share(Leader(route, way, 1.0), places, obstacles, hull, kClosest * static_cast<double>(spacing_m));
    largest.push_back(std::min(share, kFastest / std::max(radius * std::abs(turn), kFastest)));
  }
  // Limit the change from step to step.
  double farthest = 0.0;  // m, from a place of the column to that of the shape, on a straight route
  for (std::size_t i = 0; i < places.shape.size(); ++i) {
    const Eigen::Vector3d place = places.shape[i].cast<double>();
    farthest = std::max(farthest, (place - places.column[i] * Eigen::Vector3d::UnitX()).norm());
  }
  const double change = kFastest * kShareStep / std::max(farthest, kShareStep);
  for (std::size_t i = 1; i <= steps; ++i) largest[i] = std::min(largest[i], largest[i - 1] + change);
  for (std::size_t i = steps; i-- > 0;) largest[i] = std::min(largest[i], largest[i + 1] + change);
  // The mean of minima is smooth, and at most the largest share.
  const std::vector<double> least = over_windows(largest, [](auto from, auto to) { return *std::min_element(from, to); });
  shares_ =
      over_windows(least, [](auto from, auto to) { return std::accumulate(from, to, 0.0) / static_cast<double>(to - from); });
}

LeaderRoute FormationPath::route() const { return {corners_, false, kWindow, reach_}; }

double FormationPath::share(double way) const {
  const double at = std::clamp((way - first_) / kShareStep, 0.0, static_cast<double>(shares_.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), shares_.size() - 2);
  return shares_[i] + (at - static_cast<double>(i)) * (shares_[i + 1] - shares_[i]);
}

}  // namespace flockstep::task
