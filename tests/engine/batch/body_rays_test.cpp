// LiDAR beams and camera pixels of a batch against every body and the static world, in double precision. Bodies of all shapes
// and poses, 1 mm to 100 m large, most of them where a ray hits or just misses them.

#include "batch_helpers.hpp"
#include "picture_oracle.hpp"
#include "ray_oracle.hpp"

namespace flockstep {
namespace {

using oracle::Vec3d;
using namespace testing;

constexpr int kRayEnvs = 4, kRayBodies = 12;

// A body at its pose: a primitive, or the triangles of a mesh.
struct RayTarget {
  Primitive solid;
  const TriangleMesh* mesh = nullptr;
  float reach = 0.0F;  // m, half of its largest size
  int slot = 0;

  oracle::Hit hit(const Vec3d& origin, const Vec3d& direction) const {
    if (mesh == nullptr) return oracle::hit_primitive(solid, origin, direction);
    const Eigen::Matrix3d rotation = solid.rotation.cast<double>().normalized().toRotationMatrix();
    const Vec3d o = rotation.transpose() * (origin - solid.center.cast<double>());
    const Vec3d d = rotation.transpose() * direction;
    oracle::Hit nearest;
    for (std::size_t i = 0; i < mesh->triangles.size(); ++i) {
      const oracle::Hit hit = oracle::hit_triangle(*mesh, i, o, d);
      if (hit.t < nearest.t) nearest = hit;
    }
    nearest.normal = rotation * nearest.normal;
    return nearest;
  }
};

// Everything that the rays of one env may hit: the static world and the bodies.
struct RayTargets {
  const World* world = nullptr;
  std::vector<RayTarget> bodies;

  const RayTarget* body_of(int element) const {
    const auto found = std::ranges::find_if(bodies, [element](const RayTarget& body) { return element == -2 - body.slot; });
    return found == bodies.end() ? nullptr : &*found;
  }

  // Numbers elements as the world does; body b follows as -2 - b. Distances are in lengths of the direction.
  oracle::Hit nearest(const Vec3d& origin, const Vec3d& direction, double range) const {
    oracle::Hit found = oracle::nearest(*world, origin, direction, range);
    for (const RayTarget& body : bodies) {
      const oracle::Hit hit = body.hit(origin, direction);
      if (hit.t > range || hit.t >= found.t) continue;
      found = hit;
      found.element = -2 - body.slot;
      if (found.normal.dot(direction) > 0.0) found.normal = -found.normal;
    }
    return found;
  }

