// Drones with simulated rotors that tumble onto things with still rotors: none freezes, gets inside or gains energy. Drones that
// begin inside something get out.

#include "batch_helpers.hpp"
#include "meshes.hpp"

namespace flockstep {
namespace {

using namespace testing;

constexpr int kStill = 20;  // ticks

// Obstacles that drones tumble onto.
enum class Onto { level_box, tilted_box, edges, sphere, pole, mesh, bodies, each_other };
constexpr std::array kAll{Onto::level_box, Onto::tilted_box, Onto::edges,  Onto::sphere,
                          Onto::pole,      Onto::mesh,       Onto::bodies, Onto::each_other};

std::shared_ptr<const World> world_of(Onto onto) {
  const auto box = [](const Vec3& center, const Vec3& half, const Quat& rotation = Quat::Identity()) {
    return primitive(PrimitiveKind::box, center, half, rotation);
  };
  switch (onto) {
    case Onto::level_box:
      return make_world({box({0, 0, 0}, {0.4F, 0.4F, 0.15F})});
    case Onto::tilted_box:
      return make_world({box({0, 0, 0}, {0.25F, 0.2F, 0.15F}, Quat(0.8F, 0.36F, 0.48F, 0.0F))});
    case Onto::edges:
      return make_world({box({-0.3F, 0, 0}, {0.01F, 0.5F, 0.3F}), box({0.3F, 0.1F, 0.05F}, {0.01F, 0.5F, 0.3F})});
    case Onto::sphere:
      return make_world({primitive(PrimitiveKind::sphere, {0, 0, 0}, Vec3::Constant(0.5F))});
    case Onto::pole:
      return make_world({primitive(PrimitiveKind::cylinder, {0, 0, 0}, {0.1F, 0.1F, 0.5F})});
    case Onto::mesh: {
      TriangleMesh mesh;
      add_box(mesh, Vec3::Zero(), {0.4F, 0.3F, 0.2F}, Quat(0.8F, 0.36F, 0.48F, 0.0F));
      return make_world({}, {}, mesh);
    }
    default:
      return make_world({primitive(PrimitiveKind::room, {0, 0, 0}, {1000, 1000, 1000})});
  }
}

std::vector<BodyConfig> moving_bodies() {
  BodyConfig box, ball;
  box.size_m = {0.6F, 0.5F, 0.3F};
  box.motion.turn_rate_dps = {40.0F, 10.0F, 60.0F};
  ball.shape = BodyShape::sphere;
  ball.size_m = {0.5F, 0.5F, 0.5F};
  ball.position_m = {0.8F, 0.0F, 0.0F};
  ball.motion.kind = BodyMotionKind::orbit;
  ball.motion.period_s = 3.0F;
  return {box, ball};
}

// A batch of drones without drag, so that only contacts change their energy.
struct Tumble {
  static constexpr int kDrones = 14;

  Tumble(Random& random, const std::string& frame, Onto place)
      : onto(place), airframe(*DroneModel::load(frame).airframe()), radius(DroneModel::load(frame).radius()) {
    constexpr std::array kRates{100.0F, 250.0F, 500.0F, 1000.0F};
    BatchConfig config{.num_envs = kDrones, .num_threads = 1};
    const float hz = kRates[static_cast<std::size_t>(random.within(0.0F, 3.999F))];
    config.clock.policy_hz = hz;
    config.clock.physics_hz = hz;
    config.dynamics.motion = Motion::rotors;
    config.dynamics.control = Control::rotor_speeds;
    config.dynamics.on_contact = random.within(0, 1) < 0.3F ? OnContact::stop : OnContact::bounce;
    config.dynamics.restitution = random.within(0, 1) < 0.4F ? 0.0F : random.within(0, 0.7F);
    config.dynamics.friction = random.within(0, 1) < 0.4F ? 0.0F : random.within(0, 0.8F);
    config.dynamics.body_drag = config.dynamics.rotor_drag = false;
    if (onto == Onto::bodies) config.bodies = moving_bodies();
    if (onto == Onto::each_other) {
      config.num_envs = kDrones / 2;
      config.drones_per_env = 2;
      config.interaction = Interaction::collide;
    }
    ticks = static_cast<int>(hz * 0.5F);
    batch = std::make_unique<Batch>(config, Batch::Worlds{world_of(onto)}, nullptr, DroneModel::load(frame));
    conserves = airframe.thrust_n[0] == 0.0 && onto != Onto::bodies && onto != Onto::each_other;
    throw_drones(random);
  }

