#include "collision/convex.hpp"

#include <algorithm>
#include <array>
#include <cassert>
#include <cmath>
#include <cstddef>
#include <limits>
#include <utility>
#include <vector>

#include "collision/convex_distance.hpp"

namespace flockstep::collision {

namespace {

// Returns the nearest point of triangle abc, by the Voronoi regions of its features (Ericson, Real-Time Collision Detection,
// 5.1.5).
Vec3d closest_on_triangle(const Vec3d& p, const Vec3d& a, const Vec3d& b, const Vec3d& c) {
  const Vec3d ab = b - a;
  const Vec3d ac = c - a;
  const auto on_edge = [&p](const Vec3d& from, const Vec3d& edge) -> Vec3d {
    const double length2 = edge.squaredNorm();
    const double s = length2 > 0.0 ? std::clamp(edge.dot(p - from) / length2, 0.0, 1.0) : 0.0;
    return from + s * edge;
  };
  const Vec3d n = ab.cross(ac);
  const double area2 = n.squaredNorm();
  if (area2 > 0.0) {
    const double v = n.dot((p - a).cross(ac)) / area2;  // barycentric coordinates of p's projection
    const double w = n.dot(ab.cross(p - a)) / area2;
    if (v >= 0.0 && w >= 0.0 && v + w <= 1.0) return a + v * ab + w * ac;
  }
  Vec3d best = on_edge(a, ab);
  for (const Vec3d& candidate : {on_edge(b, c - b), on_edge(a, ac)}) {
    best = (candidate - p).squaredNorm() < (best - p).squaredNorm() ? candidate : best;
  }
  return best;
}

}  // namespace

Convex make_convex(const Primitive& primitive) {
  Convex convex;
  convex.center = primitive.center.cast<double>();
  convex.rotation = primitive.rotation.cast<double>().normalized().toRotationMatrix();
  convex.half_extents = primitive.half_extents.cast<double>();
  switch (primitive.kind) {
    case PrimitiveKind::box:
    case PrimitiveKind::plane:
      convex.kind = Convex::Kind::box;
      break;
    case PrimitiveKind::cylinder:
    case PrimitiveKind::disc:
      convex.kind = Convex::Kind::cylinder;
      break;
    case PrimitiveKind::capsule:
      convex.kind = Convex::Kind::capsule;
      break;
    case PrimitiveKind::sphere:
      convex.kind = Convex::Kind::sphere;
      break;
    case PrimitiveKind::room:
      assert(false && "a room is not convex: its solid lies outside of its box");
      break;
  }
  return convex;
}

Convex make_hull(const Corners& corners, const Pose& pose) {
  Convex convex;
  convex.kind = Convex::Kind::hull;
  convex.center = pose.position.cast<double>();
  convex.rotation = pose.rotation.cast<double>().normalized().toRotationMatrix();
  convex.hull = &corners;
  return convex;
}

Convex make_triangle(const Vec3& a, const Vec3& b, const Vec3& c) {
  Convex convex;
  convex.kind = Convex::Kind::triangle;
  convex.center = a.cast<double>();
  convex.corners = {Vec3d::Zero(), b.cast<double>() - convex.center, c.cast<double>() - convex.center};
  return convex;
}

Vec3d support(const Convex& convex, const Vec3d& direction) {
  const Vec3d& h = convex.half_extents;
  switch (convex.kind) {
    case Convex::Kind::box:
      return {std::copysign(h.x(), direction.x()), std::copysign(h.y(), direction.y()), std::copysign(h.z(), direction.z())};
    case Convex::Kind::cylinder: {
      const double across = std::sqrt(direction.x() * direction.x() + direction.y() * direction.y());
      const double scale = across > 0.0 ? h.x() / across : 0.0;
      return {scale * direction.x(), scale * direction.y(), std::copysign(h.z(), direction.z())};
    }
    case Convex::Kind::capsule: {
      const double length = direction.norm();
      const Vec3d cap(0.0, 0.0, std::copysign(h.z() - h.x(), direction.z()));
      return length > 0.0 ? Vec3d(cap + direction * (h.x() / length)) : cap;
    }
    case Convex::Kind::sphere: {
      const double length = direction.norm();
      return length > 0.0 ? Vec3d(direction * (h.x() / length)) : Vec3d(h.x(), 0.0, 0.0);
    }
    case Convex::Kind::triangle: {
      const auto& corners = convex.corners;
      const double a = direction.dot(corners[0]);
      const double b = direction.dot(corners[1]);
      const double c = direction.dot(corners[2]);
      return a >= b && a >= c ? corners[0] : (b >= c ? corners[1] : corners[2]);
    }
    case Convex::Kind::hull:
      return convex.hull->support(direction);
  }
  return Vec3d::Zero();
}

Vec3d closest_point(const Convex& convex, const Vec3d& point) {
  if (convex.kind == Convex::Kind::sphere) {
    const Vec3d from_center = point - convex.center;
    const double distance = from_center.norm();
    return distance > convex.half_extents.x() ? Vec3d(convex.center + from_center * (convex.half_extents.x() / distance)) : point;
  }
  if (convex.kind == Convex::Kind::triangle) {
    const auto& corners = convex.corners;
    return convex.center + closest_on_triangle(point - convex.center, corners[0], corners[1], corners[2]);
  }
  if (convex.kind == Convex::Kind::hull) return closest_point_of_hull(convex, point);
  const Vec3d& h = convex.half_extents;
  if (convex.kind == Convex::Kind::capsule) {
    const Vec3d axis = convex.rotation.col(2);
    const double middle = h.z() - h.x();
    const Vec3d on_axis = convex.center + std::clamp(axis.dot(point - convex.center), -middle, middle) * axis;
    const Vec3d apart = point - on_axis;
    const double distance = apart.norm();
    return distance > h.x() ? Vec3d(on_axis + apart * (h.x() / distance)) : point;
  }
  Vec3d local = convex.rotation.transpose() * (point - convex.center);
  if (convex.kind == Convex::Kind::box) {
    local = local.cwiseMax(-h).cwiseMin(h);
  } else {
    const double across = local.head<2>().norm();
    if (across > h.x()) local.head<2>() *= h.x() / across;
    local.z() = std::clamp(local.z(), -h.z(), h.z());
  }
  return convex.center + convex.rotation * local;
}

Corners::Corners(const TriangleMesh& mesh, std::span<const std::array<std::int32_t, 3>> triangles) {
  std::vector<std::array<float, 3>> corners;
  for (const auto& triangle : triangles) {
    for (const std::int32_t index : triangle) {
      const Vec3& corner = mesh.vertices[static_cast<std::size_t>(index)];
      corners.push_back({corner.x(), corner.y(), corner.z()});
    }
  }
  take(std::move(corners));
}

Corners::Corners(std::span<const Vec3> points) {
  std::vector<std::array<float, 3>> corners;
  for (const Vec3& point : points) corners.push_back({point.x(), point.y(), point.z()});
  take(std::move(corners));
}

void Corners::take(std::vector<std::array<float, 3>> corners) {
  std::ranges::sort(corners);
  corners.erase(std::unique(corners.begin(), corners.end()), corners.end());
  for (const auto& [x, y, z] : corners) {
    x_.push_back(x);
    y_.push_back(y);
    z_.push_back(z);
    radius_ = std::max(radius_, corner(x_.size() - 1).norm());
  }
}

Vec3d Corners::support(const Vec3d& direction) const {
  constexpr std::size_t kListThreshold = 32, kBlock = 256;
  if (x_.size() <= kListThreshold) {
    std::array<double, kListThreshold> distances;
    for (std::size_t i = 0; i < x_.size(); ++i) distances[i] = corner(i).dot(direction);
    std::size_t best = 0;
    for (std::size_t i = 1; i < x_.size(); ++i) best = distances[i] > distances[best] ? i : best;
    return corner(best);
  }
  // Float32 decides which corners may be the farthest, double precision which one is.
  const double length = direction.norm();
  const Vec3 along = (length > 0.0 ? Vec3d(direction / length) : direction).cast<float>();
  const float doubt = 1e-6F * static_cast<float>(radius_);  // more than the rounding errors of two sums
  std::array<float, kBlock> distances;
  float most = -std::numeric_limits<float>::infinity();
  double farthest = -std::numeric_limits<double>::infinity();
  std::size_t best = 0;
  for (std::size_t first = 0; first < x_.size(); first += kBlock) {
    const std::size_t count = std::min(kBlock, x_.size() - first);
    float most_here = -std::numeric_limits<float>::infinity();
    for (std::size_t i = 0; i < count; ++i) {
      distances[i] = x_[first + i] * along.x() + y_[first + i] * along.y() + z_[first + i] * along.z();
    }
    for (std::size_t i = 0; i < count; ++i) most_here = std::max(most_here, distances[i]);
    if (most_here < most - doubt) continue;
    most = std::max(most, most_here);
    for (std::size_t i = 0; i < count; ++i) {
      if (distances[i] < most - doubt) continue;
      if (const double distance = corner(first + i).dot(direction); distance > farthest) {
        farthest = distance;
        best = first + i;
      }
    }
  }
  return corner(best);
}

std::vector<Corners> corners_of_objects(const TriangleMesh& mesh) {
  std::vector<Corners> corners;
  const std::span triangles(mesh.triangles);
  for (std::size_t first = 0; first < triangles.size();) {  // sorted by object
    std::size_t end = first + 1;
    while (end < triangles.size() && mesh.objects[end] == mesh.objects[first]) ++end;
    if (is_solid(mesh.visibility_of(first))) corners.emplace_back(mesh, triangles.subspan(first, end - first));
    first = end;
  }
  return corners;
}

}  // namespace flockstep::collision
