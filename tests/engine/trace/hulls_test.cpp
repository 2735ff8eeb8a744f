#include "trace/hulls.hpp"

#include <gtest/gtest.h>

#include <array>
#include <cmath>
#include <cstddef>
#include <limits>
#include <memory>
#include <sstream>
#include <vector>

#include "base/platform.hpp"
#include "bundles.hpp"
#include "flockstep/drone_model.hpp"
#include "hull_oracle.hpp"
#include "random.hpp"
#include "world/hull_faces.hpp"

namespace flockstep::trace {
namespace {

using oracle::Vec3d;
using testing::Directions;
using testing::Random;

// Random points, corners of a box or a prism, and points inside of them.
std::vector<Vec3> random_points(Random& random) {
  const float size = std::exp(random.within(std::log(0.02F), std::log(2.0F)));
  std::vector<Vec3> points;
  const unsigned kind = random.generator()() % 4;
  if (kind == 0) {
    const std::size_t count = 4 + random.generator()() % 29;
    for (std::size_t i = 0; i < count; ++i) points.push_back(size * random.point(1.0F));
  } else if (kind == 1) {  // on a ball: all are corners
    for (std::size_t i = 0; i < 32; ++i) points.push_back(size * random.direction().normalized());
  } else {  // a prism, with coplanar corners
    const std::size_t sides = kind == 2 ? 4 : 3 + random.generator()() % 12;
    const float height = size * random.within(0.1F, 1.0F);
    const Quat turn = random.generator()() % 2 == 0 ? Quat::Identity() : random.rotation();
    for (std::size_t i = 0; i < sides; ++i) {
      const float angle = 6.2831853F * static_cast<float>(i) / static_cast<float>(sides);
      for (const float z : {-height, height}) points.push_back(turn * Vec3(size * std::cos(angle), size * std::sin(angle), z));
    }
    points.push_back(turn * Vec3(0.1F * size, 0, height));  // on a face
    points.push_back(Vec3::Zero());                         // inside
  }
  return points;
}

struct PosedPoints {
  DroneModel model;
  HullPlanes planes;
  oracle::Hull exact;
  Pose pose;
  TurnedPlanes turned;
  std::array<float, 4> quat_wxyz{};

