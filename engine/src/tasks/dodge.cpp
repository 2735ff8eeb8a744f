// Dodge: fly to a goal by LiDAR, in the plane, among bodies that move.
#include "flockstep/tasks/dodge.hpp"

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "tasks/configured_task.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

// N rows.
struct DodgeState {
  std::vector<float> goal;            // (N, 3) m
  std::vector<double> last_distance;  // (N,) m to the goal, after the last step
  std::vector<float> last_action;     // (N, 2) clipped
  std::vector<float> last_ranges;     // (N, rays) normalised, of the scan before the last step

  static constexpr auto fields() {
    using C = DodgeState;
    return field_list(field("goal", &C::goal), field("last_distance", &C::last_distance), field("last_action", &C::last_action),
                      field("last_ranges", &C::last_ranges));
  }
};

class Dodge final : public ConfiguredTask<DodgeConfig> {
  static constexpr std::uint32_t kStartStream = 0, kGoalStream = 1;
  static constexpr std::uint32_t kTries = 64;    // random positions to try
  static constexpr std::size_t kHead = 5;        // numbers before the ranges
  static constexpr std::size_t kNumAxes = 2;     // numbers per action
  static constexpr float kClearOfBodies = 1.5F;  // m, distance of starts from the centres of bodies
  enum Term : std::size_t { kProgress, kGoal, kCrash, kNear, kTime };

 public:
  explicit Dodge(const DodgeConfig& config) : ConfiguredTask(config, {.name = "action", .shape = {kNumAxes}}) {}

  TaskDefaults defaults() const override {
    return {.worlds = "living",
            .max_episode_steps = 400,
            .batch = {.lidars = {LidarConfig{.beams = 72, .hfov_deg = 360.0F, .max_range_m = 6.0F}}}};
  }

