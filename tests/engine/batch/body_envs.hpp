// Envs of one drone among bodies that move, and their oracle.
#pragma once

#include "batch_helpers.hpp"
#include "collision/sweep.hpp"
#include "convex_oracle.hpp"

namespace flockstep::contacts {

using oracle::Vec3d;
using oracle::Way;
using namespace testing;

inline constexpr float kStepS = 0.1F;  // of a kinematic batch, one tick

inline const DroneModel& tried_drone() {
  static const DroneModel model = DroneModel::quadrotor650();
  return model;
}

// A convex solid and its motion. A room is hollow, and a mesh is its convex hull.
struct Mover {
  PrimitiveKind kind = PrimitiveKind::box;
  Vec3 half = Vec3::Ones();
  Way way;
  int number = -1;  // of the body; -1: static
  const TriangleMesh* mesh = nullptr;

  double radius() const { return half.cast<double>().norm(); }

  // The solid at a time. Spheres and capsules are the points within rounding() of it.
  oracle::Support core(double time) const {
    const Vec3d position = way.position(time);
    if (kind == PrimitiveKind::sphere) return oracle::polytope({position});
    const Eigen::Matrix3d rotation = way.rotation(time).toRotationMatrix();
    if (mesh != nullptr) {
      std::vector<Vec3d> corners;
      for (const Vec3& vertex : mesh->vertices) corners.emplace_back(position + rotation * vertex.cast<double>());
      return oracle::polytope(std::move(corners));
    }
    if (kind == PrimitiveKind::capsule) {
      const Vec3d up = static_cast<double>(half.z() - half.x()) * rotation.col(2);
      return oracle::polytope({position + up, position - up});
    }
    const oracle::Support local = oracle::solid({.kind = kind, .half_extents = half});
    return [=](const Vec3d& d) -> Vec3d { return position + rotation * local(rotation.transpose() * d); };
  }
  double rounding() const {
    return kind == PrimitiveKind::sphere || kind == PrimitiveKind::capsule ? static_cast<double>(half.x()) : 0.0;
  }

  // Returns the distance from a hull at a time, or a lower bound of it that exceeds `enough`.
  double distance(double time, const Way& drone, double drone_time, double enough) const {
    const Vec3d at = drone.position(drone_time);
    if (kind == PrimitiveKind::room) {
      const oracle::Support hull = oracle::hull_at(tried_drone(), at, drone.rotation(drone_time));
      return oracle::distance_from(hull, {.kind = kind, .half_extents = half});
    }
    const double reach = radius() + static_cast<double>(tried_drone().radius());
    const double apart = (at - way.position(time)).norm() - reach;
    if (apart > enough) return apart;
    const oracle::Support hull = oracle::hull_at(tried_drone(), at, drone.rotation(drone_time));
    return oracle::distance(hull, core(time)).lower - rounding();
  }
};

inline float any_size(Random& random, float least, float most) {
  return least * std::exp(random.within(0.0F, 1.0F) * std::log(most / least));
}

inline BodyConfig any_body(Random& random, float least, float most) {
  BodyConfig body;
  body.shape = static_cast<BodyShape>(random.generator()() % 5);
  body.size_m = {any_size(random, least, most), any_size(random, least, most), any_size(random, least, most)};
  if (body.shape == BodyShape::mesh) {
    TriangleMesh mesh;
    for (std::int32_t i = 0; i < 12; ++i) {
      mesh.vertices.push_back(0.5F * Vec3(Vec3::Map(body.size_m.data())).cwiseProduct(random.point(1.0F)));
      if (i % 3 == 0) mesh.triangles.push_back({i, i + 1, i + 2});
    }
    body.mesh = make_world({}, {}, std::move(mesh));
    body.size_m = BodyConfig().size_m;
    return body;
  }
  if (body.shape != BodyShape::box) body.size_m[1] = body.size_m[0];
  if (body.shape == BodyShape::sphere) body.size_m[2] = body.size_m[0];
  if (body.shape == BodyShape::capsule) body.size_m[2] += body.size_m[0];
  return body;
}

inline PrimitiveKind primitive_kind(BodyShape shape) {
  constexpr std::array kKinds{PrimitiveKind::box, PrimitiveKind::cylinder, PrimitiveKind::sphere, PrimitiveKind::capsule};
  return kKinds[static_cast<std::size_t>(shape)];
}

inline Quat turned_by(Random& random, float most_degrees, const Quat& from) {
  const float angle = random.within(0.0F, most_degrees) * std::numbers::pi_v<float> / 180.0F;
  return (Quat(Eigen::AngleAxisf(angle, random.direction().normalized())) * from).normalized();
}

// Rows of an array of positions, rotations or velocities.
inline void put(std::vector<float>& array, std::size_t row, const Vec3& value) {
  std::copy_n(value.data(), 3, array.begin() + static_cast<std::ptrdiff_t>(3 * row));
}
inline void put(std::vector<float>& array, std::size_t row, const Quat& q) {
  const std::array<float, 4> wxyz{q.w(), q.x(), q.y(), q.z()};
  std::copy_n(wxyz.data(), 4, array.begin() + static_cast<std::ptrdiff_t>(4 * row));
}
inline Vec3 vector_at(const std::vector<float>& array, std::size_t row) { return Vec3::Map(array.data() + 3 * row); }
inline Pose pose_at(const std::vector<float>& position, const std::vector<float>& quat, std::size_t row) {
  const float* const q = quat.data() + 4 * row;
  return {vector_at(position, row), Quat(q[0], q[1], q[2], q[3])};
}

// Envs of one drone each, among bodies of their own, in one static world.
class BodyEnvs {
 public:
  std::vector<Primitive> statics;
  std::size_t envs, slots;
  Batch batch;
  std::vector<float> position, quat, velocity, turning;  // of bodies, for the next call

