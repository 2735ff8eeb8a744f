// Formation: the drones of an env hold their places relative to a moving leader.
#include "flockstep/tasks/formation.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <iterator>
#include <memory>
#include <numbers>
#include <numeric>
#include <optional>
#include <span>
#include <string>
#include <unordered_map>
#include <vector>

#include "base/check_fields.hpp"
#include "base/interrupt.hpp"
#include "base/require.hpp"
#include "collision/sweep.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/world.hpp"
#include "planning/navigable.hpp"
#include "prepared/prepared_world.hpp"
#include "tasks/configured_task.hpp"
#include "tasks/leader.hpp"
#include "tasks/team_motion.hpp"
#include "tasks/terms.hpp"

namespace flockstep {

std::vector<Vec3> formation_places(FormationShape shape, std::size_t count, float spacing_m) {
  constexpr float kTurn = 2.0F * std::numbers::pi_v<float>;
  const auto number = static_cast<float>(count);
  const float radius = count < 2 ? spacing_m : std::max(spacing_m, spacing_m / (2.0F * std::sin(kTurn / 2.0F / number)));
  std::vector<Vec3> places;
  places.reserve(count);
  for (std::size_t i = 0; i < count; ++i) {
    const float pair = spacing_m * static_cast<float>(i / 2 + 1), side = i % 2 == 0 ? 1.0F : -1.0F;
    const float slant = pair / std::numbers::sqrt2_v<float>, angle = kTurn * static_cast<float>(i) / number;
    switch (shape) {
      case FormationShape::line:
        places.emplace_back(0.0F, side * pair, 0.0F);
        break;
      case FormationShape::column:
        places.emplace_back(-spacing_m * static_cast<float>(i + 1), 0.0F, 0.0F);
        break;
      case FormationShape::v:
        places.emplace_back(-slant, side * slant, 0.0F);
        break;
      case FormationShape::circle:
        places.emplace_back(radius * std::cos(angle), radius * std::sin(angle), 0.0F);
        break;
    }
  }
  return places;
}

namespace task {
namespace {

constexpr double kRoom = 0.2;            // m, to be free around the drone
constexpr double kWindow = 2.0 * kRoom;  // m; a route that is rounded by at most the room touches nothing
constexpr float kPathCell = 0.2F;        // m, of the plan
constexpr double kShareStep = 0.1;       // m along the route between two shares, less than the room
constexpr int kSmoothSteps = 10;         // before and after one, over which shares are smoothed
constexpr double kClosest = 0.7;         // least distance of places, in units of their spacing
constexpr double kFastest = 1.0;         // greatest speed of a place that turns or narrows, in units of the leader's speed

// An upright prism around the drone at any heading, and the room around it.
DroneModel with_room(const DroneModel& drone) {
  constexpr int kSides = kMaxHullVertices / 2;
  constexpr double kTurn = 2.0 * std::numbers::pi;
  double radius = 0.0;
  for (const Vec3& vertex : drone.hull()) radius = std::max(radius, vertex.head<2>().cast<double>().norm());
  radius = (radius + kRoom) / std::cos(kTurn / 2.0 / kSides);
  std::vector<Vec3> hull;
  for (int i = 0; i < kSides; ++i) {
    const double x = radius * std::cos(kTurn * i / kSides), y = radius * std::sin(kTurn * i / kSides);
    for (const double z :
         {static_cast<double>(drone.extents().min.z()) - kRoom, static_cast<double>(drone.extents().max.z()) + kRoom}) {
      hull.push_back(Eigen::Vector3d(x, y, z).cast<float>());
    }
  }
  return DroneModel(hull);
}

// The largest share up to which two places keep their distance, if they move by their shares from `column` apart to `shape`
// apart.
double share_apart(const Eigen::Vector3d& column, const Eigen::Vector3d& shape, double distance) {
  const Eigen::Vector3d change = shape - column;
  const double a = change.squaredNorm(), b = column.dot(change), c = column.squaredNorm() - distance * distance;
  if (c <= 0.0) return 0.0;
  const double root = b * b - a * c;  // discriminant for |column + share * change|^2 = distance^2
  return b >= 0.0 || root <= 0.0 ? 1.0 : std::min((-b - std::sqrt(root)) / a, 1.0);
}

// The largest share of the shape at a way of the leader: with it, and with any smaller one, the drone is free at all places, and
// these keep their distance.
double largest_share(const Leader& leader, const FormationPlaces& places, const collision::Obstacles& obstacles,
                     const collision::Hull& hull, double distance) {
  const std::size_t count = places.shape.size();
  std::vector<Eigen::Vector3d> columns, shapes;
  double share = 1.0;
  for (std::size_t i = 0; i < count; ++i) {
    columns.push_back(leader.in_column(places.column[i]));
    shapes.push_back(leader.in_shape(places.shape[i]));
    const Pose from{.position = columns[i].cast<float>()}, to{.position = shapes[i].cast<float>()};
    share = std::min(share, static_cast<double>(collision::sweep(obstacles, hull, from, to).fraction));
    for (std::size_t j = 0; j < i; ++j) {
      share = std::min(share, share_apart(columns[i] - columns[j], shapes[i] - shapes[j], distance));
    }
  }
  return share;
}

// Applies a function to the window around each value.
template <class Function>
std::vector<double> over_windows(const std::vector<double>& values, const Function& function) {
  const std::ptrdiff_t end = std::ssize(values);
  std::vector<double> results;
  for (std::ptrdiff_t i = 0; i < end; ++i) {
    const std::ptrdiff_t from = std::max<std::ptrdiff_t>(i - kSmoothSteps, 0),
                         to = std::min<std::ptrdiff_t>(i + kSmoothSteps + 1, end);
    results.push_back(function(values.begin() + from, values.begin() + to));
  }
  return results;
}

// A planned route through a world, and how much of a formation's shape has room along it.
class FormationPath {
 public:
  // Plans the path from the start marker over the waypoints to the goal, with some room around the drone. Throws
  // std::invalid_argument if there is none, or none that is longer than the column.
  FormationPath(const World& world, const DroneModel& drone, const FormationPlaces& places, float spacing_m);