  // Returns how far the hit moves along the ray, relative to the offset, if the ray moves aside or along by `aside` (m).
  // Infinite near an edge, a silhouette or the end of the range.
  double steepness(const oracle::Hit& hit, const Vec3d& origin, const Vec3d& direction, double range, double aside) const {
    const double length = direction.norm();
    if (std::abs(hit.t - range) * length <= aside) return oracle::kNever;
    const Vec3d along = direction / length;
    const Vec3d u = along.unitOrthogonal();
    const Vec3d v = along.cross(u);
    double steepest = 0.0;
    for (const Vec3d& way : {u, Vec3d(-u), v, Vec3d(-v), along, Vec3d(-along)}) {
      const oracle::Hit other = nearest(origin + aside * way, direction, range);
      if (other.element != hit.element) return oracle::kNever;
      if (hit.element == -1) continue;
      if (other.normal.dot(hit.normal) < 0.9) return oracle::kNever;
      steepest = std::max(steepest, std::abs(other.t - hit.t) * length / aside);
    }
    return steepest;
  }
};

struct RayTally {
  long rays = 0, of_bodies = 0, of_meshes = 0, of_small = 0, of_large = 0, of_statics = 0, misses = 0, unclear = 0;
  double worst = 0.0;  // error relative to the tolerance
};

struct Ray {
  Vec3d origin, direction;
  double near = 0.0, range = 0.0;  // in lengths of the direction
};

// Compares one ray with its reading: the distance in lengths of the direction, and, if known, what it hit.
void check_ray(const RayTargets& targets, const Ray& ray, float distance, const int* element, RayTally& tally) {
  ++tally.rays;
  const Vec3d origin = ray.origin + ray.near * ray.direction;
  const double range = ray.range - ray.near;
  const oracle::Hit expected = targets.nearest(origin, ray.direction, range);
  // Positions, directions and hits are rounded to float32: to 1e-7 of the largest number that takes part.
  const double length = ray.direction.norm();
  double scale = std::max(ray.origin.cwiseAbs().maxCoeff(), expected.element == -1 ? 0.0 : expected.t * length);
  const RayTarget* const body = targets.body_of(expected.element);
  if (body != nullptr) {
    scale = std::max({scale, static_cast<double>(body->solid.center.cwiseAbs().maxCoeff()), static_cast<double>(body->reach)});
  }
  const double error_m = 2e-6 * std::max(1.0, scale);
  const double steepness = targets.steepness(expected, origin, ray.direction, range, 2.0 * error_m);
  if (steepness == oracle::kNever) {
    ++tally.unclear;
    return;
  }
  tally.of_bodies += body != nullptr;
  tally.of_statics += expected.element >= 0;
  tally.misses += expected.element == -1;
  if (body != nullptr) {
    tally.of_meshes += body->mesh != nullptr;
    tally.of_small += body->reach < 0.01F;
    tally.of_large += body->reach > 5.0F;
  }
  const auto text = [&] {
    std::ostringstream said;
    said << "from " << ray.origin.transpose() << " along " << ray.direction.transpose() << ", [" << ray.near << ", " << ray.range
         << "]: element " << expected.element << " at " << ray.near + expected.t << ", steepness " << steepness;
    return said.str();
  };
  if (element != nullptr) {
    EXPECT_EQ(*element, expected.element) << text();
  }
  if (expected.element == -1) {
    EXPECT_TRUE(std::isinf(distance)) << distance << ' ' << text();
    return;
  }
  const double error = std::abs(static_cast<double>(distance) - ray.near - expected.t) * length;
  const double most = error_m * std::max(1.0, steepness);
  tally.worst = std::max(tally.worst, error / most);
  EXPECT_LE(error, most) << distance << ' ' << text();
}

float log_uniform(Random& random, float least, float most) {
  return least * std::exp(random.within(0.0F, 1.0F) * std::log(most / least));
}

// Triangles at random places around the origin.
TriangleMesh triangles_within(Random& random, int count, float spread, float size) {
  TriangleMesh mesh;
  for (std::int32_t i = 0; i < 3 * count; i += 3) {
    const Vec3 center = random.point(spread);
    for (int corner = 0; corner < 3; ++corner) mesh.vertices.push_back(center + random.point(size));
    mesh.triangles.push_back({i, i + 1, i + 2});
  }
  return mesh;
}

BodyConfig body_of_any_size(Random& random) {
  BodyConfig body;
  if (random.generator()() % 10 == 0) body.visibility = Visibility::solid;
  body.shape = static_cast<BodyShape>(random.generator()() % 5);
  const float size = log_uniform(random, 1e-3F, 100.0F);
  if (body.shape == BodyShape::mesh) {
    body.mesh = make_world({}, {}, triangles_within(random, 12, 0.3F * size, 0.2F * size));
    return body;
  }
  const auto side = [&] { return std::clamp(size * log_uniform(random, 0.1F, 1.0F), 1e-3F, 100.0F); };
  body.size_m = {side(), side(), side()};
  if (body.shape != BodyShape::box) body.size_m[1] = body.size_m[0];
  if (body.shape == BodyShape::sphere) body.size_m[2] = body.size_m[0];
  if (body.shape == BodyShape::capsule) body.size_m[2] += body.size_m[0];
  return body;
}

// Half of the body's largest size.
float reach_of(const BodyConfig& body) {
  if (body.mesh == nullptr) return 0.5F * std::max({body.size_m[0], body.size_m[1], body.size_m[2]});
  const Aabb& box = body.mesh->bounds();
  return box.min.cwiseAbs().cwiseMax(box.max.cwiseAbs()).maxCoeff();
}

PrimitiveKind kind_of(BodyShape shape) {
  constexpr std::array kKinds{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule};
  return kKinds[static_cast<std::size_t>(shape)];
}

std::shared_ptr<const World> world_around(Random& random) {
  std::vector<Primitive> primitives;
  if (random.generator()() % 2 == 0) {
    primitives.push_back(
        primitive(PrimitiveKind::room, random.point(1.0F), Vec3(log_uniform(random, 4, 80), log_uniform(random, 4, 80), 40)));
  }
  const unsigned count = std::array{1U, 5U, 60U}[random.generator()() % 3];
  for (unsigned i = 0; i < count; ++i) {
    const auto shape = static_cast<BodyShape>(random.generator()() % 4);
    Vec3 half(random.within(0.05F, 0.8F), random.within(0.05F, 0.8F), random.within(0.05F, 0.8F));
    if (shape != BodyShape::box) half.y() = half.x();
    if (shape == BodyShape::sphere) half.z() = half.x();
    if (shape == BodyShape::capsule) half.z() += half.x();
    const Quat turn = shape == BodyShape::sphere ? Quat::Identity() : random.rotation();
    primitives.push_back(primitive(kind_of(shape), random.point(12.0F), half, turn));
  }
  TriangleMesh mesh;
  if (random.generator()() % 3 == 0) mesh = triangles_within(random, 20, 8.0F, 1.5F);
  return make_world(std::move(primitives), {}, std::move(mesh));
}

// One drone among bodies in each env, with a LiDAR and a camera.
class RayScene {
 public:
  explicit RayScene(Random& random) : random_(random), world_(world_around(random)), batch_(config(), {world_}) {
    for (int slot = 0; slot < kRayBodies; ++slot) {
      for (int env = 0; env < kRayEnvs; ++env) {
        std::vector<std::uint8_t> only(kRayEnvs, 0);
        only[static_cast<std::size_t>(env)] = 1;
        if (random_.generator()() % 8 != 0) batch_.bodies().spawn(body_of_any_size(random_), {}, {}, {}, {}, only);
      }
    }
  }

