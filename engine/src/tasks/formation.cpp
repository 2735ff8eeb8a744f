// Formation: the drones of an env hold their places relative to a moving leader.
#include "flockstep/formation.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/hash.hpp"
#include "base/require.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/tasks.hpp"
#include "planning/navigable.hpp"
#include "tasks/ranges.hpp"
#include "tasks/route.hpp"
#include "tasks/team_motion.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

// Pose and velocity of the leader, and the rate of its heading.
struct Leader {
  Eigen::Vector3d position, velocity;  // m, m/s
  double heading, turning;             // rad, rad/s

  Vec3 place(const Vec3& offset) const { return (position + turned(offset)).cast<float>(); }
  Vec3 velocity_of(const Vec3& offset) const {
    const Eigen::Vector3d from = turned(offset);
    return (velocity + turning * Eigen::Vector3d(-from.y(), from.x(), 0.0)).cast<float>();
  }
  Quat rotation() const {
    return {static_cast<float>(std::cos(heading / 2.0)), 0.0F, 0.0F, static_cast<float>(std::sin(heading / 2.0))};
  }

 private:
  Eigen::Vector3d turned(const Vec3& offset) const {
    const Eigen::Vector3d o = offset.cast<double>();
    return {std::cos(heading) * o.x() - std::sin(heading) * o.y(), std::sin(heading) * o.x() + std::cos(heading) * o.y(), o.z()};
  }
};

struct FormationState {
  std::vector<float> corners;        // (E, kLoopCorners, 3) m, of the loop of each env
  std::vector<double> summed_error;  // (N,) m, of the episode's steps

  static constexpr auto fields() {
    using C = FormationState;
    return field_list(field("corners", &C::corners), field("summed_error", &C::summed_error));
  }
};

class Formation final : public Task {
  static constexpr std::uint32_t kLoopStream = 0, kStartStream = 1;
  static constexpr std::uint32_t kTries = 64;     // random positions to try
  static constexpr std::size_t kLoopCorners = 6;  // of a loop
  static constexpr float kLeastRadius = 0.6F;     // of the corners of a loop, in units of its radius
  static constexpr float kWiderStart = 0.05F;     // m, by which each try widens the spread of starts
  static constexpr float kFarPlace = 2.0F;        // m; of farther places only the direction is observed
  static constexpr std::size_t kAxes = 3;         // of an action
  using Team = TeamMotion<kAxes>;
  static constexpr std::size_t kHead = 6 + Team::kOwn;  // numbers before the neighbours
  enum Term : std::size_t { kPlace, kCrash, kNear, kChange };

 public:
  explicit Formation(const FormationConfig& config) : config_(config), motion_(config.step_m) {
    config.validate();
    spec_.action = {.name = "action", .shape = {kAxes}};
    spec_.reward_terms = {"place", "crash", "near", "change"};
  }

  const TaskSpec& spec() const override { return spec_; }

  TaskDefaults defaults() const override {
    return {.worlds = "arena/hall",
            .lidars = {LidarConfig{.beams = 36, .hfov_deg = 360.0F, .max_range_m = 4.0F}},
            .max_episode_steps = 300,
            .drones_per_env = 4,
            .meet = Meet::both};
  }

  std::string identity() const override {
    Hash hash;
    hash.add(config_);
    return "formation " + std::to_string(hash.value());
  }

  void setup(const TaskContext& context) override {
    require(!context.lidars().empty(), "lidar", "a LidarConfig (the formation task needs one)", "None");
    const LidarConfig& lidar = context.lidars()[0];
    rays_ = static_cast<std::size_t>(lidar.rows()) * static_cast<std::size_t>(lidar.columns());
    neighbors_ = Team::kNeighbor * static_cast<std::size_t>(config_.neighbors);
    const std::size_t size = kHead + neighbors_ + rays_;
    Field observation{.name = "observation", .shape = {static_cast<std::int64_t>(size)}};
    observation.low.assign(kHead + neighbors_, -1.0);
    for (std::size_t i = kHead + Team::kNeighbor - 1; i < kHead + neighbors_; i += Team::kNeighbor) observation.low[i] = 0.0;
    observation.low.resize(size, 0.0);
    observation.absent.assign(kHead + neighbors_, 0.0);
    observation.absent.resize(size, 1.0);
    spec_.observation = {observation};
    places_ = formation_places(config_.shape, context.drones_per_env(), config_.spacing_m);
    tick_s_ = context.clock().dt_s();
    step_s_ = context.clock().step_s();
    substeps_ = context.clock().substeps();
    state_.corners.resize(3 * kLoopCorners * context.num_envs());
    state_.summed_error.resize(context.num_drones());
    change_.resize(context.num_drones());
    motion_.setup(context);
    if (config_.route == FormationRoute::path) {
      require(!context.worlds().empty(), "route", "\"loop\" with a WorldPool", "\"path\"");
      for (const auto& world : context.worlds()) paths_.push_back(path_of(*world, context.drone_model()));
    }
  }