  void setup(const TaskContext& context) override {
    require(!context.lidars().empty(), "lidar", "a LidarConfig (the dodge task needs one)", "None");
    const LidarConfig& lidar = context.lidars()[0];
    rays_ = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
    Field field{.name = "observation", .shape = {static_cast<std::int64_t>(kHead + 2 * rays_)}};
    field.low = {-1.0, -1.0, 0.0, -1.0, -1.0};
    field.low.resize(kHead + 2 * rays_, 0.0);
    field.absent.assign(kHead, 0.0);
    field.absent.resize(kHead + 2 * rays_, 1.0);
    spec_.observation = {field};
    state_.goal.resize(3 * context.num_drones());
    state_.last_distance.resize(context.num_drones());
    state_.last_action.resize(kNumAxes * context.num_drones());
    state_.last_ranges.resize(rays_ * context.num_drones());
  }

  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      const EnvIndex env = block.context.env_of(drone);
      Vec3 start = block.context.world_of(env).drone_start();
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        const Vec3 drawn = drawn_position(block.context, drone, kStartStream, attempt);
        if (!is_clear_of_bodies(block.context, env, drawn)) continue;
        if (!block.context.is_free(drone, {drawn, Quat::Identity()})) continue;
        start = drawn;
        break;
      }
      block.context.place(drone, {start, Quat::Identity()});
    }
  }

  void begin(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      const Vec3 start = position_of(block.context.state(), drone);
      Vec3 goal = start;  // the farthest free one, if none is far enough
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        const Vec3 drawn = drawn_position(block.context, drone, kGoalStream, attempt);
        if (distance_m(drawn, start) <= distance_m(goal, start)) continue;
        if (!block.context.is_free(drone, {drawn, Quat::Identity()})) continue;
        goal = drawn;
        if (distance_m(goal, start) >= static_cast<double>(config_.goal_distance_m)) break;
      }
      std::copy_n(goal.data(), 3, state_.goal.data() + 3 * drone);
      state_.last_distance[drone] = distance_m(goal, start);
      std::fill_n(state_.last_action.data() + kNumAxes * drone, kNumAxes, 0.0F);
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    for (const DroneIndex drone : block.drones) {
      normalise(ranges_of(block.context, drone), block.context.lidar_readings().max_range_m[drone],
                state_.last_ranges.data() + rays_ * drone);
      const std::span<const float> action = actions.row<float>(drone);
      Vec3 step = Vec3::Zero();
      for (std::size_t axis = 0; axis < kNumAxes; ++axis) {
        const float clipped = std::clamp(action[axis], -1.0F, 1.0F);
        state_.last_action[kNumAxes * drone + axis] = clipped;
        step[static_cast<Eigen::Index>(axis)] = config_.step_m * clipped;
      }
      const Pose pose = pose_of(block.context.state(), drone);
      setpoints.target[drone] = {pose.position + pose.rotation * step, pose.rotation};
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const State& state = block.context.state();
    for (const DroneIndex drone : block.drones) {
      const bool crashed = state.contact.hit[drone] != 0;
      const double distance = distance_m(goal_of(drone), position_of(state, drone));
      const bool reached = !crashed && distance <= static_cast<double>(config_.goal_radius_m);
      const float max_range = block.context.lidar_readings().max_range_m[drone];
      const double nearest = clearance_of(ranges_of(block.context, drone), max_range).nearest * static_cast<double>(max_range);
      const std::span<double> terms = score.terms_of(drone);
      terms[kProgress] = static_cast<double>(config_.progress_weight) * (state_.last_distance[drone] - distance);
      terms[kGoal] = reached ? static_cast<double>(config_.goal_weight) : 0.0;
      terms[kCrash] = crashed ? -static_cast<double>(config_.crash_weight) : 0.0;
      terms[kNear] =
          -static_cast<double>(config_.near_weight) * std::max(1.0 - nearest / static_cast<double>(config_.near_m), 0.0);
      terms[kTime] = -static_cast<double>(config_.time_weight);
      state_.last_distance[drone] = distance;
      score.terminated[drone] = crashed || reached;
      score.success[drone] = reached;
    }
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    for (const DroneIndex drone : block.drones) {
      const std::span<float> row = observation[0].row<float>(drone);
      write_goal(block.context.sensed_pose(drone), goal_of(drone), row.data());
      std::copy_n(state_.last_action.data() + kNumAxes * drone, kNumAxes, row.data() + 3);
      float* const now = row.data() + kHead;
      normalise(ranges_of(block.context, drone), block.context.lidar_readings().max_range_m[drone], now);
      const bool is_first = block.context.episodes().steps[drone] == 0;
      std::copy_n(is_first ? now : state_.last_ranges.data() + rays_ * drone, rays_, now + rays_);
    }
  }

  void visit(ArrayVisitor& visitor) override { visitor.fields(state_); }

  void check() const override {
    require_finite(state_.goal, "goal");
    require_finite(state_.last_distance, "last_distance");
    require_finite(state_.last_action, "last_action");
    require_finite(state_.last_ranges, "last_ranges");
  }

 private:
  Vec3 goal_of(DroneIndex drone) const { return Vec3::Map(state_.goal.data() + 3 * drone); }

  std::span<const float> ranges_of(const TaskContext& context, DroneIndex drone) const {
    return std::span(context.lidar_readings().ranges).subspan(drone * rays_, rays_);
  }

  // A position in the world's bounds, at the height of its start marker, or in the middle without one.
  Vec3 drawn_position(const TaskContext& context, DroneIndex drone, std::uint32_t stream, std::uint32_t attempt) const {
    const World& world = context.world_of(context.env_of(drone));
    const Aabb& box = world.bounds();
    Vec3 position = (box.min + box.max) / 2.0F;
    if (world.markers().start) position.z() = world.markers().start->z();
    for (std::uint32_t axis = 0; axis < kNumAxes; ++axis) {
      const auto k = static_cast<Eigen::Index>(axis);
      position[k] = box.min[k] + context.random(drone, stream, 2 * attempt + axis) * (box.max[k] - box.min[k]);
    }
    return position;
  }

  static bool is_clear_of_bodies(const TaskContext& context, EnvIndex env, const Vec3& position) {
    const BodyState& bodies = context.state().bodies;
    const std::size_t per_env = context.bodies_per_env();
    for (std::size_t row = env * per_env; row < (env + 1) * per_env; ++row) {
      if (!bodies.active[row]) continue;
      const Vec3 apart = Vec3::Map(bodies.position.data() + 3 * row) - position;
      if (apart.squaredNorm() < kClearOfBodies * kClearOfBodies) return false;
    }
    return true;
  }

  std::size_t rays_ = 0;
  DodgeState state_;
};

}  // namespace
}  // namespace task

void DodgeConfig::validate() const { check_fields(*this, "task."); }

std::unique_ptr<Task> make_task(const DodgeConfig& config) { return std::make_unique<task::Dodge>(config); }

}  // namespace flockstep
