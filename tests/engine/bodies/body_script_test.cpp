// Scripts of bodies, against closed forms written down here, finite differences and statistics.
#include "bodies/body_script.hpp"

#include "allocation_counter.hpp"
#include "flockstep/body.hpp"
#include "standard.hpp"

namespace flockstep::bodies {
namespace {

using namespace testing;
using Eigen::Quaterniond;
using Eigen::Vector3d;
using Points = std::vector<std::array<float, 3>>;

constexpr double kPi = std::numbers::pi;
const Quaterniond kTurned(0.5, 0.5, -0.5, 0.5);

BodyConfig body_with(BodyMotionKind kind) {
  BodyConfig body{.position_m = {3.0F, 1.0F, 2.0F}, .quat_wxyz = {0.5F, 0.5F, -0.5F, 0.5F}};
  body.motion.kind = kind;
  return body;
}

BodyConfig on_route(const Points& points, BodyRoute route, float corner_radius_m = 0.0F, float speed_mps = 1.0F) {
  BodyConfig body = body_with(BodyMotionKind::waypoints);
  body.motion.points_m = points;
  body.motion.route = route;
  body.motion.corner_radius_m = corner_radius_m;
  body.motion.speed_mps = speed_mps;
  return body;
}

BodyConfig facing_route(const Points& points, BodyRoute route, float corner_radius_m = 0.0F) {
  BodyConfig body = on_route(points, route, corner_radius_m);
  body.quat_wxyz = {1, 0, 0, 0};
  body.motion.faces_travel = true;
  return body;
}

Moment at(const BodyConfig& body, double time_s, const ScriptKey& key = {}) {
  body.validate();
  return BodyScript(body).at(time_s, key);
}

Vector3d position_at(const BodyConfig& body, double time_s, const ScriptKey& key = {}) {
  return at(body, time_s, key).pose.position.cast<double>();
}

Vector3d x_axis_at(const BodyConfig& body, double time_s) {
  return at(body, time_s).pose.rotation.cast<double>() * Vector3d::UnitX();
}

void expect_near(const Vector3d& got, const Vector3d& expected, double tolerance, const char* what = "") {
  EXPECT_LT((got - expected).norm(), tolerance) << what << ": expected " << expected.transpose() << ", got " << got.transpose();
}

void expect_places(const BodyConfig& body, const std::vector<std::pair<double, Vector3d>>& places) {
  for (const auto& [time_s, place] : places) expect_near(position_at(body, time_s), place, 1e-6);
}

void expect_x_axes(const BodyConfig& body, const std::vector<std::pair<double, Vector3d>>& axes) {
  for (const auto& [time_s, axis] : axes) expect_near(x_axis_at(body, time_s), axis, 1e-6);
}

void expect_same_rotation(const Quat& got, const Quaterniond& expected, double tolerance) {
  EXPECT_LT(got.cast<double>().angularDistance(expected), tolerance);
}

// Compares the velocity with differences of poses around a time.
void expect_derivative(const BodyConfig& body, double time_s, const ScriptKey& key = {}) {
  constexpr double kStep = 1e-2;
  const BodyScript script(body);
  const Moment before = script.at(time_s - kStep, key), now = script.at(time_s, key), after = script.at(time_s + kStep, key);
  const Vector3d linear = (after.pose.position - before.pose.position).cast<double>() / (2.0 * kStep);
  expect_near(now.velocity.linear.cast<double>(), linear, 2e-3 * (1.0 + linear.norm()), "velocity");
  const Quaterniond first = before.pose.rotation.cast<double>(), last = after.pose.rotation.cast<double>();
  const Eigen::AngleAxisd turn((first.conjugate() * last).normalized());
  double angle = turn.angle();
  if (angle > kPi) angle -= 2.0 * kPi;
  const Vector3d angular = turn.axis() * angle / (2.0 * kStep);
  expect_near(now.velocity.angular.cast<double>(), angular, 2e-3 * (1.0 + angular.norm()), "angular velocity");
}

BodyConfig orbiting(float period_s) {
  BodyConfig body = body_with(BodyMotionKind::orbit);
  body.motion.center_m = {1.0F, 1.0F, 0.5F};
  body.motion.axis = {0.0F, 0.0F, 3.0F};
  body.motion.period_s = period_s;
  return body;
}

// -- orbit, hinge and slider

TEST(BodyScript, OrbitsInACircle) {
  const BodyConfig body = orbiting(8.0F);
  for (double time = 0.0; time < 20.0; time += 0.37) {
    const double angle = 2.0 * kPi * time / 8.0;
    const Moment moment = at(body, time);
    expect_near(moment.pose.position.cast<double>(), {1.0 + 2.0 * std::cos(angle), 1.0 + 2.0 * std::sin(angle), 2.0}, 1e-6);
    expect_same_rotation(moment.pose.rotation, Quaterniond(std::cos(angle / 2), 0, 0, std::sin(angle / 2)) * kTurned, 1e-6);
    const double speed = 2.0 * kPi * 2.0 / 8.0;
    expect_near(moment.velocity.linear.cast<double>(), {-speed * std::sin(angle), speed * std::cos(angle), 0.0}, 1e-6);
    expect_near(moment.pose.rotation.cast<double>() * moment.velocity.angular.cast<double>(), {0, 0, 2.0 * kPi / 8.0}, 1e-6);
  }
}

TEST(BodyScript, AnOrbitWithoutARadiusSpins) {
  BodyConfig body = orbiting(4.0F);
  body.motion.center_m = body.position_m;
  const Moment moment = at(body, 1.0);
  expect_near(moment.pose.position.cast<double>(), {3, 1, 2}, 1e-12);
  expect_near(moment.velocity.linear.cast<double>(), {0, 0, 0}, 1e-12);
  expect_same_rotation(moment.pose.rotation, Quaterniond(std::sqrt(0.5), 0, 0, std::sqrt(0.5)) * kTurned, 1e-6);
}

TEST(BodyScript, AHingeOpensAndCloses) {
  BodyConfig body = orbiting(6.0F);
  body.motion.kind = BodyMotionKind::hinge;
  body.motion.angle_deg = 90.0F;
  const double angle = 0.25 * kPi * (1.0 - std::cos(2.0 * kPi / 6.0)), root = std::sqrt(2.0);
  expect_places(body, {{0.0, {3, 1, 2}}, {1.5, {1.0 + root, 1.0 + root, 2.0}}, {3.0, {1, 3, 2}}, {6.0, {3, 1, 2}}});
  expect_places(body, {{7.0, {1.0 + 2.0 * std::cos(angle), 1.0 + 2.0 * std::sin(angle), 2.0}}});
  expect_near(at(body, 3.0).velocity.linear.cast<double>(), {0, 0, 0}, 1e-6);
}

TEST(BodyScript, ASliderGoesAndReturns) {
  BodyConfig body = body_with(BodyMotionKind::slider);
  body.motion.travel_m = {0.0F, 4.0F, -2.0F};
  body.motion.period_s = 5.0F;
  for (double time = 0.0; time < 12.0; time += 0.31) {
    const double part = (1.0 - std::cos(2.0 * kPi * time / 5.0)) / 2.0;
    const Moment moment = at(body, time);
    expect_near(moment.pose.position.cast<double>(), {3.0, 1.0 + 4.0 * part, 2.0 - 2.0 * part}, 1e-6);
    expect_same_rotation(moment.pose.rotation, kTurned, 1e-9);
    expect_near(moment.velocity.linear.cast<double>(), Vector3d(0, 4, -2) * (kPi / 5.0 * std::sin(2.0 * kPi * time / 5.0)), 1e-6);
  }
}

TEST(BodyScript, APhaseShiftsTheTime) {
  for (const auto kind : {BodyMotionKind::orbit, BodyMotionKind::hinge, BodyMotionKind::slider, BodyMotionKind::random_walk}) {
    BodyConfig body = orbiting(8.0F);
    body.motion.kind = kind;
    body.motion.travel_m = {1.0F, 2.0F, 3.0F};
    body.motion.box_max_m = {1.0F, 2.0F, 3.0F};
    BodyConfig shifted = body;
    shifted.motion.phase = 0.25F;
    for (const double time : {0.0, 3.3, 5.9, 6.1, 77.7}) {
      expect_near(position_at(shifted, time), position_at(body, time + 2.0), 1e-6);
    }
  }
}

// -- waypoints

const Points kSquare{{0, 0, 1}, {4, 0, 1}, {4, 4, 1}, {0, 4, 1}};

TEST(BodyScript, FollowsALoop) {
  const BodyConfig body = on_route(kSquare, BodyRoute::loop, 0.0F, 2.0F);
  expect_places(body, {{0.0, {0, 0, 1}}, {1.0, {2, 0, 1}}, {3.0, {4, 2, 1}}, {7.5, {0, 1, 1}}, {9.0, {2, 0, 1}}});
  expect_near(at(body, 7.5).velocity.linear.cast<double>(), {0, -2, 0}, 1e-6);
}

TEST(BodyScript, ReturnsTheSameWay) {
  const BodyConfig body = on_route({{0, 0, 1}, {4, 0, 1}, {4, 2, 1}}, BodyRoute::back_and_forth);
  expect_places(
      body, {{0, {0, 0, 1}}, {2, {2, 0, 1}}, {4, {4, 0, 1}}, {6, {4, 2, 1}}, {8, {4, 0, 1}}, {10, {2, 0, 1}}, {12, {0, 0, 1}}});
  expect_near(at(body, 10.0).velocity.linear.cast<double>(), {-1, 0, 0}, 1e-6);
  BodyConfig halfway = body;
  halfway.motion.phase = 0.5F;
  expect_near(position_at(halfway, 0.0), {4, 2, 1}, 1e-6);
}

TEST(BodyScript, StaysAtTheEnd) {
  const BodyConfig body = on_route({{0, 0, 1}, {4, 0, 1}, {4, 2, 1}}, BodyRoute::once);
  expect_near(position_at(body, 5.0), {4, 1, 1}, 1e-6);
  for (const double time : {6.0, 7.0, 1e6}) {
    expect_near(position_at(body, time), {4, 2, 1}, 1e-6);
    expect_near(at(body, time).velocity.linear.cast<double>(), {0, 0, 0}, 1e-12);
  }
  BodyConfig over = body;
  over.motion.phase = 1.0F;
  expect_near(position_at(over, 0.0), {4, 2, 1}, 1e-6);
}

TEST(BodyScript, RoundsCorners) {
  // Legs of 4 m with arcs of radius 1: a way of 4 x 2 + 2 pi. The loop starts where the arc of the first point ends.
  const BodyConfig body = on_route(kSquare, BodyRoute::loop, 1.0F);
  const double lap = 8.0 + 2.0 * kPi;
  const double half = std::sqrt(0.5), middle = 2.0 + kPi / 4.0;  // of an arc
  expect_places(body, {{0, {1, 0, 1}}, {2, {3, 0, 1}}, {middle, {3 + half, 1 - half, 1}}, {2.0 + kPi / 2.0, {4, 1, 1}}});
  expect_near(at(body, middle).velocity.linear.cast<double>(), {half, half, 0}, 1e-6);
  for (const double time : {0.3, 2.5, 9.9}) expect_near(position_at(body, time + 3.0 * lap), position_at(body, time), 1e-5);
}

TEST(BodyScript, AnArcUsesAtMostHalfOfEachLeg) {
  // The arcs of radius 2 touch in the middles of the sides: a circle.
  const BodyConfig body = on_route(kSquare, BodyRoute::loop, 100.0F);
  for (double time = 0.0; time < 30.0; time += 0.7) {
    EXPECT_NEAR((position_at(body, time) - Vector3d(2, 2, 1)).norm(), 2.0, 1e-5);
  }
  // The short leg limits the arc of the corner: with 90 degrees the radius is half of 1 m.
  const BodyConfig uneven = on_route({{0, 0, 0}, {10, 0, 0}, {10, 1, 0}}, BodyRoute::once, 3.0F);
  expect_places(uneven, {{9.5, {9.5, 0, 0}}, {9.5 + kPi / 4.0, {10, 0.5, 0}}});
}

TEST(BodyScript, FacesItsTravel) {
  const BodyConfig body = facing_route(kSquare, BodyRoute::loop, 1.0F);
  const double half = std::sqrt(0.5);
  expect_x_axes(body, {{1.0, {1, 0, 0}}, {2.0 + kPi / 4.0, {half, half, 0}}, {2.0 + kPi / 2.0 + 1.0, {0, 1, 0}}});
  expect_near(at(body, 2.5).velocity.angular.cast<double>(), {0, 0, 1}, 1e-6);
  expect_near(at(body, 1.0).velocity.angular.cast<double>(), {0, 0, 0}, 1e-9);
  BodyConfig leaning = body;
  leaning.quat_wxyz = {0.5F, 0.5F, -0.5F, 0.5F};
  const Quaterniond yaw(std::cos(kPi / 8), 0, 0, std::sin(kPi / 8));
  expect_same_rotation(at(leaning, 2.0 + kPi / 4.0).pose.rotation, yaw * kTurned, 1e-6);
}

TEST(BodyScript, KeepsItsHeadingOnVerticalLegs) {
  for (const float radius : {0.0F, 0.5F}) {
    const BodyConfig body = facing_route({{0, 0, 0}, {0, 4, 0}, {0, 4, 4}, {4, 4, 4}, {4, 4, 8}}, BodyRoute::once, radius);
    const BodyScript script(body);
    for (double time = 0.0; time < 16.0; time += 0.01) {
      const Vector3d x = script.at(time, {}).pose.rotation.cast<double>() * Vector3d::UnitX();
      const Vector3d position = script.at(time, {}).pose.position.cast<double>();
      const bool is_before = position.x() < 1e-9 && position.y() < 4.0 + 1e-6;
      expect_near(x, is_before ? Vector3d(0, 1, 0) : Vector3d(1, 0, 0), 1e-5);
    }
  }
  // A route that begins upwards faces its first horizontal leg; one that only goes up keeps its initial rotation.
  const BodyConfig up = facing_route({{0, 0, 0}, {0, 0, 4}, {0, -4, 4}}, BodyRoute::once);
  expect_near(x_axis_at(up, 1.0), {0, -1, 0}, 1e-6);
  BodyConfig lift = on_route({{0, 0, 0}, {0, 0, 4}}, BodyRoute::back_and_forth);
  lift.motion.faces_travel = true;
  for (const double time : {1.0, 5.0}) expect_same_rotation(at(lift, time).pose.rotation, kTurned, 1e-6);
  // A loop that begins upwards has the heading of its last leg there.
  const BodyConfig loop = facing_route({{0, 0, 0}, {0, 0, 4}, {4, 0, 4}, {4, 0, 0}}, BodyRoute::loop);
  expect_x_axes(loop, {{2.0, {-1, 0, 0}}, {10.0, {1, 0, 0}}, {14.0, {-1, 0, 0}}});
}

TEST(BodyScript, TurnsBackSharplyAndPassesCollinearPoints) {
  for (const float radius : {0.0F, 1.0F}) {
    const BodyConfig body = facing_route({{0, 0, 0}, {1, 0, 0}, {4, 0, 0}}, BodyRoute::loop, radius);  // both ends are reversals
    for (const double time : {0.0, 0.5, 1.0, 3.9}) expect_near(position_at(body, time), {time, 0, 0}, 1e-6);
    for (const double time : {4.0, 4.1, 7.9}) expect_near(position_at(body, time), {8.0 - time, 0, 0}, 1e-6);
    expect_x_axes(body, {{1.0, {1, 0, 0}}, {5.0, {-1, 0, 0}}});
  }
}

TEST(BodyScript, ARouteNeedsNoSpeed) {
  BodyConfig body = on_route(kSquare, BodyRoute::loop, 0.0F, 0.0F);
  body.motion.phase = 0.375F;
  EXPECT_FALSE(BodyScript(body).moves());
  for (const double time : {0.0, 1e6}) {
    expect_near(position_at(body, time), {4, 2, 1}, 1e-6);
    expect_near(at(body, time).velocity.linear.cast<double>(), {0, 0, 0}, 1e-12);
  }
}

TEST(BodyScript, RoutesOfAnySizeHaveFinitePoses) {
  for (const Points& points : {Points{{0, 0, 0}, {1e-30F, 0, 0}},
                               {{-1e6F, 0, 0}, {1e6F, 0, 0}, {1e6F, 1e-3F, 0}},
                               {{0, 0, 0}, {1, 0, 0}, {0, 1e-6F, 0}}}) {
    for (const BodyRoute route : {BodyRoute::loop, BodyRoute::back_and_forth, BodyRoute::once}) {
      BodyConfig body = on_route(points, route, 2.0F, 1e4F);
      body.motion.faces_travel = true;
      for (const double time : {0.0, 1e-3, 12.3, 1e7}) {
        const Moment moment = at(body, time);
        EXPECT_TRUE(moment.pose.position.allFinite() && moment.pose.rotation.coeffs().allFinite());
        EXPECT_TRUE(moment.velocity.linear.allFinite() && moment.velocity.angular.allFinite());
      }
    }
  }
}

// -- all kinds

std::vector<BodyConfig> one_of_each() {
  std::vector<BodyConfig> bodies{orbiting(3.0F),
                                 orbiting(3.0F),
                                 body_with(BodyMotionKind::slider),
                                 body_with(BodyMotionKind::random_walk),
                                 body_with(BodyMotionKind::velocity),
                                 on_route({{0, 0, 0}, {3, 0, 1}, {4, 4, 1}, {0, 1, 5}, {0, 1, 2}}, BodyRoute::loop, 0.4F, 1.5F),
                                 on_route({{0, 0, 0}, {3, 0, 1}, {1, 4, 1}}, BodyRoute::back_and_forth, 0.4F, 1.5F)};
  bodies[0].motion.axis = {1.0F, -2.0F, 0.5F};
  bodies[1].motion.kind = BodyMotionKind::hinge;
  bodies[1].motion.axis = {1.0F, -2.0F, 0.5F};
  bodies[1].motion.angle_deg = -120.0F;
  bodies[2].motion.travel_m = {1.0F, 2.0F, -1.0F};
  bodies[2].motion.period_s = 3.0F;
  bodies[3].motion.box_min_m = {-5.0F, 1.0F, 2.0F};
  bodies[3].motion.box_max_m = {5.0F, 3.0F, 3.0F};
  bodies[3].motion.period_s = 3.0F;
  bodies[4].motion.velocity_mps = {0.3F, -0.4F, 0.1F};
  bodies[4].motion.turn_rate_dps = {30.0F, -45.0F, 60.0F};
  for (BodyConfig& body : bodies) body.motion.faces_travel = true;
  return bodies;
}

TEST(BodyScript, VelocityIsTheDerivative) {
  std::size_t compared = 0;
  for (BodyConfig body : one_of_each()) {
    for (const float spread : {0.0F, 0.5F}) {
      body.motion.speed_spread = spread;
      const ScriptKey key{.seed = 5, .episode = 2, .body = 3};
      for (double time = 0.1; time < 9.0; time += 0.217) {
        // At a corner, and at a point of a random walk, the velocity jumps.
        const BodyScript script(body);
        const auto velocity = [&](double t) { return script.at(t, key).velocity; };
        if ((velocity(time + 0.011).linear - velocity(time - 0.011).linear).norm() > 0.1F) continue;
        if ((velocity(time + 0.011).angular - velocity(time - 0.011).angular).norm() > 0.1F) continue;
        expect_derivative(body, time, key);
        ++compared;
      }
    }
  }
  EXPECT_GT(compared, 300U);
}

TEST(BodyScript, PositionsAreContinuous) {
  for (const BodyConfig& body : one_of_each()) {
    const BodyScript script(body);
    Vector3d last = script.at(0.0, {}).pose.position.cast<double>();
    for (int step = 1; step < 40000; ++step) {
      const Vector3d now = script.at(1e-3 * step, {}).pose.position.cast<double>();
      ASSERT_LT((now - last).norm(), 15.0 * 1e-3) << step;
      last = now;
    }
  }
}

TEST(BodyScript, RoundedCornersHaveNoJumpOfVelocity) {
  BodyConfig body = on_route(kSquare, BodyRoute::loop, 0.5F);
  body.motion.faces_travel = true;
  const BodyScript script(body);
  Moment last = script.at(0.0, {});
  for (int step = 1; step < 40000; ++step) {
    const Moment now = script.at(1e-3 * step, {});
    ASSERT_LT((now.velocity.linear - last.velocity.linear).norm(), 1e-3 / 0.5 + 1e-5);
    ASSERT_LT(now.pose.rotation.angularDistance(last.pose.rotation), 1e-3F / 0.5F + 1e-3F);
    last = now;
  }
}

TEST(BodyScript, LongTimesStayAccurate) {
  // 1e7 s are a whole number of periods of 4 s and 8 s; the square's lap takes 16 s.
  std::vector<BodyConfig> bodies{orbiting(8.0F), orbiting(4.0F), body_with(BodyMotionKind::slider),
                                 on_route(kSquare, BodyRoute::loop), on_route(kSquare, BodyRoute::back_and_forth)};
  bodies[1].motion.kind = BodyMotionKind::hinge;
  bodies[2].motion.travel_m = {1.0F, 2.0F, 3.0F};
  bodies[2].motion.period_s = 8.0F;
  for (const BodyConfig& body : bodies) {
    const double whole = body.motion.route == BodyRoute::back_and_forth ? 24.0 * 416666.0 : 1e7;
    for (const double time : {0.0, 1.3, 3.9, 11.1}) {
      const Moment early = at(body, time), late = at(body, whole + time);
      expect_near(late.pose.position.cast<double>(), early.pose.position.cast<double>(), 1e-6);
      expect_near(late.velocity.linear.cast<double>(), early.velocity.linear.cast<double>(), 1e-6);
    }
  }
}

TEST(BodyScript, TheSameArgumentsGiveTheSameBitsWithoutAllocation) {
  for (BodyConfig body : one_of_each()) {
    body.motion.random_phase = true;
    body.motion.speed_spread = 0.3F;
    const BodyScript script(body), other(body);
    for (const double time : {0.0, 1.7, 1e6}) {
      const ScriptKey key{.seed = 9, .episode = 4, .body = 7};
      const std::uint64_t before = allocations_of_this_thread();
      const Moment a = script.at(time, key);
      EXPECT_EQ(allocations_of_this_thread(), before);
      const Moment b = other.at(time, key);
      EXPECT_EQ(a.pose.position, b.pose.position);
      EXPECT_EQ(a.pose.rotation.coeffs(), b.pose.rotation.coeffs());
      EXPECT_EQ(a.velocity.linear, b.velocity.linear);
      EXPECT_EQ(a.velocity.angular, b.velocity.angular);
    }
  }
}

TEST(BodyScript, SaysIfItMoves) {
  for (const BodyConfig& body : one_of_each()) EXPECT_TRUE(BodyScript(body).moves());
  BodyConfig still = body_with(BodyMotionKind::hinge);
  still.motion.angle_deg = 0.0F;
  for (const auto kind : {BodyMotionKind::velocity, BodyMotionKind::hinge, BodyMotionKind::slider, BodyMotionKind::random_walk}) {
    still.motion.kind = kind;
    EXPECT_FALSE(BodyScript(still).moves());
    EXPECT_EQ(at(still, 0.0).pose.position, at(still, 77.7).pose.position);
    EXPECT_EQ(at(still, 0.0).pose.rotation.coeffs(), at(still, 77.7).pose.rotation.coeffs());
  }
}

// -- random numbers

BodyConfig wandering() {
  BodyConfig body = body_with(BodyMotionKind::random_walk);
  body.motion.box_min_m = {-2.0F, 0.0F, 1.0F};
  body.motion.box_max_m = {2.0F, 10.0F, 1.0F};
  body.motion.period_s = 2.0F;
  return body;
}

TEST(BodyScript, ARandomWalkGoesStraightFromPointToPoint) {
  const BodyScript script(wandering());
  const ScriptKey key{.seed = 1, .episode = 2, .body = 3};
  for (int way = 0; way < 50; ++way) {
    const Vector3d from = script.at(2.0 * way, key).pose.position.cast<double>();
    const Vector3d to = script.at(2.0 * (way + 1), key).pose.position.cast<double>();
    for (const double part : {0.1, 0.5, 0.99}) {
      const Moment moment = script.at(2.0 * (way + part), key);
      expect_near(moment.pose.position.cast<double>(), from + part * (to - from), 1e-5);
      expect_near(moment.velocity.linear.cast<double>(), (to - from) / 2.0, 1e-5);
      EXPECT_EQ(moment.pose.position.z(), 1.0F);
    }
  }
}

TEST(BodyScript, PointsOfARandomWalkAreUniform) {
  constexpr int kPoints = 20000;
  const BodyScript script(wandering());
  Vector3d mean = Vector3d::Zero(), square = Vector3d::Zero();
  double product = 0.0, after = 0.0, last = 0.0;
  for (int i = 0; i < kPoints; ++i) {
    const Vector3d point = script.at(2.0 * i, {.seed = 8}).pose.position.cast<double>();
    EXPECT_TRUE(std::abs(point.x()) <= 2.0 && point.y() >= 0.0 && point.y() <= 10.0);
    const Vector3d unit(point.x() / 4.0, point.y() / 10.0 - 0.5, 0.0);  // in [-0.5, 0.5]
    mean += unit / kPoints;
    square += unit.cwiseProduct(unit) / kPoints;
    product += unit.x() * unit.y() / kPoints;
    after += unit.x() * last / kPoints;
    last = unit.x();
  }
  for (const int axis : {0, 1}) {
    EXPECT_NEAR(mean[axis], 0.0, 0.01);
    EXPECT_NEAR(square[axis], 1.0 / 12.0, 0.003);
  }
  for (const double correlation : {product, after}) EXPECT_NEAR(correlation, 0.0, 0.003);
}

TEST(BodyScript, WaysBeyond32BitsDiffer) {
  BodyConfig body = wandering();
  body.motion.period_s = 1e-3F;
  const BodyScript script(body);
  const double later = 4294967296.0 * static_cast<double>(body.motion.period_s);  // 2^32 ways
  EXPECT_GT((script.at(0.0, {}).pose.position - script.at(later, {}).pose.position).norm(), 0.1F);
}

TEST(BodyScript, PhasesAndSpeedsAreDrawnPerEpisodeEnvAndBody) {
  constexpr int kDraws = 20000;
  BodyConfig body = on_route({{0, 0, 0}, {1000, 0, 0}}, BodyRoute::once, 0.0F, 2.0F);
  body.motion.random_phase = true;
  body.motion.speed_spread = 0.5F;
  body.motion.phase = 0.9F;  // replaced
  const BodyScript script(body);
  std::vector<double> phases, speeds;
  double product = 0.0;
  for (int i = 0; i < kDraws; ++i) {
    const auto number = static_cast<std::uint32_t>(i);
    const ScriptKey key = i % 3 == 0   ? ScriptKey{.seed = number, .episode = 5, .body = 1}
                          : i % 3 == 1 ? ScriptKey{.seed = 77, .episode = i, .body = 1}
                                       : ScriptKey{.seed = 78, .episode = 6, .body = number % kMaxBodies};
    const Moment moment = script.at(0.0, key);
    phases.push_back(static_cast<double>(moment.pose.position.x()) / 1000.0);
    speeds.push_back(static_cast<double>(moment.velocity.linear.x()) / 2.0);
    product += (phases.back() - 0.5) * (speeds.back() - 1.0) / kDraws;
  }
  EXPECT_NEAR(product, 0.0, 0.003);
  std::ranges::sort(phases);
  std::ranges::sort(speeds);
  for (int part = 0; part <= 10; ++part) {
    const auto rank = static_cast<std::size_t>(std::min(kDraws - 1, part * kDraws / 10));
    EXPECT_NEAR(phases[rank], 0.1 * part, 0.02);
    EXPECT_NEAR(speeds[rank], 0.5 + 0.1 * part, 0.02);
  }
  EXPECT_NE(phases[0], phases[1]);
}

TEST(BodyScript, ASpeedFactorScalesTime) {
  for (BodyConfig body : one_of_each()) {
    BodyConfig varied = body;
    varied.motion.speed_spread = 0.8F;
    const ScriptKey key{.seed = 3, .episode = 1, .body = 2};
    BodyConfig probe = on_route({{0, 0, 0}, {1000, 0, 0}}, BodyRoute::once);
    probe.motion.speed_spread = 0.8F;
    const double factor = static_cast<double>(at(probe, 0.0, key).velocity.linear.x());
    EXPECT_GT(std::abs(factor - 1.0), 0.01);
    for (const double time : {0.4, 5.0}) {
      const Moment fast = at(varied, time, key), slow = at(body, factor * time, key);
      expect_near(fast.pose.position.cast<double>(), slow.pose.position.cast<double>(), 1e-4);
      expect_near(fast.velocity.linear.cast<double>(), factor * slow.velocity.linear.cast<double>(), 1e-3);
      expect_near(fast.velocity.angular.cast<double>(), factor * slow.velocity.angular.cast<double>(), 1e-3);
    }
  }
}

}  // namespace
}  // namespace flockstep::bodies
