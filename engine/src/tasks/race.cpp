#include "flockstep/tasks/race.hpp"

#include <algorithm>
#include <array>
#include <bit>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <numbers>
#include <optional>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/pose_access.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/sensors/imu.hpp"
#include "tasks/flight_task.hpp"
#include "tasks/gate_corners.hpp"
#include "tasks/gates.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

constexpr float kRadians = std::numbers::pi_v<float> / 180.0F;

class Race final : public DifferentiableTask<RaceConfig> {
 public:
  explicit Race(const RaceConfig& config)
      : DifferentiableTask(config), gates_ahead_(static_cast<std::size_t>(config.gates_ahead)) {
    max_thrust_to_weight_ = static_cast<double>(config.max_thrust_to_weight);
    if (config.gate_detector) corners_.emplace(*config.gate_detector);
    spec_.observation = {flight_field((corners_ ? GateCorners::kNumbers : kPerGate) * gates_ahead_ + kOwn)};
    spec_.records_path = true;
  }

  TaskDefaults defaults() const override {
    return {.worlds = "race/figure-8",
            .max_episode_steps = 350,
            .drone = "racer5",
            .batch = {.clock = {.policy_hz = 50.0F},
                      .dynamics = {.motion = Motion::rotors,
                                   .control = Control::body_rates,
                                   .max_rate_dps = 460.0F,         // 8 rad/s
                                   .max_yaw_rate_dps = 230.0F}}};  // 4 rad/s
  }

  bool takes(Control control) const override { return control == Control::body_rates; }

  void setup(const TaskContext& context) override {
    ConfiguredFlightTask::setup(context);
    const std::size_t n = context.num_drones();
    target_.assign(n, 0);
    passed_.assign(n, 0);
    distance_.assign(n, 0.0);
    cap_.assign(n, config_.speed_cap_mps[0]);
    history_.assign(n, 0);
    outcome_.assign(n, kNone);
  }

