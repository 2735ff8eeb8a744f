// The navigation tasks. They differ only in what they observe in addition to the ranges; see ObservationKind.
#include "flockstep/tasks/navigation.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <span>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "planning/navigable.hpp"
#include "tasks/color_blob.hpp"
#include "tasks/configured_task.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

constexpr double kCentimetresPerMetre = 100.0;
constexpr std::uint32_t kStartTries = 64;  // random starts to try before using the start marker

// Directions (x, y, z) of the discrete actions.
constexpr std::array<std::array<float, 3>, 6> kDirections{{{1, 0, 0}, {-1, 0, 0}, {0, 1, 0}, {0, -1, 0}, {0, 0, 1}, {0, 0, -1}}};
constexpr std::array<std::array<float, 3>, 3> kForwardDirections{{{1, 0, 0}, {0, 1, 0}, {0, -1, 0}}};

// The terms of the reward, in the order of TaskSpec::reward_terms.
enum Term : std::size_t { kDistance, kCrash, kFreeSpace, kStep, kActionChange, kOvershoot, kNumTerms };

// Each array has shape (N,).
struct NavigationState {
  std::vector<std::int32_t> goal_index;  // number of waypoints reached; the final goal comes after the last
  std::vector<double> last_distance;     // m to the current goal, after the last step

  static constexpr auto fields() {
    using C = NavigationState;
    return field_list(field("goal_index", &C::goal_index), field("last_distance", &C::last_distance));
  }
};

// A cached goal and its key. Without the cache, every step would access the world of every env.
struct Goal {
  std::int32_t world_index = -1;
  std::int32_t goal_index = 0;
  Vec3 position;  // m
};

Field action_field(ActionKind action) {
  switch (action) {
    case ActionKind::discrete:
      return {.name = "action", .type = DType::int64, .shape = {}, .low = {0}, .high = {kDirections.size() - 1}};
    case ActionKind::discrete_forward:
      return {.name = "action", .type = DType::int64, .shape = {}, .low = {0}, .high = {kForwardDirections.size() - 1}};
    case ActionKind::displacement:
      return {.name = "action", .shape = {3}};
    default:
      return {.name = "action", .shape = {4}};
  }
}

// A field of leading numbers followed by the ranges. The leading numbers have the lower bounds low_of_head and the upper bound
// 1. They are 0 for a removed drone.
Field vector_field(const char* name, std::vector<double> low_of_head, std::size_t rays) {
  Field field{.name = name, .shape = {static_cast<std::int64_t>(low_of_head.size() + rays)}, .low = low_of_head};
  field.absent.assign(low_of_head.size(), 0.0);
  field.low.insert(field.low.end(), rays, 0.0);
  field.absent.insert(field.absent.end(), rays, 1.0);
  return field;
}

// Data of all envs, read from the context once for each block.
struct BlockInputs {
  explicit BlockInputs(const TaskContext& context)
      : state(context.state()),
        episodes(context.episodes()),
        ranges(context.lidar_readings().ranges),
        max_range_m(context.lidar_readings().max_range_m) {}

  const State& state;
  const EpisodeState& episodes;
  std::span<const float> ranges;       // (N, rays) m
  std::span<const float> max_range_m;  // (N,)
};

class Navigation final : public ConfiguredTask<NavigationConfig> {
 public:
  explicit Navigation(const NavigationConfig& config) : ConfiguredTask(config, action_field(config.action)) {}

  TaskDefaults defaults() const override {
    if (config_.observation == ObservationKind::goal) return {.worlds = "train", .batch = {.lidars = {LidarConfig()}}};
    // Across the playground, at 10 m, the goal is 1.6 pixels wide, so it always covers the centre of a pixel.
    CameraConfig camera{.width_px = 64, .height_px = 48};
    if (config_.observation == ObservationKind::pixels) camera.layout = ImageLayout::chw;
    return {.worlds = "camera-train", .batch = {.lidars = {LidarConfig{.beams = 20, .hfov_deg = 180.0F}}, .cameras = {camera}}};
  }

