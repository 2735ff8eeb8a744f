// Bodies that push drones of a batch among walls and other bodies, and thin plates that nothing passes.
#include "batch/body_envs.hpp"

namespace flockstep {
namespace {

using namespace contacts;

// -- Pushes among walls and other bodies.

// Returns true if the drone is proved to be apart from the solid.
bool is_apart(const Mover& solid, const Pose& drone) { return solid.distance(1.0, {drone, drone}, 0.0, 0.0) > 0.0; }

// Bodies that fly to and fro in a room with two obstacles. At most `length` (m) per motion.
class Shoving {
 public:
  Shoving(const BatchConfig& config, Random& random, float length, float motion_s)
      : random_(random), speed_(length / motion_s), envs(config, statics_of(random)) {
    envs.spawn([this] { return any_body(random_, 5e-3F, 1.2F); });
    for (std::size_t env = 0; env < envs.envs; ++env) begin(env);
  }

  // Puts the drone of an env and its bodies elsewhere; the drone is free.
  void begin(std::size_t env) {
    std::vector<Mover> solids = envs.solids(env);
    Pose pose;
    do {
      pose = {random_.point(1.2F), random_.rotation()};
    } while (!std::all_of(solids.begin(), solids.end(),
                          [&pose](const Mover& solid) { return solid.number >= 0 || is_apart(solid, pose); }));
    std::vector<float> position(batch().state().position), quat(batch().state().quat_wxyz);
    put(position, env, pose.position);
    put(quat, env, pose.rotation);
    std::vector<std::uint8_t> drone_mask(envs.envs, 0), body_mask(envs.envs * envs.slots, 0);
    drone_mask[env] = 1;
    batch().set_pose(position, quat, drone_mask);
    for (Mover& solid : solids) {
      if (solid.number < 0) continue;
      const std::size_t row = env * envs.slots + static_cast<std::size_t>(solid.number);
      do {
        solid.way.from = solid.way.to = {random_.point(1.7F), random_.rotation()};
      } while (!is_apart(solid, pose));
      put(envs.position, row, solid.way.to.position);
      put(envs.quat, row, solid.way.to.rotation);
      body_mask[row] = 1;
    }
    batch().bodies().set_pose(envs.position, envs.quat, body_mask);
    for (std::size_t slot = 0; slot < envs.slots; ++slot) turn_back(env * envs.slots + slot);
    batch().bodies().set_velocity(envs.velocity, envs.turning, body_mask);
    was_inside_[env] = false;
    age_[env] = 0;
  }

  // Call it before each motion: bodies that leave the room turn back.
  void steer() {
    for (std::size_t row = 0; row < envs.envs * envs.slots; ++row) {
      const Vec3 at = envs.body(row).position;
      if (at.cwiseAbs().maxCoeff() > 1.8F || random_.generator()() % 64 == 0) turn_back(row);
    }
    batch().bodies().set_velocity(envs.velocity, envs.turning);
  }

  // Call it after each motion.
  void check(long motion) {
    const ContactState& contact = batch().state().contact;
    for (std::size_t env = 0; env < envs.envs; ++env, ++motions) {
      const Pose pose = envs.drone(env);
      for (const Mover& solid : envs.solids(env)) {
        if (is_apart(solid, pose)) continue;
        ASSERT_GE(solid.number, 0) << "in a wall or an obstacle: motion " << motion << ", env " << env;
        ASSERT_TRUE(contact.inside[env]) << "in body " << solid.number << ": motion " << motion << ", env " << env;
      }
      pushes += contact.body[env] >= 0;
      squeezes += !was_inside_[env] && contact.inside[env];
      was_inside_[env] = contact.inside[env];
      if (++age_[env] > 400 || (was_inside_[env] && random_.generator()() % 8 == 0)) begin(env);
    }
  }

  Batch& batch() { return envs.batch; }

  static void report(long motions, long pushes, long squeezes) {
    EXPECT_GT(pushes, motions / 50);
    EXPECT_GT(squeezes, 0);
    EXPECT_LT(squeezes, pushes / 2);
    std::ostringstream text;
    text << motions << " motions, " << pushes << " pushes, " << squeezes << " squeezes";
    ::testing::Test::RecordProperty("counts", text.str());
    testing::tried("shoves", pushes);
  }

 private:
  static std::vector<Primitive> statics_of(Random& random) {
    std::vector<Primitive> statics{primitive(PrimitiveKind::room, Vec3::Zero(), {2, 2, 2})};
    for (int i = 0; i < 2; ++i) {
      BodyConfig shape;
      do {
        shape = any_body(random, 0.02F, 1.0F);
      } while (shape.mesh != nullptr);
      const Quat turn = shape.shape == BodyShape::sphere ? Quat::Identity() : random.rotation();
      statics.push_back(primitive(primitive_kind(shape.shape), random.point(1.8F),
                                  0.5F * Vec3(shape.size_m[0], shape.size_m[1], shape.size_m[2]), turn));
    }
    return statics;
  }

