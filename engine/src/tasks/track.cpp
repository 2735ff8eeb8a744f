#include "flockstep/tasks/track.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <numbers>
#include <string>
#include <vector>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "dynamics/setpoint.hpp"
#include "tasks/flight_task.hpp"
#include "tasks/terms.hpp"

namespace flockstep {
namespace task {
namespace {

constexpr double kTurn = 2.0 * std::numbers::pi;
constexpr std::size_t kPhases = 9;  // phases of an episode: three waves along each axis; a figure-8 uses one
constexpr std::uint32_t kPhaseStream = 1;

// The phase of a wave as a rotating unit vector.
struct Wave {
  float cosine, sine;

  // Accurate to float32 at any time: whole turns are removed in double precision.
  static Wave at(double turns) {
    const auto angle = static_cast<float>(kTurn * (turns - std::floor(turns)));
    return {std::cos(angle), std::sin(angle)};
  }
  Wave turned(const Wave& by) const { return {cosine * by.cosine - sine * by.sine, sine * by.cosine + cosine * by.sine}; }
};

// A path as a sum of waves. The size and speed are fixed; the phases differ between episodes.
class Trajectory {
 public:
  using Waves = std::array<Wave, kPhases>;

  explicit Trajectory(const TrackConfig& config) : kind_(config.path), size_(config.size_m) {
    const auto speed = static_cast<double>(config.speed_mps) / static_cast<double>(config.size_m);
    if (kind_ == TrackPath::figure8) {
      // Length of a lap of size 1 by the midpoint rule, which is exact to rounding for a smooth closed curve.
      constexpr int kPieces = 1000;
      double length = 0.0;
      for (int i = 0; i < kPieces; ++i) {
        const double angle = kTurn * (i + 0.5) / kPieces;
        length += std::hypot(std::sin(angle), std::cos(2.0 * angle)) * kTurn / kPieces;
      }
      hz_[0] = speed / length;
    } else {
      double square = 0.0;
      for (std::size_t k = 0; k < kPhases; ++k) {
        const double fastest = kShares[k / 3] * kSizes[k % 3] * kRates[k % 3];
        square += 0.5 * fastest * fastest;
      }
      for (std::size_t k = 0; k < kPhases; ++k) hz_[k] = kRates[k % 3] * speed / std::sqrt(square) / kTurn;
    }
  }

  // phases: in turns.
  Waves waves_at(double time, const float* phases) const {
    Waves waves{};
    for (std::size_t k = 0; k < count(); ++k) waves[k] = Wave::at(hz_[k] * time + static_cast<double>(phases[k]));
    return waves;
  }
  void turn(Waves& waves, const Waves& by) const {
    for (std::size_t k = 0; k < count(); ++k) waves[k] = waves[k].turned(by[k]);
  }

  Vec3 position(const Waves& waves) const {
    if (kind_ == TrackPath::figure8) return size_ * Vec3(waves[0].cosine, waves[0].sine * waves[0].cosine, 0.0F);
    Vec3 p = Vec3::Zero();
    for (std::size_t k = 0; k < kPhases; ++k) p[axis_of(k)] += size_of(k) * waves[k].sine;
    return p;
  }

  Vec3 velocity(const Waves& waves) const {
    if (kind_ == TrackPath::figure8) {
      const float sine = waves[0].sine;
      return size_ * rate_of(0) * Vec3(-sine, 1.0F - 2.0F * sine * sine, 0.0F);
    }
    Vec3 v = Vec3::Zero();
    for (std::size_t k = 0; k < kPhases; ++k) v[axis_of(k)] += size_of(k) * rate_of(k) * waves[k].cosine;
    return v;
  }

 private:
  static constexpr std::array kShares{1.0, 1.0, 0.5};           // amplitude over size_m, by axis
  static constexpr std::array kSizes{0.6, 0.25, 0.15};          // share of that amplitude, by wave
  static constexpr std::array kRates{1.0, 1.618034, 2.414214};  // relative frequencies; their sum never repeats

  std::size_t count() const { return kind_ == TrackPath::figure8 ? 1 : kPhases; }
  static Eigen::Index axis_of(std::size_t k) { return static_cast<Eigen::Index>(k / 3); }
  float size_of(std::size_t k) const { return size_ * static_cast<float>(kShares[k / 3] * kSizes[k % 3]); }
  float rate_of(std::size_t k) const { return static_cast<float>(kTurn * hz_[k]); }