  LeaderRoute route() const;
  double first() const { return first_; }  // m, way of the leader when the last place of the column is at the start
  double last() const { return last_; }    // m, its way when the first place of the column is at the goal
  // Share of the shape at a way of the leader, in [0, 1].
  double share(double way) const;

 private:
  std::vector<float> corners_;  // (K, 3) m
  double reach_ = 0.0;          // m, before and after the leader, between which its heading leads
  double first_ = 0.0, last_ = 0.0;
  std::vector<double> shares_;  // from first_ on, one for each step
};

FormationPath::FormationPath(const World& world, const DroneModel& drone, const FormationPlaces& places, float spacing_m) {
  require_navigable(world, drone);
  const std::string name = "world \"" + world.name() + "\"";
  std::vector<Vec3> goals = world.markers().waypoints;
  goals.push_back(*world.markers().goal);
  const DroneModel wide = with_room(drone);
  const std::optional<std::vector<Vec3>> path = plan(world, wide, *world.markers().start, goals, kPathCell);
  require(path && path->size() > 1, "worlds", "a path from the start to the goal with 0.2 m of room around the drone",
          name + " without one");
  for (const Vec3& corner : *path) corners_.insert(corners_.end(), corner.data(), corner.data() + 3);

  const double radius = places.radius();
  reach_ = std::max(radius, kWindow);
  const LeaderRoute route = this->route();
  const auto [back, front] = std::minmax_element(places.column.begin(), places.column.end());
  first_ = kWindow - std::min(*back, 0.0);
  last_ = route.length() - kWindow - std::max(*front, 0.0);
  require(first_ < last_, "worlds",
          "a path of more than " + std::to_string(first_ + route.length() - last_) + " m, for the column",
          name + " with a path of " + std::to_string(route.length()) + " m");

  if (places.is_column) {
    shares_.assign(2, 0.0);
    return;
  }
  const collision::Obstacles& obstacles = prepared(world).obstacles();
  const collision::Hull hull(wide);
  const auto steps = static_cast<std::size_t>(std::ceil((last_ - first_) / kShareStep));
  std::vector<double> largest;
  for (std::size_t i = 0; i <= steps; ++i) {
    Interrupt::poll();
    const double way = first_ + kShareStep * static_cast<double>(i);
    const double turn = std::remainder(route.heading(way + kShareStep) - route.heading(way), 2.0 * std::numbers::pi) / kShareStep;
    const double share =
        largest_share(Leader(route, way, 1.0), places, obstacles, hull, kClosest * static_cast<double>(spacing_m));
    largest.push_back(std::min(share, kFastest / std::max(radius * std::abs(turn), kFastest)));
  }
  // Limit the change from step to step.
  double farthest = 0.0;  // m, from a place of the column to that of the shape, on a straight route
  for (std::size_t i = 0; i < places.shape.size(); ++i) {
    const Eigen::Vector3d place = places.shape[i].cast<double>();
    farthest = std::max(farthest, (place - places.column[i] * Eigen::Vector3d::UnitX()).norm());
  }
  const double change = kFastest * kShareStep / std::max(farthest, kShareStep);
  for (std::size_t i = 1; i <= steps; ++i) largest[i] = std::min(largest[i], largest[i - 1] + change);
  for (std::size_t i = steps; i-- > 0;) largest[i] = std::min(largest[i], largest[i + 1] + change);
  // The mean of minima is smooth, and at most the largest share.
  const std::vector<double> least = over_windows(largest, [](auto from, auto to) { return *std::min_element(from, to); });
  shares_ =
      over_windows(least, [](auto from, auto to) { return std::accumulate(from, to, 0.0) / static_cast<double>(to - from); });
}

LeaderRoute FormationPath::route() const { return {corners_, false, kWindow, reach_}; }

double FormationPath::share(double way) const {
  const double at = std::clamp((way - first_) / kShareStep, 0.0, static_cast<double>(shares_.size() - 1));
  const auto i = std::min(static_cast<std::size_t>(at), shares_.size() - 2);
  return shares_[i] + (at - static_cast<double>(i)) * (shares_[i + 1] - shares_[i]);
}

struct FormationState {
  std::vector<float> corners;        // (E, kLoopCorners, 3) m, of the loop of each env
  std::vector<double> summed_error;  // (N,) m, of the episode's steps

