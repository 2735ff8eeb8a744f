// Slices that are hard to trace: no ray slips between triangles, and edges, faces and segments beside the origin or in the plane.
#include "trace/slices.hpp"

namespace flockstep::trace {
namespace {

using namespace slices;

// Returns the angle at which a cell of a fan that is not even begins.
double begin_of_cell(std::size_t cell) {
  return 2.0 * kPi * static_cast<double>(cell) / static_cast<double>(Fan::kMaxCells) - kPi;
}

std::size_t random_cell(Random& random) { return random.generator()() % Fan::kMaxCells; }

// Returns the angles of everything that may let a ray slip: where edges pass through the plane, as seen from the origin, and the
// ends of the cells of angles; each of them some roundings off, too. frame: of the plane, in its columns.
std::vector<double> critical_angles(const TriangleMesh& mesh, const Vec3d& origin, const Eigen::Matrix3d& frame, Random& random) {
  std::vector<double> angles;
  const auto add = [&](double angle) {
    angles.push_back(angle);
    const double off = std::pow(10.0, static_cast<double>(random.within(-9, -4.5F)));
    for (const double aside : {-off, off}) angles.push_back(angle + aside);
  };
  for (std::size_t triangle = 0; triangle < mesh.triangles.size(); ++triangle) {
    for (std::size_t k = 0; k < 3; ++k) {
      const auto i = static_cast<std::int32_t>(triangle);
      const Vec3d a = frame.transpose() * (corner_of(mesh, i, k) - origin);
      const Vec3d b = frame.transpose() * (corner_of(mesh, i, (k + 1) % 3) - origin);
      if (a.z() * b.z() > 0.0 || (a.z() == 0.0 && b.z() == 0.0)) continue;
      const Vec3d point = (a * b.z() - b * a.z()) / (b.z() - a.z());
      add(std::atan2(point.y(), point.x()));
    }
  }
  std::ranges::shuffle(angles, random.generator());
  if (angles.size() > kMaxRays - 48) angles.resize(kMaxRays - 48);
  while (angles.size() < kMaxRays) add(begin_of_cell(random_cell(random)));
  angles.resize(kMaxRays);
  return angles;
}

// From inside closed meshes, in planes through their corners and in level planes through their faces, towards edges and corners.
TEST(SlicesWatertight, NoRaySlipsBetweenTriangles) {
  const EmbreeDevice device;
  Random random(2 + (part_tried() << 24U));
  constexpr long kFansOfAMesh = 25;
  const long fans = times_tried(200);
  const long of_a_mesh = std::max(kFansOfAMesh, fans / 80);
  long rays = 0;
  TriangleMesh mesh;
  std::unique_ptr<const MeshTree> tree;
  Vec3 place = Vec3::Zero();
  for (long i = 0; i < fans; ++i) {
    const long kind = i / of_a_mesh % 8;
    if (i % of_a_mesh == 0) {
      const int rings = std::array{3, 4, 12, 40}[static_cast<std::size_t>(kind % 4)];
      mesh = kind < 4    ? ball(rings, 2 * rings, rings == 12 ? 1.0F : 0.0F, random)
             : kind == 4 ? cube(3.0F)
             : kind == 5 ? lattice(1, 3.0F, false)
             : kind == 6 ? lattice(4, 0.75F, false)
                         : lattice(4, 1.0F, true);
      place = kind == 1 || kind == 2 ? Vec3(10000, -9000, 500) : Vec3(0, 0, 0);
      for (Vec3& vertex : mesh.vertices) vertex += place;
      tree = std::make_unique<const MeshTree>(tree_of(device, mesh));
    }
    const auto any_vertex = [&] { return mesh.vertices[random.generator()() % mesh.vertices.size()]; };
    Vec3 origin = random.point(0.8F);  // not in a box of the lattice
    if (i % 2 == 0) origin = Vec3::Zero();
    if (kind > 4 && i % 4 == 2) origin = Vec3(0.5F, 0, 0);
    if (i % 5 == 1) origin[static_cast<Eigen::Index>(i % 3)] = 0.0F;
    if (kind > 5 && i % 8 == 4) {  // in the plane of other faces, or just beside it
      const auto level_of = static_cast<float>(static_cast<int>(random.generator()() % 5) - 2);
      origin.z() = (kind == 6 ? 0.75F : 1.0F) * level_of + (i % 16 == 4 ? 0.0F : random.within(-1e-6F, 1e-6F));
    }
    origin += place;
    // The plane: of two axes, or through two corners. Some corner may lie at the end of a cell of the angles.
    const Vec3d a = (any_vertex() - origin).cast<double>(), b = (any_vertex() - origin).cast<double>();
    Eigen::Matrix3d frame = plane_of_axes(i % 4 == 1 ? 2 : 0);
    if (i % 4 > 1 && a.cross(b).norm() > 0.1) {
      frame.col(2) = a.cross(b).normalized();
      frame.col(0) = a.normalized();
      frame.col(1) = frame.col(2).cross(frame.col(0));
      const double off = std::pow(10.0, static_cast<double>(random.within(-9, -4.5F))) * (i % 3 == 0 ? -1.0 : 1.0);
      const double turn = begin_of_cell(random_cell(random)) + off;
      frame = frame * Eigen::AngleAxisd(turn, Vec3d::UnitZ()).toRotationMatrix();
    }
    // As a level fan of a tilted drone, or as a tilted fan of a level drone.
    const bool is_drone_tilted = i % 3 != 0;
    std::vector<double> angles = critical_angles(mesh, origin.cast<double>(), frame, random);
    if (i % 5 == 4) {  // even, so that rays themselves begin cells; one of them points to an edge
      const double step = i % 2 == 0 ? 2.0 * kPi / static_cast<double>(angles.size()) : 0.02;
      const double first = angles.front() - std::floor((angles.front() + kPi) / step) * step;
      for (std::size_t ray = 0; ray < angles.size(); ++ray) angles[ray] = first + step * static_cast<double>(ray);
    }
    std::vector<Vec3d> directions;
    for (const double angle : angles) {
      directions.push_back(is_drone_tilted ? level(angle) : Vec3d(frame * level(angle)));
    }
    const std::size_t at_once = i % 4 == 3 ? 2 : kMaxRays;
    for (std::size_t begin = 0; begin < kMaxRays; begin += at_once) {
      const auto from = directions.begin() + static_cast<std::ptrdiff_t>(begin);
      // Two rays in a plane of their own may be too close to each other to define it.
      if (at_once == 2 && from[0].cross(from[1]).norm() < 1e-3) continue;
      Slice slice({from, from + static_cast<std::ptrdiff_t>(at_once)});
      slice.trace(*tree, origin, is_drone_tilted ? Mat3(frame.cast<float>()) : Mat3(Mat3::Identity()),
                  kWalks[random.generator()() % 3]);
      for (std::size_t ray = 0; ray < at_once; ++ray) {
        ++rays;
        ASSERT_GE(slice.rays->element[ray], 0) << "ray " << ray << " of fan " << i << " at " << slice.direction(ray).transpose();
        ASSERT_TRUE(is_on_its_triangle(slice, ray, mesh)) << "fan " << i;
      }
    }
  }
  testing::tried("slices_watertight", rays);
}

// A beam along the negative first axis is where the angles begin and end.
TEST(SlicesWatertight, NoRaySlipsThroughTheCutOfTheAngles) {
  const EmbreeDevice device;
  for (const bool with_corners_on_axis : {true, false}) {
    const TriangleMesh mesh = with_corners_on_axis ? lattice(2, 2.0F, false) : cube(4.0F);
    const MeshTree tree = tree_of(device, mesh);
    for (const double aside : {0.0, 1e-300, 1e-40, 1e-16, 1e-12, 6e-8, 1e-6, 1e-5, 1e-4}) {
      std::vector<Vec3d> directions;
      for (int i = 0; i < 36; ++i) directions.push_back(level(2.0 * kPi * i / 36.0 - kPi));
      directions.push_back({-1.0, 0.0, 0.0});
      directions.push_back({-1.0, -0.0, 0.0});
      directions.push_back(Vec3d(-1.0, aside, 0.0).normalized());
      directions.push_back(Vec3d(-1.0, -aside, 0.0).normalized());
      Slice slice(directions);
      // Corners exactly on the axis, beside it, and an edge that crosses it.
      for (const Vec3& origin : {Vec3(0, 0, 0), Vec3(0, 0, 0.5F), Vec3(0, 1e-6F, 0), Vec3(0, -1e-6F, 0.5F), Vec3(0.5F, 1, 1)}) {
        for (const SliceWalk walk : kWalks) {
          slice.trace(tree, origin, Mat3::Identity(), walk);
          for (std::size_t ray = 0; ray < directions.size(); ++ray) {
            ASSERT_GE(slice.rays->element[ray], 0) << "ray " << ray << " from " << origin.transpose();
            const Vec3d end = slice.origin() + static_cast<double>(slice.rays->t_hit[ray]) * directions[ray];
            ASSERT_NEAR(end.cwiseAbs().maxCoeff(), 4.0, 3e-6) << "ray " << ray << " from " << origin.transpose();
          }
        }
      }
    }
  }
}

// Walls around the origin, on the sides of a triangle whose corners are 5 m away: one at an angle, the others 2 rad beside it.
TriangleMesh walls_with_corner_at(double angle) {
  TriangleMesh mesh;
  for (const double side : {0.0, 2.0, -2.0}) {
    const Vec3d corner = 5.0 * level(angle + side);
    for (const float z : {-1.0F, 1.0F}) mesh.vertices.emplace_back(corner.cast<float>().x(), corner.cast<float>().y(), z);
  }
  for (int i = 0; i < 6; i += 2) {
    mesh.triangles.push_back({i, i + 1, (i + 2) % 6});
    mesh.triangles.push_back({i + 1, (i + 3) % 6, (i + 2) % 6});
  }
  return mesh;
}

// Returns the distance from the origin to these walls, by the distances from the origin to the walls' lines.
double distance_to_walls(double corner, double angle) {
  double distance = oracle::kNever;
  for (const auto& [middle, half] : {std::pair{corner + 1.0, 1.0}, {corner - 1.0, 1.0}, {corner + kPi, kPi - 2.0}}) {
    const double along = std::cos(angle - middle);
    if (along > 0.0) distance = std::min(distance, 5.0 * std::cos(half) / along);
  }
  return distance;
}

// Two walls meet in a corner just beside the beginning of a cell: the rays between the two must hit one of them.
TEST(SlicesWatertight, NoRaySlipsAtTheEndOfACell) {
  const EmbreeDevice device;
  for (std::size_t cell = 0; cell <= Fan::kMaxCells; ++cell) {
    const double turn = begin_of_cell(cell);
    for (const double ahead : {-8e-6, -3e-6, 3e-6, 8e-6}) {
      const MeshTree tree = tree_of(device, walls_with_corner_at(turn + ahead));
      std::vector<Vec3d> directions;
      for (int i = -20; i <= 20; ++i) directions.push_back(level(turn + 5e-7 * i));
      Slice beams(directions);
      ASSERT_FALSE(beams.fan->is_even);
      for (const SliceWalk walk : kWalks) {
        beams.trace(tree, Vec3::Zero(), Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < directions.size(); ++ray) {
          ASSERT_NEAR(static_cast<double>(beams.rays->t_hit[ray]), 5.0, 1e-3) << "ray " << ray << " of cell " << cell;
        }
      }
    }
  }
}

// The rays of an even fan lie at the beginnings of its cells, up to rounding. Two walls meet in a corner just beside one of them.
TEST(SlicesWatertight, NoRaySlipsAtTheBeginningOfAnEvenFansCell) {
  const EmbreeDevice device;
  Random random(11 + (part_tried() << 24U));
  const long fans = times_tried(500);
  for (long i = 0; i < fans; ++i) {
    const std::size_t count = i % 3 == 0 ? kMaxRays : 2 + random.generator()() % (kMaxRays - 1);
    const double most = i % 2 == 0 ? 2.0 * kPi / static_cast<double>(count) : 2.0 / static_cast<double>(kMaxRays);
    const double step = i % 4 < 2 ? most : most * static_cast<double>(random.within(0.5F, 1.0F));
    const double width = step * static_cast<double>(count - 1);
    const double first = static_cast<double>(random.within(0, 1)) * (2.0 * kPi - width) - kPi;
    std::vector<double> angles;
    std::vector<Vec3d> directions;
    for (std::size_t ray = 0; ray < count; ++ray) {
      angles.push_back(first + step * static_cast<double>(ray) + static_cast<double>(random.within(-4e-7F, 4e-7F)));
      directions.push_back(level(angles.back()));
    }
    Slice beams(directions);
    ASSERT_TRUE(beams.fan->is_even) << count << " rays";
    const std::size_t at = random.generator()() % count;
    const double tolerance = rounding_of(5.1) / std::cos(kPi - 2.0);  // at most 5.1 m to a corner, and hit at that angle
    for (const double ahead : {-8e-6, -3e-6, -3e-7, 0.0, 3e-7, 3e-6, 8e-6}) {
      const double corner = angles[at] + ahead;
      const MeshTree tree = tree_of(device, walls_with_corner_at(corner));
      for (const SliceWalk walk : kWalks) {
        beams.trace(tree, Vec3::Zero(), Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < count; ++ray) {
          ASSERT_NEAR(static_cast<double>(beams.rays->t_hit[ray]), distance_to_walls(corner, angles[ray]), tolerance)
              << "ray " << ray << " of " << count << ", corner beside ray " << at;
        }
      }
    }
  }
}

// -- Hard worlds.

// Faces in the fan's plane are not above it: a slice is what a plane just above it, along its normal, sees.
TEST(MeshSlices, FacesInThePlaneAreBelowIt) {
  const EmbreeDevice device;
  const auto world = make_world({}, {}, lattice(4, 1.0F, true));
  const MeshTree tree = tree_of(device, world->triangles());
  Random random(4);
  std::size_t compared = 0, rays = 0;
  for (int i = 0; i < 60; ++i) {
    const Eigen::Matrix3d plane = plane_of_axes(static_cast<std::size_t>(i) % 3);
    std::vector<Vec3d> directions;
    for (int k = 0; k < 100; ++k) directions.push_back(plane * level(static_cast<double>(random.within(-3.2F, 3.2F))));
    Slice slice(directions);
    const auto step = [&] { return static_cast<float>(static_cast<int>(random.generator()() % 7)) - 3.0F; };
    Vec3 origin(step(), step(), step());
    if (i % 2 == 0) origin += 0.25F * Vec3(plane.col(0).cast<float>()) + 0.125F * Vec3(plane.col(1).cast<float>());
    slice.trace(tree, origin, Mat3::Identity(), kWalks[static_cast<std::size_t>(i) % 3]);
    const Vec3d above = slice.origin() + 1e-7 * slice.normal();
    for (std::size_t ray = 0; ray < directions.size(); ++ray) {
      ++rays;
      const Vec3d& direction = directions[ray];
      const oracle::Hit hit = oracle::nearest(*world, above, direction, 100.0);
      const Vec3d aside = 1e-5 * slice.normal().cross(direction);
      const oracle::Hit left = oracle::nearest(*world, above + aside, direction, 100.0);
      const oracle::Hit right = oracle::nearest(*world, above - aside, direction, 100.0);
      const double moves = std::max(std::abs(left.t - hit.t), std::abs(right.t - hit.t));
      if (moves > 1e-3 || hit.t < 1e-3) continue;
      ++compared;
      ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), hit.t, 1e-5 + moves)
          << "ray " << ray << " from " << origin.transpose();
    }
  }
  EXPECT_GT(compared, 3 * rays / 4);
}

