// Slice: a fan, its pose and its hits, and what tests of slices compare them with.
#pragma once

#include "base/platform.hpp"
#include "batch_helpers.hpp"
#include "embree_mesh.hpp"
#include "meshes.hpp"
#include "on_target.hpp"
#include "ray_oracle.hpp"
#include "trace/mesh_slices.hpp"
#include "trace/mesh_tree.hpp"

namespace flockstep::trace::slices {

using oracle::Vec3d;
using namespace testing;

inline constexpr double kPi = std::numbers::pi;
inline constexpr std::array kWalks{SliceWalk::automatic, SliceWalk::listed, SliceWalk::ordered};
inline constexpr std::int32_t kEarlier = 1 << 20;  // element of hits before the trace

inline Vec3d level(double angle) { return {std::cos(angle), std::sin(angle), 0.0}; }

// Rays in a plane, their pose and their hits.
struct Slice {
  std::vector<Vec3d> directions;  // before the mounting
  Eigen::Matrix3d mounting;
  std::unique_ptr<Fan> fan;
  std::unique_ptr<RayBundle> rays = std::make_unique<RayBundle>();

  explicit Slice(std::vector<Vec3d> of, const Eigen::Matrix3d& mounting_of = Eigen::Matrix3d::Identity())
      : directions(std::move(of)), mounting(mounting_of), fan(std::make_unique<Fan>(make_fan(directions, mounting))) {
    rays->count = directions.size();
    rays->range = 100.0F;
  }

  void trace(const MeshTree& tree, const Vec3& origin, const Mat3& rotation, SliceWalk walk = SliceWalk::automatic) {
    std::fill_n(rays->t_hit, rays->count, kInfinity);
    std::fill_n(rays->element, rays->count, -1);
    rays->origin = origin;
    rays->rotation = rotation;
    trace_on(tree, 0, walk);
  }

  // Traces with the current setup, keeping earlier hits.
  void trace_on(const MeshTree& tree, std::int32_t first_element, SliceWalk walk = SliceWalk::automatic) {
    const FlushDenormals flush;
    trace_mesh_slice(tree, first_element, *fan, *rays, walk);
  }

  Vec3d origin() const { return rays->origin.cast<double>(); }
  Vec3d direction(std::size_t ray) const { return rays->rotation.cast<double>() * (mounting * directions[ray]); }
  // A unit normal of the plane, world frame.
  Vec3d normal() const { return rays->rotation.cast<double>() * fan->to_sensor.col(2).cast<double>(); }
};

inline Vec3d corner_of(const TriangleMesh& mesh, std::int32_t triangle, std::size_t k) {
  const std::int32_t vertex = mesh.triangles[static_cast<std::size_t>(triangle)][k];
  return mesh.vertices[static_cast<std::size_t>(vertex)].cast<double>();
}

inline double distance_to_segment(const Vec3d& point, const Vec3d& a, const Vec3d& b) {
  const Vec3d along = b - a;
  const double share = along.isZero() ? 0.0 : std::clamp((point - a).dot(along) / along.squaredNorm(), 0.0, 1.0);
  return (point - a - share * along).norm();
}

inline double distance_to_triangle(const Vec3d& point, const TriangleMesh& mesh, std::int32_t triangle) {
  const Vec3d a = corner_of(mesh, triangle, 0), b = corner_of(mesh, triangle, 1), c = corner_of(mesh, triangle, 2);
  const Vec3d normal = (b - a).cross(c - a);
  const auto is_inside = [&](const Vec3d& from, const Vec3d& to) { return normal.cross(to - from).dot(point - from) >= 0.0; };
  if (!normal.isZero() && is_inside(a, b) && is_inside(b, c) && is_inside(c, a)) {
    return std::abs(normal.normalized().dot(point - a));
  }
  return std::min({distance_to_segment(point, a, b), distance_to_segment(point, b, c), distance_to_segment(point, c, a)});
}

// Returns the largest distance (m) from the origin to a corner of a triangle, or of any triangle.
inline double reach_of(const Vec3d& origin, const TriangleMesh& mesh, std::int32_t triangle) {
  double reach = 0.0;
  for (std::size_t k = 0; k < 3; ++k) reach = std::max(reach, (corner_of(mesh, triangle, k) - origin).norm());
  return reach;
}

inline double reach_of(const Vec3d& origin, const TriangleMesh& mesh) {
  double reach = 0.0;
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    reach = std::max(reach, reach_of(origin, mesh, static_cast<std::int32_t>(i)));
  }
  return reach;
}

