// The built-in navigation tasks: actions to target poses; reward, termination and observation from state and sensors; resets.
// They share all but what they observe beside the ranges; see ObservationKind.
// Each function works on the listed drones, in the order the step calls them.
#pragma once

#include <array>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"
#include "task/green_blob.hpp"
#include "task/ranges.hpp"

namespace flockstep::task {

inline constexpr std::size_t kMaxActionSize = 4;

// (N,) each; written by navigation alone.
struct NavigationState {
  std::vector<std::int32_t> goal_index;                        // waypoints reached; the final goal when it equals their number
  std::vector<double> last_distance;                           // m to the current goal, after the last step
  std::vector<std::array<float, kMaxActionSize>> last_action;  // NaN before the first: a change whatever comes
  std::vector<std::int64_t> step;                              // number of the next step in the episode, from 0
  std::vector<std::int64_t> time_limit;                        // steps; 0: none
  std::vector<double> episode_return;
  FlagArray begun;  // the first episode has begun
  FlagArray done;   // the episode ended and no reset has come since

  explicit NavigationState(std::size_t num_drones);
};

class Navigation {
 public:
  Navigation(const NavigationConfig& config, std::span<const World* const> worlds, const DroneModel& drone,
             std::size_t num_drones);

  std::size_t head_size() const;  // of the observation, before the ranges: 3, 2 or 0
  std::size_t observation_size(std::size_t rays) const { return head_size() + rays; }
  std::size_t action_size() const;  // 1, 3 or 4

  // Where an action (action_size() numbers) takes a drone.
  Pose target(const Pose& pose, const float* action) const;

  // Writes the ranges (m) over max_range, 1 on a miss, into the observation row of a drone.
  void observe_ranges(std::size_t drone, std::span<const float> ranges, float max_range, float* observation);

  // Reward, flags and episode figures of one flown step of a drone, after its ranges were observed. The reward is added to that
  // of the same step() so far, unless this is the first it flies.
  void evaluate(std::size_t drone, const float* action, std::size_t num_ranges, const State& state, bool first, Outputs& out);

  // Writes the head of the observation row of a drone: the unit direction to the current goal, in the sensed body frame.
  void observe_goal(std::size_t drone, const State& state, float* observation) const;
  // Or what is green in its camera's image.
  static void observe_blob(const GreenBlob& blob, float* observation);

  // Puts a drone where the episode that state.seed and state.episode name begins.
  void place(std::size_t drone, State& state) const;
  // Begins the episode from where the drone is.
  void begin(std::size_t drone, const State& state);

  NavigationState& state() { return nav_; }
  const NavigationState& state() const { return nav_; }

 private:
  const Vec3& current_goal(std::size_t drone, const World& world) const;
  Vec3 start_position(std::size_t drone, const State& state, const World& world) const;

  NavigationConfig config_;
  std::vector<const World*> worlds_;
  const DroneModel* drone_;
  NavigationState nav_;
  std::vector<Clearance> clearance_;                         // (N,) of the ranges last observed
  std::vector<std::array<double, kNumRewardTerms>> earned_;  // (N,) in this step() so far
};

}  // namespace flockstep::task
