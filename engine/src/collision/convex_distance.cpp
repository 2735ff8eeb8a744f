#include "collision/convex_distance.hpp"

// Bullet's GJK and EPA are templates over the shape. Therefore nothing of the library is linked, and only this file depends on
// it.
#define BT_USE_DOUBLE_PRECISION
#include <BulletCollision/NarrowPhaseCollision/btGjkEpa3.h>

#include <Eigen/Dense>
#include <array>
#include <cmath>
#include <limits>

namespace flockstep::collision {

namespace {

// Bullet merges points within 1e-2 of each other and treats distances below 1e-4 as zero, in its own units. In millimetres
// these are 10 um and 0.1 um.
constexpr double kUnitsPerMetre = 1000.0;
constexpr double kRelativeError = 3e-4;
constexpr double kAbsoluteError = 1e-6;  // m
constexpr int kMaxRestarts = 8;
constexpr int kMaxStarts = 7;             // of a search for the way out
constexpr double kCoarse = 2e-3;          // m, error of such a search at a round obstacle
constexpr double kZeroDifference = 1e-9;  // m
constexpr double kZeroDistance = 1e-4;    // Bullet units; Bullet does not normalise shorter directions

btVector3 to_bullet(const Vec3d& v) { return {v.x(), v.y(), v.z()}; }
Vec3d from_bullet(const btVector3& v) { return {v.x(), v.y(), v.z()}; }

// One side of the pair, in the form that Bullet's templates require: a support function and a transform. The common frame is
// the body's.
class Side {
 public:
  explicit Side(const Hull& hull) : hull_(&hull), transform_(btMatrix3x3::getIdentity()) {}
  Side(const Convex& obstacle, const Mat3d& rotation, const Vec3d& position) : obstacle_(&obstacle) {
    const Mat3d r = rotation.transpose() * obstacle.rotation;
    const Vec3d p = kUnitsPerMetre * (rotation.transpose() * (obstacle.center - position));
    transform_ =
        btTransform(btMatrix3x3(r(0, 0), r(0, 1), r(0, 2), r(1, 0), r(1, 1), r(1, 2), r(2, 0), r(2, 1), r(2, 2)), to_bullet(p));
  }

  btVector3 getLocalSupportWithMargin(const btVector3& direction) const {
    const Vec3d d = from_bullet(direction);
    return to_bullet(kUnitsPerMetre * (hull_ ? hull_->vertex(hull_->support(d.cast<float>())) : support(*obstacle_, d)));
  }
  const btTransform& getWorldTransform() const { return transform_; }

 private:
  const Hull* hull_ = nullptr;
  const Convex* obstacle_ = nullptr;
  btTransform transform_;
};

}  // namespace

}  // namespace flockstep::collision

// Bullet copies its uninitialised flag for margins, which is undefined behaviour; we have no margins.
template <>
MinkowskiDiff<flockstep::collision::Side>::MinkowskiDiff(const flockstep::collision::Side& a, const flockstep::collision::Side& b)
    : m_convexAPtr(&a), m_convexBPtr(&b), m_enableMargin(false) {}

namespace flockstep::collision {

namespace {

Separation search(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle, const Side& a,
                  const Side& b, const Vec3d& guess) {
  btGjkEpaSolver3::sResults found;
  Separation result;
  if (!btGjkEpaSolver3_Distance(a, b, to_bullet(rotation.transpose() * guess), found) || found.distance <= kZeroDistance) {
    result.overlapping = true;
    return result;
  }
  const Vec3d body_normal = from_bullet(found.normal).normalized();
  const Vec3d normal = rotation * body_normal;
  result.plane = supporting_plane(obstacle, normal);
  const int nearest = hull.support(-body_normal.cast<float>());
  result.gap = normal.dot(position) - result.plane.offset + body_normal.dot(hull.vertex(nearest));
  result.distance = found.distance / kUnitsPerMetre;
  result.point = position + rotation * (from_bullet(found.witnesses[1]) / kUnitsPerMetre);
  return result;
}

bool is_certain(const Separation& s) { return s.distance - s.gap <= kRelativeError * s.distance + kAbsoluteError; }

}  // namespace

Plane supporting_plane(const Convex& obstacle, const Vec3d& normal) {
  const Vec3d local = obstacle.rotation.transpose() * normal;
  return {normal, normal.dot(obstacle.center) + local.dot(support(obstacle, local))};
}

namespace {

// A point of the hull minus a point of the obstacle.
struct Difference {
  Vec3d value = Vec3d::Zero();
  Vec3d on_obstacle = Vec3d::Zero();
};

Difference farthest_against(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle,
                            const Vec3d& n) {
  const Vec3d outer = obstacle.center + obstacle.rotation * support(obstacle, obstacle.rotation.transpose() * n);
  const Vec3d inner = position + rotation * hull.vertex(hull.support(-(rotation.transpose() * n).cast<float>()));
  return {inner - outer, outer};
}

// Up to four differences, and the point of their convex hull that is nearest to zero.
struct Simplex {
  std::array<Difference, 4> corners;
  std::size_t count = 0;
  Vec3d nearest = Vec3d::Zero();
  Vec3d on_obstacle = Vec3d::Zero();

