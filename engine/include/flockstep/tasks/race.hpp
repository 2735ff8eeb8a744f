// RaceConfig: a drone flies through the gates of its world, in their order.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <optional>

#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/task.hpp"
#include "flockstep/task_words.hpp"

namespace flockstep {

// Place of the start: anywhere on the way from one gate to the next, or at a gate, at rest.
enum class RaceStart : std::uint8_t { between, gate };
template <>
struct EnumNames<RaceStart> {
  static constexpr std::array kNames{"between", "gate"};
};

// A camera at the drone's centre, and a program that finds gates in its images.
struct GateDetector {
  // The docstring.
  static constexpr const char* kAbout =
      "A camera with a program that finds the corners of gates: of a square opening, or of the square inside a ring.\n\n"
      "There is one image for each observation. The program tells gates and corners apart, and sees through what hides them.";

  int width_px = 640;
  int height_px = 480;
  float hfov_deg = 90.0F;
  float tilt_deg = 0.0F;
  float max_range_m = 30.0F;
  float noise_std_px = 0.0F;
  float dropout = 0.0F;

  static constexpr auto fields() {
    using C = GateDetector;
    return field_list(
        field("width_px", &C::width_px, {.about = "Width of the images.", .unit = "px", .limits = between(1, 8192)}),
        field("height_px", &C::height_px, {.about = "Height of the images.", .unit = "px", .limits = between(1, 8192)}),
        field("hfov_deg", &C::hfov_deg,
              {.about = "Horizontal field of view of a pinhole with square pixels.", .unit = "deg", .limits = between(0.1, 179)}),
        field("tilt_deg", &C::tilt_deg,
              {.about = "Angle by which the camera looks up from the body's x axis.", .unit = "deg", .limits = within(90)}),
        field("max_range_m", &C::max_range_m,
              {.about = "Maximum distance of a corner.", .unit = "m", .limits = above_up_to(0, 1e6)}),
        field("noise_std_px", &C::noise_std_px,
              {.about = "Gaussian noise along both sides of the image.", .unit = "px", .limits = between(0, 1000)}),
        field("dropout", &C::dropout,
              {.about = "Probability that a corner in the image is not found.", .limits = between(0, 1)}));
  }

  FLOCKSTEP_API void validate() const;
};

struct RaceConfig {
  static constexpr const char* kName = "race";
  static constexpr const char* kAbout = "Fly through the gates of a track, lap after lap.";

  static TaskWords words() {
    return {
        .about =
            "The gates are `World.gates` in their order, and ``control`` is ``\"body_rates\"``. A drone passes a gate if its "
            "path crosses the gate's plane forwards within the opening, and misses it if the path crosses the plane outside the "
            "opening but within ``miss_m`` of the centre. The reward counts speed up to a cap v of each env. The cap rises by "
            "``cap_rise_mps`` when at least the share ``cap_success`` of the env's last ``cap_episodes`` episodes were clean. An "
            "episode is clean if it succeeds, or reaches its time limit after at least half a lap. ``batch.task_state`` holds "
            "``target``, "
            "``passed`` and ``speed_cap``.",
        .start =
            "With ``start=\"gate\"``, at rest, at least 0.3 m past a random gate, as if the drone had just passed it. With "
            "``\"between\"``, half of the drones start there, the others on the first nine tenths of the path to the next gate, "
            "at "
            "up to ``start_speed_mps`` along each axis. Offset, yaw, roll and pitch are drawn up to ``start_offset_m``, "
            "``start_yaw_deg`` and ``start_tilt_deg``.",
        .action =
            "Four numbers, clipped to [-1, 1]: thrust (-1 the least of the rotors, 0 hovers, 1 ``max_thrust_to_weight`` times "
            "the "
            "weight), and body rates about x, y and z, up to the ``max_rate_dps`` and ``max_yaw_rate_dps`` of `DynamicsConfig`.",
        .observed = "All vectors are in the body frame. k is ``observation_scale``.",
        .observation =
            {
                {"6 for each of ``gates_ahead``",
                 "offset to the next gate's centre, m, times k (3), and the direction in which it is passed (3)"},
                {"or 12 with ``gate_detector``",
                 "instead unit vectors to the gate's corners (4 x 3), seen from the exact pose, 0 for each that is not found"},
                {"3", "velocity, m/s, times k"},
                {"3", "the world's up vector"},
                {"3", "angular velocity, rad/s, times k. With ``gate_detector`` by the first IMU, if there is one"},
                {"4", "last action"},
            },
        .reward =
            {
                {"progress",
                 "``progress_weight`` times the distance gained towards the next gate's centre, m, at most v times the duration "
                 "of a step"},
                {"gate", "``gate_weight`` for each gate passed"},
                {"rates", "-``rates_weight`` times the magnitude of the angular velocity, rad/s"},
                {"change", "-``change_weight`` times the mean squared difference from the last action, 0 at first"},
                {"crash", "-``crash_weight`` on a failure"},
            },
        .end =
            "A contact, a missed gate, or a distance above ``max_distance_m`` from the next gate ends an episode as a failure. "
            "It "
            "ends as a success after the last gate of the last of ``laps`` laps.",
        .view = "third_person",
        .overlay = "gate",
    };
  }