  void throw_drones(Random& random) {
    std::vector<float> position, rotation, velocity, rates;
    const auto append = [](std::vector<float>& to, const Vec3& v) { to.insert(to.end(), {v.x(), v.y(), v.z()}); };
    for (int drone = 0; drone < kDrones; ++drone) {
      Vec3 place = random.point(0.3F + radius / 2), speed = random.point(1.0F);
      if (onto != Onto::each_other) {
        place.z() = 0.45F + 1.2F * radius + 0.2F * place.z();
        speed.z() = random.within(-3, 0);
      } else if (drone % 2 == 1) {
        const Vec3 first = Vec3::Map(position.data() + position.size() - 3);
        const Vec3 aside = random.point(1.0F).normalized() * 2.3F * radius;
        place = first + aside;
        speed = -4.0F * aside + 0.3F * speed;
      }
      const Quat q = random.rotation();
      append(position, place);
      rotation.insert(rotation.end(), {q.w(), q.x(), q.y(), q.z()});
      append(velocity, speed);
      append(rates, random.point(6.0F));
    }
    batch->set_pose(position, rotation);
    batch->set_velocity(velocity, rates, std::vector<float>(kDrones * batch->num_rotors(), 0.0F));
  }

  static Vec3 vec3(const auto& array, std::size_t drone) { return Vec3::Map(array.data() + 3 * drone); }
  Velocity velocity(std::size_t drone) const {
    const State& state = batch->state();
    return {vec3(state.flight.velocity, drone), vec3(state.flight.angular_velocity, drone)};
  }

  // J/kg
  double energy(std::size_t drone) const {
    const Velocity v = velocity(drone);
    const Vec3 turn = v.angular;
    double spin = 0.0;
    for (std::size_t axis = 0; axis < 3; ++axis) {
      const auto rate = static_cast<double>(turn[static_cast<Eigen::Index>(axis)]);
      spin += airframe.inertia_kgm2[axis] * rate * rate;
    }
    const double height = static_cast<double>(batch->state().position[3 * drone + 2]);
    return kGravity * height + 0.5 * v.linear.cast<double>().squaredNorm() + 0.5 * spin / airframe.mass_kg;
  }

