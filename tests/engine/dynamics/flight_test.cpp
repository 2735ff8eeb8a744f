// Flight with simulated rotors: identical bits on every SIMD target and with any neighbours, agreement of the paths with and
// without collision checks, and contacts. tests/python/dynamics/test_dynamics.py has a reference implementation of the equations.
#include "dynamics/flight.hpp"

#include <hwy/targets.h>

#include <bit>

#include "allocation_counter.hpp"
#include "batch_helpers.hpp"
#include "collide.hpp"
#include "collision/sweep.hpp"
#include "dynamics/impact.hpp"
#include "flight_state.hpp"
#include "on_target.hpp"
#include "prepared/prepared_world.hpp"

namespace flockstep {
namespace {

using dynamics::Flock;
using dynamics::kLanes;
using dynamics::Physics;
using namespace testing;

DynamicsConfig config_of(Control control) { return {.motion = Motion::rotors, .control = control, .ground_effect = true}; }

BatchConfig batch_of(int num_envs, Control control) {
  BatchConfig config;
  config.num_envs = num_envs;
  config.num_threads = 1;
  config.clock = {.policy_hz = 50.0F, .physics_hz = 500.0F, .controller_hz = 250.0F};
  config.dynamics = config_of(control);
  return config;
}

Flock random_flock(std::uint32_t seed, dynamics::Stage stage) {
  Random random(seed);
  Flock flock;
  const auto fill = [&](auto& lanes, float low, float high) {
    for (auto& lane : lanes) {
      for (float& value : lane) value = random.within(low, high);
    }
  };
  fill(flock.velocity, -3.0F, 3.0F);
  fill(flock.turn, -4.0F, 4.0F);
  fill(flock.rotor, 400.0F, 900.0F);
  fill(flock.rotor_command, 400.0F, 900.0F);
  fill(flock.error_integral, -0.5F, 0.5F);
  fill(flock.wind, -2.0F, 2.0F);
  fill(flock.rotation, -1.0F, 1.0F);
  fill(flock.setpoint, -2.0F, 2.0F);
  for (std::size_t lane = 0; lane < kLanes; ++lane) {
    float square = 0.0F;
    for (const auto& part : flock.rotation) square += part[lane] * part[lane];
    for (auto& part : flock.rotation) part[lane] /= std::sqrt(square);
    flock.height[lane] = random.within(0.1F, 2.0F);
    if (stage == dynamics::Stage::rotors) {
      for (std::size_t i = 0; i < kMaxRotors; ++i) flock.setpoint[i][lane] = random.within(400.0F, 900.0F);
    }
  }
  return flock;
}

std::vector<dynamics::ContactPoint> with_normal(std::span<const Vec3> points, const Vec3& normal = Vec3::UnitZ()) {
  std::vector<dynamics::ContactPoint> result;
  for (const Vec3& point : points) result.push_back({point, normal});
  return result;
}

bool same(const Flock& a, const Flock& b) { return std::memcmp(&a, &b, sizeof a) == 0; }

TEST(Flight, OfADroneIsTheSameBesideOtherAirframes) {
  std::vector<Airframe> frames = different_airframes();
  ASSERT_GE(frames.size(), 8U);
  for (const char* const name : {"f550", "naki"}) frames.push_back(*DroneModel::load(name).airframe());
  for (const Control control : kFlightControls) {
    for (const Integrator integrator : {Integrator::midpoint, Integrator::rk4}) {
      SCOPED_TRACE(::testing::Message() << "control " << static_cast<int>(control) << ", integrator "
                                        << static_cast<int>(integrator));
      DynamicsConfig config = config_of(control);
      config.integrator = integrator;
      std::vector<Physics> alone;
      for (const Airframe& frame : frames) alone.emplace_back(frame, config, 0.002, 2);
      Physics mixed = alone[0];
      std::array<const dynamics::AirframeNumbers<float>*, kLanes> of_lanes;
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        mixed.include(alone[lane % frames.size()]);
        of_lanes[lane] = &alone[lane % frames.size()].numbers;
      }
      dynamics::LaneNumbers numbers;
      dynamics::set_lanes(of_lanes, numbers);
      Flock start = random_flock(11, mixed.stage);
      for (std::size_t lane = 0; lane < kLanes; ++lane) {
        for (std::size_t rotor = frames[lane % frames.size()].num_rotors(); rotor < kMaxRotors; ++rotor) {
          start.rotor[rotor][lane] = start.rotor_command[rotor][lane] = 0.0F;
          if (mixed.stage == dynamics::Stage::rotors) start.setpoint[rotor][lane] = 0.0F;
        }
      }
      Flock together = start;
      dynamics::fly(mixed, numbers, together, 0, 20);
      for (std::size_t frame = 0; frame < frames.size(); ++frame) {
        Flock flock = start;
        dynamics::fly(alone[frame], flock, 0, 20);
        for (std::size_t lane = frame; lane < kLanes; lane += frames.size()) {
          const auto differ = [&](const auto& a, const auto& b) {
            for (std::size_t k = 0; k < a.size(); ++k) {
              EXPECT_EQ(std::bit_cast<std::uint32_t>(a[k][lane]), std::bit_cast<std::uint32_t>(b[k][lane])) << "lane " << lane;
            }
          };
          differ(flock.travelled, together.travelled);
          differ(flock.velocity, together.velocity);
          differ(flock.rotation, together.rotation);
          differ(flock.turn, together.turn);
          differ(flock.rotor, together.rotor);
          differ(flock.rotor_command, together.rotor_command);
          differ(flock.error_integral, together.error_integral);
          EXPECT_EQ(flock.is_good[lane], together.is_good[lane]);
        }
      }
    }
  }
}

TEST(Flight, HasTheSameBitsOnEveryTarget) {
  const std::array<Airframe, 2> airframes{*DroneModel::load("hummingbird").airframe(), *DroneModel::load("naki").airframe()};
  int compared = 0;
  for (const Control control : kFlightControls) {
    for (std::size_t kind = 0; kind < 4; ++kind) {
      DynamicsConfig config = config_of(control);
      config.integrator = kind % 2 == 0 ? Integrator::midpoint : Integrator::rk4;
      Airframe frame = airframes[kind / 2];
      frame.rotor_lift = 1e-3;
      frame.linear_drag = {0.1, 0.2, 0.3};
      frame.quadratic_drag = {0.01, 0.02, 0.03};
      frame.rotor_inertia_kgm2 = 1e-5;
      const Physics physics(frame, config, 0.002, 2);
      const Flock start = random_flock(7, physics.stage);
      const OnTarget first(HWY_EMU128);
      Flock expected = start;
      dynamics::fly(physics, expected, 0, 20);
      on_every_target([&] {
        Flock flown = start;
        dynamics::fly(physics, flown, 0, 20);
        EXPECT_TRUE(same(flown, expected)) << "control " << static_cast<int>(control);
        ++compared;
      });
    }
  }
  EXPECT_GE(compared, 4 * static_cast<int>(kFlightControls.size()));
}

TEST(Flight, OfALaneDependsOnlyOnThatLane) {
  const DroneModel model = DroneModel::load("kingfisher");
  for (const Control control : kFlightControls) {
    const Physics physics(*model.airframe(), config_of(control), 0.002, 1);
    const Flock start = random_flock(3, physics.stage);
    Flock together = start;
    dynamics::fly(physics, together, 0, 10);
    for (const std::size_t lane : {std::size_t{0}, std::size_t{5}, std::size_t{15}}) {
      Flock other = random_flock(99, physics.stage);
      const auto copy = [&](auto member) {
        auto& to = other.*member;
        const auto& from = start.*member;
        if constexpr (std::is_same_v<std::remove_cvref_t<decltype(to)>, dynamics::Lane>) {
          to[lane] = from[lane];
        } else {
          for (std::size_t k = 0; k < to.size(); ++k) to[k][lane] = from[k][lane];
        }
      };
      copy(&Flock::velocity), copy(&Flock::rotation), copy(&Flock::turn), copy(&Flock::rotor), copy(&Flock::rotor_command);
      copy(&Flock::error_integral), copy(&Flock::wind), copy(&Flock::height), copy(&Flock::setpoint);
      dynamics::fly(physics, other, 0, 10);
      for (std::size_t k = 0; k < 3; ++k) {
        EXPECT_EQ(other.travelled[k][lane], together.travelled[k][lane]);
        EXPECT_EQ(other.turn[k][lane], together.turn[k][lane]);
      }
      EXPECT_EQ(other.rotor[0][lane], together.rotor[0][lane]);
    }
  }
}

// Compares open space with obstacles on both sides. They are close enough to be checked in every tick, but far enough to never
// be hit.
TEST(Flight, PastObstaclesIsThatInTheOpen) {
  const auto open = make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {500, 500, 500})});
  std::vector<Primitive> beside{primitive(PrimitiveKind::room, {0, 0, 0}, {500, 500, 500})};
  for (const float z : {-6.0F, 6.0F}) beside.push_back(primitive(PrimitiveKind::box, {0, 0, z}, {400, 400, 0.5F}));
  const auto between = make_world(std::move(beside));
  const DroneModel model = DroneModel::load("kingfisher").scaled(12.0, 1000.0);  // large, so its checks reach far
  constexpr std::size_t kDrones = 40;
  for (const Control control : kFlightControls) {
    BatchConfig config = batch_of(kDrones, control);
    config.dynamics.ground_effect = false;
    std::vector<float> position;
    Random random(11);
    for (std::size_t i = 0; i < 3 * kDrones; ++i) position.push_back(random.within(-0.5F, 0.5F));
    Batch free(config, {open}, nullptr, model);
    Batch careful(config, {between}, nullptr, model);
    for (Batch* const batch : {&free, &careful}) batch->set_pose(position, {});
    for (int step = 0; step < 10; ++step) {
      const std::vector<float> command = flight_commands(random, control, std::vector(kDrones, *model.airframe()));
      for (Batch* const batch : {&free, &careful}) batch->fly(command);
    }
    for (std::size_t i = 0; i < kDrones; ++i) ASSERT_FALSE(careful.state().contact.hit[i]);
    EXPECT_TRUE(same_bits(free.state().position, careful.state().position));
    EXPECT_TRUE(same_bits(free.state().quat_wxyz, careful.state().quat_wxyz));
    EXPECT_TRUE(same_arrays(free.state().flight, careful.state().flight));
  }
}