  int laps = 3;
  int gates_ahead = 2;
  std::optional<GateDetector> gate_detector;
  float max_thrust_to_weight = 4.0F;
  RaceStart start = RaceStart::between;
  float start_offset_m = 0.5F;
  float start_yaw_deg = 30.0F;
  float start_tilt_deg = 17.0F;
  float start_speed_mps = 0.5F;
  float miss_m = 3.0F;
  float max_distance_m = 30.0F;
  float observation_scale = 0.2F;
  std::array<float, 2> speed_cap_mps{8.0F, 16.0F};
  float cap_rise_mps = 1.0F;
  int cap_episodes = 4;
  float cap_success = 1.0F;
  float progress_weight = 0.3F;
  float gate_weight = 0.6F;
  float rates_weight = 0.003F;
  float change_weight = 0.024F;
  float crash_weight = 1.5F;

  static constexpr auto fields() {
    using C = RaceConfig;
    return field_list(
        field("laps", &C::laps, {.about = "Laps of a successful episode.", .limits = between(1, 1000)}),
        field("gates_ahead", &C::gates_ahead, {.about = "Number of gates that are observed.", .limits = between(1, 8)}),
        field("gate_detector", &C::gate_detector,
              {.about = "How the drone sees the gates. None: it observes where they are. `flockstep.APG` needs None."}),
        field("max_thrust_to_weight", &C::max_thrust_to_weight,
              {.about = "Largest commanded thrust over the weight, if the rotors can deliver it.", .limits = between(1.1, 100)}),
        field("start", &C::start,
              {.about = "``\"gate\"``: behind a gate, at rest. ``\"between\"``: half of the drones behind a gate, the others "
                        "anywhere in the first nine tenths of the way to the next gate."}),
        field("start_offset_m", &C::start_offset_m,
              {.about = "Maximum offset of the start along each axis. All spreads are drawn uniformly up to their maxima, and "
                        "drawn again if the drone would touch something.",
               .unit = "m",
               .limits = between(0, 1000)}),
        field("start_yaw_deg", &C::start_yaw_deg,
              {.about = "Maximum angle between the heading and the way to fly.", .unit = "deg", .limits = between(0, 180)}),
        field("start_tilt_deg", &C::start_tilt_deg,
              {.about = "Maximum roll and pitch at the start.", .unit = "deg", .limits = between(0, 90)}),
        field("start_speed_mps", &C::start_speed_mps,
              {.about = "Maximum speed along each axis of a start between gates.", .unit = "m/s", .limits = between(0, 1000)}),
        field(
            "miss_m", &C::miss_m,
            {.about = "A drone misses a gate if it crosses its plane outside the opening but within this distance of its centre.",
             .unit = "m",
             .limits = at_least(0)}),
        field(
            "max_distance_m", &C::max_distance_m,
            {.about = "Distance from the next gate beyond which an episode ends as a failure.", .unit = "m", .limits = above(0)}),
        field("observation_scale", &C::observation_scale,
              {.about = "Factor of observed offsets, velocities and angular velocities.", .limits = above_up_to(0, 1000)}),
        field("speed_cap_mps", &C::speed_cap_mps,
              {.about = "First and last cap on the speed that the progress term rewards.",
               .unit = "m/s",
               .limits = above_up_to(0, 1000)}),
        field("cap_rise_mps", &C::cap_rise_mps,
              {.about = "Rise of the cap after an episode, until it has reached its last value.",
               .unit = "m/s",
               .limits = at_least(0)}),
        field("cap_episodes", &C::cap_episodes,
              {.about = "Number of last episodes of an env that decide whether its cap rises.", .limits = between(1, 8)}),
        field("cap_success", &C::cap_success,
              {.about = "Share of clean episodes among these at which the cap rises.", .limits = between(0, 1)}),
        field("progress_weight", &C::progress_weight,
              {.about =
                   "Weight of the distance gained towards the centre of the next gate, in m, at most v times the step's time."}),
        field("gate_weight", &C::gate_weight, {.about = "Reward for each gate that is passed."}),
        field("rates_weight", &C::rates_weight, {.about = "Weight of the penalty on the angular velocity, in rad/s."}),
        field("change_weight", &C::change_weight,
              {.about = "Weight of the penalty on the mean squared difference from the previous action. The first action is "
                        "compared with 0."}),
        field("crash_weight", &C::crash_weight, {.about = "Penalty for a crash."}));
  }

  FLOCKSTEP_API void validate() const;
};

FLOCKSTEP_API std::unique_ptr<Task> make_task(const RaceConfig& config);

}  // namespace flockstep