  // Puts the drones and bodies elsewhere, reads the sensors and checks every ray.
  void look(RayTally& tally) {
    place();
    batch_.sense();
    batch_.camera(0).capture();
    for (std::size_t env = 0; env < kRayEnvs; ++env) {
      const RayTargets targets = targets_of(env);
      check_beams(env, targets, tally);
      check_pixels(env, targets, tally);
    }
  }

 private:
  BatchConfig config() {
    BatchConfig config{.num_envs = kRayEnvs, .num_threads = 1, .max_bodies = kRayBodies};
    LidarConfig lidar;
    lidar.channels = random_.generator()() % 2 == 0 ? 1 : 9;
    lidar.beams = lidar.channels == 1 ? 140 : 16;
    lidar.hfov_deg = std::array{20.0F, 120.0F, 360.0F}[random_.generator()() % 3];
    lidar.vfov_deg = lidar.channels == 1 ? 0.0F : random_.within(10, 120);
    lidar.max_range_m = std::array{3.0F, 30.0F, 300.0F}[random_.generator()() % 3];
    config.lidars = {lidar};
    CameraConfig camera;
    camera.width_px = 19;
    camera.height_px = 17;
    camera.hfov_deg = random_.within(5, 120);
    camera.near_m = std::array{0.01F, 0.05F, 1.0F}[random_.generator()() % 3];
    camera.far_m = std::array{10.0F, 100.0F, 1000.0F}[random_.generator()() % 3];
    camera.outputs = {.rgb = false, .depth = true, .instance = true};
    camera.capture_mode = CaptureMode::on_demand;
    config.cameras = {camera};
    return config;
  }