// A small cluttered room, partly made of triangles.
std::shared_ptr<const World> clutter(const Vec3& at) {
  using enum PrimitiveKind;
  const Quat turned(Eigen::AngleAxisf(0.7F, Vec3(1, 2, 3).normalized()));
  std::vector<Primitive> primitives{primitive(room, at, {2, 2, 1.5F}),
                                    primitive(cylinder, at + Vec3(1, 1, 0), {0.3F, 0.3F, 1.5F}),
                                    primitive(box, at + Vec3(-1, 1, -1), {0.4F, 0.3F, 0.5F}, turned),
                                    primitive(sphere, at + Vec3(1, -1, -0.8F), {0.5F, 0.5F, 0.5F})};
  TriangleMesh mesh;
  for (const Vec3& corner :
       {Vec3(-1.5F, -1.5F, -1.4F), Vec3(-0.5F, -1.2F, -1.4F), Vec3(-1, -0.6F, -1.4F), Vec3(-1, -1.1F, 0.2F)}) {
    mesh.vertices.push_back(at + corner);
  }
  mesh.triangles = {{0, 1, 3}, {1, 2, 3}, {2, 0, 3}, {0, 2, 1}};
  return make_world(std::move(primitives), {}, std::move(mesh));
}

// Covers contacts that bounce, gusts, an IMU, a LiDAR between ticks, and resets.
void expect_no_allocation(int drones_per_env, const std::vector<std::string>& airframes = {}) {
  constexpr std::size_t kDrones = 64;
  const auto room = make_world({primitive(PrimitiveKind::room, Vec3::Zero(), {2.0F, 2.0F, 1.5F}),
                                primitive(PrimitiveKind::cylinder, {1.2F, 0.4F, 0.0F}, {0.2F, 0.2F, 1.5F})},
                               {.goal = Vec3::Zero()});
  BatchConfig config = batch_of(static_cast<int>(kDrones) / drones_per_env, Control::body_rates);
  config.drones_per_env = drones_per_env;
  config.dynamics.on_contact = OnContact::bounce;
  config.dynamics.wind.gusts = Gusts::dryden;
  config.airframes = airframes;
  config.imus = {ImuConfig{}};
  config.lidars = {LidarConfig{.rate_hz = 100.0F}};
  config.episode.max_episode_steps = 150;
  HoverConfig hover;
  hover.start_offset_m = 0.5F;
  Batch batch(config, Batch::Worlds{room}, make_task(hover), DroneModel::load("crazyflie"));
  batch.reset({});
  Random random(5);
  std::vector<std::vector<float>> actions(200);
  for (auto& step : actions) {
    for (std::size_t i = 0; i < 4 * kDrones; ++i) step.push_back(random.within(-0.3F, 0.3F));
  }
  for (std::size_t i = 0; i < 2 * actions.size(); ++i) batch.step(std::span<const float>(actions[i % actions.size()]));
  std::size_t hits = 0, ends = 0;
  const std::uint64_t before = allocations();
  for (const auto& step : actions) {
    batch.step(std::span<const float>(step));
    for (const auto hit : batch.state().contact.hit) hits += hit;
    for (const auto ended : batch.outputs().truncated) ends += ended;
    for (const auto ended : batch.outputs().terminated) ends += ended;
  }
  EXPECT_EQ(allocations() - before, 0U);
  EXPECT_GT(hits, 10U);
  EXPECT_GT(ends, 10U);
}

