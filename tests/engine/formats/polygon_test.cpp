#include <gtest/gtest.h>

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <numbers>
#include <random>
#include <vector>

#include "formats/mesh_files.hpp"

namespace flockstep {
namespace {

using Point = std::array<double, 2>;
using CornerTriples = std::vector<CornerTriple>;

double turn(const Point& a, const Point& b, const Point& c) {
  return (b[0] - a[0]) * (c[1] - a[1]) - (b[1] - a[1]) * (c[0] - a[0]);
}

double shoelace(const std::vector<Point>& polygon) {
  double sum = 0.0;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    sum += 0.5 * (a[0] * b[1] - a[1] * b[0]);
  }
  return sum;
}

// Returns whether a point is inside, by the number of edges that a ray to the right crosses.
bool is_inside(const Point& p, const std::vector<Point>& polygon) {
  bool inside = false;
  for (std::size_t i = 0; i < polygon.size(); ++i) {
    const Point &a = polygon[i], &b = polygon[(i + 1) % polygon.size()];
    const double along = (p[1] - a[1]) / (b[1] - a[1]);
    if ((a[1] > p[1]) != (b[1] > p[1]) && p[0] < a[0] + along * (b[0] - a[0])) inside = !inside;
  }
  return inside;
}

// Checks the polygon in a plane that depends on the seed, in a random order and from a random first corner.
void expect_covered(std::vector<Point> polygon, unsigned seed) {
  std::mt19937 random(seed);
  std::uniform_real_distribution<double> uniform(-1.0, 1.0);
  std::rotate(polygon.begin(), polygon.begin() + static_cast<std::ptrdiff_t>(random() % polygon.size()), polygon.end());
  if (random() % 2 == 0) std::reverse(polygon.begin(), polygon.end());
  const double area = shoelace(polygon);
  const Eigen::Quaterniond turned =
      Eigen::Quaterniond(uniform(random), uniform(random), uniform(random), uniform(random)).normalized();
  const Eigen::Vector3d origin(uniform(random), uniform(random), uniform(random));
  std::vector<Vec3> corners;
  for (const Point& p : polygon) corners.push_back((origin + turned * Eigen::Vector3d(p[0], p[1], 0.0)).cast<float>());

  const CornerTriples triangles = cut_polygon(corners);
  ASSERT_EQ(triangles.size(), polygon.size() - 2);
  double sum = 0.0;
  for (const auto& [i, j, k] : triangles) {
    const Point &a = polygon[i], &b = polygon[j], &c = polygon[k];
    const double part = 0.5 * turn(a, b, c);
    EXPECT_GE(part / area, -1e-6);  // none is flipped
    sum += std::abs(part);
    const Point middle{(a[0] + b[0] + c[0]) / 3.0, (a[1] + b[1] + c[1]) / 3.0};
    EXPECT_TRUE(is_inside(middle, polygon) || std::abs(part / area) < 1e-5);
  }
  EXPECT_NEAR(sum / std::abs(area), 1.0, 1e-5);
}

// The same cut as by tinyobjloader 2.0.0rc10.
TEST(Polygon, ConvexOnesKeepTheTrianglesOfTinyobjloader) {
  const std::vector<Vec3> around{{-1, -1, 0}, {1, -1, 0}, {2, 0, 0}, {1, 1, 0}, {-1, 1, 0}, {-2, 0, 0}};
  EXPECT_EQ(cut_polygon(around), (CornerTriples{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}}));
  const std::vector<Vec3> beside{{5, 0, 0}, {7, 0, 0}, {8, 2, 0}, {6, 4, 0}, {4, 2, 0}};
  EXPECT_EQ(cut_polygon(beside), (CornerTriples{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}}));
  const std::vector<Vec3> backwards{{5, 0, 3}, {4, 2, 3}, {6, 4, 3}, {8, 2, 3}, {7, 0, 3}};
  EXPECT_EQ(cut_polygon(backwards), (CornerTriples{{2, 3, 4}, {2, 4, 0}, {0, 1, 2}}));
  const std::vector<Vec3> straight{{1, 1, 0}, {2, 1, 0}, {3, 1, 0}, {3, 2, 0}, {3, 3, 0}, {1, 3, 0}};
  EXPECT_EQ(cut_polygon(straight), (CornerTriples{{0, 1, 2}, {2, 3, 4}, {2, 4, 5}, {0, 2, 5}}));
  const std::vector<Vec3> upright{{-3, 5, 0}, {-3, 7, 1}, {-3, 9, 4}, {-3, 8, 7}, {-3, 6, 8}, {-3, 4, 6}, {-3, 3, 3}};
  EXPECT_EQ(cut_polygon(upright), (CornerTriples{{0, 1, 2}, {0, 2, 3}, {0, 3, 4}, {0, 4, 5}, {0, 5, 6}}));
}