  void setup(const TaskContext& context) override {
    require(!context.lidars().empty(), "lidar", "a LidarConfig (the navigation task needs one)", "None");
    if (config_.observation != ObservationKind::goal) require_camera(context);
    rays_ = static_cast<std::size_t>(context.lidars()[0].rows()) * static_cast<std::size_t>(context.lidars()[0].columns());
    spec_.observation = observation_fields(context);
    context_ = &context;
    state_.goal_index.resize(context.num_drones());
    state_.last_distance.resize(context.num_drones());
    goals_.resize(context.num_drones());
    blobs_.resize(context.num_threads());
    if (config_.observation == ObservationKind::blob) {
      const CameraConfig& camera = context.cameras().front();
      const std::vector<std::uint8_t> black(image_size(camera));
      for (ColorBlobScratch& scratch : blobs_) {  // allocates here instead of in a step
        find_color(black, camera.image_width_px(), camera.image_height_px(), camera.layout, config_.color, scratch);
        scratch.columns.reserve(static_cast<std::size_t>(camera.image_width_px()));
      }
    }
  }

  void require_world(const World& world, const DroneModel& drone) const override { require_navigable(world, drone); }

  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      block.context.place(drone, {start_position(block.context, drone), Quat::Identity()});
    }
  }

  void begin(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      state_.goal_index[drone] = 0;
      state_.last_distance[drone] = distance_m(goal(block.context, drone), position_of(block.context.state(), drone));
    }
  }

  void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) override {
    const State& state = block.context.state();
    const bool is_discrete = !is_floating(spec_.action.type);
    for (const DroneIndex drone : block.drones) {
      Pose& pose = setpoints.target[drone];  // written in place: to copy what has just been written makes the processor wait
      pose = pose_of(state, drone);
      is_discrete ? move_discretely(pose, actions.row<std::int64_t>(drone)[0]) : move(pose, actions.row<float>(drone));
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const BlockInputs around(block.context);
    for (const DroneIndex drone : block.drones) score_drone(around, block.context, drone, score);
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const bool apart = config_.observation == ObservationKind::pixels;  // the ranges are a separate field
    const BlockInputs around(block.context);
    for (const DroneIndex drone : block.drones) {
      const std::span<float> row = observation[apart ? 1 : 0].row<float>(drone);
      const std::size_t head = row.size() - rays_;
      normalise(around.ranges.subspan(drone * rays_, rays_), around.max_range_m[drone], row.data() + head);
      switch (config_.observation) {
        case ObservationKind::goal: {
          Vec3 direction = direction_to(block.context.sensed_pose(drone), goal(block.context, drone));
          if (config_.goal_norm == GoalNorm::maximum) {
            if (const float largest = direction.cwiseAbs().maxCoeff(); largest > 0) direction /= largest;
          }
          for (int axis = 0; axis < 3; ++axis) row[static_cast<std::size_t>(axis)] = direction[axis];
          break;
        }
        case ObservationKind::blob: {
          const CameraConfig& camera = block.context.cameras()[0];
          const ColorBlob blob = find_color(image_of(block.context, drone), camera.image_width_px(), camera.image_height_px(),
                                            camera.layout, config_.color, blobs_[block.thread]);
          row[0] = blob.offset;
          row[1] = blob.area;
          break;
        }
        case ObservationKind::pixels: {
          // Copy the image: the camera overwrites its own in the next step, while the observation may still be in use.
          const auto image = image_of(block.context, drone);
          std::copy(image.begin(), image.end(), observation[0].row<std::uint8_t>(drone).data());
          break;
        }
      }
    }
  }

  void visit(ArrayVisitor& visitor) override { visitor.fields(state_); }

  void check() const override {
    for (std::size_t drone = 0; drone < state_.goal_index.size(); ++drone) {
      // The count may exceed the world's waypoints: the env may have come from another world.
      if (state_.goal_index[drone] < 0) refuse("snapshot: goal_index", "a number >= 0", state_.goal_index[drone]);
      if (!std::isfinite(state_.last_distance[drone])) {
        refuse("snapshot: last_distance", "finite numbers", state_.last_distance[drone]);
      }
    }
  }

  bool observes_camera(std::size_t camera) const override { return camera == 0 && config_.observation != ObservationKind::goal; }

 private:
  void require_camera(const TaskContext& context) const {
    require(!context.cameras().empty(), "cameras", "a CameraConfig (the task observes its image)", "none");
    const CameraConfig& camera = context.cameras().front();
    require(camera.outputs.rgb, "camera.outputs", "rgb among them (the task observes it)", "none");
    require(camera.capture_mode != CaptureMode::on_demand, "camera.capture_mode",
            "every_step or on_movement (the task observes it)", "on_demand");
    require(config_.observation != ObservationKind::pixels || camera.layout == ImageLayout::chw, "camera.layout",
            "chw (the task observes pixels)", "hwc");
  }

  std::vector<Field> observation_fields(const TaskContext& context) const {
    if (config_.observation == ObservationKind::goal) return {vector_field("observation", {-1, -1, -1}, rays_)};
    if (config_.observation == ObservationKind::blob) return {vector_field("observation", {-1, 0}, rays_)};
    const CameraConfig& camera = context.cameras().front();
    Field image{.name = "image", .type = DType::uint8, .shape = {3, camera.image_height_px(), camera.image_width_px()}};
    image.low = {0};
    image.high = {255};
    return {image, vector_field("ranges", {}, rays_)};
  }

  std::span<const std::uint8_t> image_of(const TaskContext& context, DroneIndex drone) const {
    const CameraConfig& camera = context.cameras()[0];
    const std::size_t size = image_size(camera);
    return std::span(context.images(0).rgb).subspan(drone * size, size);
  }

  // The number of values of one rgb image.
  static std::size_t image_size(const CameraConfig& camera) {
    return 3 * static_cast<std::size_t>(camera.image_width_px()) * static_cast<std::size_t>(camera.image_height_px());
  }

  Vec3 start_position(const TaskContext& context, DroneIndex drone) const {
    const EnvIndex env = context.env_of(drone);
    const Markers& markers = context.world_of(env).markers();
    if (config_.random_start && markers.spawn_box) {
      const Aabb& box = *markers.spawn_box;
      for (std::uint32_t attempt = 0; attempt < kStartTries; ++attempt) {
        const auto bits = draw(context.state(), RandomKey::of(drone, context.drones_per_env()), Stream::start, attempt);
        const Vec3 unit(uniform01(bits[0]), uniform01(bits[1]), uniform01(bits[2]));
        const Vec3 position = box.min + unit.cwiseProduct(box.max - box.min);
        if (context.is_free(drone, {position, Quat::Identity()})) return position;
      }
    }
    return *markers.start;
  }

  void move_discretely(Pose& pose, std::int64_t action) const {
    const auto index = static_cast<std::size_t>(action);
    const auto& direction = config_.action == ActionKind::discrete ? kDirections[index] : kForwardDirections[index];
    pose.position += pose.rotation * (config_.step_m * Vec3(direction[0], direction[1], direction[2]));
  }

  void move(Pose& pose, std::span<const float> action) const {
    Vec3 step;
    for (int axis = 0; axis < 3; ++axis) {
      step[axis] = config_.step_m * std::clamp(action[static_cast<std::size_t>(axis)], -1.0F, 1.0F);
    }
    pose.position += pose.rotation * step;
    if (config_.action != ActionKind::displacement_yaw) return;
    const float yaw = std::clamp(action[3], -1.0F, 1.0F) * config_.yaw_step_deg * std::numbers::pi_v<float> / 180.0F;
    pose.rotation = (pose.rotation * Quat(std::cos(yaw / 2), 0, 0, std::sin(yaw / 2))).normalized();
  }

  // The drone's next waypoint or goal.
  const Vec3& goal(const TaskContext& context, DroneIndex drone) {
    Goal& known = goals_[drone];
    const EnvIndex env = context.env_of(drone);
    const std::int32_t world_index = context.state().world_index[env];
    if (known.world_index != world_index || known.goal_index != state_.goal_index[drone]) {
      known = {world_index, state_.goal_index[drone], goal_of(context.world_of(env), state_.goal_index[drone])};
    }
    return known.position;
  }

  void score_drone(const BlockInputs& around, const TaskContext& context, DroneIndex drone, Score& score) {
    const NavigationReward& reward = config_.reward;
    const State& state = around.state;
    const Vec3 position = position_of(state, drone);
    const bool crashed = state.contact.hit[drone] != 0;
    const double goal_reward = reward.goal_reward;

    // Distance to the current goal. When a waypoint is reached, the next one becomes the goal.
    const Vec3 target = goal(context, drone);
    const double distance = distance_m(target, position);
    const bool reached = distance <= static_cast<double>(reward.goal_radius_m);
    const auto num_waypoints =
        reached ? static_cast<std::int32_t>(context.world_of(context.env_of(drone)).markers().waypoints.size()) : 0;
    const bool at_final_goal = reached && state_.goal_index[drone] >= num_waypoints;
    double distance_term = (state_.last_distance[drone] - distance) * kCentimetresPerMetre;
    state_.last_distance[drone] = distance;
    if (at_final_goal) {
      distance_term = goal_reward;
    } else if (reached) {
      distance_term = goal_reward * static_cast<double>(reward.waypoint_share) / num_waypoints;
      ++state_.goal_index[drone];
      if (!reward.carry_over_distance) state_.last_distance[drone] = distance_m(goal(context, drone), position);
    }

    const double min_clearance = reward.min_clearance;
    const auto [nearest, sum] = clearance_of(around.ranges.subspan(drone * rays_, rays_), around.max_range_m[drone]);
    double crash_term = 0.0;
    if (crashed) {
      crash_term = -goal_reward;
    } else if (nearest < min_clearance) {
      crash_term = nearest - min_clearance;
    }

    const auto step_number = static_cast<double>(around.episodes.steps[drone] - 1);
    const bool overshot = reward.overshoot_weight != 0.0F && position.x() > target.x() + reward.goal_radius_m;

    const std::span<double> terms = score.terms_of(drone);
    terms[kDistance] = static_cast<double>(reward.distance_weight) * distance_term;
    terms[kCrash] = static_cast<double>(reward.crash_weight) * crash_term;
    terms[kFreeSpace] = static_cast<double>(reward.free_space_weight) * free_space(sum, rays_, min_clearance);
    terms[kStep] = static_cast<double>(reward.step_weight) * (-step_number / static_cast<double>(reward.step_scale));
    terms[kActionChange] =
        static_cast<double>(reward.action_change_weight) * (around.episodes.action_changed[drone] ? -1.0 : 0.0);
    terms[kOvershoot] = static_cast<double>(reward.overshoot_weight) * (overshot ? -goal_reward / 10.0 : 0.0);
    score.terminated[drone] = crashed || at_final_goal || overshot;
    score.left_area[drone] = overshot;
    score.success[drone] = at_final_goal && !crashed;
  }

  const TaskContext* context_ = nullptr;  // context of the batch, which owns the task
  std::size_t rays_ = 0;
  NavigationState state_;
  std::vector<Goal> goals_;              // (N,) cache of the current goals
  std::vector<ColorBlobScratch> blobs_;  // one for each thread
};

}  // namespace
}  // namespace task

void NavigationReward::validate() const { check_fields(*this, "reward."); }

void NavigationConfig::validate() const {
  check_fields(*this, "task.");
  require(color == ColorRange() || observation == ObservationKind::blob, "task.color", "its default unless observation=\"blob\"",
          "another color");
}

NavigationConfig NavigationConfig::observing(ObservationKind observation) {
  NavigationConfig config;
  config.observation = observation;
  if (observation != ObservationKind::goal) {
    config.action = ActionKind::discrete_forward;
    config.reward.overshoot_weight = 1.0F;
  }
  return config;
}

std::unique_ptr<Task> make_task(const NavigationConfig& config) { return std::make_unique<task::Navigation>(config); }

}  // namespace flockstep