TEST(Flight, AStepAllocatesNothing) { expect_no_allocation(1); }
TEST(Flight, AStepOfSeveralDronesPerEnvAllocatesNothing) { expect_no_allocation(4); }
TEST(Flight, AStepOfDifferentAirframesAllocatesNothing) { expect_no_allocation(1, {"crazyflie", "naki", "f550"}); }

// Drones that keep pushing against walls and corners never get inside anything. `./dev try pushes` tries it 10^8 times.
TEST(Contact, PushedAgainstWallsAndCornersNothingGetsInside) {
  constexpr std::size_t kDrones = 24;
#if defined(NDEBUG)
  constexpr long kSteps = 120;
#else  // sanitizers and debug builds are slow
  constexpr long kSteps = 60;
#endif
  const long steps = times_tried(kSteps);
  long ticks = 0;
  for (const float far : {0.0F, 300.0F}) {
    const auto world = clutter({far, -far, far});
    const DroneModel model = DroneModel::load("kingfisher");
    const collision::Hull hull(model);
    for (const OnContact on_contact : {OnContact::bounce, OnContact::stop}) {
      for (const Control control : {Control::velocity, Control::rotor_thrusts, Control::body_rates}) {
        BatchConfig config = batch_of(kDrones, control);
        config.dynamics.on_contact = on_contact;
        config.dynamics.max_speed_mps = 20.0F;
        Batch batch(config, {world}, nullptr, model);
        Random random(5U + 100U * part_tried());
        std::vector<float> position;
        for (std::size_t i = 0; i < kDrones; ++i) {
          const Vec3 at = Vec3(far, -far, far) + Vec3(random.within(-0.3F, 0.3F), random.within(-0.3F, 0.3F), 0.5F);
          position.insert(position.end(), {at.x(), at.y(), at.z()});
        }
        batch.set_pose(position, {});
        std::vector<float> command;
        long hits = 0;
        for (long step = 0; step < steps; ++step) {
          if (step % 50 == 0) {
            command = flight_commands(random, control, std::vector(kDrones, *model.airframe()));
            if (control == Control::velocity) {
              for (float& value : command) value *= 5.0F;
            }
          }
          batch.fly(command);
          ticks += 10 * static_cast<long>(kDrones);
          for (std::size_t i = 0; i < kDrones; ++i) {
            hits += batch.state().contact.hit[i];
            ASSERT_FALSE(batch.state().contact.inside[i]) << "drone " << i << " in step " << step;
          }
        }
        EXPECT_GT(hits, 0);
        for (std::size_t i = 0; i < kDrones; ++i) {
          EXPECT_FALSE(collision::overlaps(prepared(*world).obstacles(), hull, pose_of(batch.state(), DroneIndex(i))));
        }
      }
    }
  }
  testing::tried("pushes", ticks);
}