// An edge or a corner at the origin is hit at distance 0 or not at all; surfaces behind it are hit at their distance.
TEST(MeshSlices, AnOriginOnAnEdgeSeesWhatIsBehind) {
  const EmbreeDevice device;
  TriangleMesh mesh = cube(4.0F);
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (const Vec3& corner : {Vec3(1, 1, -1), Vec3(1, 1, 1), Vec3(2, 1.5F, 0), Vec3(1.5F, 2, 0)}) mesh.vertices.push_back(corner);
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 1, first + 3});
  complete(mesh);
  const auto world = make_world({}, {}, mesh);
  const MeshTree tree = tree_of(device, world->triangles());
  std::vector<Vec3d> directions;
  for (int i = 0; i < 90; ++i) directions.push_back(level(2.0 * kPi * (i + 0.3) / 90.0));
  Slice slice(directions);
  for (const float z : {0.0F, 0.25F, -1.0F, 1.0F, 0.999F}) {
    for (const float near : {0.0F, 0.01F}) {
      slice.rays->near = near;
      for (const SliceWalk walk : kWalks) {
        slice.trace(tree, Vec3(1, 1, z), Mat3::Identity(), walk);
        for (std::size_t ray = 0; ray < directions.size(); ++ray) {
          const double t = static_cast<double>(slice.rays->t_hit[ray]);
          if (near == 0.0F && t == 0.0) {
            ASSERT_GE(slice.rays->element[ray], 12);
            continue;
          }
          const Vec3d from = slice.origin() + 0.01 * directions[ray];
          const oracle::Hit hit = oracle::nearest(*world, from, directions[ray], 100.0);
          if (!oracle::is_clear_cut(*world, hit, from, directions[ray], 100.0)) continue;
          ASSERT_NEAR(t, 0.01 + hit.t, 1e-5) << "ray " << ray << " at height " << z;
        }
      }
    }
  }
}