  TrackPath kind_;
  float size_;  // m
  std::array<double, kPhases> hz_{};
};

class Track final : public DifferentiableTask<TrackConfig> {
 public:
  explicit Track(const TrackConfig& config) : DifferentiableTask(config), path_(config) {
    ahead_ = path_.waves_at(static_cast<double>(config.ahead_s), std::array<float, kPhases>{}.data());
    set_observation();
  }

  TaskDefaults defaults() const override {
    return {.worlds = "arena/hall",
            .max_episode_steps = 1000,
            .drone = "crazyflie",
            .batch = {.clock = {.policy_hz = 100.0F}, .dynamics = {.motion = Motion::rotors, .control = Control::body_rates}}};
  }

  void setup(const TaskContext& context) override {
    ConfiguredFlightTask::setup(context);
    set_observation();
    phase_.resize(kPhases * context.num_drones());
    squares_.resize(context.num_drones());
  }

  // Checks points along a figure-8, which is the same in every episode, and only the middle and extent of random paths.
  void require_world(const World& world, const DroneModel& drone) const override {
    FlightTask::require_world(world, drone);
    const Vec3 middle = target_of(world);
    if (config_.path == TrackPath::figure8) {
      constexpr int kPlaces = 32;
      for (int i = 0; i < kPlaces; ++i) {
        std::array<float, kPhases> phases{};
        phases[0] = static_cast<float>(i) / kPlaces;
        const Trajectory::Waves waves = path_.waves_at(0.0, phases.data());
        require_free(world, drone, "the path about its middle (task.size_m sets its size)", middle + path_.position(waves));
      }
      return;
    }
    const Aabb space = open_space(world);
    for (const float side : {-1.0F, 1.0F}) {
      const Vec3 reach = middle + side * config_.size_m * Vec3(1.0F, 1.0F, 0.5F);
      require((reach.array() >= space.min.array()).all() && (reach.array() <= space.max.array()).all(), "task.size_m",
              "paths that stay within the room of world \"" + world.name() + '"', config_.size_m);
    }
  }

  void place(const TaskBlock& block) override {
    for (const DroneIndex drone : block.drones) {
      float* const phases = phase_.data() + kPhases * drone;
      for (std::uint32_t k = 0; k < kPhases; ++k) phases[k] = block.context.random(drone, kPhaseStream, k);
      const Trajectory::Waves waves = path_.waves_at(0.0, phases);
      const float yaw = yaw_at(waves);
      Pose pose{target_of(block.context, drone) + path_.position(waves), Quat(std::cos(yaw / 2), 0, 0, std::sin(yaw / 2))};
      for (std::uint32_t axis = 0; axis < 3; ++axis) {
        pose.position[static_cast<Eigen::Index>(axis)] +=
            config_.start_offset_m * (2.0F * block.context.random(drone, kStartStream, axis) - 1.0F);
      }
      block.context.place(drone, pose, {path_.velocity(waves), Vec3::Zero()});
    }
  }

  void begin(const TaskBlock& block) override {
    FlightTask::begin(block);
    for (const DroneIndex drone : block.drones) squares_[drone] = 0.0;
  }

  void score(const TaskBlock& block, Score& score) override {
    const State& state = block.context.state();
    const EpisodeState& episodes = block.context.episodes();
    for (const DroneIndex drone : block.drones) {
      const Trajectory::Waves waves = waves_of(episodes, drone);
      const Pose pose = pose_of(state, drone);
      const double distance = distance_m(target_of(block.context, drone) + path_.position(waves), pose.position);
      const auto close = static_cast<double>(config_.close_m);
      const bool is_far = distance > static_cast<double>(config_.max_distance_m);
      const bool crashed = state.contact.hit[drone] != 0 || is_far;
      squares_[drone] += distance * distance;
      const std::span<double> terms = score.terms_of(drone);
      terms[kNear] = static_cast<double>(config_.near_weight * std::exp(-2.0F * static_cast<float>(distance)));
      terms[kClose] = static_cast<double>(config_.close_weight) / (1.0 + distance * distance / (close * close));
      terms[kYaw] = -static_cast<double>(config_.yaw_weight * std::abs(missing_yaw(waves, pose.rotation)));
      terms[kSpin] = -static_cast<double>(config_.spin_weight) * spin(state, drone);
      terms[kChange] = -static_cast<double>(config_.change_weight * change(block.context, drone));
      terms[kCrash] = crashed ? -static_cast<double>(config_.crash_weight) : 0.0;
      score.terminated[drone] = crashed;
      score.left_area[drone] = is_far;
      score.success[drone] = !crashed && squares_[drone] <= close * close * static_cast<double>(episodes.steps[drone]);
    }
  }