TEST(Contact, NoWallIsThinEnoughToBeFlownThrough) {
  const auto world = make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {900, 900, 900}),
                                 primitive(PrimitiveKind::plane, {50, 0, 0}, {20, 20, 0},
                                           Quat(Eigen::AngleAxisf(std::numbers::pi_v<float> / 2, Vec3::UnitY())))});
  for (const float speed : {30.0F, 300.0F, 9000.0F}) {
    BatchConfig config = batch_of(1, Control::rotor_speeds);
    config.dynamics.body_drag = config.dynamics.rotor_drag = false;
    Batch batch(config, {world}, nullptr, DroneModel::load("crazyflie"));
    batch.set_pose(std::vector<float>{0, 0, 0}, {});
    batch.set_velocity(std::vector<float>{speed, 0, 0}, {}, {});
    const std::vector<float> still(4, 0.0F);
    for (int step = 0; step < 300 && !batch.state().contact.hit[0]; ++step) batch.fly(still);
    EXPECT_TRUE(batch.state().contact.hit[0]);
    EXPECT_NEAR(batch.state().position[0], 50.0F - 0.056F, 1e-3F) << "its nose at the wall";
    EXPECT_NEAR(batch.state().contact.normal[0], -1.0F, 1e-3F);
  }
}

Vec3 inertia_of(const Airframe& frame) { return Eigen::Map<const Eigen::Vector3d>(frame.inertia_kgm2.data()).cast<float>(); }

