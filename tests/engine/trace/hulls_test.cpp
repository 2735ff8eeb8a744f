#include "trace/hulls.hpp"

#include <set>

#include "base/platform.hpp"
#include "bundles.hpp"
#include "flockstep/drone_model.hpp"
#include "random.hpp"
#include "ray_oracle.hpp"
#include "trace/near_balls.hpp"
#include "trace/shape_tree.hpp"
#include "world/hull_faces.hpp"

namespace flockstep::trace {
namespace {

using oracle::Vec3d;
using namespace testing;

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
  for (unsigned seed = 0; rays < 100'000 / kThinning; ++seed) {
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

// Returns the distance in double precision; 0 inside.
double distance(const Aabb& box, const Vec3& point) {
  const Eigen::Vector3d p = point.cast<double>();
  return (box.min.cast<double>() - p).cwiseMax(p - box.max.cast<double>()).cwiseMax(0.0).norm();
}

struct Boxes {
  std::vector<Aabb> boxes;
  std::vector<std::uint32_t> numbers;  // random order, no 0
  float reach = 1.0F;                  // m, extent of all boxes

  ShapeTree tree() const { return {boxes, numbers}; }
};

Boxes scattered(Random& random, std::size_t count, float reach, float size) {
  Boxes result;
  for (std::size_t i = 0; i < count; ++i) {
    const Vec3 center = random.point(reach);
    const Vec3 half = Vec3(random.within(0, 1), random.within(0, 1), random.within(0, 1)) * (i % 7 == 0 ? 10.0F * size : size);
    result.boxes.push_back({center - half, center + half});
  }
  result.numbers.resize(count);
  std::iota(result.numbers.begin(), result.numbers.end(), 1U);
  std::shuffle(result.numbers.begin(), result.numbers.end(), random.generator());
  result.reach = reach;
  return result;
}

std::vector<std::uint32_t> near(const ShapeTree& tree, const Vec3& point, float radius) {
  std::vector<std::uint32_t> found;
  tree.for_each_near(point, radius, [&](std::uint32_t number) { found.push_back(number); });
  return found;
}

// Expects every box within the radius to be found once, and no other. Boxes at exactly the radius are ignored because of
// rounding. Returns the number found.
std::size_t expect_like_brute_force(const Boxes& boxes, const ShapeTree& tree, const Vec3& point, float radius) {
  std::vector<std::uint32_t> found = near(tree, point, radius);
  const std::size_t count = found.size();
  std::sort(found.begin(), found.end());
  EXPECT_EQ(std::adjacent_find(found.begin(), found.end()), found.end()) << "told twice";
  const double slack = 1e-6 * (static_cast<double>(boxes.reach) + static_cast<double>(point.norm()) +
                               (radius < kInfinity ? static_cast<double>(radius) : 0.0));
  for (std::size_t i = 0; i < boxes.boxes.size(); ++i) {
    const double apart = distance(boxes.boxes[i], point);
    const bool is_found = std::binary_search(found.begin(), found.end(), boxes.numbers[i]);
    if (std::abs(apart - static_cast<double>(radius)) <= slack) continue;
    EXPECT_EQ(is_found, apart < static_cast<double>(radius)) << "box " << i << ", " << apart << " m away";
  }
  return count;
}

TEST(ShapeTree, AgreesWithBruteForce) {
  for (const std::size_t count : {0U, 1U, 2U, 15U, 16U, 17U, 255U, 256U, 257U, 1000U, 4097U, 10'000U}) {
    SCOPED_TRACE(count);
    Random random(static_cast<unsigned>(count));
    const Boxes boxes = scattered(random, count, 20.0F, 0.5F);
    const ShapeTree tree = boxes.tree();
    EXPECT_EQ(tree.empty(), count == 0);
    std::size_t found = 0;
    for (int i = 0; i < 100; ++i) {
      const Vec3 point = random.point(i % 5 == 0 ? 40.0F : 20.0F);
      const float radius = std::array{0.0F, 0.3F, 2.0F, 10.0F}[static_cast<std::size_t>(i) % 4];
      found += expect_like_brute_force(boxes, tree, point, radius);
      ASSERT_FALSE(HasFailure());
    }
    EXPECT_GE(found, count / 2);
    EXPECT_EQ(expect_like_brute_force(boxes, tree, Vec3::Zero(), kInfinity), count) << "all are within an infinite radius";
    EXPECT_EQ(near(tree, Vec3::Constant(1e4F), 1.0F).size(), 0U);
  }
}

TEST(ShapeTree, BoxesOnALineInAPlaneAndAtOnePlace) {
  Random random(1);
  for (const Vec3& spread : {Vec3(1, 0, 0), Vec3(0, 1, 1), Vec3(0, 0, 0), Vec3(1e5F, 1e-5F, 1)}) {
    Boxes boxes = scattered(random, 500, 1.0F, 0.01F);
    for (Aabb& box : boxes.boxes) box = {box.min.cwiseProduct(spread), box.max.cwiseProduct(spread)};
    boxes.reach = std::max(1.0F, spread.maxCoeff());
    const ShapeTree tree = boxes.tree();
    for (int i = 0; i < 50; ++i) {
      expect_like_brute_force(boxes, tree, random.point(1.0F).cwiseProduct(spread), 0.2F * boxes.reach);
      ASSERT_FALSE(HasFailure());
    }
  }
}

TEST(ShapeTree, TheOrderDependsOnNothingButTheBoxes) {
  Random random(2);
  const Boxes boxes = scattered(random, 1000, 20.0F, 0.5F);
  const ShapeTree tree = boxes.tree();
  const ShapeTree again = boxes.tree();
  const std::vector<std::uint32_t> all = near(tree, Vec3::Zero(), kInfinity);
  for (int i = 0; i < 20; ++i) {
    const Vec3 point = random.point(20.0F);
    const std::vector<std::uint32_t> found = near(tree, point, 8.0F);
    EXPECT_EQ(found, near(again, point, 8.0F));
    // A smaller radius yields a subsequence of the full order.
    std::size_t at = 0;
    for (const std::uint32_t number : all) at += at < found.size() && found[at] == number;
    EXPECT_EQ(at, found.size());
  }
}

// -- Searches among balls, linear and in slices, against brute force.

struct SomeBalls {
  std::vector<float> centers, radii;

  std::size_t count() const { return radii.size(); }
  Balls view() const { return {centers.data(), radii.data(), count()}; }
  Vec3 center(std::size_t i) const { return Vec3::Map(centers.data() + 3 * i); }

  // The distance of two balls over the sum of their radii, in double precision.
  static double nearness(const Vec3& a, const Vec3& b, float radii) {
    return (a.cast<double>() - b.cast<double>()).norm() / static_cast<double>(radii);
  }
};

SomeBalls any_balls(Random& random, std::size_t count) {
  SomeBalls balls;
  const Vec3 spread(std::exp(random.within(-5, 5)), std::exp(random.within(-5, 5)), std::exp(random.within(-5, 5)));
  const Vec3 middle = random.point(random.generator()() % 4 == 0 ? 10000.0F : 10.0F);
  const float largest = std::exp(random.within(-4, 1));
  const bool is_even = random.generator()() % 4 == 0;  // many balls have equal coordinates
  for (std::size_t i = 0; i < count; ++i) {
    Vec3 center = middle + spread.cwiseProduct(random.point(1.0F));
    if (is_even) center = center.array().round();
    if (random.generator()() % 200 == 0) center += Vec3(5000, 0, 0);
    balls.centers.insert(balls.centers.end(), {center.x(), center.y(), center.z()});
    balls.radii.push_back(random.generator()() % 10 == 0 ? -1.0F : random.within(0, largest));
  }
  return balls;
}

TEST(NearBalls, ALinearSearchFindsTheBallsOfBruteForce) {
  Random random(3);
  std::size_t found_in_all = 0;
  for (int round = 0; round < 2000; ++round) {
    const SomeBalls balls = any_balls(random, static_cast<std::size_t>(round % 41));  // the arrays end with the last ball
    const Vec3 origin = balls.count() == 0 ? Vec3(Vec3::Zero()) : balls.center(random.generator()() % balls.count());
    const float range = std::exp(random.within(-4, 4));
    std::vector<std::uint32_t> found(balls.count());
    found.resize(find_near_balls(balls.view(), origin, range, found.data()));
    ASSERT_EQ(std::ranges::adjacent_find(found, std::greater_equal{}), found.end());
    for (std::size_t i = 0; i < balls.count(); ++i) {
      const double nearness = SomeBalls::nearness(balls.center(i), origin, balls.radii[i] + range);
      const bool is_found = std::ranges::binary_search(found, i);
      if (balls.radii[i] < 0.0F || nearness > 1.0 + 3e-5) {
        EXPECT_FALSE(is_found) << "ball " << i << " of " << balls.count();
      } else if (nearness <= 1.0) {
        EXPECT_TRUE(is_found) << "ball " << i << " of " << balls.count();
      }
    }
    found_in_all += found.size();
  }
  EXPECT_GT(found_in_all, 10'000U);
}

TEST(BallSlices, ASearchFindsTheBallsThatALinearSearchFinds) {
  Random random(1);
  std::size_t found_in_all = 0;
  BallSlices slices;
  for (int round = 0; round < 400; ++round) {
    const std::size_t count = std::array<std::size_t, 8>{0, 1, 7, 32, 33, 100, 1000, 4096}[random.generator()() % 8];
    const SomeBalls balls = any_balls(random, count);
    slices.sort(balls.view());
    std::vector<std::uint32_t> expected(count), found(count);
    for (int search = 0; search < 20; ++search) {
      const bool is_at_ball = count > 0 && random.generator()() % 2 == 0;
      const Vec3 origin = (is_at_ball ? balls.center(random.generator()() % count) : Vec3(Vec3::Zero())) +
                          random.point(is_at_ball ? 1.0F : 20.0F);
      const float range = std::exp(random.within(-4, 4));
      expected.resize(count);
      found.resize(count + BallColumns::kPadding);
      expected.resize(find_near_balls(balls.view(), origin, range, expected.data()));
      found.resize(slices.find(origin, range, found.data()));
      std::ranges::sort(found);
      ASSERT_EQ(found, expected) << "round " << round;
      found_in_all += found.size();
    }
  }
  EXPECT_GT(found_in_all, 100'000U);
}

TEST(BallSlices, EachPairThatOverlapsIsFoundOnce) {
  Random random(2);
  std::size_t found_in_all = 0;
  BallSlices slices;
  for (int round = 0; round < 200; ++round) {
    const std::size_t count = std::array<std::size_t, 7>{0, 1, 2, 8, 32, 33, 300}[random.generator()() % 7];
    const SomeBalls balls = any_balls(random, count);
    slices.sort(balls.view());
    std::set<std::pair<std::size_t, std::size_t>> pairs;
    slices.for_each_pair([&](std::size_t a, std::size_t b) {
      ASSERT_NE(a, b);
      EXPECT_TRUE(pairs.insert(std::minmax(a, b)).second) << a << ' ' << b;
    });
    for (std::size_t a = 0; a < count; ++a) {
      for (std::size_t b = a + 1; b < count; ++b) {
        const bool are_there = balls.radii[a] >= 0.0F && balls.radii[b] >= 0.0F;
        const double nearness = SomeBalls::nearness(balls.center(a), balls.center(b), balls.radii[a] + balls.radii[b]);
        const bool is_found = pairs.contains({a, b});
        if (!are_there || nearness > 1.0 + 3e-5) {
          EXPECT_FALSE(is_found) << a << ' ' << b;
        } else if (nearness <= 1.0) {
          EXPECT_TRUE(is_found) << a << ' ' << b;
        }
      }
    }
    found_in_all += pairs.size();
  }
  EXPECT_GT(found_in_all, 10'000U);
}

}  // namespace
}  // namespace flockstep::trace