  void observe(const TaskBlock& block, std::span<Buffer> observation) override {
    for (const DroneIndex drone : block.drones) {
      const Pose pose = block.context.sensed_pose(drone);
      const Mat3 to_body = pose.rotation.toRotationMatrix().transpose();
      const std::span<float> row = observation[0].row<float>(drone);
      const auto points = static_cast<std::size_t>(config_.points);
      Trajectory::Waves waves = waves_of(block.context.episodes(), drone);
      const float missing = missing_yaw(waves, pose.rotation);
      const Vec3 from_middle = pose.position - target_of(block.context, drone);
      for (std::size_t i = 0; i < points; ++i) {
        if (i > 0) path_.turn(waves, ahead_);
        Vec3::Map(row.data() + 3 * i) = to_body * (path_.position(waves) - from_middle);
      }
      observe_flight(block.context, drone, to_body, row.subspan(3 * points));
      row[row.size() - 2] = std::sin(missing);
      row[row.size() - 1] = std::cos(missing);
    }
  }

  Terms terms() const override { return Terms::track; }
  std::size_t num_constants() const override { return 13 + 3 * static_cast<std::size_t>(config_.points); }
  void write_constants(const TaskContext& context, DroneIndex drone, float* to) override {
    const Vec3 middle = target_of(context, drone);
    Trajectory::Waves waves = waves_of(context.episodes(), drone);
    const float now = yaw_at(waves);
    to[8] = std::sin(now);
    to[9] = std::cos(now);
    std::ranges::copy(rotor_unit(context, drone), to + 10);
    for (std::size_t i = 0; i < static_cast<std::size_t>(config_.points); ++i) {
      if (i > 0) path_.turn(waves, ahead_);
      Eigen::Map<Vec3>(to + 13 + 3 * i) = middle + path_.position(waves);
    }
    const double after_s = static_cast<double>(context.episodes().steps[drone] + 1) * step_s();
    waves = path_.waves_at(after_s, phase_.data() + kPhases * drone);
    const float after = yaw_at(waves);
    Eigen::Map<Vec3>(to + 0) = middle + path_.position(waves);
    Eigen::Map<Vec3>(to + 3) = path_.velocity(waves);
    to[6] = std::sin(after);
    to[7] = std::cos(after);
  }
  void write_results(const TaskContext&, DroneIndex, float*) override {}

  void visit(ArrayVisitor& visitor) override {
    FlightTask::visit(visitor);
    visitor.array("phase", phase_);
    visitor.array("squares", squares_);
  }

  void check() const override {
    FlightTask::check();
    for (const float phase : phase_) require(phase >= 0.0F && phase < 1.0F, "snapshot: phase", "numbers in [0, 1)", phase);
    for (const double sum : squares_) require(std::isfinite(sum) && sum >= 0.0, "snapshot: squares", "numbers >= 0", sum);
  }

 private:
  void set_observation() {
    spec_.observation = {flight_field(3 * static_cast<std::size_t>(config_.points) + kOwnFlight + num_rotors() + 2)};
  }

  enum Term : std::size_t { kNear, kClose, kYaw, kSpin, kChange, kCrash };

  Trajectory::Waves waves_of(const EpisodeState& episodes, DroneIndex drone) const {
    return path_.waves_at(static_cast<double>(episodes.steps[drone]) * step_s(), phase_.data() + kPhases * drone);
  }

  float yaw_at(const Trajectory::Waves& waves) const {
    if (config_.yaw == TrackYaw::fixed) return 0.0F;
    const Vec3 velocity = path_.velocity(waves);
    return std::atan2(velocity.y(), velocity.x());
  }

  float missing_yaw(const Trajectory::Waves& waves, const Quat& rotation) const {
    return std::remainder(yaw_at(waves) - dynamics::yaw_of(rotation), static_cast<float>(kTurn));
  }

  Trajectory path_;
  Trajectory::Waves ahead_{};    // rotation of the waves in ahead_s
  std::vector<float> phase_;     // (N, 9) turns
  std::vector<double> squares_;  // (N,) m^2, sum of the squared distances of all steps
};

}  // namespace
}  // namespace task

void TrackConfig::validate() const { check_fields(*this, "task."); }

std::unique_ptr<Task> make_task(const TrackConfig& config) { return std::make_unique<task::Track>(config); }

}  // namespace flockstep
