// Task: what turns actions into setpoints, and state and sensors into rewards, ends of episodes and observations.
//
// A task declares its action, its observations and the terms of its reward once, in its TaskSpec; spaces, checks and documents
// are made from that. It runs inside the batch's step, a block of envs on each thread. These headers are all that a task of
// your own needs: tests/tasks/reach_height.cpp is a whole one.
#pragma once

#include <cstddef>
#include <cstdint>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "flockstep/array_visitor.hpp"
#include "flockstep/buffer.hpp"
#include "flockstep/camera.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/dynamics.hpp"
#include "flockstep/episode.hpp"
#include "flockstep/index.hpp"
#include "flockstep/lidar.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/version.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

struct TaskSpec {
  // Of an integer type, a scalar: one of low, low + 1, ..., high. Of a floating-point type: any finite numbers; values
  // outside [low, high] are clipped by the task.
  Field action;
  std::vector<Field> observation;         // one field is the observation itself; several form a dict
  std::vector<std::string> reward_terms;  // their sum is the reward
  Row row = Row::drone;                   // of actions, observations and rewards: one for each drone, or one for each env

  static constexpr auto fields() {
    using C = TaskSpec;
    return field_list(field("action", &C::action), field("observation", &C::observation), field("reward_terms", &C::reward_terms),
                      field("row", &C::row));
  }
};

// Defaults for an environment with this task, where the caller gives no value.
struct TaskDefaults {
  std::string worlds = "train";  // a set of scenes, or one
  std::vector<LidarConfig> lidars;
  std::vector<CameraConfig> cameras;
  int max_episode_steps = 3000;  // 0: no limit
  std::string drone;             // a bundled airframe; empty: DroneModel::quadrotor650()
  DynamicsConfig dynamics;
  ClockConfig clock;
};

// The batch as a task sees it. Everything but place() only reads. Indices are not checked.
class TaskContext {
 public:
  TaskContext(std::size_t num_envs, std::size_t drones_per_env) : num_envs_(num_envs), drones_per_env_(drones_per_env) {}
  virtual ~TaskContext() = default;

  std::size_t num_envs() const { return num_envs_; }                      // E
  std::size_t drones_per_env() const { return drones_per_env_; }          // M
  std::size_t num_drones() const { return num_envs_ * drones_per_env_; }  // N
  EnvIndex env_of(DroneIndex drone) const {                               // drone d belongs to env d / M
    return EnvIndex(drones_per_env_ == 1 ? std::size_t{drone} : drone / drones_per_env_);
  }
  virtual std::size_t num_threads() const = 0;
  virtual const State& state() const = 0;
  virtual const EpisodeState& episodes() const = 0;
  virtual const DroneModel& drone_model() const = 0;
  virtual std::span<const std::shared_ptr<const World>> worlds() const = 0;  // by state().world_index; empty with a WorldPool
  virtual const World& world_of(EnvIndex env) const = 0;

  // Sensors: their configurations, and what all drones read last. All arrays are empty for a sensor that the batch does not have.
  virtual const std::vector<LidarConfig>& lidars() const = 0;
  virtual const std::vector<CameraConfig>& cameras() const = 0;
  virtual const PoseReadings& pose_readings() const = 0;
  virtual const ImuReadings& imu_readings(std::size_t imu = 0) const = 0;
  virtual const LidarReadings& lidar_readings(std::size_t lidar = 0) const = 0;
  virtual const CameraImages& images(std::size_t camera) const = 0;
  Pose sensed_pose(DroneIndex drone) const {
    const PoseReadings& readings = pose_readings();
    const float* const p = readings.position.data() + 3 * drone;
    const float* const q = readings.quat_wxyz.data() + 4 * drone;
    return {Vec3(p[0], p[1], p[2]), Quat(q[0], q[1], q[2], q[3])};
  }

  // A uniform number in [0, 1), keyed by the env's seed and episode, the stream (below 2^31, one for each purpose) and index; for
  // a drone also by its number in the env. The first drone of an env draws the same numbers as its env.
  virtual float random(EnvIndex env, std::uint32_t stream, std::uint32_t index) const = 0;
  virtual float random(DroneIndex drone, std::uint32_t stream, std::uint32_t index) const = 0;
  // Whether a drone of the env at this pose would touch nothing.
  virtual bool is_free(EnvIndex env, const Pose& pose) const = 0;

  // How drones move, and what Setpoints tell them.
  virtual const DynamicsConfig& dynamics() const = 0;
  virtual const ClockConfig& clock() const = 0;

  // Puts a drone somewhere, without a collision check: in Task::place(). What is no pose in the world is a bad state; see
  // Outputs::bad_state. Drones that fly by rotors begin with this velocity, and rotors at the speed of hovering.
  virtual void place(DroneIndex drone, const Pose& pose, const Velocity& velocity = {}) = 0;

 private:
  std::size_t num_envs_, drones_per_env_;
};

// The envs that a call is about. Other calls may be about other envs at the same time, on other threads.
struct TaskBlock {
  TaskContext& context;
  std::span<const EnvIndex> envs;
  std::span<const DroneIndex> drones;  // the active drones of these envs, env by env
  std::size_t thread;                  // in [0, num_threads()): the index for per-thread data
};