// Beside the origin, 10 micrometres away from one end of a segment of 100 m, a hit has a distance, and only for the ray towards
// it.
TEST(MeshSlices, AnEndOfASegmentBesideTheOrigin) {
  const EmbreeDevice device;
  ASSERT_GT(hwy::SupportedAndGeneratedTargets().size(), 1U);
  Random random(13);
  int hits = 0;
  for (int i = 0; i < 200; ++i) {
    // A level cut from a far end to a near one. Both ends are halfway between a corner above the plane and one below.
    const double along = static_cast<double>(random.within(-3, 3)), turn = static_cast<double>(random.within(0.02F, 0.1F));
    const Vec3 far = (100.0 * level(along)).cast<float>();
    const Vec3 near = (std::pow(10.0, static_cast<double>(random.within(-7, -4))) * level(along + kPi - turn)).cast<float>();
    TriangleMesh mesh;
    mesh.vertices = {Vec3(0, 0, 1), Vec3(2.0F * far.x(), 2.0F * far.y(), -1), Vec3(2.0F * near.x(), 2.0F * near.y(), -1)};
    mesh.triangles = {{0, 1, 2}};
    complete(mesh);
    const MeshTree tree = tree_of(device, mesh);
    // Rays within the segment's angles close to the near end, the opposite ones, and others.
    std::vector<Vec3d> directions;
    for (const double share : {0.001, 0.3, 0.7}) {
      directions.push_back(level(along + kPi - turn - share * (kPi - turn)));
      directions.push_back(-directions.back());
    }
    while (directions.size() < 24) directions.push_back(level(static_cast<double>(random.within(-3.14F, 3.14F))));
    const auto from = far.head<2>().cast<double>(), to = near.head<2>().cast<double>();
    std::vector<float> first;
    on_every_target([&] {
      Slice slice(directions);
      slice.trace(tree, Vec3::Zero(), Mat3::Identity(), kWalks[static_cast<std::size_t>(i) % 3]);
      if (first.empty()) first.assign(slice.rays->t_hit, slice.rays->t_hit + directions.size());
      ASSERT_TRUE(same_bits(std::span(slice.rays->t_hit, directions.size()), std::span<const float>(first)));
      for (std::size_t ray = 0; ray < directions.size(); ++ray) {
        const Eigen::Vector2d d = directions[ray].head<2>();
        // p + share (q - p) = t d, by Cramer's rule.
        const Eigen::Vector2d across(-d.y(), d.x());
        const double share = from.dot(across) / (from - to).dot(across);
        const double t = from.dot(d) + share * (to - from).dot(d);
        if (std::min(std::abs(share), std::abs(share - 1.0)) < 1e-6 && std::abs(t) > 1.0) continue;  // the far end
        if (share < 0.0 || share > 1.0 || t < 0.0) {
          ASSERT_EQ(slice.rays->element[ray], -1) << "ray " << ray << " of mesh " << i;
        } else {
          ++hits;
          ASSERT_EQ(slice.rays->element[ray], 0) << "ray " << ray << " of mesh " << i << " at " << t;
          ASSERT_NEAR(static_cast<double>(slice.rays->t_hit[ray]), t, 1e-4 * t) << "ray " << ray << " of mesh " << i;
        }
      }
    });
  }
  EXPECT_GT(hits, 1000);
}