float energy_of(const Airframe& frame, const Velocity& v) {
  return static_cast<float>(frame.mass_kg) * v.linear.squaredNorm() + v.angular.cwiseAbs2().dot(inertia_of(frame));
}

const Pose kTurned{{1, 2, 3}, Quat(Eigen::AngleAxisf(0.5F, Vec3::UnitZ()))};

// Corners of a drone, all at one height, that may touch the floor at once.
struct Face {
  Face(Random& random, int count) {
    for (int k = 0; k < count; ++k) {
      corners.emplace_back(kTurned.position + Vec3(random.within(-0.2F, 0.2F), random.within(-0.2F, 0.2F), -0.06F));
    }
  }
  // The corners' least velocity upwards.
  float slowest(const Velocity& v) const {
    float least = kInfinity;
    for (const Vec3& corner : corners) {
      least = std::min(least, (v.linear + (kTurned.rotation * v.angular).cross(corner - kTurned.position)).z());
    }
    return least;
  }
  auto thrown_back(const Velocity& before, const Airframe& frame, const dynamics::ContactMaterial& surface) const {
    return dynamics::thrown_back(before, before, 0.0, kTurned, with_normal(corners), frame, surface);
  }

  std::vector<Vec3> corners;
};

TEST(Impact, BouncesByRestitutionAndFriction) {
  const Airframe frame = *DroneModel::load("kingfisher").airframe();
  dynamics::ContactMaterial surface{0.4, 0.0};
  const Pose& pose = kTurned;
  // The contact is straight below the centre, so there is no rotation.
  const std::array below{Vec3(1, 2, 2.9F)};
  const auto thrown_back = [&](const Velocity& before, std::span<const Vec3> points, const Vec3& normal) {
    return dynamics::thrown_back(before, before, 0.0, pose, with_normal(points, normal), frame, surface).at_end;
  };
  const Velocity straight = thrown_back({{1, 0, -2}, Vec3::Zero()}, below, Vec3::UnitZ());
  EXPECT_TRUE(straight.linear.isApprox(Vec3(1, 0, 0.8F), 1e-6F));
  EXPECT_TRUE(straight.angular.isZero(1e-6F));
  // A velocity that already points away is unchanged.
  const Velocity away = thrown_back({{1, 0, 2}, Vec3::Zero()}, below, Vec3::UnitZ());
  EXPECT_EQ(away.linear, Vec3(1, 0, 2));
  // Off centre, the contact point leaves at the restitution's share of its speed, and angular momentum about the point is
  // conserved.
  surface.friction = 0.5;
  Random random(1);
  for (int i = 0; i < 1000; ++i) {
    const Vec3 normal = random.point(1).normalized();
    const Vec3 arm = random.point(0.2F);
    const Velocity before{random.point(5), random.point(5)};
    const std::array<Vec3, 1> point{pose.position + arm};
    const Velocity after = thrown_back(before, point, normal);
    const auto at_point = [&](const Velocity& v) { return Vec3(v.linear + (pose.rotation * v.angular).cross(arm)); };
    const float approach = at_point(before).dot(normal);
    if (approach >= 0.0F) continue;
    if (approach < -0.1F) {
      EXPECT_GE(at_point(after).dot(normal), -1e-4F) << "it no longer approaches";
    }
    const Vec3 impulse = static_cast<float>(frame.mass_kg) * (after.linear - before.linear);
    const Vec3 turned = inertia_of(frame).cwiseProduct(after.angular - before.angular);
    EXPECT_TRUE((pose.rotation * turned).isApprox(arm.cross(impulse), 1e-2F));
    const float push = impulse.dot(normal);
    EXPECT_LE((impulse - push * normal).norm(), 0.5F * push * 1.001F) << "in Coulomb's cone";
    EXPECT_LE(energy_of(frame, after), energy_of(frame, before) * 1.0001F);
  }
}

