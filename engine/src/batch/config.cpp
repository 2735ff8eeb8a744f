#include "flockstep/config.hpp"

#include <algorithm>
#include <string>

#include "base/require.hpp"
#include "sensors/rate.hpp"

namespace flockstep {

void EpisodeConfig::validate() const {
  require(!max_episode_steps || *max_episode_steps >= 0, "max_episode_steps", "an integer >= 0", max_episode_steps.value_or(0));
  require(frame_skip >= 1 && frame_skip <= 1000, "frame_skip", "an integer in [1, 1000]", frame_skip);
  require(!stagger_first_episode || max_episode_steps != 0, "stagger_first_episode",
          "False where max_episode_steps is 0 (there is no limit to stagger)", "True");
}

void ClockConfig::validate() const {
  require(dt_s >= 1e-5F && dt_s <= 10.0F, "dt_s", "a number in [1e-05, 10]", dt_s);
  require(substeps >= 1 && substeps <= 1000, "substeps", "an integer in [1, 1000]", substeps);
}

void BatchConfig::validate() const {
  require(num_envs >= 1 && num_envs <= (1 << 20), "num_drones = num_envs x drones_per_env", "an integer in [1, 1048576]",
          num_envs);
  require(drones_per_env == 1, "drones_per_env", "1 (envs of several drones are not there yet)", drones_per_env);
  require(num_threads >= 0 && num_threads <= 4096, "num_threads", "an integer in [0, 4096]", num_threads);
  require(block_size >= 1, "block_size", "an integer >= 1", block_size);
  episode.validate();
  clock.validate();
  if (lidar) {
    lidar->validate();
    sensors::period_in_ticks(lidar->rate_hz, clock, "lidar.rate_hz");
    const long long rays = static_cast<long long>(num_drones()) * lidar->rows() * lidar->columns();
    require(rays <= (1LL << 31), "num_drones x lidar rays", "at most 2147483648 rays", rays);
  }
  for (std::size_t i = 0; i < cameras.size(); ++i) {
    const CameraConfig& camera = cameras[i];
    camera.validate();
    sensors::period_in_ticks(camera.rate_hz, clock, "camera.rate_hz");
    const auto same = [&](const CameraConfig& other) { return other.name == camera.name; };
    require(std::none_of(cameras.begin(), cameras.begin() + static_cast<std::ptrdiff_t>(i), same), "camera.name",
            "a name that no other camera has", '"' + camera.name + '"');
    const long long pixels = static_cast<long long>(num_drones()) * camera.width_px * camera.height_px;
    require(pixels <= (1LL << 32), "num_drones x camera pixels", "at most 4294967296 pixels", pixels);
  }
  pose_sensor.validate();
  sensors::period_in_ticks(pose_sensor.rate_hz, clock, "pose_sensor.rate_hz");
}

}  // namespace flockstep