  static constexpr auto fields() {
    using C = FormationState;
    return field_list(field("corners", &C::corners), field("summed_error", &C::summed_error));
  }
};

class Formation final : public ConfiguredTask<FormationConfig> {
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
  explicit Formation(const FormationConfig& config)
      : ConfiguredTask(config, {.name = "action", .shape = {kAxes}}), motion_(config.step_m) {}

  TaskDefaults defaults() const override {
    return {.worlds = "arena/hall",
            .max_episode_steps = 300,
            .batch = {.drones_per_env = 4,
                      .interaction = Interaction::both,
                      .lidars = {LidarConfig{.beams = 36, .hfov_deg = 360.0F, .max_range_m = 4.0F}}}};
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
    for (const EnvIndex env : block.envs) {
      if (config_.route == FormationRoute::loop) draw_loop(context, env);
    }
    Leaders leaders(*this, context, block.drones.front(), 0);
    for (const DroneIndex drone : block.drones) {
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
    Leaders leaders(*this, block.context, block.drones.front(), substeps_);
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
    Leaders leaders(*this, context, block.drones.front(), 0);
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
    const DroneIndex first = block.drones.front();
    Leaders leaders(*this, context, first, 0), next_leaders(*this, context, first, substeps_);
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
    Leaders(const Formation& task, const TaskContext& context, DroneIndex first, int more_ticks)
        : task_(task),
          context_(context),
          more_ticks_(more_ticks),
          env_(context.env_of(first)),
          leader_(task.leader_of(context.state(), env_, more_ticks)) {}
    const Leader& of(DroneIndex drone) {
      const EnvIndex env = context_.env_of(drone);
      if (env != env_) leader_ = task_.leader_of(context_.state(), env, more_ticks_);
      env_ = env;
      return leader_;
    }

   private:
    const Formation& task_;
    const TaskContext& context_;
    int more_ticks_;
    EnvIndex env_;
    Leader leader_;
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