// Oblique impacts on one to six points, some of which already move away. If restitution would add energy, it is reduced but not
// dropped.
TEST(Impact, KeepsTheEnergyThatRestitutionAllows) {
  const Airframe frame = *DroneModel::load("kingfisher").airframe();
  Random random(3);
  int hits = 0, lost = 0;
  for (int i = 0; i < 20000; ++i) {
    const Face face(random, 1 + i % 6);
    const Velocity before{random.point(5), random.point(20)};
    if (face.slowest(before) > -0.1F) continue;
    ++hits;
    for (const double friction : {0.0, 0.5}) {
      float kept = 0.0F;
      bool is_less = false;
      for (const double restitution : {0.0, 0.5, 0.9, 1.0}) {
        const Velocity after = face.thrown_back(before, frame, {restitution, friction}).after;
        const float share = energy_of(frame, after) / energy_of(frame, before);
        ASSERT_LE(share, 1.0F + 1e-5F) << "restitution " << restitution << ", friction " << friction;
        ASSERT_GE(face.slowest(after), -1e-2F);
        if (friction == 0.0) {
          // Points slower than 5 cm/s get no restitution.
          is_less |= share < kept - 1e-3F || (restitution == 1.0 && share < 0.99F);
          kept = share;
        }
      }
      lost += is_less;
    }
  }
  EXPECT_GT(hits, 10000);
  EXPECT_LT(lost, hits / 2000) << "rounds have an end: slivers need many";
}

// Among all motions in which no corner of a smooth face moves into the floor, the result is closest to the motion before, in
// the metric of mass and inertia (Gauss). Therefore any random motion of this kind is farther away.
TEST(Impact, AFaceThatLandsOnASmoothFloorLosesTheLeastItCan) {
  const Airframe frame = *DroneModel::load("kingfisher").airframe();
  Random random(2);
  int pressed = 0;
  for (int i = 0; i < 1000; ++i) {
    const Face face(random, 3 + i % 6);
    const Velocity before{random.point(3), random.point(10)};
    const auto lost = [&](const Velocity& v) { return energy_of(frame, {v.linear - before.linear, v.angular - before.angular}); };
    const Velocity after = face.thrown_back(before, frame, {0.0, 0.0}).at_end;
    ASSERT_GE(face.slowest(after), -1e-3F) << "rounds have an end: slivers need many";
    if (face.slowest(before) >= 0.0F) {
      EXPECT_LT(lost(after), 1e-9F);
      continue;
    }
    ++pressed;
    for (int k = 0; k < 100; ++k) {
      Velocity other{after.linear + random.point(0.1F), after.angular + random.point(1)};
      other.linear.z() -= std::min(face.slowest(other), 0.0F);  // lifted until no corner moves down
      ASSERT_GE(lost(other), lost(after) - 1e-4F);
    }
  }
  EXPECT_GT(pressed, 500);
}

}  // namespace
}  // namespace flockstep