  Pose pose_of(const std::vector<float>& position, const std::vector<float>& quat, std::size_t row) const {
    const float* const q = quat.data() + 4 * row;
    return {Vec3::Map(position.data() + 3 * row), Quat(q[0], q[1], q[2], q[3])};
  }

  void place() {
    const Poses drones = random_poses(random_, kRayEnvs, Vec3::Constant(random_.within(0.1F, 6.0F)));
    batch_.set_pose(drones.position, drones.quat_wxyz);
    Poses bodies = random_poses(random_, kRayEnvs * kRayBodies, Vec3::Constant(1.0F));
    std::vector<float> beams(kRayEnvs * rays() * 3);
    batch_.lidar().directions(beams);
    for (std::size_t row = 0; row < kRayEnvs * kRayBodies; ++row) {
      const std::size_t env = row / kRayBodies;
      const BodyConfig* const body = batch_.bodies().config(EnvIndex(env), row % kRayBodies);
      if (body == nullptr) continue;
      const Pose drone = pose_of(drones.position, drones.quat_wxyz, env);
      const std::size_t beam = random_.generator()() % rays();
      Vec3 ahead = drone.rotation * Vec3::Map(beams.data() + 3 * (env * rays() + beam));
      if (random_.generator()() % 2 == 0) {  // towards a pixel
        const CameraConfig& camera = batch_.config().cameras[0];
        const float reach = std::tan(0.5F * *camera.hfov_deg * 0.01745329F);
        ahead = drone.rotation * Vec3(1, random_.within(-reach, reach), random_.within(-reach, reach)).normalized();
      }
      const float radius = reach_of(*body);
      const float beyond = random_.generator()() % 8 == 0 ? 0.0F : radius;  // 0: may be around the sensor
      const float far = radius < 0.05F ? log_uniform(random_, 0.02F, 1.0F) : log_uniform(random_, 0.05F, 60.0F);
      const Vec3 at = drone.position + (far + beyond) * ahead + random_.point(0.7F * radius);
      std::copy_n(at.data(), 3, bodies.position.begin() + static_cast<std::ptrdiff_t>(3 * row));
      if (random_.generator()() % 4 == 0) {  // not turned, or not visibly
        const std::array<float, 4> level{random_.generator()() % 2 == 0 ? 1.0F : -1.0F, 0, 0, 0};
        std::copy_n(level.data(), 4, bodies.quat_wxyz.begin() + static_cast<std::ptrdiff_t>(4 * row));
      }
    }
    batch_.bodies().set_pose(bodies.position, bodies.quat_wxyz);
  }

  std::size_t rays() const {
    const LidarConfig& lidar = batch_.config().lidars[0];
    return static_cast<std::size_t>(lidar.channels * lidar.beams);
  }

  RayTargets targets_of(std::size_t env) const {
    RayTargets targets{world_.get(), {}};
    const BodyState& state = batch_.state().bodies;
    for (std::size_t slot = 0; slot < kRayBodies; ++slot) {
      const std::size_t row = env * kRayBodies + slot;
      const BodyConfig* const body = batch_.bodies().config(EnvIndex(env), slot);
      EXPECT_EQ(body != nullptr, state.active[row] != 0);
      if (body == nullptr || body->visibility == Visibility::solid) continue;
      const Pose pose = pose_of(state.position, state.quat_wxyz, row);
      RayTarget target{{.center = pose.position, .rotation = pose.rotation}, nullptr, reach_of(*body), static_cast<int>(slot)};
      if (body->mesh != nullptr) {
        target.mesh = &body->mesh->triangles();
      } else {
        target.solid.kind = kind_of(body->shape);
        target.solid.half_extents = 0.5F * Vec3(body->size_m[0], body->size_m[1], body->size_m[2]);
      }
      targets.bodies.push_back(target);
    }
    return targets;
  }

