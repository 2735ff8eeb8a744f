#include "planning/free_space.hpp"

#include <algorithm>
#include <cmath>
#include <numbers>

#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

constexpr double kMargin = 1e-3;           // m
constexpr double kMarginOfSize = 0x1p-20;  // per m of the largest coordinate: 8 times the growth of the sweep's standoff

double margin_in(const World& world) {
  const float largest = world.bounds().min.cwiseAbs().cwiseMax(world.bounds().max.cwiseAbs()).maxCoeff();
  return kMargin + kMarginOfSize * static_cast<double>(largest);
}

Aabb extent_of(const collision::Hull& hull) {
  Eigen::AlignedBox3d box;
  for (int i = 0; i < hull.count(); ++i) box.extend(hull.vertex(i));
  return {box.min().cast<float>(), box.max().cast<float>()};
}

}  // namespace

FreeSpace::FreeSpace(const World& world, const DroneModel& drone)
    : obstacles_(prepared(world).obstacles()), hull_(drone), extent_(extent_of(hull_)), margin_(margin_in(world)) {}

bool FreeSpace::is_clear(const Vec3& from, const Vec3& to) const {
  constexpr float kPiece = 1.0F;  // m
  const int pieces = std::max(1, static_cast<int>(std::min((to - from).norm() / kPiece, 1e4F)));
  Vec3 here = from;
  for (int piece = 1; piece <= pieces; ++piece) {
    const Vec3 next = piece == pieces ? to : Vec3(from + (static_cast<float>(piece) / static_cast<float>(pieces)) * (to - from));
    if (!is_free_leg(here, next)) return false;
    here = next;
  }
  return true;
}

FreeSpace::Obstacle FreeSpace::obstacle(std::uint32_t element, const collision::Convex& convex) const {
  Obstacle obstacle{element, {}};
  for (int axis = 0; axis < 3; ++axis) {
    const Eigen::Vector3d along = convex.rotation.row(axis);
    const double center = convex.center[axis];
    const double low = center + along.dot(collision::support(convex, -along)) - margin_;
    const double high = center + along.dot(collision::support(convex, along)) + margin_;
    obstacle.taken.min[axis] = static_cast<float>(low) - extent_.max[axis];
    obstacle.taken.max[axis] = static_cast<float>(high) - extent_.min[axis];
  }
  return obstacle;
}

// Tests the boxes around drone and obstacle first. Then uses a plane through the obstacle's point nearest to the box's center,
// perpendicular to the line between the two. The obstacle is on one side of it; the hull must stay on the other side at the
// worst place of the box.
bool FreeSpace::is_apart(const Obstacle& obstacle, const collision::Convex& convex, const Box& box) const {
  const Eigen::Array3d low = obstacle.taken.min.array().cast<double>() - box.half;
  const Eigen::Array3d high = obstacle.taken.max.array().cast<double>() + box.half;
  if ((box.center.array() < low).any() || (box.center.array() > high).any()) return true;
  const Eigen::Vector3d apart = box.center - collision::closest_point(convex, box.center);
  const Eigen::Vector3d nearest = hull_.vertex(hull_.support(-apart.cast<float>()));
  return apart.dot(apart + nearest) - box.half * apart.lpNorm<1>() > margin_ * apart.norm();
}

bool FreeSpace::is_apart_from_walls(const Box& box) const {
  const Eigen::Array3d low = box.center.array() - box.half + extent_.min.array().cast<double>() - margin_;
  const Eigen::Array3d high = box.center.array() + box.half + extent_.max.array().cast<double>() + margin_;
  return std::all_of(obstacles_.rooms().begin(), obstacles_.rooms().end(), [&](const collision::RoomInterior& room) {
    return (low > room.inside.min.array().cast<double>()).all() && (high < room.inside.max.array().cast<double>()).all();
  });
}

float FreeSpace::reach(const Box& box) const {
  return hull_.radius() + static_cast<float>(std::numbers::sqrt3 * box.half + 2.0 * margin_);
}

}  // namespace flockstep
