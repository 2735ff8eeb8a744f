// Which library should answer "how far is the drone's hull from this obstacle": accuracy against a certified oracle, cost per
// query, heap allocations, failures. Prints a Markdown table. FCL (with its two solvers, one of them libccd's) takes part where
// its headers are found.
#include "collision/convex_distance.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <cstdio>
#include <functional>
#include <memory>
#include <random>
#include <string>
#include <vector>

#include "allocation_counter.hpp"
#include "convex_oracle.hpp"

#if __has_include(<fcl/narrowphase/detail/gjk_solver_libccd.h>)
#define FLOCKSTEP_BENCH_FCL
#include <fcl/geometry/shape/box.h>
#include <fcl/geometry/shape/convex.h>
#include <fcl/geometry/shape/cylinder.h>
#include <fcl/narrowphase/detail/gjk_solver_indep.h>
#include <fcl/narrowphase/detail/gjk_solver_libccd.h>
#endif

namespace {

using namespace flockstep;
using collision::Vec3d;

constexpr int kCases = 2000;
constexpr int kRepeats = 7;
constexpr double kAsked = 1e-5;  // m, of pairs nearer than kNear: a bound on how far a sweep errs
constexpr double kNear = 0.1;    // m

enum class Kind { box, cylinder, triangle };
constexpr std::array<const char*, 3> kKindNames{"box", "cylinder", "triangle"};

struct Case {
  Kind kind = Kind::box;
  Primitive primitive;
  std::array<Vec3, 3> corners;
  collision::Convex convex;
  Eigen::Quaterniond rotation;
  Vec3d position;
  double truth = 0.0;  // m; 0 where they overlap
};

// Hulls and obstacles of random sizes: a third of the hulls axis-aligned (parallel faces), a sixth of the cases nearly touching.
std::vector<Case> make_cases(Kind kind, const DroneModel& drone) {
  std::mt19937 random(1);
  std::normal_distribution<float> normal;
  std::uniform_real_distribution<float> uniform;
  const auto point = [&](float scale) -> Vec3 {
    const float x = normal(random);
    const float y = normal(random);
    return scale * Vec3(x, y, normal(random));
  };
  std::vector<Case> cases;
  while (cases.size() < kCases) {
    Case c;
    const auto i = cases.size();
    c.kind = kind;
    const Vec3 axis = point(1.0F);
    c.rotation = i % 3 == 0 ? Eigen::Quaterniond::Identity()
                            : Eigen::Quaterniond(Eigen::AngleAxisd(3.0 * uniform(random), axis.cast<double>().normalized()));
    c.position = point(0.8F).cast<double>();
    for (Vec3& corner : c.corners) corner = point(0.4F);
    for (float& half : c.primitive.half_extents) half = 0.025F + 0.5F * uniform(random);
    if (kind == Kind::cylinder) {
      c.primitive.kind = PrimitiveKind::cylinder;
      c.primitive.half_extents.y() = c.primitive.half_extents.x();
    }
    const Vec3 tilt = point(1.0F);
    if (i % 2 == 0) c.primitive.rotation = Quat(Eigen::AngleAxisf(2.0F * uniform(random), tilt.normalized()));
    c.convex = kind == Kind::triangle ? collision::make_triangle(c.corners[0], c.corners[1], c.corners[2])
                                      : collision::make_convex(c.primitive);
    const auto distance_from = [&](const Vec3d& position) {
      const oracle::Support obstacle =
          kind == Kind::triangle
              ? oracle::polytope({c.corners[0].cast<double>(), c.corners[1].cast<double>(), c.corners[2].cast<double>()})
              : oracle::solid(c.primitive);
      return oracle::distance(oracle::hull_at(drone, position, c.rotation), obstacle).upper;
    };
    c.truth = distance_from(c.position);
    if (i % 6 == 0 && c.truth > 1e-3) {  // bring it to a millimetre or less
      const Vec3d away = (c.position - collision::closest_point(c.convex, c.position)).normalized();
      c.position -= (c.truth - 1e-3 * uniform(random)) * away;
      c.truth = distance_from(c.position);
    }
    cases.push_back(c);
  }
  return cases;
}

using Query = std::function<double(const Case&)>;  // the distance in m, 0 or less on overlap

void report(const std::string& library, Kind kind, const std::vector<Case>& cases, const Query& query) {
  int wrong = 0;
  int inaccurate = 0;
  int near = 0;
  double worst = 0.0;
  double worst_near = 0.0;
  const auto before = testing::allocations_of_this_thread();
  for (const Case& c : cases) {
    const double found = std::max(query(c), 0.0);
    const double error = std::abs(found - c.truth);
    wrong += (found > 0.0) != (c.truth > 1e-6);
    worst = std::max(worst, error);
    if (c.truth < kNear) {
      ++near;
      inaccurate += error > kAsked;
      worst_near = std::max(worst_near, error);
    }
  }
  const auto allocated = testing::allocations_of_this_thread() - before;
  double best = 1e300;
  double sink = 0.0;
  for (int repeat = 0; repeat < kRepeats; ++repeat) {
    const auto start = std::chrono::steady_clock::now();
    for (const Case& c : cases) sink += query(c);
    best = std::min(best, std::chrono::duration<double, std::nano>(std::chrono::steady_clock::now() - start).count());
  }
  std::printf("| %s | %s | %.0f | %.1e | %.1e | %.2f %% | %d | %.1f |%s\n", library.c_str(),
              kKindNames[static_cast<std::size_t>(kind)], best / kCases, worst, worst_near, 100.0 * inaccurate / near, wrong,
              static_cast<double>(allocated) / kCases, sink > 0.0 ? "" : " ");
}

#ifdef FLOCKSTEP_BENCH_FCL
// FCL wants faces, though its support function for so few vertices does not read them: any triangles on the hull will do.
fcl::Convexd fcl_hull(const DroneModel& drone) {
  auto vertices = std::make_shared<std::vector<fcl::Vector3d>>();
  for (const Vec3& v : drone.hull()) vertices->push_back(v.cast<double>());
  auto faces = std::make_shared<std::vector<int>>();
  int count = 0;
  const int n = static_cast<int>(vertices->size());
  const auto at = [&](int i) { return (*vertices)[static_cast<std::size_t>(i)]; };
  for (int i = 0; i < n; ++i) {
    for (int j = 0; j < n; ++j) {
      for (int k = 0; k < n; ++k) {
        const fcl::Vector3d normal = (at(j) - at(i)).cross(at(k) - at(i));
        bool outer = i < j && i < k && normal.norm() > 1e-9;
        for (int l = 0; outer && l < n; ++l) outer = normal.dot(at(l) - at(i)) <= 1e-9;
        if (outer) {
          faces->insert(faces->end(), {3, i, j, k});
          ++count;
        }
      }
    }
  }
  return {vertices, count, faces};
}

template <class Solver>
Query fcl_query(const Solver& solver, const fcl::Convexd& hull) {
  return [&solver, &hull](const Case& c) {
    fcl::Transform3d body = fcl::Transform3d::Identity();
    body.linear() = c.rotation.toRotationMatrix();
    body.translation() = c.position;
    fcl::Transform3d place = fcl::Transform3d::Identity();
    double distance = 0.0;
    fcl::Vector3d p;
    fcl::Vector3d q;
    bool apart = false;
    if (c.kind == Kind::triangle) {
      const std::array<fcl::Vector3d, 3> t{c.corners[0].cast<double>(), c.corners[1].cast<double>(), c.corners[2].cast<double>()};
      apart = solver.shapeTriangleDistance(hull, body, t[0], t[1], t[2], &distance, &p, &q);
    } else {
      place.linear() = c.convex.rotation;
      place.translation() = c.convex.center;
      const fcl::Vector3d h = c.convex.half_extents;
      apart = c.kind == Kind::box
                  ? solver.shapeDistance(hull, body, fcl::Boxd(2.0 * h), place, &distance, &p, &q)
                  : solver.shapeDistance(hull, body, fcl::Cylinderd(h.x(), 2.0 * h.z()), place, &distance, &p, &q);
    }
    return apart ? distance : 0.0;
  };
}
#endif

}  // namespace

