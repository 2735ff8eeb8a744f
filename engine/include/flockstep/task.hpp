// Task: turns actions into setpoints, and state and sensor readings into rewards, episode ends and observations.
//
// A task declares its action, its observations and its reward terms once, in its TaskSpec. Spaces, checks and documents are
// made from the TaskSpec. The task runs inside the batch's step; each thread handles one block of envs at a time. Your own task
// needs only these headers; tests/tasks/reach_height.cpp is a complete example.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <typeinfo>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/buffer.hpp"
#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/sensors/camera.hpp"
#include "flockstep/sensors/lidar.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Action, observations and reward terms of a task.
struct TaskSpec {
  // Integer type: a scalar, one of low, low + 1, ..., high. Floating-point type: any finite numbers; the task clips values to
  // [low, high].
  Field action;
  std::vector<Field> observation;         // one field is the observation itself; several form a dict
  std::vector<std::string> reward_terms;  // names of the terms; their sum is the reward
  Row row = Row::drone;                   // actions, observations and rewards have one row per drone or one per env
  bool records_path = false;              // the task reads TaskContext::path_of()

  static constexpr auto fields() {
    using C = TaskSpec;
    return field_list(field("action", &C::action), field("observation", &C::observation), field("reward_terms", &C::reward_terms),
                      field("row", &C::row), field("records_path", &C::records_path));
  }
};

// Defaults of an environment with this task, for values that the caller does not give.
struct TaskDefaults {
  std::string worlds = "train";  // a set of scenes, or a single scene
  int max_episode_steps = 3000;  // 0: no limit
  std::string drone;             // a bundled airframe; empty: DroneModel::quadrotor650()
  BatchConfig batch;             // sensors, dynamics, rates and the rest
};

// Access of a task to the batch. Only place(), place_body() and remove_body() write. Indices are not checked.
class TaskContext {
 public:
  // Made by the batch.
  TaskContext(std::size_t num_envs, std::size_t drones_per_env) : num_envs_(num_envs), drones_per_env_(drones_per_env) {}
  virtual ~TaskContext() = default;

  std::size_t num_envs() const { return num_envs_; }                      // E
  std::size_t drones_per_env() const { return drones_per_env_; }          // M
  std::size_t num_drones() const { return num_envs_ * drones_per_env_; }  // N
  EnvIndex env_of(DroneIndex drone) const {                               // drone d belongs to env d / M
    return EnvIndex(drones_per_env_ == 1 ? std::size_t{drone} : drone / drones_per_env_);
  }
  virtual std::size_t num_threads() const = 0;                               // threads that may call the task at once
  virtual const State& state() const = 0;                                    // poses, contacts and clocks
  virtual const EpisodeState& episodes() const = 0;                          // counters of the current episodes
  virtual const DroneModel& drone_model() const = 0;                         // body and flight model
  virtual std::span<const std::shared_ptr<const World>> worlds() const = 0;  // by state().world_index; empty with a WorldPool
  virtual const World& world_of(EnvIndex env) const = 0;                     // the world of an env

