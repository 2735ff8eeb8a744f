// Swap: the drones of an env exchange places on a circle, in the plane, without touching.
#include "flockstep/tasks/swap.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "tasks/configured_task.hpp"
#include "tasks/team_motion.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

// N rows.
struct SwapState {
  std::vector<float> goal;            // (N, 3) m
  std::vector<double> last_distance;  // (N,) m to the goal, after the last step

  static constexpr auto fields() {
    using C = SwapState;
    return field_list(field("goal", &C::goal), field("last_distance", &C::last_distance));
  }
};

class Swap final : public ConfiguredTask<SwapConfig> {
  static constexpr std::uint32_t kTurnStream = 0, kJitterStream = 1;
  static constexpr std::size_t kAxes = 2;  // numbers per action
  using Team = TeamMotion<kAxes>;
  static constexpr std::size_t kHead = 3 + Team::kOwn;  // numbers before the neighbours
  enum Term : std::size_t { kProgress, kGoal, kCrash, kNear, kTime };

 public:
  explicit Swap(const SwapConfig& config) : ConfiguredTask(config, {.name = "action", .shape = {kAxes}}), motion_(config.step_m) {
    const auto size = static_cast<std::int64_t>(kHead + Team::kNeighbor * static_cast<std::size_t>(config.neighbors));
    Field observation{.name = "observation", .shape = {size}, .low = {-1.0}, .high = {1.0}};
    observation.low.resize(static_cast<std::size_t>(size), -1.0);
    observation.low[2] = 0.0;
    for (std::size_t i = kHead + Team::kNeighbor - 1; i < observation.low.size(); i += Team::kNeighbor) observation.low[i] = 0.0;
    spec_.observation = {observation};
  }

  TaskDefaults defaults() const override {
    return {
        .worlds = "arena/hall", .max_episode_steps = 300, .batch = {.drones_per_env = 8, .interaction = Interaction::collide}};
  }

  void setup(const TaskContext& context) override {
    per_env_ = context.drones_per_env();
    state_.goal.resize(3 * context.num_drones());
    state_.last_distance.resize(context.num_drones());
    motion_.setup(context);
  }

  void require_world(const World& world, const DroneModel& drone) const override {
    const Vec3 size = world.bounds().max - world.bounds().min;
    const float room = std::min(size.x(), size.y()) / 2.0F;
    const float needed = radius() + config_.jitter_m + drone.radius();
    require(needed <= room, "worlds",
            "bounds of at least " + std::to_string(2.0F * needed) + " m along x and y, for a circle of " +
                std::to_string(per_env_) + " drones",
            "world \"" + world.name() + "\" of " + std::to_string(2.0F * room) + " m");
  }

  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      const EnvIndex env = block.context.env_of(drone);
      const std::size_t member = drone % per_env_;
      const Vec3 centre = centre_of(block.context.world_of(env));
      const float turn = block.context.random(env, kTurnStream, 0);
      const Vec3 goal = place_of(centre, turn, member, true);
      Vec3 start = place_of(centre, turn, member, false);
      for (std::uint32_t axis = 0; axis < kAxes; ++axis) {
        start[axis] += config_.jitter_m * (2.0F * block.context.random(drone, kJitterStream, axis) - 1.0F);
      }
      std::copy_n(goal.data(), 3, state_.goal.data() + 3 * drone);
      const float yaw = std::atan2(goal.y() - start.y(), goal.x() - start.x());
      block.context.place(drone, {start, Quat(std::cos(yaw / 2.0F), 0.0F, 0.0F, std::sin(yaw / 2.0F))});
    }
  }

  void begin(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      state_.last_distance[drone] = distance_m(goal_of(drone), position_of(block.context.state(), drone));
      motion_.begin(drone);
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    for (const DroneIndex drone : block.drones) {
      setpoints.target[drone] = motion_.target(block.context.state(), drone, actions.row<float>(drone));
      setpoints.target[drone].position.z() = goal_of(drone).z();  // rotor-driven drones may have left their height
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const State& state = block.context.state();
    for (const DroneIndex drone : block.drones) {
      motion_.moved(state, drone);
      const bool crashed = state.contact.hit[drone] != 0;
      const double distance = distance_m(goal_of(drone), position_of(state, drone));
      const bool success = all_are_at_their_places(state, drone / per_env_);
      const std::span<double> terms = score.terms_of(drone);
      terms[kProgress] = static_cast<double>(config_.progress_weight) * (state_.last_distance[drone] - distance);
      terms[kGoal] = success ? static_cast<double>(config_.goal_weight) : 0.0;
      terms[kCrash] = crashed ? -static_cast<double>(config_.crash_weight) : 0.0;
      terms[kNear] = -static_cast<double>(config_.near_weight) * nearness(state, per_env_, drone, config_.near_m);
      terms[kTime] = is_at_its_place(distance) ? 0.0 : -static_cast<double>(config_.time_weight);
      state_.last_distance[drone] = distance;
      score.terminated[drone] = crashed || success;
      score.success[drone] = success;
    }
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    for (const DroneIndex drone : block.drones) {
      const std::span<float> row = observation[0].row<float>(drone);
      write_goal(block.context.sensed_pose(drone), goal_of(drone), row.data());
      motion_.observe(block.context, drone, config_.sight_m, row.subspan(3));
    }
  }

  void visit(ArrayVisitor& visitor) override {
    visitor.fields(state_);
    motion_.visit(visitor);
  }

  void check() const override {
    require_finite(state_.goal, "goal");
    require_finite(state_.last_distance, "last_distance");
    motion_.check();
  }

 private:
  Vec3 goal_of(DroneIndex drone) const { return Vec3::Map(state_.goal.data() + 3 * drone); }
  float radius() const {
    const auto count = static_cast<float>(per_env_);
    return std::max(config_.radius_m, count * config_.spacing_m / (2.0F * std::numbers::pi_v<float>));
  }

  // The middle of the bounds, at the height of the start marker, if there is one.
  static Vec3 centre_of(const World& world) {
    Vec3 centre = (world.bounds().min + world.bounds().max) / 2.0F;
    if (world.markers().start) centre.z() = world.markers().start->z();
    return centre;
  }

  // The place of a drone on the circle, or the one that it flies to.
  Vec3 place_of(const Vec3& centre, float turn, std::size_t member, bool is_goal) const {
    const auto count = static_cast<float>(per_env_);
    float number = static_cast<float>(member);
    if (is_goal) number += per_env_ == 1 ? 0.5F : static_cast<float>(per_env_ / 2);
    const float angle = 2.0F * std::numbers::pi_v<float> * (turn + number / count);
    return centre + radius() * Vec3(std::cos(angle), std::sin(angle), 0.0F);
  }

  bool is_at_its_place(double distance) const { return distance <= static_cast<double>(config_.goal_radius_m); }
  // False if a drone of the env has just touched something. Drones that are not there do not count.
  bool all_are_at_their_places(const State& state, std::size_t env) const {
    for (std::size_t drone = env * per_env_; drone < (env + 1) * per_env_; ++drone) {
      if (!state.active[drone]) continue;
      const bool is_there = is_at_its_place(distance_m(goal_of(DroneIndex(drone)), position_of(state, DroneIndex(drone))));
      if (state.contact.hit[drone] || !is_there) return false;
    }
    return true;
  }

  std::size_t per_env_ = 1;
  SwapState state_;
  Team motion_;
};

}  // namespace
}  // namespace task

void SwapConfig::validate() const { check_fields(*this, "task."); }

std::unique_ptr<Task> make_task(const SwapConfig& config) { return std::make_unique<task::Swap>(config); }

}  // namespace flockstep