  BodyEnvs(const BatchConfig& config, std::vector<Primitive> static_solids)
      : statics(std::move(static_solids)),
        envs(static_cast<std::size_t>(config.num_envs)),
        slots(static_cast<std::size_t>(config.max_bodies)),
        batch(config, {make_world(statics)}),
        position(3 * envs * slots),
        quat(4 * envs * slots),
        velocity(3 * envs * slots),
        turning(3 * envs * slots) {}

  static BatchConfig config(int envs, int slots) {
    BatchConfig config{.num_envs = envs, .num_threads = 1, .max_bodies = slots};
    config.clock.policy_hz = 1.0F / kStepS;
    return config;
  }

  // Fills every slot of every env.
  template <class F>
  void spawn(const F& make) {
    for (std::size_t slot = 0; slot < slots; ++slot) {
      for (std::size_t env = 0; env < envs; ++env) {
        std::vector<std::uint8_t> only(envs, 0);
        only[env] = 1;
        batch.bodies().spawn(make(), {}, {}, {}, {}, only);
      }
    }
  }

  Pose drone(std::size_t env) const { return pose_at(batch.state().position, batch.state().quat_wxyz, env); }
  Pose body(std::size_t row) const { return pose_at(batch.state().bodies.position, batch.state().bodies.quat_wxyz, row); }
  const BodyConfig& config_of(std::size_t row) const { return *batch.bodies().config(EnvIndex(row / slots), row % slots); }

  // The solids that a drone may meet, with bodies that stand at their current poses.
  std::vector<Mover> solids(std::size_t env) const {
    std::vector<Mover> solids;
    for (std::size_t slot = 0; slot < slots; ++slot) {
      const BodyConfig& config = config_of(env * slots + slot);
      const Pose pose = body(env * slots + slot);
      Mover solid{PrimitiveKind::box, 0.5F * Vec3::Map(config.size_m.data()), {pose, pose}, static_cast<int>(slot)};
      if (config.mesh != nullptr) {
        solid.mesh = &config.mesh->triangles();
        solid.half = config.mesh->bounds().min.cwiseAbs().cwiseMax(config.mesh->bounds().max.cwiseAbs());
      } else {
        solid.kind = primitive_kind(config.shape);
      }
      solids.push_back(solid);
    }
    for (const Primitive& solid : statics) {
      const Pose pose{solid.center, solid.rotation};
      solids.push_back({solid.kind, solid.half_extents, {pose, pose}, -1});
    }
    return solids;
  }
};

}  // namespace flockstep::contacts