  // Sensors: configurations, and the latest readings of all drones. All arrays are empty for a sensor that the batch does not
  // have.
  virtual const std::vector<LidarConfig>& lidars() const = 0;
  virtual const std::vector<CameraConfig>& cameras() const = 0;                  // by index
  virtual const PoseReadings& pose_readings() const = 0;                         // the pose sensor's
  virtual const LidarReadings& lidar_readings(std::size_t lidar = 0) const = 0;  // by index
  virtual const CameraImages& images(std::size_t camera) const = 0;              // by index
  // Readings of the other sensors by their type, such as ImuReadings, and their index in the batch's list.
  template <HasFields Arrays>
  const Arrays& readings(std::size_t index = 0) const {
    return or_empty<Arrays>(find_readings(typeid(Arrays), index));
  }
  virtual const void* find_readings(const std::type_info& type, std::size_t index) const = 0;  // null if there are none
  // Returns the pose of a drone as the pose sensor read it last.
  Pose sensed_pose(DroneIndex drone) const {
    const PoseReadings& readings = pose_readings();
    const float* const p = readings.position.data() + 3 * drone;
    const float* const q = readings.quat_wxyz.data() + 4 * drone;
    return {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
  }

  // Velocities of all drones, (N, 3) m/s, world frame, as the pose sensor read them last, or exact if it does not measure them.
  // Empty with kinematic motion.
  const std::vector<float>& sensed_velocity() const {
    const std::vector<float>& sensed = pose_readings().velocity;
    return sensed.empty() ? state().flight.velocity : sensed;
  }

  // Returns a uniform number in [0, 1), keyed by the env's seed and episode, the stream and the index. Streams are below 2^31;
  // use a separate stream for each purpose. The key of a drone also contains its number in the env. The first drone of an env
  // draws the same numbers as its env.
  virtual float random(EnvIndex env, std::uint32_t stream, std::uint32_t index) const = 0;
  virtual float random(DroneIndex drone, std::uint32_t stream, std::uint32_t index) const = 0;
  // Returns true if the drone would touch nothing at this pose: neither the world nor a body, nor, if drones of an env touch each
  // other, another drone. In place(), drones that begin an episode and have not been placed yet do not count.
  virtual bool is_free(DroneIndex drone, const Pose& pose) const = 0;

  // Motion model of the drones, and meaning of Setpoints.
  virtual const DynamicsConfig& dynamics() const = 0;
  virtual const ClockConfig& clock() const = 0;  // rates
  // The airframes of the drones: one unless BatchConfig::airframes has several, none in kinematic motion.
  virtual std::span<const Airframe> airframes() const = 0;
  std::size_t num_rotors() const { return most_rotors(airframes()); }  // columns of FlightState::rotor_speed
  // Numbers of a drone's command, C: one for each rotor, or else 4.
  std::size_t command_size() const { return dynamics().tells_rotors() ? num_rotors() : 4; }
  // The row of a drone's airframe, from which its own parameters may differ; see DroneParameters.
  virtual std::size_t airframe_row(DroneIndex drone) const = 0;

  // Puts a drone at a pose, without a collision check. Call it in Task::place(). A pose that is not in the world is a bad
  // state; see Outputs::bad_state. In rotor motion the drone starts with this velocity and with its rotors at hover speed.
  virtual void place(DroneIndex drone, const Pose& pose, const Velocity& velocity = {}) = 0;

  // Number of slots for bodies in each env, B. state().bodies has their arrays, with row env B + body.
  virtual std::size_t bodies_per_env() const = 0;
  // Puts a body at a pose; from there it moves with this velocity until the next episode. The body must be active, and pose and
  // velocity finite: otherwise nothing changes. Call it in place(), begin() or command().
  virtual void place_body(EnvIndex env, std::size_t body, const Pose& pose, const Velocity& velocity = {}) = 0;
  // Removes a body until the next episode. Call it in place(), begin() or command().
  virtual void remove_body(EnvIndex env, std::size_t body) = 0;

  // Positions of a drone before the control step and after each of its ticks, (ticks + 1, 3) m, world frame. Between them the
  // drone moves almost straight. Empty unless TaskSpec::records_path is set. Read it in Task::score().
  virtual std::span<const float> path_of(DroneIndex drone) const = 0;

 private:
  std::size_t num_envs_, drones_per_env_;
};

// The envs of one call. At the same time, other threads may handle other envs.
struct TaskBlock {
  TaskContext& context;                // access to the batch
  std::span<const EnvIndex> envs;      // the envs
  std::span<const DroneIndex> drones;  // the drones of these envs that the call is for
  std::size_t thread;                  // in [0, num_threads()), index for per-thread data
};

// Setpoints of the drones for the current step. A drone flies to its target pose in a straight line and turns at a constant
// rate, the shorter way round. For exactly half a turn, both ways are equally short: the drone turns by the right-hand rule
// about the vector part of conjugate(from) * to, so a target quaternion of the opposite sign turns it the other way. If the
// direction matters, turn in two steps.
struct Setpoints {
  std::vector<Pose> target;  // (N,), used with Control::pose
  std::vector<float>
      command;  // (N, C), used with every other Control, which gives the meaning of the numbers; see command_size()
};

// Score of one control step. R rows are N or E, depending on TaskSpec::row. If the episode of one row ends,
// EpisodeConfig::episodes decides about the other rows of its env.
struct Score {
  std::size_t num_terms;      // terms of the reward
  std::vector<double> terms;  // (R, num_terms), each multiplied by its weight
  FlagArray terminated;       // (R,) the episode ends in this state
  FlagArray truncated;        // (R,) the episode is cut off, except by the time limit; 0 unless the task writes it
  FlagArray success;          // (R,) the episode counts as a success if it ends here
  FlagArray left_area;        // (R,) the episode ends because a drone left the task's area; 0 unless the task writes it