  Onto onto;
  Airframe airframe;
  bool conserves = false;  // nothing but contacts changes the energy; a still rotor may have some thrust
  float radius;
  int ticks = 0;
  std::unique_ptr<Batch> batch;
};

// A drone that has not moved by a bit in 20 ticks must be at rest, and then also stay there if it is lifted by a millimetre.
TEST(Tumbles, NoDroneFreezesInTheAirOrGainsEnergy) {
  Random random(47 + part_tried());
  const std::vector<std::string> frames = DroneModel::names();
  const auto rounds = static_cast<std::size_t>(times_tried(static_cast<long>(frames.size() * kAll.size())));
  long contacts = 0;  // ticks in which a drone touches something
  for (std::size_t round = 0; round < rounds; round += kThinning) {
    Tumble tumble(random, frames[round % frames.size()], kAll[round / frames.size() % kAll.size()]);
    Batch& batch = *tumble.batch;
    const std::vector<float> still(Tumble::kDrones * batch.num_rotors(), 0.0F);
    const State& state = batch.state();
    std::array<int, Tumble::kDrones> same{};
    std::array<bool, Tumble::kDrones> begins_inside{};
    std::array<double, Tumble::kDrones> energy{};
    for (std::size_t drone = 0; drone < Tumble::kDrones; ++drone) energy[drone] = tumble.energy(drone);
    for (int tick = 0; tick < tumble.ticks; ++tick) {
      const std::vector<float> position(state.position.begin(), state.position.end());
      const std::vector<float> rotation(state.quat_wxyz.begin(), state.quat_wxyz.end());
      batch.fly(still);
      for (std::size_t drone = 0; drone < Tumble::kDrones; ++drone) {
        const bool hit = state.contact.hit[drone] != 0, inside = state.contact.inside[drone] != 0;
        if (tick == 0) begins_inside[drone] = inside;
        if (begins_inside[drone]) continue;
        contacts += hit;
        const auto trace = [&] {
          return "round " + std::to_string(round) + " drone " + std::to_string(drone) + " tick " + std::to_string(tick);
        };
        ASSERT_FALSE(inside && tumble.onto != Onto::bodies) << trace();
        const bool is_same = std::equal(&position[3 * drone], &position[3 * drone] + 3, &state.position[3 * drone]) &&
                             std::equal(&rotation[4 * drone], &rotation[4 * drone] + 4, &state.quat_wxyz[4 * drone]);
        same[drone] = is_same ? same[drone] + 1 : 0;
        if (same[drone] >= kStill) {
          const Velocity v = tumble.velocity(drone);
          ASSERT_LT(v.linear.norm() + tumble.radius * v.angular.norm(), 1e-3F) << trace();
        }
        if (!tumble.conserves) continue;
        const double now = tumble.energy(drone);
        if (hit) {
          ASSERT_LT(now, energy[drone] + 0.08) << trace();
        }
        energy[drone] = now;
      }
    }
    if (tumble.onto == Onto::bodies || tumble.onto == Onto::each_other) continue;
    if (std::ranges::none_of(same, [](int ticks) { return ticks >= kStill; })) continue;
    std::vector<float> position(state.position.begin(), state.position.end());
    const std::vector<float> before = position, rotation(state.quat_wxyz.begin(), state.quat_wxyz.end());
    for (std::size_t drone = 0; drone < Tumble::kDrones; ++drone) position[3 * drone + 2] += 1e-3F;
    batch.set_pose(position, rotation);
    batch.set_velocity(std::vector<float>(3 * Tumble::kDrones), std::vector<float>(3 * Tumble::kDrones), still);
    for (int tick = 0; tick < tumble.ticks / 2; ++tick) batch.fly(still);
    for (std::size_t drone = 0; drone < Tumble::kDrones; ++drone) {
      if (same[drone] < kStill || begins_inside[drone]) continue;
      EXPECT_LT((tumble.vec3(before, drone) - tumble.vec3(state.position, drone)).norm(), 0.01F)
          << "round " << round << " drone " << drone;
    }
  }
  EXPECT_GT(contacts, 10'000 / kThinning);
  testing::tried("tumbles", contacts);
}

// From 1 to 50 mm inside and from the middle, level or turned, whatever the drone is told: it is out within half a second.
TEST(Tumbles, WhatBeginsInsideGetsOut) {
  const DroneModel x500 = DroneModel::load("x500");
  const float front = 0.9F + x500.radius();  // m; there the hull touches nothing
  Random random(53);
  const auto wall = [] { return primitive(PrimitiveKind::room, {0, 0, 0}, {20, 20, 20}); };
  TriangleMesh mesh;
  add_box(mesh, Vec3::Zero(), Vec3::Constant(0.5F));
  BodyConfig body;
  const std::vector<std::shared_ptr<const World>> worlds{
      make_world({wall(), primitive(PrimitiveKind::box, Vec3::Zero(), Vec3::Constant(0.5F))}),
      make_world({wall(), primitive(PrimitiveKind::sphere, Vec3::Zero(), Vec3::Constant(0.5F))}),
      make_world({wall(), primitive(PrimitiveKind::cylinder, Vec3::Zero(), Vec3::Constant(0.5F))}),
      make_world({wall()}, {}, mesh), make_world({wall()})};
  for (std::size_t place = 0; place < worlds.size(); ++place) {
    for (const OnContact on_contact : {OnContact::stop, OnContact::bounce}) {
      for (const float hz : {100.0F, 500.0F}) {
        BatchConfig config{.num_envs = 20 + 10 / kThinning, .num_threads = 1, .clock = {.policy_hz = 50.0F, .physics_hz = hz}};
        config.dynamics.motion = Motion::rotors;
        config.dynamics.control = Control::velocity;
        config.dynamics.on_contact = on_contact;
        if (place + 1 == worlds.size()) config.bodies = {body};
        Batch batch(config, {worlds[place]}, nullptr, x500);
        const auto count = static_cast<std::size_t>(config.num_envs);
        std::vector<float> position, rotation, commands;
        for (std::size_t drone = 0; drone < count; ++drone) {
          const bool in_middle = drone % 10 == 0 && place != 3;  // a mesh is hollow
          const Vec3 direction = random.point(1.0F).normalized();
          const Vec3 at = in_middle ? Vec3(0.01F * direction) : Vec3(front * direction);
          position.insert(position.end(), {at.x(), at.y(), at.z()});
          const Quat q = drone < 20 ? Quat::Identity() : random.rotation();
          rotation.insert(rotation.end(), {q.w(), q.x(), q.y(), q.z()});
          for (int axis = 0; axis < 4; ++axis) commands.push_back(drone % 3 == 0 ? 0.0F : random.within(-3.0F, 3.0F));
        }
        // From where it touches nothing, each moves on until it is inside, by up to 50 mm.
        std::vector<std::int64_t> drones(count);
        std::iota(drones.begin(), drones.end(), 0);
        std::vector<std::uint8_t> is_free(count, 1);
        for (int step = 0; step < 70; ++step) {
          batch.is_free(drones, position, rotation, is_free);
          for (std::size_t drone = 0; drone < count; ++drone) {
            if (is_free[drone] == 0) continue;
            const Vec3 at = Vec3::Map(&position[3 * drone]);
            Vec3::Map(&position[3 * drone]) = at - random.within(0.001F, 0.05F) * at.normalized();
          }
        }
        EXPECT_EQ(std::ranges::count(is_free, 1), 0);
        batch.set_pose(position, rotation);
        for (int step = 0; step < 25; ++step) batch.fly(commands);
        EXPECT_EQ(std::ranges::count(batch.state().contact.inside, 1), 0) << "world " << place << ", " << hz << " Hz";
      }
    }
  }
}

}  // namespace
}  // namespace flockstep