// Where each drone is to fly in the present step, in a straight line and turning evenly, the shorter way round. Of exactly half a
// turn both ways are as short: it turns by the right hand about the vector part of conjugate(from) * to, so that a target of the
// opposite sign turns the other way. Where the way matters, turn in two steps.
struct Setpoints {
  std::vector<Pose> target;    // (N,), where Control::pose tells the drones
  std::vector<float> command;  // (N, 4), where another Control does: what its four numbers mean
};

// What one flown step earned. R rows are N or E, as TaskSpec::row says. All drones of an env begin and end their episodes
// together: when the episode of one row ends, those of the env's other rows are truncated.
struct Score {
  std::size_t num_terms;
  std::vector<double> terms;  // (R, num_terms), each times its weight
  FlagArray terminated;       // (R,) the episode ends here
  FlagArray truncated;        // (R,) it is cut off here, for another reason than the time limit; 0 unless the task writes it
  FlagArray success;          // (R,) the episode counts as a success if it ends here
  FlagArray left_area;        // (R,) it ends here because a drone left the area the task allows; 0 unless the task writes it

  std::span<double> terms_of(std::size_t row) { return {terms.data() + row * num_terms, num_terms}; }
};

class Task {
 public:
  virtual ~Task() = default;

  virtual const TaskSpec& spec() const = 0;
  virtual TaskDefaults defaults() const { return {}; }
  // Name and configuration: snapshots are restored between tasks of equal identity alone.
  virtual std::string identity() const = 0;

  // Called once, before any call about envs: allocate the task's own arrays, and refuse what the task cannot work with, by
  // std::invalid_argument. defaults() may be called earlier, on another object. spec() may change here, and stays from then on.
  virtual void setup(const TaskContext& context) = 0;
  // Refuse, by std::invalid_argument, a world that episodes cannot be flown in. Called after setup(), for each world; with a
  // WorldPool before an episode is flown in one.
  virtual void require_world(const World& world, const DroneModel& drone) const {
    static_cast<void>(world);
    static_cast<void>(drone);
  }
  // Put the drones where an episode begins. By default: level, facing +x, at the start marker of their world, or
  // at the centre of its bounds if it has none.
  virtual void place(const TaskBlock& block) {
    for (const DroneIndex drone : block.drones) {
      const World& world = block.context.world_of(block.context.env_of(drone));
      const Vec3 start = world.markers().start.value_or((world.bounds().min + world.bounds().max) / 2.0F);
      block.context.place(drone, {start, Quat::Identity()});
    }
  }
  // Begin the task's own part of an episode, from where the drones are. Sensors read afterwards.
  virtual void begin(const TaskBlock& block) = 0;
  // Turn actions, rows as spec().action says, into setpoints.
  virtual void command(const TaskBlock& block, const Buffer& actions, Setpoints& setpoints) = 0;
  // Score what has just been flown and sensed. Every row of the block's drones (or envs) has to be written, except `truncated`
  // and `left_area`.
  virtual void score(const TaskBlock& block, Score& score) = 0;
  // Write the block's rows of each field of spec().observation, in their order.
  virtual void observe(const TaskBlock& block, std::span<Buffer> observation) = 0;
  // Show every array that the next step depends on. The sizes are those that setup() has made.
  virtual void visit(ArrayVisitor& visitor) = 0;
  // All arrays have been restored.
  virtual void restored() {}
  // Refuse, by std::invalid_argument, arrays that setup() and the other calls could not have left; a restore is undone then.
  virtual void check() const {}

  // Whether the observation is made of this camera's images, so that it may not stop taking them.
  virtual bool observes_camera(std::size_t camera) const {
    static_cast<void>(camera);
    return false;
  }
  // Whether command() can tell drones by this control; others are refused. By poses, unless it says more.
  virtual bool takes(Control control) const { return control == Control::pose; }
  // True: place, begin, command, score and observe are called once for all envs they are about, on the thread that called step(),
  // instead of block by block.
  virtual bool takes_all_envs_at_once() const { return false; }
};

// What a library with a task and the engine that loads it must agree on: the version of these headers, and how Eigen's types are
// laid out, which options such as -march=native change.
#define FLOCKSTEP_TEXT_OF(value) #value
#define FLOCKSTEP_TEXT(value) FLOCKSTEP_TEXT_OF(value)
#define FLOCKSTEP_TASK_VERSION \
  "flockstep " FLOCKSTEP_VERSION ", Eigen aligned to " FLOCKSTEP_TEXT(EIGEN_MAX_STATIC_ALIGN_BYTES) " bytes"

#if defined(_WIN32)
#define FLOCKSTEP_EXPORT extern "C" __declspec(dllexport)
#else
#define FLOCKSTEP_EXPORT extern "C" __attribute__((visibility("default")))
#endif

// Ends the file of a task that is a shared library, outside of any namespace: exports a function that makes the task by its
// constructor without arguments, and what it was built for.
#define FLOCKSTEP_EXPORT_TASK(Class)                                             \
  FLOCKSTEP_EXPORT const char flockstep_task_version[] = FLOCKSTEP_TASK_VERSION; \
  FLOCKSTEP_EXPORT flockstep::Task* flockstep_make_task() { return new Class; }

}  // namespace flockstep