  // Returns the terms of one row. The index is not checked.
  std::span<double> terms_of(std::size_t row) { return {terms.data() + row * num_terms, num_terms}; }
};

class Task {
 public:
  virtual ~Task() = default;

  virtual const TaskSpec& spec() const = 0;             // action, observations and reward terms
  virtual TaskDefaults defaults() const { return {}; }  // for values that the caller does not give
  // Returns name and configuration. A snapshot is restored only into a task of equal identity.
  virtual std::string identity() const = 0;

  // Called once, before any call with envs. Allocate the task's arrays here, and throw std::invalid_argument if the task does
  // not support the batch. defaults() may be called earlier, on another object. spec() may change in this call and must stay
  // constant afterwards.
  virtual void setup(const TaskContext& context) = 0;
  // Throws std::invalid_argument if episodes cannot be flown in a world. Called after setup() for each world; with a WorldPool,
  // called before an episode is flown in a world.
  virtual void require_world(const World& world, const DroneModel& drone) const {
    static_cast<void>(world);
    static_cast<void>(drone);
  }
  // Places the drones at the beginning of an episode. By default they are level, facing +x, at the start marker of their world,
  // or at the centre of its bounds if it has none.
  virtual void place(const TaskBlock& block) {
    for (const DroneIndex drone : block.drones) {
      const Vec3 start = block.context.world_of(block.context.env_of(drone)).drone_start();
      block.context.place(drone, {start, Quat::Identity()});
    }
  }
  // Begins the task's part of an episode. The drones are already placed; the sensors are read afterwards.
  virtual void begin(const TaskBlock& block) = 0;
  // Turns actions into setpoints. The actions have one row per drone or env, in the form of spec().action.
  virtual void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) = 0;
  // Scores the step that was just flown and sensed. Write every row of the block's drones (or envs); only `truncated` and
  // `left_area` may be skipped.
  virtual void score(const TaskBlock& block, Score& score) = 0;
  // Writes the block's rows of each field of spec().observation, in the order of the fields.
  virtual void observe(const TaskBlock& block, std::span<Buffer> observation) = 0;
  // Passes every array that the next step depends on to the visitor. The sizes must be those that setup() made.
  virtual void visit(ArrayVisitor& visitor) = 0;
  // Called after all arrays have been restored.
  virtual void restored() {}
  // Throws std::invalid_argument if the restored arrays hold values that setup() and the other calls cannot produce. The
  // restore is then undone.
  virtual void check() const {}

  // Returns true if the observation uses this camera's images. Such a camera cannot be set to on_demand.
  virtual bool observes_camera(std::size_t camera) const {
    static_cast<void>(camera);
    return false;
  }
  // Returns true if command() supports this control; others are refused. By default only Control::pose is supported.
  virtual bool takes(Control control) const { return control == Control::pose; }
  // If true, place, begin, command, score and observe are called once with all envs, on the thread that called step(), instead
  // of once per block.
  virtual bool takes_all_envs_at_once() const { return false; }
};

// Version of the binary interface between a task library and the engine. Increase it if a change to a header that this file
// includes changes a layout, a virtual function or the meaning of a value; tests/python/project/test_compatibility.py notices
// changes.
#define FLOCKSTEP_TASK_FORMAT 12

// Version string on which a task library and the engine that loads it must agree: the interface and the layout of Eigen's types,
// which options such as -march=native change.
#define FLOCKSTEP_TEXT_OF(value) #value
#define FLOCKSTEP_TEXT(value) FLOCKSTEP_TEXT_OF(value)
#define FLOCKSTEP_TASK_VERSION \
  "task format " FLOCKSTEP_TEXT(FLOCKSTEP_TASK_FORMAT) ", Eigen alignment " FLOCKSTEP_TEXT(EIGEN_MAX_STATIC_ALIGN_BYTES)

#if defined(_WIN32)
#define FLOCKSTEP_EXPORT extern "C" __declspec(dllexport)
#else
#define FLOCKSTEP_EXPORT extern "C" __attribute__((visibility("default")))
#endif

// Exports a task from a shared library. Put it at the end of the task's source file, outside any namespace. It exports a
// function that makes the task with its default constructor, and the version string of the build.
#define FLOCKSTEP_EXPORT_TASK(Class)                                             \
  FLOCKSTEP_EXPORT const char flockstep_task_version[] = FLOCKSTEP_TASK_VERSION; \
  FLOCKSTEP_EXPORT flockstep::Task* flockstep_make_task() { return new Class; }

}  // namespace flockstep
