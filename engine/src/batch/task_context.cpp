#include "batch/task_context.hpp"

#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "batch/bad_states.hpp"
#include "batch/flying.hpp"
#include "batch/simulation.hpp"
#include "collision/moving_sweep.hpp"
#include "collision/sweep.hpp"
#include "dynamics/contact.hpp"

namespace flockstep {
namespace {

class Context final : public TaskContext {
 public:
  explicit Context(Simulation& sim) : TaskContext(sim.num_envs(), sim.drones_per_env()), sim_(sim) {}

  std::size_t num_threads() const override { return static_cast<std::size_t>(sim_.workers.num_threads()); }
  const State& state() const override { return sim_.state; }
  const EpisodeState& episodes() const override { return sim_.episodes; }
  const DroneModel& drone_model() const override { return sim_.drone_model; }
  std::span<const std::shared_ptr<const World>> worlds() const override {
    return sim_.pool ? std::span<const std::shared_ptr<const World>>() : sim_.worlds;
  }
  const World& world_of(EnvIndex env) const override { return *sim_.world_pointers[sim_.slot_of(env)]; }

  const std::vector<LidarConfig>& lidars() const override { return sim_.config.lidars; }
  const std::vector<CameraConfig>& cameras() const override { return sim_.config.cameras; }
  const CameraImages& images(std::size_t camera) const override { return sim_.cameras[camera].images(); }
  const PoseReadings& pose_readings() const override { return sim_.suite.pose().readings(); }
  const LidarReadings& lidar_readings(std::size_t lidar) const override { return sim_.lidar_readings(lidar); }
  const void* find_readings(const std::type_info& type, std::size_t index) const override {
    return sim_.suite.find_readings(type, index);
  }

  std::size_t bodies_per_env() const override { return sim_.bodies ? sim_.bodies->per_env() : 0; }
  void place_body(EnvIndex env, std::size_t body, const Pose& pose, const Velocity& velocity) override {
    if (!has_body(env, body) || !is_in_world(pose.position) || !pose.rotation.coeffs().allFinite()) return;
    if (!velocity.linear.allFinite() || !velocity.angular.allFinite()) return;
    sim_.bodies->set_pose(env, body, {pose.position, pose.rotation.normalized()});
    sim_.bodies->set_velocity(env, body, velocity);
  }
  void remove_body(EnvIndex env, std::size_t body) override {
    if (has_body(env, body)) sim_.bodies->remove(env, body);
  }

  float random(EnvIndex env, std::uint32_t stream, std::uint32_t index) const override {
    return draw_uniform(sim_.state, RandomKey::of(env), stream, index);
  }
  float random(DroneIndex drone, std::uint32_t stream, std::uint32_t index) const override {
    return draw_uniform(sim_.state, sim_.random_key(drone), stream, index);
  }
  bool is_free(DroneIndex drone, const Pose& pose) const override { return touches_nothing(sim_, env_of(drone), drone, pose); }

  const DynamicsConfig& dynamics() const override { return sim_.config.dynamics; }
  const ClockConfig& clock() const override { return sim_.config.clock; }
  std::span<const Airframe> airframes() const override {
    return sim_.fleet ? std::span<const Airframe>(sim_.fleet->airframes) : std::span<const Airframe>();
  }
  std::size_t airframe_row(DroneIndex drone) const override { return sim_.fleet ? sim_.fleet->airframe_row(drone) : 0; }

  void place(DroneIndex drone, const Pose& pose, const Velocity& velocity) override {
    if (is_valid(pose) && is_speed(velocity.linear) && is_speed(velocity.angular)) {
      set_pose_of(sim_.state, drone, pose);
      if (sim_.drones_touch()) sim_.unplaced[drone] = 0;
      start_flight(sim_, DroneIndex(drone), velocity);
    } else {
      mark_bad(sim_, sim_.row_of(drone));
    }
  }

  std::span<const float> path_of(DroneIndex drone) const override {
    const std::span<const float> path = sim_.task_state->path;
    const std::size_t row = path.size() / num_drones();
    return path.subspan(drone * row, row);
  }

 private:
  bool has_body(EnvIndex env, std::size_t body) const {
    return body < bodies_per_env() && sim_.state.bodies.active[sim_.bodies->row_of(env, body)];
  }

  Simulation& sim_;
};

}  // namespace

bool touches_nothing(const Simulation& sim, EnvIndex env, std::optional<DroneIndex> drone, const Pose& pose) {
  const collision::Obstacles& obstacles = *sim.obstacles[sim.slot_of(env)];
  if (collision::overlaps(obstacles, sim.hull, pose)) return false;
  if (sim.bodies && overlaps_body(sim.bodies->moving().of_env(env, sim.bodies->per_env()), obstacles, sim.hull, pose))
    return false;
  for (std::size_t member = 0; sim.drones_touch() && member < sim.drones_per_env(); ++member) {
    const DroneIndex other = sim.drone_of(env, member);
    if (other == drone || !sim.state.active[other] || sim.unplaced[other]) continue;
    const Pose there = pose_of(sim.state, other);
    if ((there.position - pose.position).norm() > 2.0F * sim.hull.radius() + dynamics::margin(pose.position.norm())) continue;
    const collision::MovingSolid solid(sim.corners, there, there, 0);
    if (collision::first_contact(solid, sim.hull, pose, pose).hit) return false;
  }
  return true;
}

std::unique_ptr<TaskContext> make_task_context(Simulation& sim) { return std::make_unique<Context>(sim); }

}  // namespace flockstep
