// BatchConfig: the configuration of a batch, except its worlds, drone and task.
// Configs are plain structs with valid defaults, validated once on entry. Field names carry their unit or kind. validate()
// throws std::invalid_argument naming the field, the expected value and the actual one.
#pragma once

#include <memory>
#include <string>
#include <vector>

#include "flockstep/body.hpp"
#include "flockstep/drones/variation.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/interaction.hpp"
#include "flockstep/light.hpp"
#include "flockstep/sensors/barometer.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/sensors/gps_receiver.hpp"
#include "flockstep/sensors/imu.hpp"
#include "flockstep/sensors/lidar.hpp"
#include "flockstep/sensors/magnetometer.hpp"
#include "flockstep/sensors/observation.hpp"
#include "flockstep/sensors/optical_flow.hpp"
#include "flockstep/sensors/pose_sensor.hpp"

namespace flockstep {

// Method that finds the objects hit by rays of cameras and LiDARs.
enum class TracerKind : std::uint8_t { automatic, tiles, slices, embree };
template <>
struct EnumNames<TracerKind> {
  static constexpr std::array kNames{"auto", "tiles", "slices", "embree"};
};

struct BatchConfig {
  int num_envs = 1;
  int drones_per_env = 1;
  Interaction interaction = Interaction::none;
  std::shared_ptr<const World> drone_mesh;
  int num_threads = 0;
  int block_size = 0;
  std::vector<LidarConfig> lidars;
  std::vector<CameraConfig> cameras;
  CameraBackend camera_backend = CameraBackend::raycast;
  TracerKind tracer = TracerKind::automatic;
  PoseSensorConfig pose_sensor;
  std::vector<ImuConfig> imus;
  std::vector<BarometerConfig> barometers;
  std::vector<MagnetometerConfig> magnetometers;
  std::vector<GpsReceiverConfig> gps_receivers;
  std::vector<OpticalFlowConfig> optical_flows;
  std::vector<BodyConfig> bodies;
  int max_bodies = 0;
  std::vector<Light> lights;
  EpisodeConfig episode;
  ObservationConfig observed;
  ClockConfig clock;
  DynamicsConfig dynamics;
  std::vector<Variation> variations;
  std::vector<std::string> airframes;
  std::vector<std::string> privileged;

  static constexpr int kMaxDrones = 1 << 20;           // total over all envs
  static constexpr std::size_t kMaxLights = 4096;      // length of `lights`
  static constexpr std::size_t kMaxAirframes = 65536;  // length of `airframes`

  static constexpr auto fields() {
    using C = BatchConfig;
    return field_list(
        field("num_envs", &C::num_envs,
              {.about = "Number of envs, E, with at most 1048576 drones in all. Without a task it may be 0: every drone that the "
                        "batch spawns then has its own env.",
               .limits = between(0, kMaxDrones)}),
        field("drones_per_env", &C::drones_per_env,
              {.about = "Number of drones in each env, M, which share a world. Without a task it may be 0.",
               .limits = between(0, kMaxDrones)}),
        field("interaction", &C::interaction,
              {.about = "How the drones of an env interact. ``\"none\"``: not at all. ``\"sense\"``: LiDARs detect the others' "
                        "hulls, cameras see their meshes. ``\"collide\"``: their hulls collide. ``\"both\"``: both. Unless "
                        "``\"none\"``, an env has at most 4096 drones."}),
        field("drone_mesh", &C::drone_mesh,
              {.about = "World whose triangles show the drones to other drones' cameras, like the mesh of a `BodyConfig`. Needs "
                        "``interaction`` ``\"sense\"`` or ``\"both\"``. None: "
                        "their hull, in grey."}),
        field("num_threads", &C::num_threads,
              {.about = "Number of threads. More than four per CPU give a warning. 0: the physical cores that this "
                        "process may use. No result depends on it.",
               .limits = between(0, 4096),
               .affects_hash = AffectsHash::no}),
        field("block_size", &C::block_size,
              {.about = "Envs that a thread takes at once. 0: the engine chooses. No result depends on it.",
               .limits = at_least(0),
               .affects_hash = AffectsHash::no}),
        field("lidars", &C::lidars, {.about = "The LiDARs of each drone."}),
        field("cameras", &C::cameras,
              {.about = "The cameras of each drone. One camera has at most 2^32 pixels over all drones."}),
        field("camera_backend", &C::camera_backend,
              {.about = "Renderer of cameras. ``\"raycast\"``: the engine's own tracing, without a GPU, bit-identical for any "
                        "number of threads. ``\"gl\"``: OpenGL 4.5 through EGL, without shadows and fog. If it is missing, "
                        "raycast with a warning. ``\"auto\"``: raycast.",
               .affects_hash = AffectsHash::no}),
        field("tracer", &C::tracer,
              {.about = "Method that traces rays against triangles. ``\"auto\"``: the fastest for each sensor. ``\"slices\"``, "
                        "``\"tiles\"``, ``\"embree\"``: for comparison."}),
        field("pose_sensor", &C::pose_sensor, {.about = "The pose sensor of each drone."}),
        field("imus", &C::imus, {.about = "The IMUs of each drone."}),
        field("barometers", &C::barometers, {.about = "The barometers of each drone."}),
        field("magnetometers", &C::magnetometers, {.about = "The magnetometers of each drone."}),
        field("gps_receivers", &C::gps_receivers, {.about = "The GPS receivers of each drone."}),
        field("optical_flows", &C::optical_flows, {.about = "The optical flow sensors of each drone."}),
        field("bodies", &C::bodies, {.about = "Bodies in every env at an episode's beginning, after those of its world."}),
        field("max_bodies", &C::max_bodies,
              {.about = "Slots for bodies in each env, B. Free ones are for ``batch.bodies.spawn()``. 0: as many as an episode "
                        "may begin with.",
               .limits = between(0, kMaxBodies)}),
        field("lights", &C::lights,
              {.about = "At most 4096 lights, of which each episode of an env draws one. Empty: the lights of the worlds."}),
        field("episode", &C::episode, {.about = "Begin and end of episodes."}),
        field("observed", &C::observed, {.about = "History, past actions and delay of what a task observes."}),
        field("clock", &C::clock, {.about = "Rates of policy, controller and physics."}),
        field("dynamics", &C::dynamics, {.about = "Motion model of the drones."}),
        field("variations", &C::variations,
              {.about = "What differs from drone to drone, and how it is drawn. Needs ``motion=\"rotors\"``. `flockstep.vary` "
                        "makes the list."}),
        field("airframes", &C::airframes,
              {.about = "Drones from whose airframes each episode draws one, instead of the one of ``drone``: names, files, or "
                        "``\"random/seed-7\"``. Hull and sensors stay those of ``drone``."}),
        field("privileged", &C::privileged,
              {.about = "Parameters of the drone, minus their defaults, at the end of a task's observation: names of fields of "
                        "`DroneParameters`, or of elements. They need ``variations``. Keep them from the policy by "
                        "``critic_only`` of `flockstep.PPO`."}));
  }

  int num_drones() const { return num_envs * drones_per_env; }  // N

  FLOCKSTEP_API void validate() const;
};

}  // namespace flockstep
