#include "flockstep/drone_model.hpp"

#include "standard.hpp"

namespace flockstep {
namespace {

using namespace testing;

std::string hull_refusal(const std::vector<Vec3>& hull) {
  return testing::refusal([&] { DroneModel model(hull); });
}

TEST(DroneModel, DefaultHasItsDocumentedExtents) {
  const DroneModel drone = DroneModel::quadrotor650();
  EXPECT_EQ(drone.extents().max - drone.extents().min, Vec3(0.93F, 0.59F, 0.20F));
  EXPECT_EQ(drone.extents().max + drone.extents().min, Vec3::Zero());
  EXPECT_LE(drone.hull().size(), static_cast<std::size_t>(kMaxHullVertices));
}

TEST(DroneModel, DefaultIsSymmetricAndNotABox) {
  const DroneModel drone = DroneModel::quadrotor650();
  const auto has = [&](const Vec3& point) {
    return std::find(drone.hull().begin(), drone.hull().end(), point) != drone.hull().end();
  };
  for (const Vec3& vertex : drone.hull()) {
    EXPECT_TRUE(has({-vertex.x(), vertex.y(), vertex.z()}));
    EXPECT_TRUE(has({vertex.x(), -vertex.y(), vertex.z()}));
    EXPECT_TRUE(has({vertex.x(), vertex.y(), -vertex.z()}));
    EXPECT_GT((drone.extents().max - vertex.cwiseAbs()).norm(), 0.05F) << "no vertex is a corner of the box around it";
  }
}

TEST(DroneModel, EveryVertexOfTheDefaultIsOneOfItsHull) {
  const DroneModel drone = DroneModel::quadrotor650();
  for (const Vec3& vertex : drone.hull()) {
    bool extreme = false;
    for (int i = 0; i < 2000 && !extreme; ++i) {
      const auto a = static_cast<float>(i) * 0.7548776662F;  // low-discrepancy sequence of directions
      const auto b = static_cast<float>(i) * 0.5698402910F;
      const float z = 2.0F * (b - std::floor(b)) - 1.0F;
      const float angle = 6.2831853F * a;
      const Vec3 direction(std::cos(angle) * std::sqrt(1 - z * z), std::sin(angle) * std::sqrt(1 - z * z), z);
      extreme = std::all_of(drone.hull().begin(), drone.hull().end(),
                            [&](const Vec3& other) { return other == vertex || other.dot(direction) < vertex.dot(direction); });
    }
    EXPECT_TRUE(extreme) << vertex.transpose();
  }
}

TEST(DroneModel, RadiusHoldsTheHullTightly) {
  const DroneModel drone = DroneModel::quadrotor650();
  double farthest = 0.0;
  for (const Vec3& vertex : drone.hull()) farthest = std::max(farthest, vertex.cast<double>().norm());
  EXPECT_GE(static_cast<double>(drone.radius()), farthest);
  EXPECT_NEAR(static_cast<double>(drone.radius()), farthest, 1e-6);
}

TEST(DroneModel, RefusesHullsWithoutAVolume) {
  const Vec3 x(1, 0, 0);
  const Vec3 y(0, 1, 0);
  const Vec3 z(0, 0, 1);
  const Vec3 o(0, 0, 0);
  EXPECT_EQ(hull_refusal({o, x, y, z}), "accepted");
  EXPECT_TRUE(names(hull_refusal({o, x, y}), "4 to 32"));
  EXPECT_TRUE(names(hull_refusal(std::vector<Vec3>(33, x)), "4 to 32"));
  EXPECT_TRUE(names(hull_refusal({o, x, y, x + y}), "volume"));
  EXPECT_TRUE(names(hull_refusal({o, x, 2 * x, 3 * x}), "volume"));
  EXPECT_TRUE(names(hull_refusal({o, o, o, o}), "volume"));
}

TEST(DroneModel, RefusesPointsThatAreNotFinite) {
  const float inf = std::numeric_limits<float>::infinity();
  for (const float bad : {kNan, inf, 1e30F}) {
    EXPECT_TRUE(names(hull_refusal({{0, 0, 0}, {1, 0, 0}, {0, bad, 0}, {0, 0, 1}}), "hull[2]"));
  }
}

}  // namespace
}  // namespace flockstep