  void check_beams(std::size_t env, const RayTargets& targets, RayTally& tally) const {
    std::vector<float> directions(kRayEnvs * rays() * 3);
    batch_.lidar().directions(directions);
    const State& state = batch_.state();
    const Pose drone = pose_of(state.position, state.quat_wxyz, env);
    const Eigen::Matrix3d rotation = drone.rotation.cast<double>().normalized().toRotationMatrix();
    for (std::size_t beam = 0; beam < rays(); ++beam) {
      const Vec3d local = Eigen::Vector3f(directions.data() + 3 * (env * rays() + beam)).cast<double>();
      const Ray ray{drone.position.cast<double>(), (rotation * local).normalized(), 0.0,
                    static_cast<double>(batch_.config().lidars[0].max_range_m)};
      check_ray(targets, ray, batch_.lidar().readings().ranges[env * rays() + beam], nullptr, tally);
    }
  }

  void check_pixels(std::size_t env, const RayTargets& targets, RayTally& tally) const {
    const CameraConfig& camera = batch_.config().cameras[0];
    const State& state = batch_.state();
    const oracle::Eye eye = oracle::eye_of(camera, oracle::vector_of(state.position.data() + 3 * env),
                                           oracle::matrix_of(state.quat_wxyz.data() + 4 * env));
    const int instances_of_statics = static_cast<int>(world_->primitives().size());
    for (int row = 0; row < camera.height_px; ++row) {
      for (int column = 0; column < camera.width_px; ++column) {
        const Ray ray{eye.origin, oracle::direction_through(camera, eye, column + 0.5, row + 0.5),
                      static_cast<double>(camera.near_m), static_cast<double>(camera.far_m)};
        const auto pixel = static_cast<std::size_t>((static_cast<int>(env) * camera.height_px + row) * camera.width_px + column);
        const int instance = batch_.camera(0).images().instance[pixel];
        int element = instance >= kFirstBodyInstance ? kFirstBodyInstance - instance - 2 : instance - 1;
        const bool is_mesh = element >= instances_of_statics;  // all triangles are one instance
        check_ray(targets, ray, batch_.camera(0).images().depth[pixel], is_mesh ? nullptr : &element, tally);
      }
    }
  }

  Random& random_;
  std::shared_ptr<const World> world_;
  Batch batch_;
};

TEST(BodyRays, HitWhatClosedFormsHit) {
  const long wanted = times_tried(40'000) / kThinning;
  RayTally tally;
  for (unsigned seed = part_tried() << 24U; tally.rays < wanted; ++seed) {
    SCOPED_TRACE(seed);
    Random random(seed);
    RayScene scene(random);
    for (int i = 0; i < 4; ++i) scene.look(tally);
    ASSERT_FALSE(HasFailure());
  }
  EXPECT_GT(tally.of_bodies, tally.rays / 4);
  EXPECT_GT(tally.of_meshes, tally.rays / 50);
  EXPECT_GT(tally.of_small, tally.rays / 100);
  EXPECT_GT(tally.of_large, tally.rays / 20);
  EXPECT_GT(tally.of_statics, tally.rays / 10);
  EXPECT_GT(tally.misses, tally.rays / 20);
  EXPECT_LT(tally.unclear, tally.rays / 50);
  std::ostringstream text;
  text << tally.rays << " rays, " << tally.of_bodies << " on bodies (" << tally.of_small << " small, " << tally.of_large
       << " large, " << tally.of_meshes << " on meshes), " << tally.of_statics << " on the static world, " << tally.misses
       << " misses, " << tally.unclear << " near an edge; worst error " << tally.worst << " of the tolerance";
  RecordProperty("counts", text.str());
  testing::tried("body_rays", tally.rays);
}

}  // namespace
}  // namespace flockstep