TEST(Polygon, QuadsAreCutAtTheShorterDiagonalThatIsInside) {
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{0, 0, 0}, {1, 0, 0}, {1, 1, 0}, {0, 1, 0}}), (CornerTriples{{0, 1, 3}, {1, 2, 3}}));
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{0, 0, 0}, {3, -1, 0}, {4, 0, 0}, {3, 1, 0}}), (CornerTriples{{0, 1, 3}, {1, 2, 3}}));
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{3, -1, 0}, {4, 0, 0}, {3, 1, 0}, {0, 0, 0}}), (CornerTriples{{0, 1, 2}, {0, 2, 3}}));
  // An arrowhead, whose shorter diagonal lies outside.
  EXPECT_EQ(cut_polygon(std::vector<Vec3>{{0, 0, 0}, {4, -1, 0}, {3, 0, 0}, {4, 1, 0}}), (CornerTriples{{0, 1, 2}, {0, 2, 3}}));
}

TEST(Polygon, ConcaveOnesAreCoveredExactly) {
  std::mt19937 random(1);
  std::uniform_real_distribution<double> uniform(0.2, 1.0);
  for (unsigned seed = 0; seed < 500; ++seed) {
    std::vector<Point> star, band;
    const std::size_t count = 4 + seed % 40;
    for (std::size_t i = 0; i < count; ++i) {
      const double angle = 2.0 * std::numbers::pi * static_cast<double>(i) / static_cast<double>(count), radius = uniform(random);
      star.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
    expect_covered(star, seed);
    const double width = 0.3 * uniform(random);  // for a spiral
    for (std::size_t i = 0; i < 2 * count; ++i) {
      const double angle = 0.4 * static_cast<double>(i < count ? i : 2 * count - 1 - i);
      const double radius = 1.0 + 0.2 * angle + (i < count ? 0.0 : width);
      band.push_back({radius * std::cos(angle), radius * std::sin(angle)});
    }
    expect_covered(band, seed);
  }
}

// A bridge is an edge used in both directions that connects a hole to the outline.
TEST(Polygon, CornersMayTouchAsThoseOfHolesAndBridges) {
  const std::vector<Point> one{{0, 0}, {1, 0}, {1, 1}, {1, 2}, {2, 2}, {2, 1}, {1, 1}, {1, 0}, {3, 0}, {3, 3}, {0, 3}};
  const std::vector<Point> slanted{{0, 0}, {4, 0}, {4, 4}, {0, 4}, {0, 0}, {1, 1}, {1, 3}, {3, 3}, {3, 1}, {1, 1}};
  const std::vector<Point> pinched{{0, 0}, {1, 0}, {4, 4}, {2.5, 0}, {4, 0}, {4, 4}, {0, 4}};  // a hole that touches a corner
  ASSERT_EQ(shoelace(one), 8.0);
  ASSERT_EQ(shoelace(pinched), 13.0);
  ASSERT_EQ(shoelace(slanted), 12.0);
  for (unsigned seed = 0; seed < 100; ++seed) {
    expect_covered(one, seed);
    expect_covered(slanted, seed);
    expect_covered(pinched, seed);
  }
}

// Includes polygons without area, and self-intersecting ones.
TEST(Polygon, AnyCornersBecomeTwoTrianglesFewer) {
  std::mt19937 random(1);
  for (int i = 0; i < 300; ++i) {
    const bool is_rough = i % 2 == 0;
    std::vector<Vec3> corners(3 + random() % (i % 30 == 0 ? 998 : 20));
    for (Vec3& corner : corners) {
      for (float& coordinate : corner) coordinate = static_cast<float>(is_rough ? random() % 3 : random());
    }
    const CornerTriples triangles = cut_polygon(corners);
    ASSERT_EQ(triangles.size(), corners.size() - 2);
    std::vector<bool> is_used(corners.size());
    for (const CornerTriple& triangle : triangles) {
      for (const std::size_t corner : triangle) is_used.at(corner) = true;
    }
    EXPECT_EQ(std::count(is_used.begin(), is_used.end(), false), 0);
  }
}

}  // namespace
}  // namespace flockstep