  // Keeps the corners that span the nearest point. It tries all subsets, so that a flat one cannot mislead it.
  void reduce() {
    double least = std::numeric_limits<double>::infinity();
    std::array<Difference, 4> kept;
    std::size_t num_kept = 0;
    for (unsigned subset = 1; subset < (1U << count); ++subset) {
      std::array<Difference, 4> chosen;
      std::size_t k = 0;
      for (std::size_t i = 0; i < count; ++i) {
        if ((subset >> i & 1U) != 0) chosen[k++] = corners[i];
      }
      // The weights of the point that is perpendicular to its differences to all corners.
      const auto size = static_cast<Eigen::Index>(k);
      Eigen::Matrix<double, Eigen::Dynamic, Eigen::Dynamic, 0, 5, 5> system(size + 1, size + 1);
      Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 5, 1> right(size + 1);
      system.setOnes();
      right.setZero();
      system(size, size) = 0.0;
      right[size] = 1.0;
      for (Eigen::Index r = 0; r < size; ++r) {
        for (Eigen::Index c = 0; c < size; ++c) {
          system(r, c) = chosen[static_cast<std::size_t>(r)].value.dot(chosen[static_cast<std::size_t>(c)].value);
        }
      }
      const Eigen::Matrix<double, Eigen::Dynamic, 1, 0, 5, 1> weights = system.fullPivLu().solve(right);
      Vec3d point = Vec3d::Zero();
      Vec3d on = Vec3d::Zero();
      double sum = 0.0;
      bool is_within = true;
      for (Eigen::Index r = 0; r < size; ++r) {
        const Difference& corner = chosen[static_cast<std::size_t>(r)];
        is_within &= weights[r] >= 0.0;  // also false for NaN
        point += weights[r] * corner.value;
        on += weights[r] * corner.on_obstacle;
        sum += weights[r];
      }
      if (!is_within || std::abs(sum - 1.0) > 1e-9 || point.norm() >= least) continue;
      least = point.norm();
      nearest = point;
      on_obstacle = on;
      kept = chosen;
      num_kept = k;
    }
    corners = kept;
    count = num_kept;
  }
};

// The same search as Bullet's, slower but more reliable (E. G. Gilbert, D. W. Johnson, S. S. Keerthi, "A fast procedure for
// computing the distance between complex objects in three-dimensional space", 1988).
Separation search_surely(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle, Vec3d normal) {
  constexpr int kSteps = 100;
  Separation best;
  best.gap = -std::numeric_limits<double>::infinity();
  best.distance = std::numeric_limits<double>::infinity();
  Simplex simplex;
  for (int step = 0; step < kSteps; ++step) {
    const Difference corner = farthest_against(hull, rotation, position, obstacle, normal);
    if (const double gap = normal.dot(corner.value); gap > best.gap) {
      best.gap = gap;
      best.plane = supporting_plane(obstacle, normal);
    }
    simplex.corners[simplex.count++] = corner;
    simplex.reduce();
    const double distance = simplex.nearest.norm();
    if (simplex.count == 0 || simplex.count == 4 || distance < kZeroDifference) break;  // overlapping or degenerate
    if (distance < best.distance) {
      best.distance = distance;
      best.point = simplex.on_obstacle;
    }
    if (is_certain(best)) break;
    normal = simplex.nearest / distance;
  }
  return best;
}

}  // namespace

// About one search in a thousand ends early in a flat simplex, as in other libraries. The two bounds then disagree, and another
// start helps. Once in about ten million searches no start helps, and the more reliable search decides.
Separation separate(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle, const Vec3d& guess) {
  const Side a(hull);
  const Side b(obstacle, rotation, position);
  Separation best = search(hull, rotation, position, obstacle, a, b, guess);
  for (int attempt = 0; attempt < kMaxRestarts && !best.overlapping && !is_certain(best); ++attempt) {
    const Vec3d start = attempt == 0   ? best.plane.normal
                        : attempt == 1 ? Vec3d(position - obstacle.center + 1e-3 * Vec3d::Ones())
                                       : (attempt % 2 == 0 ? 1.0 : -1.0) * Vec3d::Unit(attempt / 2 - 1);
    const Separation next = search(hull, rotation, position, obstacle, a, b, start);
    if (!next.overlapping && next.gap > best.gap) {
      best.plane = next.plane;
      best.gap = next.gap;
    }
    if (!next.overlapping && next.distance < best.distance) {
      best.distance = next.distance;
      best.point = next.point;
    }
  }
  if (!best.overlapping && !is_certain(best)) {
    const Separation sure = search_surely(hull, rotation, position, obstacle, best.plane.normal);
    if (sure.gap > best.gap) {
      best.plane = sure.plane;
      best.gap = sure.gap;
    }
    if (sure.distance < best.distance) {
      best.distance = sure.distance;
      best.point = sure.point;
    }
  }
  return best;
}

namespace {

// For round obstacles, Bullet's search ends a millimetre or so from the least overlap. From there the normal follows the
// gradient downhill, by steps that shrink when they overshoot. The gradient of the overlap along a normal is the vector between
// the two support points.
Vec3d of_least_overlap(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle, Vec3d normal) {
  constexpr int kSteps = 60;
  const auto overlap_along = [&](const Vec3d& n) -> Vec3d {
    const Vec3d outer = obstacle.center + obstacle.rotation * support(obstacle, obstacle.rotation.transpose() * n);
    const Vec3d inner = position + rotation * hull.vertex(hull.support(-(rotation.transpose() * n).cast<float>()));
    return outer - inner;
  };
  Vec3d overlap = overlap_along(normal);
  double step = 1.0 / std::max(overlap.norm(), 1e-9);
  for (int i = 0; i < kSteps; ++i) {
    const Vec3d across = overlap - overlap.dot(normal) * normal;
    const Vec3d other = (normal - step * across).normalized();
    const Vec3d along = overlap_along(other);
    if (along.dot(other) < overlap.dot(normal)) {
      normal = other;
      overlap = along;
      step *= 2.0;
    } else {
      step *= 0.4;
    }
  }
  return normal;
}

}  // namespace

Penetration penetrate(const Hull& hull, const Mat3d& rotation, const Vec3d& position, const Convex& obstacle) {
  Vec3d outwards = position - obstacle.center;
  if (outwards.squaredNorm() == 0.0) outwards = Vec3d::UnitZ();
  const Side a(hull);
  const Side b(obstacle, rotation, position);
  Penetration result{outwards.normalized(), closest_point(obstacle, position)};
  double least = std::numeric_limits<double>::infinity();
  // About one search in ten thousand fails, or ends at a way out that is far too long. The depth that it claims then differs from
  // the overlap along its normal, and another start helps.
  for (int attempt = 0; attempt < kMaxStarts; ++attempt) {
    const Vec3d guess = attempt == 0 ? Vec3d(-outwards) : (attempt % 2 == 0 ? 1.0 : -1.0) * Vec3d::Unit((attempt - 1) / 2);
    btGjkEpaSolver3::sResults found;
    if (!btGjkEpaSolver3_Penetration(a, b, to_bullet(rotation.transpose() * guess), found)) continue;
    if (!(std::abs(found.normal.length2() - 1.0) < 1e-6)) continue;
    const Vec3d normal = (rotation * from_bullet(found.normal)).normalized();
    const double overlap = -normal.dot(farthest_against(hull, rotation, position, obstacle, normal).value);
    if (!(overlap < least)) continue;
    least = overlap;
    result = {normal, position + rotation * (from_bullet(found.witnesses[1]) / kUnitsPerMetre)};
    if (overlap + found.distance / kUnitsPerMetre < kCoarse) break;
  }
  result.normal = of_least_overlap(hull, rotation, position, obstacle, result.normal);
  return result;
}

Vec3d closest_point_of_hull(const Convex& convex, const Vec3d& point) {
  const Vec3d apart = point - convex.center;
  const Separation found =
      separate(Hull(), Mat3d::Identity(), point, convex, apart.squaredNorm() > 0.0 ? apart : Vec3d(Vec3d::UnitZ()));
  return found.overlapping || !(found.gap > 0.0) ? point : Vec3d(point - found.gap * found.plane.normal);
}

}  // namespace flockstep::collision
