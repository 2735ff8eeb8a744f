// BatchConfig: everything a batch is made of except its worlds, drone and task.
// Configs are plain structs, valid by default, validated once where they enter. Names carry their unit or kind.
// validate() throws std::invalid_argument naming the field, what was expected and what came.
#pragma once

#include <optional>
#include <vector>

#include "flockstep/camera.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/imu.hpp"
#include "flockstep/lidar.hpp"
#include "flockstep/pose_sensor.hpp"

namespace flockstep {

// How rays of cameras and LiDARs meet what is in a world. In tiles, rays that lie close go through a tree of triangles together.
// Fans, sparse patterns, raycast() and rays of shadows always go through Embree in packets.
enum class TracerKind : std::uint8_t {
  automatic,  // tiles where they are faster, which the number of rays and that of the triangles decide; nothing is timed
  tiles,      // tiles wherever they are possible
  embree,     // all by Embree, primitives too: to compare with
};
template <>
struct EnumNames<TracerKind> {
  static constexpr std::array kNames{"auto", "tiles", "embree"};
};

struct BatchConfig {
  int num_envs = 1;                   // E; E x M in [1, 1 << 20]
  int drones_per_env = 1;             // M; the drones of an env are in one world and do not sense or touch each other
  int num_threads = 0;                // 0: physical cores in the affinity mask
  int block_size = 0;                 // envs a thread takes at once; 0: a good number; no result depends on it
  std::vector<LidarConfig> lidars;    // of different names, as are the next two
  std::vector<CameraConfig> cameras;  // of different names; at most 2^32 pixels each, of all drones
  CameraBackend camera_backend = CameraBackend::raycast;
  TracerKind tracer = TracerKind::automatic;
  PoseSensorConfig pose_sensor;
  std::vector<ImuConfig> imus;
  EpisodeConfig episode;
  ClockConfig clock;
  DynamicsConfig dynamics;

  static constexpr auto fields() {
    using C = BatchConfig;
    return field_list(field("num_envs", &C::num_envs), field("drones_per_env", &C::drones_per_env),
                      field("num_threads", &C::num_threads, Decides::nothing),
                      field("block_size", &C::block_size, Decides::nothing), field("lidars", &C::lidars),
                      field("cameras", &C::cameras), field("camera_backend", &C::camera_backend, Decides::nothing),
                      field("tracer", &C::tracer), field("pose_sensor", &C::pose_sensor), field("imus", &C::imus),
                      field("episode", &C::episode), field("clock", &C::clock), field("dynamics", &C::dynamics));
  }

  int num_drones() const { return num_envs * drones_per_env; }  // N

  void validate() const;
};

}  // namespace flockstep
