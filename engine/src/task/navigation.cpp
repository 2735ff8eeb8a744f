#include "task/navigation.hpp"

#include <algorithm>
#include <cmath>
#include <limits>
#include <numbers>

#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "collision/sweep.hpp"
#include "compiled/compiled_world.hpp"
#include "scenario/navigable.hpp"

namespace flockstep::task {
namespace {

constexpr double kCentimetresPerMetre = 100.0;
constexpr int kStartTries = 64;  // random starts drawn before the start marker is taken

// What discrete actions mean: x, y, z.
constexpr std::array<std::array<float, 3>, 6> kDirections{{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
constexpr std::array<std::array<float, 3>, 3> kForwardDirections{{{1, 0, 0}, {0, 1, 0}, {0, -1, 0}}};

double distance_m(const Vec3& a, const Vec3& b) { return (a.cast<double>() - b.cast<double>()).norm(); }

}  // namespace

NavigationState::NavigationState(std::size_t num_drones)
    : goal_index(num_drones, 0),
      last_distance(num_drones, 0.0),
      last_action(num_drones, std::array<float, kMaxActionSize>{}),
      step(num_drones, 0),
      time_limit(num_drones, 0),
      episode_return(num_drones, 0.0),
      begun(num_drones, 0),
      done(num_drones, 0) {}

Navigation::Navigation(const NavigationConfig& config, std::span<const World* const> worlds, const DroneModel& drone,
                       std::size_t num_drones)
    : config_(config),
      worlds_(worlds.begin(), worlds.end()),
      drone_(&drone),
      nav_(num_drones),
      clearance_(num_drones),
      earned_(num_drones) {
  for (const World* world : worlds_) require_navigable(*world, drone);
}

std::size_t Navigation::head_size() const {
  switch (config_.observation) {
    case ObservationKind::goal:
      return 3;
    case ObservationKind::blob:
      return 2;
    default:
      return 0;
  }
}

std::size_t Navigation::action_size() const {
  switch (config_.action) {
    case ActionKind::displacement:
      return 3;
    case ActionKind::displacement_yaw:
      return 4;
    default:
      return 1;
  }
}

Pose Navigation::target(const Pose& pose, const float* action) const {
  Vec3 step = Vec3::Zero();
  Quat rotation = pose.rotation;
  if (is_discrete(config_.action)) {
    const auto index = static_cast<std::size_t>(action[0]);
    const auto& direction = config_.action == ActionKind::discrete ? kDirections[index] : kForwardDirections[index];
    step = config_.step_m * Vec3(direction[0], direction[1], direction[2]);
  } else {
    for (int axis = 0; axis < 3; ++axis) step[axis] = config_.step_m * std::clamp(action[axis], -1.0F, 1.0F);
  }
  if (config_.action == ActionKind::displacement_yaw) {
    const float yaw = std::clamp(action[3], -1.0F, 1.0F) * config_.yaw_step_deg * std::numbers::pi_v<float> / 180.0F;
    rotation = (rotation * Quat(std::cos(yaw / 2), 0, 0, std::sin(yaw / 2))).normalized();
  }
  return {pose.position + pose.rotation * step, rotation};
}

const Vec3& Navigation::current_goal(std::size_t drone, const World& world) const {
  const auto& waypoints = world.markers().waypoints;
  const auto index = static_cast<std::size_t>(nav_.goal_index[drone]);
  return index < waypoints.size() ? waypoints[index] : *world.markers().goal;
}

void Navigation::evaluate(std::size_t drone, const float* action, std::size_t num_ranges, const State& state, bool first,
                          Outputs& out) {
  const NavigationReward& reward = config_.reward;
  const World& world = *worlds_[static_cast<std::size_t>(state.world_index[drone])];
  const auto num_waypoints = static_cast<std::int32_t>(world.markers().waypoints.size());
  const Vec3 position = position_of(state, drone);
  const bool crashed = state.contact.hit[drone] != 0;

  // distance and goals
  const Vec3 goal = current_goal(drone, world);
  const double distance = distance_m(goal, position);
  const bool reached = distance <= static_cast<double>(reward.goal_radius_m);
  const bool at_final_goal = reached && nav_.goal_index[drone] == num_waypoints;
  double distance_term = (nav_.last_distance[drone] - distance) * kCentimetresPerMetre;
  nav_.last_distance[drone] = distance;
  if (at_final_goal) {
    distance_term = reward.goal_reward;
  } else if (reached) {
    distance_term = static_cast<double>(reward.goal_reward) * static_cast<double>(reward.waypoint_share) / num_waypoints;
    ++nav_.goal_index[drone];
    if (!reward.carry_over_distance) nav_.last_distance[drone] = distance_m(current_goal(drone, world), position);
  }

  // clearance; sum(l / M - 1) / (|L| / M - |L|), written so that the ranges are only summed
  const double min_clearance = reward.min_clearance;
  const auto [nearest, sum] = clearance_[drone];
  const auto count = static_cast<double>(num_ranges);
  const double free_space_term = (sum / min_clearance - count) / (count / min_clearance - count);
  double crash_term = 0.0;
  if (crashed) {
    crash_term = -static_cast<double>(reward.goal_reward);
  } else if (nearest < min_clearance) {
    crash_term = nearest - min_clearance;
  }

  const double step_term = -static_cast<double>(nav_.step[drone]) / static_cast<double>(reward.step_scale);

  std::array<float, kMaxActionSize>& last_action = nav_.last_action[drone];
  const bool same_action = std::equal(action, action + action_size(), last_action.begin());
  std::copy_n(action, action_size(), last_action.begin());

  const bool overshot = reward.overshoot_weight != 0.0F && position.x() > goal.x() + reward.goal_radius_m;

  const std::array<double, kNumRewardTerms> terms{
      static_cast<double>(reward.distance_weight) * distance_term,
      static_cast<double>(reward.crash_weight) * crash_term,
      static_cast<double>(reward.free_space_weight) * free_space_term,
      static_cast<double>(reward.step_weight) * step_term,
      static_cast<double>(reward.action_change_weight) * (same_action ? 0.0 : -1.0),
      static_cast<double>(reward.overshoot_weight) * (overshot ? -static_cast<double>(reward.goal_reward) / 10.0 : 0.0),
  };
  std::array<double, kNumRewardTerms>& earned = earned_[drone];
  double total = 0.0;
  double step_total = 0.0;
  for (std::size_t k = 0; k < terms.size(); ++k) {
    total += terms[k];
    earned[k] = first ? terms[k] : earned[k] + terms[k];
    step_total += earned[k];
    out.reward_terms[drone * kNumRewardTerms + k] = static_cast<float>(earned[k]);
  }

  ++nav_.step[drone];
  nav_.episode_return[drone] += total;
  const bool terminated = crashed || at_final_goal || overshot;
  const bool truncated = !terminated && nav_.time_limit[drone] > 0 && nav_.step[drone] >= nav_.time_limit[drone];
  nav_.done[drone] = terminated || truncated;
  out.reward[drone] = static_cast<float>(step_total);
  out.terminated[drone] = terminated;
  out.truncated[drone] = truncated;
  out.success[drone] = at_final_goal && !crashed;
  out.crashed[drone] = crashed;
  out.episode_return[drone] = nav_.episode_return[drone];
  out.episode_length[drone] = nav_.step[drone];
}

void Navigation::observe_ranges(std::size_t drone, std::span<const float> ranges, float max_range, float* observation) {
  clearance_[drone] = normalise(ranges, max_range, observation + head_size());
}

void Navigation::observe_goal(std::size_t drone, const State& state, float* observation) const {
  const World& world = *worlds_[static_cast<std::size_t>(state.world_index[drone])];
  const float* const p = state.sensed_position.data() + 3 * drone;
  const float* const q = state.sensed_quat_wxyz.data() + 4 * drone;
  const Vec3 offset = current_goal(drone, world) - Vec3(p[0], p[1], p[2]);
  const float length = offset.norm();
  const Vec3 direction = length > 0.0F ? Vec3(Quat(q[0], q[1], q[2], q[3]).conjugate() * (offset / length)) : Vec3::Zero();
  for (int axis = 0; axis < 3; ++axis) observation[axis] = std::clamp(direction[axis], -1.0F, 1.0F);
}

void Navigation::observe_blob(const GreenBlob& blob, float* observation) {
  observation[0] = blob.offset;
  observation[1] = blob.area;
}

Vec3 Navigation::start_position(std::size_t drone, const State& state, const World& world) const {
  const auto& box = world.markers().spawn_box;
  if (config_.random_start && box) {
    const collision::Obstacles& obstacles = compiled(world).obstacles();
    const collision::Hull hull(*drone_);
    for (std::uint32_t attempt = 0; attempt < kStartTries; ++attempt) {
      const auto bits = draw(state, drone, Stream::start, attempt);
      const Vec3 unit(uniform01(bits[0]), uniform01(bits[1]), uniform01(bits[2]));
      const Vec3 position = box->min + unit.cwiseProduct(box->max - box->min);
      if (!collision::overlaps(obstacles, hull, {position, Quat::Identity()})) return position;
    }
  }
  return *world.markers().start;
}

void Navigation::place(std::size_t drone, State& state) const {
  if (config_.random_world) {
    const double u = uniform01(draw(state, drone, Stream::world, 0)[0]);
    state.world_index[drone] = static_cast<std::int32_t>(u * static_cast<double>(worlds_.size()));
  }
  const World& world = *worlds_[static_cast<std::size_t>(state.world_index[drone])];
  set_pose_of(state, drone, {start_position(drone, state, world), Quat::Identity()});
}

void Navigation::begin(std::size_t drone, const State& state) {
  const World& world = *worlds_[static_cast<std::size_t>(state.world_index[drone])];
  nav_.goal_index[drone] = 0;
  nav_.last_distance[drone] = distance_m(current_goal(drone, world), position_of(state, drone));
  nav_.last_action[drone].fill(std::numeric_limits<float>::quiet_NaN());
  nav_.step[drone] = 0;
  nav_.episode_return[drone] = 0.0;
  nav_.begun[drone] = 1;
  nav_.done[drone] = 0;
  nav_.time_limit[drone] = config_.max_episode_steps;
  if (config_.stagger_first_episode && state.episode[drone] == 0) {
    const double u = uniform01(draw(state, drone, Stream::time_limit, 0)[0]);
    nav_.time_limit[drone] = 1 + static_cast<std::int64_t>(u * config_.max_episode_steps);
  }
}

}  // namespace flockstep::task