  void require_world(const World& world, const DroneModel& drone) const override {
    if (config_.route == FormationRoute::path) return;  // setup() has planned the path
    float farthest = 0.0F;
    for (const Vec3& place : places_) farthest = std::max(farthest, place.norm());
    const Vec3 size = world.bounds().max - world.bounds().min;
    const float room = std::min(size.x(), size.y()), needed = 2.0F * (config_.loop_radius_m + farthest + drone.radius());
    require(needed <= room, "worlds", "bounds of at least " + std::to_string(needed) + " m along x and y, for this formation",
            "world \"" + world.name() + "\" of " + std::to_string(room) + " m");
  }

  void place(const TaskBlock& block) override {
    const TaskContext& context = block.context;
    for (const DroneIndex drone : block.drones) {
      const EnvIndex env = context.env_of(drone);
      if (config_.route == FormationRoute::loop) draw_loop(context, env);
      const Leader leader = leader_of(context, env, 0);
      Vec3 start = leader.place(place_of(context, drone));
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        const float spread = config_.jitter_m + kWiderStart * static_cast<float>(attempt);
        Vec3 drawn = leader.place(place_of(context, drone));
        for (std::uint32_t axis = 0; axis < kAxes - 1; ++axis) {
          drawn[axis] += spread * (2.0F * context.random(drone, kStartStream, 2 * attempt + axis) - 1.0F);
        }
        if (!context.is_free(drone, {drawn, leader.rotation()})) continue;
        start = drawn;
        break;
      }
      block.context.place(drone, {start, leader.rotation()});
    }
  }

  void begin(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      state_.summed_error[drone] = 0.0;
      motion_.begin(drone);
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    for (const DroneIndex drone : block.drones) {
      change_[drone] = 0.0;
      Pose target = motion_.target(block.context.state(), drone, actions.row<float>(drone), &change_[drone]);
      target.rotation = leader_of(block.context, block.context.env_of(drone), substeps_).rotation();
      setpoints.target[drone] = target;
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const TaskContext& context = block.context;
    const State& state = context.state();
    for (const DroneIndex drone : block.drones) {
      motion_.moved(state, drone);
      const EnvIndex env = context.env_of(drone);
      const bool crashed = state.contact.hit[drone] != 0;
      const double error = distance_m(leader_of(context, env, 0).place(place_of(context, drone)), position_of(state, drone));
      const bool is_lost = error > static_cast<double>(config_.max_distance_m);
      const float max_range = context.lidar_readings().max_range_m[drone];
      const double nearest = clearance_of(ranges_of(context, drone), max_range).nearest * static_cast<double>(max_range);
      state_.summed_error[drone] += error;
      const std::span<double> terms = score.terms_of(drone);
      terms[kPlace] = static_cast<double>(config_.place_weight) * std::exp(-error);
      terms[kCrash] = crashed || is_lost ? -static_cast<double>(config_.crash_weight) : 0.0;
      terms[kNear] =
          -static_cast<double>(config_.near_weight) * std::max(1.0 - nearest / static_cast<double>(config_.near_m), 0.0);
      terms[kChange] = -static_cast<double>(config_.change_weight) * change_[drone];
      const double mean = state_.summed_error[drone] / static_cast<double>(context.episodes().steps[drone]);
      const bool arrived = config_.route == FormationRoute::path && way_of(state, env, 0) >= route_of(context, env).length();
      score.terminated[drone] = crashed || is_lost;
      score.left_area[drone] = is_lost;
      score.truncated[drone] = arrived && !score.terminated[drone];
      score.success[drone] = !is_lost && !has_touched(state, env) && mean <= static_cast<double>(config_.close_m);
    }
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const TaskContext& context = block.context;
    for (const DroneIndex drone : block.drones) {
      const std::span<float> row = observation[0].row<float>(drone);
      const Leader leader = leader_of(context, context.env_of(drone), 0);
      const Vec3 offset = place_of(context, drone);
      const Pose pose = context.sensed_pose(drone);
      const Quat to_body = pose.rotation.conjugate();
      Team::write_shortened(to_body * (leader.place(offset) - pose.position), kFarPlace, row.data());
      Team::write_limited(to_body * leader.velocity_of(offset) / motion_.fastest(), row.data() + 3);
      motion_.observe(context, drone, config_.sight_m, row.subspan(6, Team::kOwn + neighbors_));
      normalise(ranges_of(context, drone), context.lidar_readings().max_range_m[drone], row.data() + kHead + neighbors_);
    }
  }

  void visit(ArrayVisitor& visitor) override {
    visitor.fields(state_);
    motion_.visit(visitor);
  }

  void check() const override {
    require_finite(state_.corners, "corners");
    require_finite(state_.summed_error, "summed_error");
    motion_.check();
  }

 private:
  const Vec3& place_of(const TaskContext& context, DroneIndex drone) const { return places_[drone % context.drones_per_env()]; }

  std::span<const float> ranges_of(const TaskContext& context, DroneIndex drone) const {
    return std::span(context.lidar_readings().ranges).subspan(drone * rays_, rays_);
  }

  // True if a drone of the env has just touched something, which ends the episode of a team.
  bool has_touched(const State& state, EnvIndex env) const {
    const auto first = state.contact.hit.begin() + static_cast<std::ptrdiff_t>(env * places_.size());
    return std::any_of(first, first + std::ssize(places_), [](std::uint8_t hit) { return hit != 0; });
  }

  // Draws the corners of an env's loop around the middle of its world, at the height of the start marker, if there is one.
  void draw_loop(const TaskContext& context, EnvIndex env) {
    const World& world = context.world_of(env);
    Vec3 centre = (world.bounds().min + world.bounds().max) / 2.0F;
    if (world.markers().start) centre.z() = world.markers().start->z();
    const float sense = context.random(env, kLoopStream, 0) < 0.5F ? -1.0F : 1.0F;
    const float first = context.random(env, kLoopStream, 1);
    for (std::size_t i = 0; i < kLoopCorners; ++i) {
      const float turns = first + sense * static_cast<float>(i) / static_cast<float>(kLoopCorners);
      const float angle = 2.0F * std::numbers::pi_v<float> * turns;
      const float share = context.random(env, kLoopStream, static_cast<std::uint32_t>(2 + i));
      const float radius = config_.loop_radius_m * (kLeastRadius + (1.0F - kLeastRadius) * share);
      const Vec3 corner = centre + radius * Vec3(std::cos(angle), std::sin(angle), 0.0F);
      std::copy_n(corner.data(), 3, state_.corners.data() + 3 * (kLoopCorners * env + i));
    }
  }

  // Plans the path of the leader from the start marker over the waypoints to the goal.
  static std::vector<float> path_of(const World& world, const DroneModel& drone) {
    require_navigable(world, drone);
    std::vector<Vec3> goals = world.markers().waypoints;
    goals.push_back(*world.markers().goal);
    const std::optional<std::vector<Vec3>> path = plan(world, drone, *world.markers().start, goals);
    require(path && path->size() > 1, "worlds", "a path from the start to the goal",
            "world \"" + world.name() + "\" without one");
    std::vector<float> corners;
    for (const Vec3& corner : *path) corners.insert(corners.end(), corner.data(), corner.data() + 3);
    return corners;
  }

  LeaderRoute route_of(const TaskContext& context, EnvIndex env) const {
    if (config_.route == FormationRoute::path) {
      return {paths_[static_cast<std::size_t>(context.state().world_index[env])], false};
    }
    return {std::span(state_.corners).subspan(3 * kLoopCorners * env, 3 * kLoopCorners), true};
  }

  // Way of the leader along its route, m, after some more ticks.
  double way_of(const State& state, EnvIndex env, int more_ticks) const {
    return static_cast<double>(config_.leader_speed_mps) * tick_s_ * static_cast<double>(state.tick[env] + more_ticks);
  }
  Leader leader_of(const TaskContext& context, EnvIndex env, int more_ticks) const {
    const LeaderRoute route = route_of(context, env);
    const double way = way_of(context.state(), env, more_ticks);
    const auto speed = static_cast<double>(config_.leader_speed_mps);
    const double ahead = speed * step_s_;  // the change of the heading over the next step
    const double heading = heading_at(route, way);
    const double change = std::remainder(heading_at(route, way + ahead) - heading, 2.0 * std::numbers::pi);
    return {route.position(way), speed * route.direction(way), heading, change / step_s_};
  }
  // An open route keeps its last heading.
  static double heading_at(const LeaderRoute& route, double way) {
    const Eigen::Vector3d direction = route.direction(way);
    return std::atan2(direction.y(), direction.x());
  }

  FormationConfig config_;
  TaskSpec spec_;
  std::size_t rays_ = 0, neighbors_ = 0;  // numbers of the observation
  double tick_s_ = 0.0, step_s_ = 0.0;
  int substeps_ = 1;
  std::vector<Vec3> places_;               // (M,) m, relative to the leader
  std::vector<std::vector<float>> paths_;  // (K, 3) m, corners by world_index, if the route is a path
  std::vector<double> change_;             // (N,) of the action; used only within a step
  FormationState state_;
  Team motion_;
};

}  // namespace
}  // namespace task

void FormationConfig::validate() const { check_fields(*this, "task."); }

std::unique_ptr<Task> make_task(const FormationConfig& config) { return std::make_unique<task::Formation>(config); }

}  // namespace flockstep
