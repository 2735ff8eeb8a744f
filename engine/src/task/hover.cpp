#include "flockstep/hover.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "base/hash.hpp"
#include "base/require.hpp"
#include "task/flight_task.hpp"
#include "task/terms.hpp"

namespace flockstep {
namespace task {
namespace {

class Hover final : public FlightTask {
 public:
  explicit Hover(const HoverConfig& config) : FlightTask({"near", "hold", "speed", "spin", "change", "crash"}), config_(config) {
    config.validate();
    spec_.observation = {flight_field(3 + kOwnFlight)};
  }

  TaskDefaults defaults() const override {
    return {.worlds = "arena/hall",
            .max_episode_steps = 300,
            .drone = "crazyflie",
            .dynamics = {.motion = Motion::rotors, .control = Control::rotor_thrusts},
            .clock = {.policy_hz = 50.0F}};
  }

  std::string identity() const override {
    Hash hash;
    hash.add(config_);
    return "hover " + std::to_string(hash.value());
  }

  void setup(const TaskContext& context) override {
    FlightTask::setup(context);
    held_.resize(context.num_envs());
    hold_steps_ = std::max(std::llround(static_cast<double>(config_.hold_s) / step_s()), 1LL);
  }

  void place(const TaskBlock& block) override {
    for (const std::uint32_t env : block.envs) {
      Pose pose{middle_of(block.context, env), Quat::Identity()};
      Velocity velocity;
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        const auto [thrown_pose, thrown_velocity] = thrown(block.context, env, attempt);
        if (!block.context.is_free(env, thrown_pose)) continue;
        pose = thrown_pose;
        velocity = thrown_velocity;
        break;
      }
      block.context.place(env, pose, velocity);
    }
  }

  void begin(const TaskBlock& block) override {
    FlightTask::begin(block);
    for (const std::uint32_t env : block.envs) held_[env] = 0;
  }

  void score(const TaskBlock& block, Score& score) override {
    const State& state = block.context.state();
    const auto hold = static_cast<double>(config_.hold_m);
    Together all;
    for_each_together(block.envs, [&](std::span<const std::uint32_t> envs) {
      for (std::size_t i = 0; i < envs.size(); ++i) {
        all.set_way(i, middle_of(block.context, envs[i]), position_of(state, envs[i]));
        all.set_flight(i, state, envs[i]);
      }
      const Together::Doubles distance = all.distance();
      const Together::Doubles squares = distance.square() * (1.0 / (4.0 * hold * hold));
      const Together::Floats near = config_.near_weight * (-2.0F * distance.cast<float>()).exp();
      const Together::Doubles holding = static_cast<double>(config_.hold_weight) / (1.0 + squares);
      const Together::Floats speed = -config_.speed_weight * all.speed();
      const Together::Floats spin = -config_.spin_weight * all.spin();
      for (std::size_t i = 0; i < envs.size(); ++i) {
        const std::uint32_t env = envs[i];
        const auto at = static_cast<Eigen::Index>(i);
        const bool crashed = state.contact.hit[env] != 0 || distance[at] > static_cast<double>(config_.max_distance_m);
        held_[env] = distance[at] <= hold ? held_[env] + 1 : 0;
        double* const terms = score.terms_of(env).data();
        terms[kNear] = static_cast<double>(near[at]);
        terms[kHold] = holding[at];
        terms[kSpeed] = static_cast<double>(speed[at]);
        terms[kSpin] = static_cast<double>(spin[at]);
        terms[kChange] = -static_cast<double>(config_.change_weight * change(env));
        terms[kCrash] = crashed ? -static_cast<double>(config_.crash_weight) : 0.0;
        score.terminated[env] = crashed;
        score.success[env] = !crashed && held_[env] >= hold_steps_;
      }
    });
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const State& state = block.context.state();
    for (const std::uint32_t env : block.envs) {
      const Pose pose = block.context.sensed_pose(env);
      const Mat3 to_body = pose.rotation.toRotationMatrix().transpose();
      const Vec3 way = to_body * (middle_of(block.context, env) - pose.position);
      const std::span<float> row = observation[0].row<float>(env);
      std::copy_n(way.data(), 3, row.data());
      observe_flight(state, env, to_body, row.subspan(3));
    }
  }