  void turn_back(std::size_t row) {
    const Vec3 target = random_.within(0, 1) < 0.7F ? envs.drone(row / envs.slots).position : random_.point(1.0F);
    const Vec3 way = target - envs.body(row).position;
    put(envs.velocity, row, Vec3(random_.within(0.1F, 1.0F) * speed_ * (way.normalized() + 0.2F * random_.direction())));
    const float turn = random_.within(0, 1) < 0.5F ? 0.0F : random_.within(0.0F, 2.0F) * speed_;
    put(envs.turning, row, Vec3(std::min(turn, 30.0F) * random_.direction().normalized()));
  }

  Random& random_;
  float speed_;

 public:
  BodyEnvs envs;
  long motions = 0, pushes = 0, squeezes = 0;

 private:
  std::vector<bool> was_inside_ = std::vector<bool>(envs.envs, false);
  std::vector<int> age_ = std::vector<int>(envs.envs, 0);
};

constexpr int kShovedEnvs = 16, kShovingBodies = 4;

// Makes scenes and moves what is in them until bodies have pushed drones often enough.
template <class Scene, class Act>
void try_pushes(unsigned seed, long wanted, const Scene& scene_of, long motions_per_scene, const Act& act) {
  Random random(seed + 100U * part_tried());
  wanted = times_tried(wanted);
  long motions = 0, pushes = 0, squeezes = 0;
  for (std::size_t number = 0; pushes < wanted; ++number) {
    auto scene = scene_of(random, number);
    for (long motion = 0; motion < motions_per_scene; ++motion) {
      act(scene, random, motion);
      scene.check(motion);
      if (::testing::Test::HasFatalFailure()) return;
    }
    motions += scene.motions;
    pushes += scene.pushes;
    squeezes += scene.squeezes;
  }
  decltype(scene_of(random, 0))::report(motions, pushes, squeezes);
}

void shove_kinematic(unsigned seed, long wanted, float length) {
  const auto scene_of = [&](Random& random, std::size_t) {
    return Shoving(BodyEnvs::config(kShovedEnvs, kShovingBodies), random, length, kStepS);
  };
  try_pushes(seed, wanted, scene_of, 100, [&](Shoving& shoving, Random& random, long) {
    std::vector<float> target(3 * kShovedEnvs), quat(4 * kShovedEnvs);
    for (std::size_t env = 0; env < kShovedEnvs; ++env) {
      const Pose pose = shoving.envs.drone(env);
      const bool stands = random.within(0, 1) < 0.4F;
      put(target, env, stands ? pose.position : Vec3(pose.position + random.point(std::min(length, 0.5F))));
      put(quat, env, stands ? pose.rotation : turned_by(random, 20.0F, pose.rotation));
    }
    shoving.steer();
    shoving.batch().move(target, quat);
  });
}

TEST(Shoves, OfKinematicDronesBySlowBodies) { shove_kinematic(21, 1000, 0.1F); }
TEST(Shoves, OfKinematicDronesByFastBodies) { shove_kinematic(22, 1000, 1.0F); }
TEST(Shoves, OfKinematicDronesAt50MetresPerSecond) { shove_kinematic(23, 1000, 5.0F); }

// The configuration of a scene by its number: drones with rotors, and each kind of contact in turn.
BatchConfig rotor_config(std::size_t scene, int envs, int slots) {
  constexpr std::array kAll{OnContact::terminate, OnContact::stop, OnContact::bounce};
  BatchConfig config = BodyEnvs::config(envs, slots);
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::velocity;
  config.dynamics.on_contact = kAll[scene % kAll.size()];
  config.clock.policy_hz = 50.0F;
  config.clock.physics_hz = 500.0F;
  return config;
}

// Bodies at up to `speed` (m/s), observed after every tick.
void shove_rotors(unsigned seed, long wanted, float speed) {
  constexpr float kTickS = 0.002F;
  const auto scene_of = [&](Random& random, std::size_t scene) {
    return Shoving(rotor_config(scene, kShovedEnvs, kShovingBodies), random, speed * kTickS, kTickS);
  };
  std::vector<float> command(4 * kShovedEnvs);
  try_pushes(seed, wanted, scene_of, 500, [&](Shoving& shoving, Random& random, long tick) {
    if (tick % 20 == 0) {
      for (float& value : command) value = random.within(-3.0F, 3.0F);
    }
    if (tick % 10 == 0) shoving.steer();
    shoving.batch().fly(command, 1);
  });
}

TEST(Shoves, OfDronesWithRotors) { shove_rotors(24, 1000, 10.0F); }
TEST(Shoves, OfDronesWithRotorsAt50MetresPerSecond) { shove_rotors(25, 1000, 50.0F); }

// -- Thin plates. A plate of 5 mm is so large that there is no way around it, and nothing else is there that could squeeze a
// drone: it is never inside, and stays on its side of the plate.

// Drones and plates that approach each other at 50 m/s or more, each pair in an env.
class Plates {
 public:
  static constexpr int kEnvs = 16;
  static constexpr float kHalfSide = 500.0F, kApproach = 50.0F;  // m, m/s