  PosedPoints(const std::vector<Vec3>& points, const Pose& at) : model(points), planes(points), exact(points), pose(at) {}
  PosedHull posed(std::int32_t element) {
    const Quat& q = pose.rotation;
    quat_wxyz = {q.w(), q.x(), q.y(), q.z()};
    return {&planes, &turned, quat_wxyz.data(), pose.position, model.radius(), element};
  }
};

oracle::Hit nearest(const std::vector<std::unique_ptr<PosedPoints>>& hulls, const Vec3d& origin, const Vec3d& direction) {
  oracle::Hit found;
  for (std::size_t i = 0; i < hulls.size(); ++i) {
    oracle::Hit hit = hulls[i]->exact.hit(hulls[i]->pose, origin, direction);
    if (hit.t >= found.t) continue;
    found = hit;
    found.element = static_cast<int>(i);
  }
  return found;
}

// Returns how far the hit moves along the ray, relative to the offset, if the ray moves aside. Infinite near an edge.
double steepness(const std::vector<std::unique_ptr<PosedPoints>>& hulls, const oracle::Hit& hit, const Vec3d& origin,
                 const Vec3d& direction, double aside) {
  const Vec3d u = direction.unitOrthogonal(), v = direction.cross(u);
  double steepest = 1.0;
  for (const Vec3d& way : {u, Vec3d(-u), v, Vec3d(-v), direction, Vec3d(-direction)}) {
    const oracle::Hit other = nearest(hulls, origin + aside * way, direction);
    if (other.element != hit.element) return oracle::kNever;
    if (hit.element < 0) continue;
    if (other.normal.dot(hit.normal) < 0.999) return oracle::kNever;
    steepest = std::max(steepest, std::abs(other.t - hit.t) / aside);
  }
  return steepest;
}

TEST(Hulls, RaysHitThemWhereClippingDoes) {
  const FlushDenormals flush;
  std::size_t rays = 0, hits = 0, unclear = 0, inside = 0;
  for (unsigned seed = 0; rays < 100'000; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    std::vector<std::unique_ptr<PosedPoints>> hulls;
    const std::size_t count = 1 + random.generator()() % 8;
    const Vec3 origin = random.point(random.generator()() % 8 == 0 ? 300.0F : 3.0F);
    while (hulls.size() < count) {
      const float away = random.within(0.0F, 6.0F);
      const Pose pose{origin + away * random.direction().normalized(), random.rotation()};
      hulls.push_back(std::make_unique<PosedPoints>(random_points(random), pose));
    }
    std::vector<PosedHull> posed;
    for (std::size_t i = 0; i < count; ++i) posed.push_back(hulls[i]->posed(static_cast<std::int32_t>(i)));
    // Towards the hulls, in a narrow or a wide set.
    std::vector<Vec3> chosen;
    const bool is_narrow = random.generator()() % 2 == 0;
    const std::size_t size = 1 + random.generator()() % kMaxRays;
    const Mat3 rotation = random.rotation().toRotationMatrix();
    for (std::size_t i = 0; i < size; ++i) {
      const PosedPoints& target = *hulls[is_narrow ? 0 : random.generator()() % count];
      const Vec3 way = target.pose.position + target.model.radius() * random.point(1.0F) - origin;
      chosen.push_back(rotation.transpose() * (way.norm() > 1e-3F ? way : random.direction()));
    }
    const Directions directions(chosen);
    auto bundle = std::make_unique<RayBundle>();
    bundle->origin = origin;
    bundle->rotation = rotation;
    bundle->range = random.generator()() % 4 == 0 ? 3.0F : 100.0F;
    directions.aim(*bundle);
    std::fill_n(bundle->t_hit, size, std::numeric_limits<float>::infinity());
    std::fill_n(bundle->element, size, -1);
    trace_hulls(posed, *bundle);
    for (std::size_t i = 0; i < size; ++i, ++rays) {
      const Vec3d direction = rotation.cast<double>() * directions[i].cast<double>();
      const Vec3d from = origin.cast<double>();
      oracle::Hit expected = nearest(hulls, from, direction);
      const double error_m = 1e-6 * (2.0 + from.cwiseAbs().maxCoeff() + (expected.element < 0 ? 0.0 : expected.t));
      const double steep = steepness(hulls, expected, from, direction, 2.0 * error_m);
      const double range = static_cast<double>(bundle->range);
      if (steep == oracle::kNever || steep > 100.0 || std::abs(expected.t - range) < 100.0 * error_m) {
        ++unclear;
        continue;
      }
      if (expected.t > range) expected = {};
      ASSERT_EQ(bundle->element[i], expected.element) << i << ' ' << expected.t << ' ' << bundle->t_hit[i];
      if (expected.element < 0) {
        ASSERT_TRUE(std::isinf(bundle->t_hit[i]));
        continue;
      }
      ++hits;
      inside += expected.normal.dot(direction) > 0.0 ? 1 : 0;
      ASSERT_NEAR(static_cast<double>(bundle->t_hit[i]), expected.t, steep * error_m) << i;
    }
  }
  EXPECT_GT(hits, rays / 3);
  EXPECT_GT(inside, rays / 100);
  EXPECT_LT(unclear, rays / 20);
  std::ostringstream text;
  text << rays << " rays, " << hits << " hits, " << inside << " from inside, " << unclear << " near an edge";
  RecordProperty("counts", text.str());
}

// A ray's result has the same bits beside any other rays, and a nearer hit stays.
TEST(Hulls, ARayDependsOnNoOtherRay) {
  const FlushDenormals flush;
  Random random(5);
  const DroneModel model = DroneModel::quadrotor650();
  const HullPlanes planes(model.hull());
  std::vector<TurnedPlanes> turned(80);
  std::vector<std::array<float, 4>> quats(80);
  std::vector<PosedHull> posed;
  for (std::size_t i = 0; i < 80; ++i) {
    const Quat q = random.rotation();
    quats[i] = {q.w(), q.x(), q.y(), q.z()};
    posed.push_back({&planes, &turned[i], quats[i].data(), random.point(3.0F), model.radius(), static_cast<std::int32_t>(i)});
  }
  std::vector<Vec3> chosen;
  for (std::size_t i = 0; i < kMaxRays; ++i) chosen.push_back(random.direction());
  const auto trace = [&](const std::vector<Vec3>& some, float before) {
    const Directions directions(some);
    auto bundle = std::make_unique<RayBundle>();
    bundle->origin = Vec3::Zero();
    bundle->rotation = Mat3::Identity();
    bundle->range = 9.0F;
    directions.aim(*bundle);
    std::fill_n(bundle->t_hit, some.size(), before);
    std::fill_n(bundle->element, some.size(), 99);
    trace_hulls(posed, *bundle);
    return bundle;
  };
  const auto together = trace(chosen, 100.0F);
  std::size_t hits = 0;
  for (std::size_t i = 0; i < chosen.size(); ++i) {
    const auto single = trace({chosen[i]}, 100.0F);
    EXPECT_EQ(single->t_hit[0], together->t_hit[i]);
    EXPECT_EQ(single->element[0], together->element[i]);
    if (single->element[0] == 99) continue;
    ++hits;
    const auto nearer = trace({chosen[i]}, 0.5F * single->t_hit[0]);
    EXPECT_EQ(nearer->t_hit[0], 0.5F * single->t_hit[0]);
    EXPECT_EQ(nearer->element[0], 99);
  }
  EXPECT_GT(hits, 50U);
}

TEST(HullFaces, BoundAllPointsAndCloseTheHull) {
  Random random(11);
  for (int i = 0; i < 100; ++i) {
    const std::vector<Vec3> points = random_points(random);
    const std::vector<HullFace> faces = hull_faces(points, HullPlanes::kMax);
    ASSERT_LE(faces.size(), HullPlanes::kMax);
    double size = 0.0;
    for (const Vec3& point : points) size = std::max(size, static_cast<double>(point.norm()));
    Vec3d total = Vec3d::Zero();  // of the areas along the normals; zero for a closed surface
    double area = 0.0;
    for (const HullFace& face : faces) {
      for (const Vec3& point : points) ASSERT_LE(face.normal.dot(point.cast<double>()), face.offset + 1e-12);
      ASSERT_GE(face.corners.size(), 3U);
      const auto corner = [&](std::size_t k) { return Vec3d(points[face.corners[k]].cast<double>()); };
      for (std::size_t k = 2; k < face.corners.size(); ++k) {
        const Vec3d twice = (corner(k - 1) - corner(0)).cross(corner(k) - corner(0));
        EXPECT_GE(twice.dot(face.normal), 0.0);
        total += twice;
        area += twice.norm();
      }
      for (std::size_t k = 0; k < face.corners.size(); ++k) EXPECT_GE(face.normal.dot(corner(k)), face.offset - 1e-5 * size);
    }
    EXPECT_LE(total.norm(), 1e-5 * area) << i << ' ' << points.size() << ' ' << faces.size();
  }
  EXPECT_EQ(hull_faces(DroneModel::quadrotor650().hull(), HullPlanes::kMax).size(), 26U);
}

}  // namespace
}  // namespace flockstep::trace
