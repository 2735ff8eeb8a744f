#include "flockstep/tasks/hover.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <utility>
#include <vector>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "tasks/flight_task.hpp"
#include "tasks/hover_kernels.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

class Hover final : public DifferentiableTask<HoverConfig> {
 public:
  explicit Hover(const HoverConfig& config) : DifferentiableTask(config) {
    static_assert(kHoverNumbers == 3 + kOwnFlight + kMinRotors);
    spec_.observation = {flight_field(kHoverNumbers)};
  }

  TaskDefaults defaults() const override {
    return {.worlds = "arena/hall",
            .max_episode_steps = 300,
            .drone = "crazyflie",
            .batch = {.clock = {.policy_hz = 50.0F}, .dynamics = {.motion = Motion::rotors, .control = Control::rotor_thrusts}}};
  }

  void setup(const TaskContext& context) override {
    ConfiguredFlightTask::setup(context);
    spec_.observation = {flight_field(3 + kOwnFlight + num_rotors())};
    held_.resize(context.num_drones());
    units_.clear();
    for (const Airframe& frame : context.airframes()) {
      const double hovering = frame.hover_speed();
      units_.push_back({static_cast<float>(hovering), static_cast<float>(1.0 / (hovering - frame.min_speed_radps)),
                        static_cast<float>(1.0 / (frame.max_speed_radps - hovering))});
    }
    for (std::size_t lane = 0; lane < GatheredRows::kCount; ++lane) set_units(units_[0], lane, rotors_);
    hold_steps_ = std::max(std::llround(static_cast<double>(config_.hold_s) / step_s()), 1LL);
  }

  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      Pose pose{target_of(block.context, drone), Quat::Identity()};
      Velocity velocity;
      for (std::uint32_t attempt = 0; attempt < kTries; ++attempt) {
        const auto [thrown_pose, thrown_velocity] = thrown(block.context, drone, attempt);
        if (!block.context.is_free(drone, thrown_pose)) continue;
        pose = thrown_pose;
        velocity = thrown_velocity;
        break;
      }
      block.context.place(drone, pose, velocity);
    }
  }

  void begin(const TaskBlock& block) override {
    FlightTask::begin(block);
    for (const DroneIndex drone : block.drones) held_[drone] = 0;
  }

  void score(const TaskBlock& block, Score& score) override {
    const State& state = block.context.state();
    const auto hold = static_cast<double>(config_.hold_m);
    // Local copies: writes through uint8_t* may alias members and would force reloads.
    const HoverConfig weights = config_;
    const std::int64_t hold_steps = hold_steps_;
    const std::uint8_t* const hit = state.contact.hit.data();
    std::int64_t* const held = held_.data();
    double* const out = score.terms.data();
    std::uint8_t* const terminated = score.terminated.data();
    std::uint8_t* const success = score.success.data();
    std::uint8_t* const left_area = score.left_area.data();
    const bool is_four = num_actions() == kActions;
    for_each_lanes(block.drones, [&](GatheredRows& rows) {
      HoverScores scores;
      score_hover({.target = targets_of(block.context, rows),
                   .position = rows.rows<3>(state.position),
                   .velocity = rows.rows<3>(state.flight.velocity),
                   .angular_velocity = rows.rows<3>(state.flight.angular_velocity),
                   .action = is_four ? rows.rows<4>(action_now()) : nullptr,
                   .action_before = is_four ? rows.rows<4>(action_before()) : nullptr},
                  2.0 * hold, scores);
      for (std::size_t i = 0; !is_four && i < rows.drones().size(); ++i) {
        scores.change[i] = change(block.context, rows.drones()[i]);
      }
      std::array<std::array<double, kTerms>, GatheredRows::kCount> terms;
      for (std::size_t i = 0; i < GatheredRows::kCount; ++i) {
        terms[i] = {static_cast<double>(weights.near_weight * scores.closeness[i]),
                    static_cast<double>(weights.hold_weight) * scores.holding[i],
                    -static_cast<double>(weights.speed_weight * scores.speed[i]),
                    -static_cast<double>(weights.spin_weight * (scores.spin[i] / kSpinUnit)),
                    -static_cast<double>(weights.change_weight * scores.change[i]),
                    0.0};
      }
      for (std::size_t i = 0; i < rows.drones().size(); ++i) {
        const DroneIndex drone = rows.drones()[i];
        const bool is_far = scores.distance[i] > static_cast<double>(weights.max_distance_m);
        const bool crashed = (hit[drone] != 0) | is_far;
        const bool is_held = scores.distance[i] <= hold;
        held[drone] = is_held ? held[drone] + 1 : 0;
        if (crashed) terms[i][kCrash] = -static_cast<double>(weights.crash_weight);
        std::copy_n(terms[i].data(), kTerms, out + kTerms * drone);
        terminated[drone] = crashed;
        left_area[drone] = is_far;
        success[drone] = !crashed & (held[drone] >= hold_steps);
      }
    });
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    const State& state = block.context.state();
    for_each_lanes(block.drones, [&](GatheredRows& rows) {
      std::array<float, kMinRotors * GatheredRows::kCount> first_speeds;
      for (std::size_t i = 0; num_rotors() > kMinRotors && i < GatheredRows::kCount; ++i) {
        const DroneIndex drone = rows.drones()[std::min(i, rows.drones().size() - 1)];
        std::copy_n(state.flight.rotor_speed.data() + num_rotors() * drone, kMinRotors, first_speeds.data() + kMinRotors * i);
      }
      const HoverRows flown{
          .target = targets_of(block.context, rows),
          .position = rows.rows<3>(block.context.pose_readings().position),
          .quat_wxyz = rows.rows<4>(block.context.pose_readings().quat_wxyz),
          .velocity = rows.rows<3>(block.context.sensed_velocity()),
          .angular_velocity = rows.rows<3>(state.flight.angular_velocity),
          .rotor_speed = num_rotors() > kMinRotors ? first_speeds.data() : rows.rows<4>(state.flight.rotor_speed)};
      float* const first = observation[0].row<float>(rows.drones()[0]).data();
      RotorUnits several;
      for (std::size_t i = 0; units_.size() > 1 && i < GatheredRows::kCount; ++i) {
        const DroneIndex drone = rows.drones()[std::min(i, rows.drones().size() - 1)];
        set_units(units_[block.context.airframe_row(drone)], i, several);
      }
      const RotorUnits& rotors = units_.size() > 1 ? several : rotors_;
      if (rows.is_contiguous() && num_rotors() == kMinRotors) return observe_hover(flown, rotors, kSpinUnit, first);
      std::array<float, kHoverNumbers * GatheredRows::kCount> out;
      observe_hover(flown, rotors, kSpinUnit, out.data());
      for (std::size_t i = 0; i < rows.drones().size(); ++i) {
        const DroneIndex drone = rows.drones()[i];
        float* const row = std::copy_n(out.data() + kHoverNumbers * i, kHoverNumbers, observation[0].row<float>(drone).data());
        for (std::size_t k = kMinRotors; k < num_rotors(); ++k) row[k - kMinRotors] = rotor_level(block.context, drone, k);
      }
    });
  }

  Terms terms() const override { return Terms::hover; }
  std::size_t num_constants() const override { return 6; }
  void write_constants(const TaskContext& context, DroneIndex drone, float* to) override {
    const Vec3 target = target_of(context, drone);
    to = std::copy_n(target.data(), 3, to);
    std::ranges::copy(units_[context.airframe_row(drone)], to);
  }
  void write_results(const TaskContext&, DroneIndex, float*) override {}

  void visit(ArrayVisitor& visitor) override {
    FlightTask::visit(visitor);
    visitor.array("held", held_);
  }

  void check() const override {
    FlightTask::check();
    for (const std::int64_t held : held_) require(held >= 0, "snapshot: held", "numbers >= 0", held);
  }

 private:
  enum Term : std::size_t { kNear, kHold, kSpeed, kSpin, kChange, kCrash, kTerms };
  static constexpr std::uint32_t kTries = 64;  // random starts to try before starting at the target

  std::pair<Pose, Velocity> thrown(const TaskContext& context, DroneIndex drone, std::uint32_t attempt) {
    constexpr std::uint32_t kDraws = 12;
    constexpr float kPi = std::numbers::pi_v<float>;
    std::array<float, kDraws> unit;
    for (std::uint32_t k = 0; k < kDraws; ++k) unit[k] = context.random(drone, kStartStream, kDraws * attempt + k);
    const auto around = [&](std::size_t k) {
      return Vec3(2.0F * unit[k] - 1.0F, 2.0F * unit[k + 1] - 1.0F, 2.0F * unit[k + 2] - 1.0F);
    };
    // Rotate by the tilt about a horizontal axis, then by the yaw about the vertical.
    const float tilt = unit[3] * config_.start_tilt_deg * kPi / 180.0F;
    const float axis = 2.0F * kPi * unit[4];
    const float yaw = 2.0F * kPi * unit[5];
    const Quat tilted(std::cos(tilt / 2), std::sin(tilt / 2) * std::cos(axis), std::sin(tilt / 2) * std::sin(axis), 0.0F);
    const Quat headed(std::cos(yaw / 2), 0.0F, 0.0F, std::sin(yaw / 2));
    const float upward = 2.0F * unit[7] - 1.0F;
    const float level = std::sqrt(1.0F - upward * upward);
    const float heading = 2.0F * kPi * unit[8];
    const Vec3 direction(level * std::cos(heading), level * std::sin(heading), upward);
    return {{target_of(context, drone) + config_.start_offset_m * around(0), (tilted * headed).normalized()},
            {config_.start_speed_mps * unit[6] * direction, config_.start_rate_dps * kPi / 180.0F * around(9)}};
  }

  using Units = std::array<float, 3>;
  static void set_units(const Units& units, std::size_t lane, RotorUnits& lanes) {
    lanes.hovering[lane] = units[0];
    lanes.inverse_below[lane] = units[1];
    lanes.inverse_above[lane] = units[2];
  }

  std::vector<Units> units_;  // of RotorUnits, by row of the airframes
  RotorUnits rotors_;         // of the first
  std::int64_t hold_steps_ = 1;
  std::vector<std::int64_t> held_;  // (N,) consecutive steps within hold_m
};

}  // namespace
}  // namespace task

void HoverConfig::validate() const { check_fields(*this, "task."); }

std::unique_ptr<Task> make_task(const HoverConfig& config) { return std::make_unique<task::Hover>(config); }

}  // namespace flockstep