// Bounds the distance (m) of a hit from its place on its ray and from its triangle, whose corners are up to `reach` m from the
// origin. Every operation has a relative error of at most u, half the distance of 1 to the next float. In units of u reach:
// - 20 for a corner in the fan's frame. An axis of the frame has unit length; its rounded components and a rotation of three
//   products and two sums make 4 for each component, which is less than 7 for the axis. Subtracting the origin makes 1, three
//   products and two sums make 3, and sqrt(3) times these 11 is less than 20.
// - 24 for a rotation from a float quaternion, which is orthonormal only up to rounding, and 1 for the ray's rounded components.
// - 8 for a cut. It lies between two corners: 2 for the products and their difference, 3 for the reciprocal of the difference of
//   heights and its product; sqrt(2) times these 5 is less than 8.
// - 6 for the place on the segment: 2 for a side, and 2 for the quotient of sides times a length of up to 2 reach.
// - 7 for the distance: 2 for those of the ends, 4 for their difference of up to 2 reach and its product, 1 for the sum.
// Neither a grazing angle nor a needle makes this larger, but they magnify the error along the ray.
inline double rounding_of(double reach) {
  constexpr double kU = 0.5 * static_cast<double>(std::numeric_limits<float>::epsilon());
  return (20.0 + 24.0 + 1.0 + 8.0 + 6.0 + 7.0) * kU * reach;
}

inline ::testing::AssertionResult is_on_its_triangle(const Slice& slice, std::size_t ray, const TriangleMesh& mesh) {
  const double t = static_cast<double>(slice.rays->t_hit[ray]);
  const std::int32_t triangle = slice.rays->element[ray];
  const double distance = distance_to_triangle(slice.origin() + t * slice.direction(ray), mesh, triangle);
  if (distance <= rounding_of(reach_of(slice.origin(), mesh, triangle))) return ::testing::AssertionSuccess();
  return ::testing::AssertionFailure() << "ray " << ray << " at " << t << " is " << distance << " m from triangle " << triangle;
}

// Returns three axes. The first two span the plane of x and y, of x and z, or of y and z; the third is its normal.
inline Eigen::Matrix3d plane_of_axes(std::size_t number) {
  Eigen::Matrix3d plane = Eigen::Matrix3d::Identity();
  if (number == 1) plane << 1, 0, 0, 0, 0, 1, 0, 1, 0;
  if (number == 2) plane << 0, 0, 1, 1, 0, 0, 0, 1, 0;
  return plane;
}

// 1 to kMaxRays directions in a plane, before the mounting: in a plane of two axes or in any, evenly spaced or not, in a sector
// or all around.
inline std::vector<Vec3d> random_fan(Random& random) {
  const auto any = [&](std::size_t count) { return random.generator()() % count; };
  const std::size_t few = std::array<std::size_t, 8>{1, 2, 3, 12, 35, 72, 255, kMaxRays}[any(8)];
  const std::size_t count = any(2) == 0 ? few : 1 + any(kMaxRays);
  const double width = any(3) == 0 ? 2.0 * kPi : std::array{0.05, 1.0, 3.0, 3.3, 4.7, 6.0}[any(6)];
  const double first = any(2) == 0 ? -0.5 * width : static_cast<double>(random.within(-4, 4));
  const bool is_even = any(2) == 0;
  const std::size_t kind = any(count < 3 ? 3 : 4);  // one ray, or two opposite ones, lie in many planes
  const Eigen::Matrix3d plane =
      kind < 3 ? plane_of_axes(kind) : Eigen::Matrix3d(random.rotation().cast<double>().normalized().toRotationMatrix());
  std::vector<Vec3d> directions;
  for (std::size_t i = 0; i < count; ++i) {
    const double part = is_even ? static_cast<double>(i) / static_cast<double>(count) : static_cast<double>(random.within(0, 1));
    directions.push_back(plane * level(first + width * part));
  }
  return directions;
}

// Returns the tree that slices are traced through.
inline MeshTree tree_of(const EmbreeDevice& device, const TriangleMesh& mesh) { return {device.device.get(), mesh}; }

// -- No ray slips between triangles.

// A closed box of squares whose corners lie at multiples of `step`, from -half to half steps along each axis, around closed boxes
// with faces on the same planes.
inline TriangleMesh lattice(int half, float step, bool with_boxes) {
  TriangleMesh mesh;
  for (int axis = 0; axis < 3; ++axis) {
    for (const int side : {-half, half}) {
      const auto first = static_cast<std::int32_t>(mesh.vertices.size());
      for (int row = -half; row <= half; ++row) {
        for (int column = -half; column <= half; ++column) {
          Vec3 corner;
          corner[axis] = step * static_cast<float>(side);
          corner[(axis + 1) % 3] = step * static_cast<float>(column);
          corner[(axis + 2) % 3] = step * static_cast<float>(row);
          mesh.vertices.push_back(corner);
        }
      }
      add_squares(mesh, first, 2 * half, 2 * half);
    }
  }
  complete(mesh);
  if (!with_boxes) return mesh;
  for (const Vec3& center : {Vec3(2, 2, -1), Vec3(-2, 1, 1), Vec3(0, -2, 1), Vec3(2, -2, -1)}) {
    add_box(mesh, step * center, Vec3::Constant(step));
  }
  return mesh;
}

}  // namespace flockstep::trace::slices