  void visit(ArrayVisitor& visitor) override {
    FlightTask::visit(visitor);
    visitor.array("held", held_);
  }

  void check() const override {
    FlightTask::check();
    for (const std::int64_t held : held_) require(held >= 0, "snapshot: held", "numbers >= 0", held);
  }

 private:
  enum Term : std::size_t { kNear, kHold, kSpeed, kSpin, kChange, kCrash };
  static constexpr std::uint32_t kTries = 64;  // starts drawn before the point itself is taken

  std::pair<Pose, Velocity> thrown(const TaskContext& context, std::uint32_t env, std::uint32_t attempt) {
    constexpr std::uint32_t kDraws = 12;
    constexpr float kPi = std::numbers::pi_v<float>;
    std::array<float, kDraws> unit;
    for (std::uint32_t k = 0; k < kDraws; ++k) unit[k] = context.random(env, kStartStream, kDraws * attempt + k);
    const auto around = [&](std::size_t k) {
      return Vec3(2.0F * unit[k] - 1.0F, 2.0F * unit[k + 1] - 1.0F, 2.0F * unit[k + 2] - 1.0F);
    };
    // Turned about a level axis by the tilt, then about the vertical.
    const float tilt = unit[3] * config_.start_tilt_deg * kPi / 180.0F;
    const float axis = 2.0F * kPi * unit[4];
    const float yaw = 2.0F * kPi * unit[5];
    const Quat tilted(std::cos(tilt / 2), std::sin(tilt / 2) * std::cos(axis), std::sin(tilt / 2) * std::sin(axis), 0.0F);
    const Quat headed(std::cos(yaw / 2), 0.0F, 0.0F, std::sin(yaw / 2));
    const float upward = 2.0F * unit[7] - 1.0F;
    const float level = std::sqrt(1.0F - upward * upward);
    const float heading = 2.0F * kPi * unit[8];
    const Vec3 direction(level * std::cos(heading), level * std::sin(heading), upward);
    return {{middle_of(context, env) + config_.start_offset_m * around(0), (tilted * headed).normalized()},
            {config_.start_speed_mps * unit[6] * direction, config_.start_rate_dps * kPi / 180.0F * around(9)}};
  }

  HoverConfig config_;
  std::int64_t hold_steps_ = 1;
  std::vector<std::int64_t> held_;  // (E,) steps in a row within hold_m
};

}  // namespace
}  // namespace task

void HoverConfig::validate() const {
  require(start_offset_m >= 0.0F && start_offset_m <= 1000.0F, "task.start_offset_m", "a number in [0, 1000]", start_offset_m);
  require(start_tilt_deg >= 0.0F && start_tilt_deg <= 180.0F, "task.start_tilt_deg", "a number in [0, 180]", start_tilt_deg);
  require(start_speed_mps >= 0.0F && start_speed_mps <= 1000.0F, "task.start_speed_mps", "a number in [0, 1000]",
          start_speed_mps);
  require(start_rate_dps >= 0.0F && start_rate_dps <= 1e5F, "task.start_rate_dps", "a number in [0, 100000]", start_rate_dps);
  require_positive(max_distance_m, "task.max_distance_m");
  require_positive(hold_m, "task.hold_m");
  require(hold_s > 0.0F && hold_s <= 1e6F, "task.hold_s", "a number in (0, 1000000]", hold_s);
  require_finite(near_weight, "task.near_weight");
  require_finite(hold_weight, "task.hold_weight");
  require_finite(speed_weight, "task.speed_weight");
  require_finite(spin_weight, "task.spin_weight");
  require_finite(change_weight, "task.change_weight");
  require_finite(crash_weight, "task.crash_weight");
}

std::unique_ptr<Task> make_hover(const HoverConfig& config) { return std::make_unique<task::Hover>(config); }

}  // namespace flockstep