// -- Planes and fans.

TEST(MeshSlices, KnowDirectionsInAPlane) {
  Random random(10);
  int wide = 0;
  for (int i = 0; i < 200; ++i) {
    std::vector<Vec3d> directions = random_fan(random);
    EXPECT_TRUE(are_in_plane(directions)) << directions.size();
    const Vec3d normal = make_fan(directions, Eigen::Matrix3d::Identity()).to_sensor.col(2).cast<double>();
    for (const Vec3d& direction : directions) EXPECT_LT(std::abs(normal.dot(direction)), 2e-6);
    const bool is_wide =
        std::ranges::any_of(directions, [&](const Vec3d& direction) { return direction.cross(directions.front()).norm() > 0.1; });
    if (!is_wide) continue;  // a tilted plane contains one more direction nearly as well
    ++wide;
    directions.push_back((directions.front() + 1e-4 * normal).normalized());
    EXPECT_FALSE(are_in_plane(directions)) << directions.size();
  }
  EXPECT_GT(wide, 100);
  EXPECT_TRUE(are_in_plane(std::vector{Vec3d(Vec3d::UnitX())}));
  EXPECT_TRUE(are_in_plane(std::vector{Vec3d(1, 1, 1).normalized()}));
}

// Far from the origin, and with all lengths multiplied by a power of two: the same bits, since the differences of coordinates are
// exact.
TEST(MeshSlices, ScaleAndPlaceDoNotMatter) {
  const EmbreeDevice device;
  Random random(6);
  const auto snapped = [](const Vec3& v) { return Vec3((1024.0F * v).array().round() / 1024.0F); };
  std::size_t hits = 0, rays = 0;
  for (int round = 0; round < 30; ++round) {
    TriangleMesh mesh = round % 3 == 0 ? lattice(4, 1.0F, true) : random_mesh(random);
    for (Vec3& vertex : mesh.vertices) vertex = snapped(vertex);
    const Vec3 origin = snapped(random.point(3.0F));
    const Mat3 rotation = random_pose(random);
    Slice slice(random_fan(random), random_mounting(random));
    slice.trace(tree_of(device, mesh), origin, rotation);
    const auto expect_same = [&](float scale, const Vec3& offset) {
      TriangleMesh other = mesh;
      for (Vec3& vertex : other.vertices) vertex = scale * vertex + offset;
      Slice same(slice.directions, slice.mounting);
      same.rays->range = scale * slice.rays->range;
      same.trace(tree_of(device, other), scale * origin + offset, rotation, kWalks[static_cast<std::size_t>(round / 3) % 3]);
      for (std::size_t ray = 0; ray < same.rays->count; ++ray) {
        same.rays->t_hit[ray] /= scale;
        ASSERT_TRUE(same_hit(*same.rays, ray, *slice.rays, ray)) << "round " << round << ", scale " << scale;
        hits += slice.rays->element[ray] >= 0;
      }
      rays += same.rays->count;
    };
    expect_same(1.0F, Vec3(10240, -10240, 0));
    expect_same(1.0F, Vec3(-10240, 10240, 10240));
    for (const float scale : {0x1p-12F, 0x1p-8F, 0x1p8F, 0x1p16F}) expect_same(scale, Vec3::Zero());
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_GT(hits, rays / 4);
}

// Among copies of a triangle, the one with the lowest number is met. There are more copies than a leaf holds.
TEST(MeshSlices, TheFirstOfEqualTrianglesIsMet) {
  const EmbreeDevice device;
  Random random(5);
  for (int round = 0; round < 20; ++round) {
    const TriangleMesh once = round % 2 == 0 ? cube(4.0F) : ball(3, 6, 0.5F, random);
    TriangleMesh often = once;
    for (int copy = 0; copy < 40; ++copy) {
      often.triangles.insert(often.triangles.end(), once.triangles.begin(), once.triangles.end());
    }
    complete(often);
    const MeshTree tree = tree_of(device, once), copies = tree_of(device, often);
    const Vec3 origin = random.point(1.0F);
    const Mat3 rotation = random_pose(random);
    for (const std::size_t count : {std::size_t{4}, kMaxRays}) {  // met one by one and in vectors
      std::vector<Vec3d> directions;
      for (std::size_t i = 0; i < count; ++i) directions.push_back(level(static_cast<double>(random.within(-3, 3))));
      Slice slice(directions), same(directions);
      slice.trace(tree, origin, rotation);
      for (const SliceWalk walk : kWalks) {
        same.trace(copies, origin, rotation, walk);
        for (std::size_t ray = 0; ray < count; ++ray) {
          ASSERT_TRUE(same_hit(*same.rays, ray, *slice.rays, ray)) << "round " << round;
        }
      }
    }
  }
}

}  // namespace
}  // namespace flockstep::trace
