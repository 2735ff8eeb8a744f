#include "flockstep/config.hpp"

#include <algorithm>
#include <cmath>
#include <sstream>
#include <string>

#include "base/check_fields.hpp"
#include "base/require.hpp"
#include "batch/growth.hpp"
#include "bodies/body_model.hpp"
#include "dynamics/parameters.hpp"
#include "sensors/sensor.hpp"

namespace flockstep {
namespace {

constexpr double kMinPhysicsHz = 50.0;
constexpr double kRateTolerance = 1e-4;  // relative tolerance of the ratio of two float32 rates

}  // namespace

void EpisodeConfig::validate() const {
  check_fields(*this, "");
  require(!stagger_first_episode || max_episode_steps != 0, "stagger_first_episode",
          "False with max_episode_steps=0 (there is no limit to stagger)", "True");
}

void ObservationConfig::validate() const { check_fields(*this, "observed."); }

void ClockConfig::validate() const {
  check_fields(*this, "");
  const auto divides = [](double slow, double fast, double most) {
    const double ratio = fast / slow;
    return ratio >= 1.0 - kRateTolerance && ratio <= most && std::abs(ratio - std::round(ratio)) <= kRateTolerance * ratio;
  };
  const auto hz = [](double rate) {
    std::ostringstream text;
    text << rate << " Hz";
    return text.str();
  };
  const double policy = static_cast<double>(policy_hz);
  require(divides(policy, ticks_hz(), 1000.5), "physics_hz",
          "a multiple of policy_hz (" + hz(policy) + "), at most 1000 times it", hz(ticks_hz()));
  if (!controller_hz) return;
  const double controller = static_cast<double>(*controller_hz);
  require(!physics_hz || divides(controller, ticks_hz(), 1000.5), "controller_hz",
          "a divisor of physics_hz (" + hz(ticks_hz()) + ")", hz(controller));
  require(divides(policy, controller, 1000.5), "controller_hz", "a multiple of policy_hz (" + hz(policy) + ")", hz(controller));
}

void ControllerConfig::validate() const { check_fields(*this, "controller."); }

void WindConfig::validate() const {
  check_fields(*this, "wind.");
  const WindConfig unset;
  const auto require_read = [&](float WindConfig::* field, const char* name, Gusts by) {
    require(gusts == by || this->*field == unset.*field, name,
            std::string("its default unless gusts=\"") + EnumNames<Gusts>::kNames[static_cast<std::size_t>(by)] +
                "\" (no other gusts use it)",
            this->*field);
  };
  require_read(&WindConfig::gust_std_mps, "wind.gust_std_mps", Gusts::ornstein_uhlenbeck);
  require_read(&WindConfig::gust_time_s, "wind.gust_time_s", Gusts::ornstein_uhlenbeck);
  require_read(&WindConfig::wind_at_6m_mps, "wind.wind_at_6m_mps", Gusts::dryden);
  require_read(&WindConfig::height_m, "wind.height_m", Gusts::dryden);
}

void DynamicsConfig::validate() const {
  check_fields(*this, "");
  require(!is_kinematic() || control == Control::pose, "control", "\"pose\" (motion is \"kinematic\": give motion=\"rotors\")",
          EnumNames<Control>::kNames[static_cast<std::size_t>(control)]);
  const auto require_off = [&](bool is_on, const char* name, const char* off, const char* shown) {
    require(!is_kinematic() || !is_on, name,
            std::string(off) + " for kinematic motion (it has no rotors: give motion=\"rotors\")", shown);
  };
  require_off(downwash, "downwash", "False", "True");
  require_off(ground_effect, "ground_effect", "False", "True");
  require_off(wind.gusts != Gusts::none || wind.mean_mps != WindConfig().mean_mps, "wind", "no wind", "some");
}

namespace {

template <class T>
concept SensorConfig = requires(const T& config) { config.rate_hz; };

// Checks the rates and names of the sensors in a field of BatchConfig, which holds one or a list, and whether they can read what
// its motion has. Ignores other fields.
template <class Value>
void check_sensors(const std::string& field, const Value& value, const BatchConfig& batch) {
  if constexpr (SensorConfig<Value>) {
    if constexpr (requires { value.check_motion(batch.dynamics); }) value.check_motion(batch.dynamics);
    sensors::period_in_ticks(value.rate_hz, batch.clock, field + ".rate_hz");
  } else if constexpr (requires { requires SensorConfig<typename Value::value_type>; }) {
    const std::string kind = field.substr(0, field.size() - 1);  // "lidars" becomes "lidar"
    for (auto config = value.begin(); config != value.end(); ++config) {
      check_sensors(kind, *config, batch);
      const auto same = [&](const auto& other) { return other.name == config->name; };
      require(std::none_of(value.begin(), config, same), kind + ".name", "a name that no other " + kind + " has",
              '"' + config->name + '"');
    }
  }
}

}  // namespace

void BatchConfig::validate() const {
  const long long drones = static_cast<long long>(num_envs) * drones_per_env;
  require(drones >= 0 && drones <= kMaxDrones, "num_drones = num_envs x drones_per_env", "an integer in [0, 1048576]", drones);
  check_fields(*this, "");
  require(num_envs > 0 || drones_per_env == 1, "num_envs",
          "an integer >= 1, or drones_per_env=1 (then each new drone has a separate env)", num_envs);
  require(!dynamics.is_kinematic() || !clock.controller_hz, "controller_hz",
          "None for kinematic motion (it has no controller: give motion=\"rotors\")", clock.controller_hz.value_or(0.0F));
  require(dynamics.is_kinematic() || clock.ticks_hz() >= kMinPhysicsHz, "physics_hz",
          "at least 50 Hz for motion by rotors (500 is usual)", clock.ticks_hz());
  require(max_bodies == 0 || max_bodies >= static_cast<int>(bodies.size()), "max_bodies",
          "at least the number of bodies (" + std::to_string(bodies.size()) + "), or 0", max_bodies);
  const std::size_t most = max_drones_per_env(interaction);
  require(static_cast<std::size_t>(drones_per_env) <= most, "drones_per_env",
          "at most " + std::to_string(most) + " unless interaction is \"none\"", drones_per_env);
  require(drone_mesh == nullptr || senses(interaction), "drone_mesh", "None unless interaction is \"sense\" or \"both\"",
          "a world");
  if (drone_mesh != nullptr) require_mesh(*drone_mesh, "drone_mesh");
  require(!dynamics.is_kinematic() || (variations.empty() && airframes.empty()), variations.empty() ? "airframes" : "variations",
          "none for kinematic motion (it has no flight model: give motion=\"rotors\")", "some");
  require(airframes.size() <= kMaxAirframes, "airframes", "at most 65536", airframes.size());
  const std::string shown = privileged.empty() ? "" : '"' + privileged[0] + '"';
  require(privileged.empty() || !variations.empty() || airframes.size() > 1, "privileged",
          "none without variations, which it shows", shown);
  static_cast<void>(dynamics::ShownParameters(privileged));  // refuses unknown names
  require(lights.size() <= kMaxLights, "lights", "at most 4096", lights.size());
  for_each_field(*this, [&](const auto& entry, const auto& value) { check_sensors(entry.name, value, *this); });
  for (const LidarConfig& lidar : lidars) {
    const long long rays = static_cast<long long>(num_drones()) * lidar.rows() * lidar.columns();
    require(rays <= (1LL << 31), "num_drones x lidar rays", "at most 2147483648 rays", rays);
  }
  for (const CameraConfig& camera : cameras) {
    if (camera_backend == CameraBackend::gl) {
      require(camera.sun_size_deg == 0.0F, "sun_size_deg", "0 with camera_backend=\"gl\"", camera.sun_size_deg);
      require(camera.ambient_occlusion_rays == 0, "ambient_occlusion_rays", "0 with camera_backend=\"gl\"",
              camera.ambient_occlusion_rays);
      require(!camera.shadows, "shadows", "False with camera_backend=\"gl\"", "True");
      require(camera.projection == Projection::pinhole, "projection", "\"pinhole\" with camera_backend=\"gl\"", "\"fisheye\"");
      require(!camera.has_lens(), "distortion", "none with camera_backend=\"gl\"",
              std::to_string(camera.distortion.size()) + " coefficients");
      require(camera.rolling_shutter_s == 0.0F, "rolling_shutter_s", "0 with camera_backend=\"gl\"", camera.rolling_shutter_s);
      require(camera.exposure_s == 0.0F, "exposure_s", "0 with camera_backend=\"gl\"", camera.exposure_s);
    }
    const double between_s =
        std::max(episode.frame_skip * clock.step_s(), camera.rate_hz ? 1.0 / static_cast<double>(*camera.rate_hz) : 0.0);
    const double takes_s = static_cast<double>(camera.rolling_shutter_s) + static_cast<double>(camera.exposure_s);
    require(camera.capture_mode == CaptureMode::on_demand || takes_s <= between_s * (1 + 1e-6),
            "camera.rolling_shutter_s + exposure_s", "at most the time between images, " + std::to_string(between_s) + " s",
            takes_s);
    const long long pixels = static_cast<long long>(num_drones()) * camera.width_px * camera.height_px;
    require(pixels <= (1LL << 32), "num_drones x camera pixels", "at most 4294967296 pixels", pixels);
  }
}

}  // namespace flockstep