  void require_world(const World& world, const DroneModel& drone) const override {
    const std::span<const Gate> gates = world.gates();
    require(gates.size() >= 2, "world \"" + world.name() + "\": gates", "at least 2", gates.size());
    for (std::size_t i = 0; i < gates.size(); ++i) {
      require_free(world, drone, "gates[" + std::to_string(i) + ']', gates[i].center);
    }
  }

  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      const EnvIndex env = block.context.env_of(drone);
      const std::span<const Gate> gates = block.context.world_of(env).gates();
      const float chosen = block.context.random(drone, kGateStream, 0) * static_cast<float>(gates.size());
      const auto target = std::min(static_cast<std::size_t>(chosen), gates.size() - 1);
      target_[drone] = static_cast<std::int32_t>(target);
      const Gate& last = gates[(target + gates.size() - 1) % gates.size()];
      std::array<float, kDraws> still;
      still.fill(0.5F);
      still[0] = 0.0F;
      auto [pose, velocity] = start_between(last, gates[target], still);
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        std::array<float, kDraws> unit;
        for (std::uint32_t k = 0; k < kDraws; ++k) unit[k] = block.context.random(drone, kStartStream, kDraws * attempt + k);
        const auto [drawn_pose, drawn_velocity] = start_between(last, gates[target], unit);
        if (!block.context.is_free(drone, drawn_pose)) continue;
        pose = drawn_pose;
        velocity = drawn_velocity;
        break;
      }
      block.context.place(drone, pose, velocity);
    }
  }

  void begin(const TaskBlock& block) override {
    FlightTask::begin(block);
    for (const DroneIndex drone : block.drones) {
      if (outcome_[drone] != kNone) raise_cap(drone);
      outcome_[drone] = kNone;
      passed_[drone] = 0;
      const std::span<const Gate> gates = block.context.world_of(block.context.env_of(drone)).gates();
      target_[drone] %= static_cast<std::int32_t>(gates.size());  // without place(), it may be that of another world
      distance_[drone] = distance_m(target_of(gates, drone).center, position_of(block.context.state(), drone));
    }
  }

  void score(const TaskBlock& block, Score& score) override {
    const State& state = block.context.state();
    const EpisodeState& episodes = block.context.episodes();
    for (const DroneIndex drone : block.drones) {
      const EnvIndex env = block.context.env_of(drone);
      const std::span<const Gate> gates = block.context.world_of(env).gates();
      target_[drone] %= static_cast<std::int32_t>(gates.size());  // the env may have moved to another world
      const Vec3 position = position_of(state, drone);
      const double distance = distance_m(target_of(gates, drone).center, position);
      const double most = static_cast<double>(cap_[drone]) * step_s();
      const double progress = std::min(distance_[drone] - distance, most);
      const Crossings crossings =
          cross_gates(gates, static_cast<std::size_t>(target_[drone]), block.context.path_of(drone), config_.miss_m);
      target_[drone] = (target_[drone] + crossings.passed) % static_cast<std::int32_t>(gates.size());
      passed_[drone] += crossings.passed;
      distance_[drone] = crossings.passed == 0 ? distance : distance_m(target_of(gates, drone).center, position);
      const bool is_far = distance_[drone] > static_cast<double>(config_.max_distance_m);
      const bool crashed = state.contact.hit[drone] != 0 || crossings.has_missed || is_far;
      const auto lap = static_cast<std::int64_t>(gates.size());
      const bool finished = !crashed && passed_[drone] >= config_.laps * lap;
      const bool is_last = episodes.time_limit[drone] > 0 && episodes.steps[drone] >= episodes.time_limit[drone];
      const bool ends = crashed || finished || is_last;
      if (ends) outcome_[drone] = finished || (!crashed && 2 * passed_[drone] >= lap) ? kClean : kUnclean;
      const std::span<double> terms = score.terms_of(drone);
      terms[kProgress] = static_cast<double>(config_.progress_weight) * progress;
      terms[kGate] = static_cast<double>(config_.gate_weight) * crossings.passed;
      terms[kRates] = -static_cast<double>(config_.rates_weight * angular_velocity_of(state, drone).norm());
      terms[kChange] = -static_cast<double>(config_.change_weight * change(block.context, drone));
      terms[kCrash] = crashed ? -static_cast<double>(config_.crash_weight) : 0.0;
      score.terminated[drone] = crashed || finished;
      score.left_area[drone] = is_far;
      score.success[drone] = finished;
    }
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const State& state = block.context.state();
    const std::vector<float>& gyroscope = block.context.readings<ImuReadings>().gyroscope;
    const auto& rates = corners_ && !gyroscope.empty() ? gyroscope : state.flight.angular_velocity;
    const float scale = config_.observation_scale;
    for (const DroneIndex drone : block.drones) {
      const EnvIndex env = block.context.env_of(drone);
      const std::span<const Gate> gates = block.context.world_of(env).gates();
      const Pose pose = block.context.sensed_pose(drone);
      const Mat3 to_body = pose.rotation.toRotationMatrix().transpose();
      float* row = observation[0].row<float>(drone).data();
      const auto write = [&row](const Vec3& v) {
        Vec3::Map(row) = v;  // not std::copy_n(), which would read the parts of v together, right after they are written
        row += 3;
      };
      std::size_t index = static_cast<std::size_t>(target_[drone]) % gates.size();
      for (std::size_t i = 0; i < gates_ahead_; ++i) {
        const Gate& gate = gates[index];
        if (corners_) {
          const std::size_t view = gates_ahead_ * static_cast<std::size_t>(state.sensed[env]) + i;
          row = corners_->find(gate, state, drone, block.context.drones_per_env(), view, row);
        } else {
          const Vec3 way = gate.center - pose.position;
          write(to_body * way * scale);
          write(to_body * normal_of(gate));
        }
        if (++index == gates.size()) index = 0;
      }
      write(to_body * sensed_velocity_of(block.context, drone) * scale);
      write(to_body.col(2));
      write(Vec3::Map(rates.data() + 3 * drone) * scale);
      std::copy_n(action_now().data() + kActions * drone, kActions, row);
    }
  }

  Terms terms() const override { return Terms::race; }
  void require_derivatives() const override {
    require(!corners_, "task.gate_detector", "None, whose observation has derivatives", "a GateDetector");
  }
  std::size_t num_constants() const override { return 13 + kPerGate * gates_ahead_; }
  void write_constants(const TaskContext& context, DroneIndex drone, float* to) override {
    const World& world = context.world_of(context.env_of(drone));
    const std::span<const Gate> gates = world.gates();
    std::size_t index = static_cast<std::size_t>(target_[drone]) % gates.size();
    const Mat3 axes = gates[index].rotation.toRotationMatrix();
    to[4] = config_.observation_scale;
    to[5] = world.bounds().min.z() + kLow;
    to[12] = cap_[drone];
    Eigen::Map<Vec3>(to + 6) = axes.col(1);
    Eigen::Map<Vec3>(to + 9) = axes.col(2);
    for (std::size_t i = 0; i < gates_ahead_; ++i) {
      Eigen::Map<Vec3>(to + 13 + kPerGate * i) = gates[index].center;
      Eigen::Map<Vec3>(to + 16 + kPerGate * i) = normal_of(gates[index]);
      if (++index == gates.size()) index = 0;
    }
  }
  void write_results(const TaskContext& context, DroneIndex drone, float* to) override {
    const std::span<const Gate> gates = context.world_of(context.env_of(drone)).gates();
    const Vec3 center = target_of(gates, drone).center;
    to[3] = center == Vec3(Eigen::Map<const Vec3>(to + 13)) ? 0.0F : 1.0F;
    Eigen::Map<Vec3>(to + 0) = center;
  }

  void visit(ArrayVisitor& visitor) override {
    FlightTask::visit(visitor);
    visitor.array("target", target_);
    visitor.array("passed", passed_);
    visitor.array("distance", distance_);
    visitor.array("speed_cap", cap_);
    visitor.array("history", history_);
    visitor.array("outcome", outcome_);
  }

  void check() const override {
    FlightTask::check();
    for (const std::int32_t target : target_) require(target >= 0, "snapshot: target", "numbers >= 0", target);
    for (const std::int64_t passed : passed_) require(passed >= 0, "snapshot: passed", "numbers >= 0", passed);
    for (const double distance : distance_) {
      require(std::isfinite(distance) && distance >= 0.0, "snapshot: distance", "numbers >= 0", distance);
    }
    const auto [least, most] = config_.speed_cap_mps;
    for (const float cap : cap_) {
      require(cap >= least && cap <= most, "snapshot: speed_cap", "numbers within task.speed_cap_mps", cap);
    }
    for (const std::uint8_t outcome : outcome_) {
      require(outcome <= kUnclean, "snapshot: outcome", "0, 1 or 2", static_cast<int>(outcome));
    }
  }

 private:
  enum Term : std::size_t { kProgress, kGate, kRates, kChange, kCrash };
  enum Outcome : std::uint8_t { kNone, kClean, kUnclean };
  static constexpr std::size_t kPerGate = 6, kOwn = 13;  // numbers of an observation
  static constexpr std::uint32_t kGateStream = 1;
  static constexpr std::uint32_t kDraws = 10;
  static constexpr std::uint32_t kTries = 64;  // random starts to try before starting right behind a gate
  static constexpr float kWayShare = 0.9F;     // share of the way to the next gate on which drones start
  static constexpr float kLow = 0.7F;          // m above the floor, below which the loss rises
  static constexpr float kBehind = 0.3F;       // m, least distance behind the plane of the last gate
  static constexpr float kBefore = 0.8F;       // m, before the next gate

  const Gate& target_of(std::span<const Gate> gates, DroneIndex drone) const {
    return gates[static_cast<std::size_t>(target_[drone])];
  }

  // Adds the last episode to the history, and raises the cap if enough of the last ones were clean.
  void raise_cap(DroneIndex drone) {
    const unsigned last = (1U << static_cast<unsigned>(config_.cap_episodes)) - 1U;
    const unsigned history = (unsigned{history_[drone]} << 1U | (outcome_[drone] == kClean ? 1U : 0U)) & last;
    history_[drone] = static_cast<std::uint8_t>(history);
    const float share = static_cast<float>(std::popcount(history)) / static_cast<float>(config_.cap_episodes);
    if (share < config_.cap_success) return;
    cap_[drone] = std::min(cap_[drone] + config_.cap_rise_mps, config_.speed_cap_mps[1]);
  }

  // unit: draws from [0, 1). 0: place on the way; 1 to 3: offset; 4: yaw; 5, 6: roll and pitch; 7 to 9: velocity.
  std::pair<Pose, Velocity> start_between(const Gate& last, const Gate& next, const std::array<float, kDraws>& unit) const {
    const auto even = [&](std::size_t k) { return 2.0F * unit[k] - 1.0F; };
    const auto around = [&](std::size_t k) { return Vec3(even(k), even(k + 1), even(k + 2)); };
    const bool is_between = config_.start == RaceStart::between;
    // Half of the drones begin behind the gate: from there the first gate is the hardest.
    const float share = is_between ? kWayShare * std::max(0.0F, 2.0F * unit[0] - 1.0F) : 0.0F;
    const Vec3 way = next.center - last.center;
    const Vec3 leaving = normal_of(last);
    const Vec3 direction = (1.0F - share) * leaving + share * way.normalized();
    // The offset of a start behind the gate does not lead back into its frame, which the drone does not observe.
    const float behind = kBehind + config_.start_offset_m * leaving.lpNorm<1>();
    const Vec3 position = last.center + (1.0F - share) * behind * leaving + share * (way - kBefore * normal_of(next));
    const float yaw = std::atan2(direction.y(), direction.x()) + kRadians * config_.start_yaw_deg * even(4);
    const float roll = kRadians * config_.start_tilt_deg * even(5), pitch = kRadians * config_.start_tilt_deg * even(6);
    const Vec3 velocity = is_between ? Vec3(config_.start_speed_mps * around(7)) : Vec3(Vec3::Zero());
    return {{position + config_.start_offset_m * around(1), quat_from_rpy(roll, pitch, yaw).normalized()},
            {velocity, Vec3::Zero()}};
  }

  std::size_t gates_ahead_;
  std::optional<GateCorners> corners_;
  std::vector<std::int32_t> target_;   // (N,) index of the next gate
  std::vector<std::int64_t> passed_;   // (N,) gates passed in this episode
  std::vector<double> distance_;       // (N,) m, to the centre of the next gate after the last step
  std::vector<float> cap_;             // (N,) m/s, cap on the rewarded speed
  std::vector<std::uint8_t> history_;  // (N,) a bit for each of the last episodes, 1 if it was clean; the last is bit 0
  std::vector<std::uint8_t> outcome_;  // (N,) an Outcome: how the episode ended; none while it goes on
};

}  // namespace
}  // namespace task

void GateDetector::validate() const { check_fields(*this, "task.gate_detector."); }

void RaceConfig::validate() const {
  check_fields(*this, "task.");
  require(speed_cap_mps[0] <= speed_cap_mps[1], "task.speed_cap_mps", "a first cap that is at most the last",
          std::to_string(speed_cap_mps[0]) + " and " + std::to_string(speed_cap_mps[1]));
}

std::unique_ptr<Task> make_task(const RaceConfig& config) { return std::make_unique<task::Race>(config); }

}  // namespace flockstep
