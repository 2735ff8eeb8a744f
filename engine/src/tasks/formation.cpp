// Formation: the drones of an env hold their places relative to a moving leader.
#include "flockstep/tasks/formation.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/check_fields.hpp"
#include "base/hash.hpp"
#include "base/require.hpp"
#include "tasks/formation_path.hpp"
#include "tasks/leader.hpp"
#include "tasks/team_motion.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

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
  static constexpr std::size_t kLoopCorners = 6;  // corners per loop
  static constexpr float kMinRadius = 0.6F;       // least distance of a loop's corners from its centre, in units of its radius
  static constexpr double kLoopWindow = 1.0;      // m, within which the corners of a loop are rounded
  static constexpr float kWiderStart = 0.05F;     // m, by which each try widens the spread of starts
  static constexpr float kFarPlace = 2.0F;        // m; of farther places only the direction is observed
  static constexpr std::size_t kAxes = 3;         // numbers per action
  using Team = TeamMotion<kAxes>;
  static constexpr std::size_t kHead = 6 + Team::kOwn;  // numbers before the neighbours
  enum Term : std::size_t { kPlace, kCrash, kNear, kChange };

 public:
  explicit Formation(const FormationConfig& config) : config_(config), motion_(config.step_m) {
    config.validate();
    spec_.action = {.name = "action", .shape = {kAxes}};
    spec_.reward_terms = reward_terms_of<FormationConfig>();
  }

  const TaskSpec& spec() const override { return spec_; }

  TaskDefaults defaults() const override {
    return {.worlds = "arena/hall",
            .lidars = {LidarConfig{.beams = 36, .hfov_deg = 360.0F, .max_range_m = 4.0F}},
            .max_episode_steps = 300,
            .drones_per_env = 4,
            .interaction = Interaction::both};
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
    places_ = FormationPlaces(config_.shape, context.drones_per_env(), config_.spacing_m);
    tick_s_ = context.clock().dt_s();
    step_s_ = context.clock().step_s();
    substeps_ = context.clock().substeps();
    state_.corners.resize(3 * kLoopCorners * context.num_envs());
    state_.summed_error.resize(context.num_drones());
    change_.resize(context.num_drones());
    motion_.setup(context);
    if (config_.route == FormationRoute::path) {
      require(!context.worlds().empty(), "route", "\"loop\" with a WorldPool", "\"path\"");
      std::unordered_map<const World*, std::shared_ptr<const FormationPath>> planned;
      for (const auto& world : context.worlds()) {
        auto& path = planned[world.get()];
        if (!path) path = std::make_shared<FormationPath>(*world, context.drone_model(), places_, config_.spacing_m);
        paths_.push_back(path);
      }
    } else if (places_.is_column) {
      const float shortest = static_cast<float>(kLoopCorners) * kMinRadius * config_.loop_radius_m;
      const float length = config_.spacing_m * static_cast<float>(context.drones_per_env());
      require(length <= shortest, "spacing_m", "a column that fits on the shortest loop, " + std::to_string(shortest) + " m",
              std::to_string(length) + " m for all drones");
    }
  }

  void require_world(const World& world, const DroneModel& drone) const override {
    if (config_.route == FormationRoute::path) return;  // setup() has planned the path
    const Vec3 size = world.bounds().max - world.bounds().min;
    const float room = std::min(size.x(), size.y());
    const float needed = 2.0F * (config_.loop_radius_m + static_cast<float>(places_.radius()) + drone.radius());
    require(needed <= room, "worlds", "bounds of at least " + std::to_string(needed) + " m along x and y, for this formation",
            "world \"" + world.name() + "\" of " + std::to_string(room) + " m");
  }

  void place(const TaskBlock& block) override {
    const TaskContext& context = block.context;
    Leaders leaders(*this, context, 0);
    for (const DroneIndex drone : block.drones) {
      if (config_.route == FormationRoute::loop) draw_loop(context, context.env_of(drone));
      const Leader& leader = leaders.of(drone);
      const Vec3 place = place_of(leader, drone).cast<float>();
      Vec3 start = place;
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        const float spread = config_.jitter_m + kWiderStart * static_cast<float>(attempt);
        Vec3 drawn = place;
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
    Leaders leaders(*this, block.context, substeps_);
    for (const DroneIndex drone : block.drones) {
      change_[drone] = 0.0;
      Pose target = motion_.target(block.context.state(), drone, actions.row<float>(drone), &change_[drone]);
      target.rotation = leaders.of(drone).rotation();
      setpoints.target[drone] = target;
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const TaskContext& context = block.context;
    const State& state = context.state();
    Leaders leaders(*this, context, 0);
    for (const DroneIndex drone : block.drones) {
      motion_.moved(state, drone);
      const EnvIndex env = context.env_of(drone);
      const bool crashed = state.contact.hit[drone] != 0;
      const double error = distance_m(place_of(leaders.of(drone), drone).cast<float>(), position_of(state, drone));
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
      const bool arrived = config_.route == FormationRoute::path && way_of(state, env, 0) >= path_of(state, env).last();
      score.terminated[drone] = crashed || is_lost;
      score.left_area[drone] = is_lost;
      score.truncated[drone] = arrived && !score.terminated[drone];
      score.success[drone] = !is_lost && !has_touched(state, env) && mean <= static_cast<double>(config_.close_m);
    }
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const TaskContext& context = block.context;
    Leaders leaders(*this, context, 0), next_leaders(*this, context, substeps_);
    for (const DroneIndex drone : block.drones) {
      const std::span<float> row = observation[0].row<float>(drone);
      const Eigen::Vector3d place = place_of(leaders.of(drone), drone);
      const Eigen::Vector3d velocity = (place_of(next_leaders.of(drone), drone) - place) / step_s_;
      const Pose pose = context.sensed_pose(drone);
      const Quat to_body = pose.rotation.conjugate();
      Team::write_shortened(to_body * (place.cast<float>() - pose.position), kFarPlace, row.data());
      Team::write_limited(to_body * velocity.cast<float>() / motion_.fastest(), row.data() + 3);
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
  // The leaders of envs after some more ticks. Keeps that of the last env, since the drones of an env follow each other.
  class Leaders {
   public:
    Leaders(const Formation& task, const TaskContext& context, int more_ticks)
        : task_(task), context_(context), more_ticks_(more_ticks) {}
    const Leader& of(DroneIndex drone) {
      const EnvIndex env = context_.env_of(drone);
      if (!leader_ || env != env_) leader_ = task_.leader_of(context_.state(), env, more_ticks_);
      env_ = env;
      return *leader_;
    }

   private:
    const Formation& task_;
    const TaskContext& context_;
    int more_ticks_;
    EnvIndex env_{0};
    std::optional<Leader> leader_;
  };

  Eigen::Vector3d place_of(const Leader& leader, DroneIndex drone) const {
    return leader.place(places_, drone % places_.shape.size());
  }

  std::span<const float> ranges_of(const TaskContext& context, DroneIndex drone) const {
    return std::span(context.lidar_readings().ranges).subspan(drone * rays_, rays_);
  }

  // True if a drone of the env has just touched something, which ends the episode of a team.
  bool has_touched(const State& state, EnvIndex env) const {
    const auto first = state.contact.hit.begin() + static_cast<std::ptrdiff_t>(env * places_.shape.size());
    return std::any_of(first, first + std::ssize(places_.shape), [](std::uint8_t hit) { return hit != 0; });
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
      const float radius = config_.loop_radius_m * (kMinRadius + (1.0F - kMinRadius) * share);
      const Vec3 corner = centre + radius * Vec3(std::cos(angle), std::sin(angle), 0.0F);
      std::copy_n(corner.data(), 3, state_.corners.data() + 3 * (kLoopCorners * env + i));
    }
  }

  const FormationPath& path_of(const State& state, EnvIndex env) const {
    return *paths_[static_cast<std::size_t>(state.world_index[env])];
  }

  // Way of the leader along its route, m, after some more ticks.
  double way_of(const State& state, EnvIndex env, int more_ticks) const {
    const double first = config_.route == FormationRoute::path ? path_of(state, env).first() : 0.0;
    return first + static_cast<double>(config_.leader_speed_mps) * tick_s_ * static_cast<double>(state.tick[env] + more_ticks);
  }
  Leader leader_of(const State& state, EnvIndex env, int more_ticks) const {
    const double way = way_of(state, env, more_ticks);
    if (config_.route == FormationRoute::path) {
      const FormationPath& path = path_of(state, env);
      return {path.route(), way, path.share(way)};
    }
    const auto corners = std::span(state_.corners).subspan(3 * kLoopCorners * env, 3 * kLoopCorners);
    return {LeaderRoute(corners, true, kLoopWindow, std::max(places_.radius(), kLoopWindow)), way, places_.is_column ? 0.0 : 1.0};
  }

  FormationConfig config_;
  TaskSpec spec_;
  std::size_t rays_ = 0, neighbors_ = 0;  // numbers of the observation
  double tick_s_ = 0.0, step_s_ = 0.0;
  int substeps_ = 1;
  FormationPlaces places_;
  std::vector<std::shared_ptr<const FormationPath>> paths_;  // by world_index, if the route is a path
  std::vector<double> change_;                               // (N,) of the action; used only within a step
  FormationState state_;
  Team motion_;
};

}  // namespace
}  // namespace task

void FormationConfig::validate() const { check_fields(*this, "task."); }

std::unique_ptr<Task> make_task(const FormationConfig& config) { return std::make_unique<task::Formation>(config); }

}  // namespace flockstep