  Plates(const BatchConfig& config, Random& random)
      : envs(config, {primitive(PrimitiveKind::sphere, {5000, 0, 0}, Vec3::Ones())}) {
    envs.spawn([] {
      BodyConfig plate;
      plate.size_m = {0.005F, 2.0F * kHalfSide, 2.0F * kHalfSide};
      return plate;
    });
    std::vector<float> position(3 * envs.envs), quat(4 * envs.envs);
    for (std::size_t env = 0; env < envs.envs; ++env) {
      sides_.push_back(random.generator()() % 2 == 0 ? 1.0F : -1.0F);
      parts_.push_back(random.generator()() % 3 == 0 ? 1.0F : random.within(0, 1));
      const Pose drone{random.point(2.0F), random.rotation()};
      put(position, env, drone.position);
      put(quat, env, drone.rotation);
      const Quat turn = random.rotation();
      const Vec3 normal = sides_[env] * (turn * Vec3::UnitX());
      const Vec3 along = turn * Vec3(0, random.within(-1, 1), random.within(-1, 1));
      put(envs.position, env,
          Vec3(drone.position - (tried_drone().radius() + 0.003F + random.within(0.0F, 1.0F)) * normal + 50.0F * along));
      put(envs.quat, env, turn);
      put(envs.velocity, env, Vec3(parts_[env] * kApproach * normal + random.within(0, 20) * along));
      const float rate = random.generator()() % 2 == 0 ? 0.0F : random.within(0.0F, 0.5F);  // rad/s
      put(envs.turning, env, Vec3(rate * random.direction().normalized()));
    }
    envs.batch.set_pose(position, quat);
    envs.batch.bodies().set_pose(envs.position, envs.quat);
    envs.batch.bodies().set_velocity(envs.velocity, envs.turning);
  }

  // Normal of the face that is towards the drone.
  Vec3 normal(std::size_t env) const { return sides_[env] * (envs.body(env).rotation * Vec3::UnitX()); }
  // Velocity of the drone, which makes up for the approach that its plate lacks.
  Vec3 speed(std::size_t env) const { return -(1.0F - parts_[env]) * kApproach * normal(env); }

  // Call it after each motion.
  void check(long motion) {
    const ContactState& contact = envs.batch.state().contact;
    for (std::size_t env = 0; env < envs.envs; ++env, ++motions) {
      const Pose drone = envs.drone(env), plate = envs.body(env);
      const Vec3d face = normal(env).cast<double>().normalized();
      const oracle::Support hull = oracle::hull_at(tried_drone(), drone.position.cast<double>(), drone.rotation.cast<double>());
      const Vec3d apart = hull(-face) - plate.position.cast<double>();
      ASSERT_GT(face.dot(apart), 0.0025) << "motion " << motion << ", env " << env;
      ASSERT_LT((apart - face.dot(apart) * face).cwiseAbs().maxCoeff(), static_cast<double>(kHalfSide) - 2.0);
      ASSERT_FALSE(contact.inside[env]) << "motion " << motion << ", env " << env;
      pushes += contact.body[env] >= 0;
    }
  }

  static void report(long motions, long pushes, long) {
    EXPECT_GT(pushes, motions / 4);
    ::testing::Test::RecordProperty("counts", std::to_string(motions) + " motions, " + std::to_string(pushes) + " pushes");
    testing::tried("shoves", pushes);
  }

  BodyEnvs envs;
  long motions = 0, pushes = 0, squeezes = 0;  // nothing could squeeze them

 private:
  std::vector<float> sides_, parts_;  // parts: of the approach that is the plate's
};

TEST(Shoves, NoKinematicDronePassesAThinPlate) {
  const auto scene_of = [](Random& random, std::size_t) { return Plates(BodyEnvs::config(Plates::kEnvs, 1), random); };
  try_pushes(31, 1000 / kThinning, scene_of, 20, [](Plates& plates, Random& random, long) {
    std::vector<float> target(3 * plates.envs.envs), quat(4 * plates.envs.envs);
    for (std::size_t env = 0; env < plates.envs.envs; ++env) {
      const Pose pose = plates.envs.drone(env);
      put(target, env, Vec3(pose.position + kStepS * plates.speed(env)));
      put(quat, env, random.within(0, 1) < 0.5F ? pose.rotation : turned_by(random, 90.0F, pose.rotation));
    }
    plates.envs.batch.move(target, quat);
  });
}

TEST(Shoves, NoDroneWithRotorsPassesAThinPlate) {
  const auto scene_of = [](Random& random, std::size_t scene) { return Plates(rotor_config(scene, Plates::kEnvs, 1), random); };
  std::vector<float> command(4 * Plates::kEnvs), velocity(3 * Plates::kEnvs), turning(3 * Plates::kEnvs);
  try_pushes(32, 1000, scene_of, 200, [&](Plates& plates, Random& random, long tick) {
    if (tick % 10 == 0) {  // again towards the plate
      for (std::size_t env = 0; env < plates.envs.envs; ++env) {
        put(velocity, env, plates.speed(env));
        put(turning, env, random.point(20.0F));
        put(command, env, Quat(-1, -1, -1, 1));
      }
      plates.envs.batch.set_velocity(velocity, turning, {});
    }
    plates.envs.batch.fly(command, 1);
  });
}

}  // namespace
}  // namespace flockstep