int main() {
  const DroneModel drone = DroneModel::quadrotor650();
  const collision::Hull hull(drone);
  const Query engine = [&hull](const Case& c) {
    const collision::Separation found = collision::separate(hull, c.rotation.toRotationMatrix(), c.position, c.convex,
                                                            c.position - collision::closest_point(c.convex, c.position));
    return found.overlapping ? 0.0 : found.distance;
  };
#ifdef FLOCKSTEP_BENCH_FCL
  const fcl::Convexd fcl_body = fcl_hull(drone);
  fcl::detail::GJKSolver_libccd<double> libccd;
  libccd.distance_tolerance = 1e-6;
  fcl::detail::GJKSolver_indep<double> indep;
  indep.gjk_tolerance = 1e-6;
#endif
  std::printf(
      "| library | hull against | ns | worst error, m | within 0.1 m | over 1e-5 m there | overlaps mistaken | allocations |\n");
  std::printf("|---|---|---|---|---|---|---|---|\n");
  for (const Kind kind : {Kind::box, Kind::cylinder, Kind::triangle}) {
    const std::vector<Case> cases = make_cases(kind, drone);
    report("Bullet, as the engine asks it", kind, cases, engine);
#ifdef FLOCKSTEP_BENCH_FCL
    report("FCL, libccd solver", kind, cases, fcl_query(libccd, fcl_body));
    report("FCL, own solver", kind, cases, fcl_query(indep, fcl_body));
#endif
  }
}
