// Batch: E envs over W worlds, stepped together.
#pragma once

#include <cstdint>
#include <functional>
#include <memory>
#include <optional>
#include <span>
#include <string>
#include <string_view>
#include <typeinfo>
#include <vector>

#include "flockstep/aligned.hpp"
#include "flockstep/buffer.hpp"
#include "flockstep/config.hpp"
#include "flockstep/drone_model.hpp"
#include "flockstep/export.hpp"
#include "flockstep/move_line.hpp"
#include "flockstep/pilot.hpp"
#include "flockstep/sensors/readings.hpp"
#include "flockstep/state.hpp"
#include "flockstep/task.hpp"
#include "flockstep/world.hpp"
#include "flockstep/world_pool.hpp"

namespace flockstep {

// Results of a step or reset, each array aligned to a cache line. R rows are N or E, depending on TaskSpec::row. A batch
// alternates between two Outputs, so the results of one call stay intact during the next.
struct Outputs {
  std::vector<Buffer> observation;        // (R, ...) one buffer per field of TaskSpec::observation
  std::vector<Buffer> final_observation;  // (R, ...) same fields; valid if terminated or truncated
  AlignedVector<float> reward;
  AlignedVector<float> reward_terms;
  FlagArray terminated;
  FlagArray truncated;
  FlagArray success;
  FlagArray crashed;
  // The episode ended because a setpoint, pose, reward or observation was not finite, or because a pose was outside the world.
  // The drone stayed where it was; its reward and observation read 0. An infinity within the bounds of the observation's field
  // counts as finite.
  FlagArray bad_state;
  AlignedVector<std::uint8_t> episode_end;  // EpisodeEnd
  AlignedVector<double> episode_return;
  AlignedVector<double> episode_terms;
  AlignedVector<std::int64_t> episode_length;

  static constexpr auto fields() {
    using C = Outputs;
    constexpr auto flag = [](const char* about) {
      return ArrayInfo{.rows = Rows::task, .values = Values::flag, .writer = "the step", .about = about};
    };
    constexpr auto number = [](const char* about, Per per = Per::row, Access access = Access::read) {
      return ArrayInfo{
          .rows = Rows::task, .per = per, .values = Values::any, .access = access, .writer = "the step", .about = about};
    };
    return field_list(
        field("observation", &C::observation), field("final_observation", &C::final_observation),
        array("reward", &C::reward, number("reward of the last step", Per::row, Access::write)),
        array("reward_terms", &C::reward_terms,
              number("reward terms, in the order of the spec. Their sum is `reward`", Per::term)),
        array("terminated", &C::terminated,
              flag("True if the last step ended the episode in a terminal state, such as a crash or the goal")),
        array("truncated", &C::truncated, flag("True if the last step cut the episode off, for example at the time limit")),
        array("success", &C::success, flag("True if the last step ended the episode, and the task counts it as a success")),
        array("crashed", &C::crashed,
              flag("True if the last step ended the episode while a drone was in contact with something")),
        array("bad_state", &C::bad_state,
              flag("True if the last step ended the episode because a number was not finite or a pose was out of bounds")),
        array("episode_end", &C::episode_end, number("reason for the end of the episode, an `EpisodeEnd`, 0 until it ends")),
        array("episode_return", &C::episode_return,
              number("sum of the rewards of the current episode, or of the one that the last step ended")),
        array("episode_terms", &C::episode_terms,
              number("sum of each reward term, over the same episode as `episode_return`", Per::term)),
        array("episode_length", &C::episode_length,
              {.rows = Rows::task,
               .unit = "steps",
               .values = Values::count,
               .writer = "the step",
               .about = "steps flown, in the same episode as `episode_return`"}));
  }
};

class BatchLock;
class ServedBatch;
class CallLock;
struct Simulation;

inline constexpr std::size_t kFlownNumbers = 24;  // of a drone's state that a flight changes, see Batch::flown()

// Work that Embree's triangle trees did for LiDARs and cameras, shadows included.
struct EmbreeCounts {
  std::int64_t rays = 0;     // number of rays
  std::int64_t packets = 0;  // in which they were traced
};

// All methods check their input before they change anything. They throw std::invalid_argument naming the field, the expected
// value and the actual one. An empty mask selects every active drone or env; an env is active if one of its drones is.
// Lists of indices are int64, as in NumPy: an EnvIndex or DroneIndex is made of a number that has been checked.
// One thread at a time: a call while another thread is in one throws std::runtime_error, or waits if the batch is served: see
// ServedBatch. A batch does not survive fork(): using a parent's batch in the child throws std::runtime_error.
class FLOCKSTEP_API Batch {
 public:
  using Worlds = std::vector<std::shared_ptr<const World>>;  // the worlds of a batch, by index
  class Bodies;                                              // facets: they refer to the batch and must not outlive it
  class Lidar;
  class Camera;
  class MoveLines;

  // world_index: (E,), the world of each env; if empty, env i is in world i mod W. Drones start at the start marker of their
  // world, or at the centre of its bounds if it has none. Without a task, reset() and step() are not available; everything else
  // works.
  Batch(BatchConfig config, Worlds worlds, std::unique_ptr<Task> task = nullptr, DroneModel drone = DroneModel::quadrotor650(),
        std::span<const std::int32_t> world_index = {});
  // Takes the worlds from a pool. Resets draw from it, so a task is required. state().world_index holds the pool's world
  // numbers. All drones are in world 0 until their first reset. Cameras are rendered by raycast.
  Batch(BatchConfig config, WorldPool pool, std::unique_ptr<Task> task, DroneModel drone = DroneModel::quadrotor650());
  ~Batch();
  Batch(const Batch&) = delete;
  Batch& operator=(const Batch&) = delete;

  const BatchConfig& config() const;  // the constructor's, with the current sizes
  const Worlds& worlds() const;       // indexed by state().world_index; empty with a pool
  // The world of an env, in the light of the env; the index is not checked.
  std::shared_ptr<const World> world_of(EnvIndex env) const;
  // The same in its own light, without a copy of the pointer: valid until the env changes its world.
  const World& unlit_world_of(EnvIndex env) const;
  const DroneModel& drone() const;  // body and flight model of all drones
  // Columns of rotor speeds: 4, or the largest number of rotors of an airframe. A drone that has fewer reads 0 in the others and
  // ignores what is given for them.
  std::size_t num_rotors() const;
  std::size_t num_rotors(DroneIndex drone) const;  // of one drone; the index is not checked
  // Numbers of a drone's command: one for each rotor if the control tells rotors, otherwise 4. By default the batch's control.
  std::size_t command_size(std::optional<Control> control = {}) const;
  int num_threads() const;      // actual number, also if num_threads = 0
  EmbreeCounts embree() const;  // rays against triangles since the batch was made
  const State& state() const;   // poses, contacts and clocks; valid until the batch is destroyed or grows, see ServedBatch

  // --- motion and sensing; positions (N, 3) m, quaternions (N, 4) wxyz; an empty span leaves the value unchanged
  // Places drones without a collision check, at rest. Without quaternions, drones with rotors are level and face +x.
  void set_pose(std::span<const float> position, std::span<const float> quat_wxyz, DroneMask mask = {});
  // The same for some drones: their indices (K,), positions (K, 3), quaternions (K, 4).
  void set_pose(std::span<const std::int64_t> drones, std::span<const float> position, std::span<const float> quat_wxyz);
  void move(std::span<const float> position, std::span<const float> quat_wxyz,
            DroneMask mask = {});  // with collision check; sets state().contact
  // Rotor motion only: velocities (N, 3) in m/s, world frame; angular velocities (N, 3) in rad/s, body frame; rotor speeds (N,
  // num_rotors()) in rad/s. After set_pose() a drone is at rest with its rotors at hover speed.
  void set_velocity(std::span<const float> velocity, std::span<const float> angular_velocity, std::span<const float> rotor_speed,
                    DroneMask mask = {});
  // The same for some drones: their indices (K,), and K rows of each array.
  void set_velocity(std::span<const std::int64_t> drones, std::span<const float> velocity,
                    std::span<const float> angular_velocity, std::span<const float> rotor_speed);
  // Sets what differs from drone to drone: rows (N, kNumParameters) like state().parameters.params. They last
  // until the next draw, and only parameters in config().variations may be other than their defaults.
  void set_params(std::span<const float> params, DroneMask mask = {});
  // Replaces the laws of the variations for the next draws, which is how a curriculum makes them harder. The list has to be about
  // the same parameters as before, without longer delays.
  void set_variations(const std::vector<Variation>& variations);
  // Flies a command (N, command_size(control)) for a number of ticks in [0, 1000000]; 0 means one step. control: the meaning of
  // this command, by default config().dynamics.control; not Control::pose. Rotor motion only; use move() for kinematic motion.
  void fly(std::span<const float> command, int ticks = 0, DroneMask mask = {}, std::optional<Control> control = {});
  void require_command(std::span<const float> command, std::optional<Control> control = {}) const;  // as fly() checks it
  // Quadrotors only: what a flight changes, (N, kFlownNumbers): position, velocity, quaternion wxyz, angular velocity, integral
  // of the velocity error, rotor speeds, last commanded rotor speeds, in the units of state().
  void flown(std::span<float> out) const;
  // Puts drones whose row differs into this state, without a collision check.
  void set_flown(std::span<const float> rows);
  // Derivatives of a number by the state before fly(command) and by the command, from those by the state after it. All but the
  // command, (N, 4), are (N, kFlownNumbers). The equations of flight are differentiated at these states, over `ticks` long
  // midpoint ticks; wind, batteries and parameters are those of the moment, and contacts have no part. Rows of removed drones
  // are 0. Throws std::invalid_argument if the control, or a late command, has no derivative.
  void pullback(std::span<const float> before, std::span<const float> command, std::span<const float> d_after, int ticks,
                std::span<float> d_before, std::span<float> d_command) const;
  void sense(DroneMask mask = {});  // reads the sensors now; cameras as their capture mode requires

  // --- slots
  // Activates a slot for each row, where a new drone is placed as by set_pose() and senses; returns the slots. They are
  // `indices`, or else the lowest inactive ones of the envs in `env`, or else of the batch. Missing slots are added to a batch
  // without a task: an env for each if M = 1 and `env` is empty, or else slots to all envs, in which drones then have other
  // indices, d = e M + m.
  std::vector<std::int64_t> spawn(std::span<const std::int64_t> indices, std::span<const float> position,
                                  std::span<const float> quat_wxyz, std::span<const std::int32_t> world_index,
                                  std::span<const std::int64_t> env = {});
  void remove(std::span<const std::int64_t> indices);  // deactivates slots (K,), which then read as absent
  void set_world(std::span<const std::int32_t> world_index, EnvMask mask = {});  // (E,); refused with a pool
  // Replaces a world, by its index into worlds(), by a copy of it in another light, for all of its envs. Frames that show the
  // world become stale. Snapshots from before are refused by restore(), unless the same light is set again. Refused with a pool.
  void set_light(std::int64_t world_index, const Lighting& lighting);
  // Gives envs their own lights: one for each env (E,), or one for all that the mask selects. Their frames become stale. A light
  // stays until the next call, also in other worlds and episodes; with BatchConfig::lights, until the next episode draws one.
  void set_light(std::span<const Light> lights, EnvMask mask = {});
  void set_light(const Light& light, EnvMask mask = {}) { set_light(std::span(&light, 1), mask); }
  void use_world_light(EnvMask mask = {});  // the envs show the lights of their worlds again

  // Tests poses of drones: writes 1 to out (K,) if the drone would touch nothing there, neither its world nor a body. drones (K,)
  // are their indices; empty: all drones, K = N. position (K, 3) m; quat_wxyz (K, 4), or empty: level, facing +x.
  void is_free(std::span<const std::int64_t> drones, std::span<const float> position, std::span<const float> quat_wxyz,
               std::span<std::uint8_t> out) const;
  bool is_free(EnvIndex env, const Pose& pose) const;  // the same for a new drone of an env
  Bodies bodies();                                     // the moving objects
  const Bodies bodies() const;                         // the same, for reading

  // --- sensors, by their index in config() or by name. Without a name: the first one, or the only camera. Throws
  // std::invalid_argument for an unknown name; the calls of the facet check an index.
  const PoseReadings& pose_readings() const;         // empty arrays without a pose sensor
  Lidar lidar(std::size_t index = 0);                // by index
  Lidar lidar(std::string_view name);                // by name
  const Lidar lidar(std::size_t index = 0) const;    // for reading
  const Lidar lidar(std::string_view name) const;    // for reading
  Camera camera(std::size_t index);                  // by index
  Camera camera(std::string_view name);              // by name
  const Camera camera(std::size_t index) const;      // for reading
  const Camera camera(std::string_view name) const;  // for reading
  // The readings of another sensor, by their type, such as ImuReadings, and by the index into its list in config().
  template <HasFields Arrays>
  const Arrays& readings(std::size_t index = 0) const {
    return or_empty<Arrays>(find_readings(typeid(Arrays), index));
  }
  // Returns the arrays that the sensor of this name publishes. Its kind may precede the name, as in "imu.front". Throws
  // std::invalid_argument if there is none, or if sensors of two kinds have this name.
  std::vector<ArrayView> sensor_arrays(std::string_view name) const;
  const std::string& camera_backend_report() const;  // the backend in use and the reason for it
  std::string take_warning();                        // a warning not reported yet, e.g. that OpenGL failed; usually empty
  MoveLines move_lines();                            // the paths that drones draw
  const MoveLines move_lines() const;                // for reading

  // --- random numbers, keyed by (env seed, episode, stream); drawing does not change any state
  void seed(std::span<const std::uint64_t> seeds, EnvMask mask = {});        // (E,); sets the episode counters to 0
  void begin_episode(EnvMask mask = {});                                     // advances each masked env to its next episode
  void random(std::uint32_t stream, int count, std::span<float> out) const;  // (E, count), uniform in [0, 1)
  // The rows of some envs, (K, count).
  void random(std::uint32_t stream, int count, std::span<const std::int64_t> envs, std::span<float> out) const;
  // Rows of some drones, (K, count), keyed by the drone too. The first drone of an env has the numbers of its env, as long as it
  // begins no episode without the others.
  void random_of_drones(std::uint32_t stream, int count, std::span<const std::int64_t> drones, std::span<float> out) const;

  // --- the task; std::logic_error without one, or before the first reset
  const Task* task() const;                                             // null without one
  const TaskSpec& spec() const;                                         // of the task, with BatchConfig::observed
  void reset(std::span<const std::uint64_t> seeds, EnvMask mask = {});  // seeds (E,); empty: the next episode of each env
  // Resets by a mask of drones. With Episodes::each the selected drones begin their next episodes, while their envs go on. With
  // Episodes::last an env begins its next episode if all of its drones are selected, or one of them after all have ended; before
  // that, only drones whose episodes have ended may be selected, which clears their flags.
  void reset_drones(DroneMask mask);
  // Actions have one row per drone or env, in the form of TaskSpec::action. Each action is flown EpisodeConfig::frame_skip
  // times.
  void step(std::span<const std::int64_t> actions);  // (R,) integer actions
  void step(std::span<const float> actions);         // (R, ...) floating-point actions
  void step(Pilot& pilot);                           // the actions that it chooses, on the threads that step the envs
  const EpisodeState& episodes() const;              // counters and flags of the current episodes
  // Returns the speeds of the rotors for commands; see set_controller().
  using Controller = std::function<std::span<const float>(std::span<const float> command, int tick)>;
  // Replaces the built-in controller in steps: before each tick it gets the commands of the task, (N, command_size()), and the
  // index of the tick in the step, and returns the speeds of the rotors for this tick, (N, num_rotors()) rad/s. Empty: the
  // built-in one again. For rotor motion, and commands that are in time. A snapshot does not hold it.
  void set_controller(Controller controller);
  // (R,) 1 for rows that take no part in the next step: it only begins their next episode, or their drones rest.
  FlagArray waiting() const;
  void visit_task(ArrayVisitor& visitor) const;  // visits the arrays of the task, for reading
  // Positions of the drones before the last control step and after each of its ticks, (N, ticks + 1, 3) m; see
  // TaskContext::path_of(). Throws std::logic_error if the task does not record them.
  std::span<const float> path() const;
  const Outputs& outputs() const;  // the last step's, reset's or restore's; intact during the next one
  Outputs& outputs();

  // --- everything that the next step depends on, with a hash of the configuration that restore() checks
  std::string snapshot() const;           // the bytes of a snapshot
  void restore(const std::string& blob);  // std::invalid_argument, and no change, if it is of another configuration or corrupt

 private:
  friend class BatchLock;
  friend class Learner;
  friend class ServedBatch;

  void replace(std::shared_ptr<Simulation> next);
  const void* find_readings(const std::type_info& type, std::size_t index) const;

  std::unique_ptr<CallLock> lock_;  // held by each call; outlives sim_
  std::shared_ptr<Simulation> sim_;
};

// The moving objects, E envs of B slots; state().bodies has their arrays. An object that a call has placed, moved or given a
// velocity moves with constant velocity until the next episode, which begins with those of the configuration and no others. A
// mask has E B flags; an empty one selects all. Slots without an object are skipped. All but per_env() throw
// std::invalid_argument if B is 0. Sensors see a change at their next reading.
class FLOCKSTEP_API Batch::Bodies {
 public:
  std::size_t per_env() const;  // B
  // Puts an object into the first free slot of each selected env; returns the slots (E,), -1 for other envs. position (E, 3) m,
  // quat_wxyz (E, 4), velocity (E, 3) m/s, world frame, and angular_velocity (E, 3) rad/s, body frame, replace those of the
  // configuration; without all of them its script moves the object. Refused if a selected env has no free slot.
  std::vector<std::int64_t> spawn(const BodyConfig& config, std::span<const float> position = {},
                                  std::span<const float> quat_wxyz = {}, std::span<const float> velocity = {},
                                  std::span<const float> angular_velocity = {}, EnvMask mask = {});
  void remove(std::span<const std::uint8_t> mask);  // until the next episode
  // position (E, B, 3) m, quat_wxyz (E, B, 4); an empty span leaves the value unchanged. An object may be put onto a drone, which
  // is then inside an obstacle that it may only leave.
  void set_pose(std::span<const float> position, std::span<const float> quat_wxyz, std::span<const std::uint8_t> mask = {});
  // velocity (E, B, 3) m/s, world frame, at most 10000; angular_velocity (E, B, 3) rad/s, body frame, at most 1000.
  void set_velocity(std::span<const float> velocity, std::span<const float> angular_velocity,
                    std::span<const std::uint8_t> mask = {});
  // Valid until the object is removed or the batch is restored or destroyed; null for a free slot.
  const BodyConfig* config(EnvIndex env, std::size_t body) const;

 private:
  friend class Batch;
  explicit Bodies(Batch& batch) : batch_(&batch) {}

  Batch* batch_;
};

// A LiDAR of all drones. All calls but readings() throw std::invalid_argument if there is no such LiDAR.
class FLOCKSTEP_API Batch::Lidar {
 public:
  std::size_t index() const { return index_; }  // into config().lidars
  const LidarReadings& readings() const;        // empty arrays if there is no such LiDAR
  void require_scan() const;                    // std::logic_error before the first scan, while all ranges are inf
  LidarConfig config(DroneIndex drone) const;   // one drone's, run-time changes included
  void directions(std::span<float> out) const;  // of the readings, (N, channels, beams, 3) unit, body frame
  void directions(DroneIndex drone, std::span<float> out) const;  // one drone's, (channels, beams, 3)
  void points(std::span<float> out) const;                        // (N, channels, beams, 3) m, world frame, inf on a miss
  // Scans along directions() from the current pose of one drone and returns its ranges, (channels, beams) m, with the errors of
  // its latest reading; the readings stay unchanged.
  void scan(DroneIndex drone, std::span<float> out) const;
  // From the next scan on. With beams or channels, the mask must select all drones; ranges are inf until that scan. A LiDAR that
  // was made without fans (BatchConfig::tracer) does not get any. Errors that need memory are refused if its configuration has
  // none for them: a width of beams, and without outputs what depends on surfaces.
  void set(const LidarChange& change, DroneMask mask = {});

 private:
  friend class Batch;
  Lidar(Batch& batch, std::size_t index) : batch_(&batch), index_(index) {}

  Batch* batch_;
  std::size_t index_;
};

// A camera of all drones. All calls throw std::invalid_argument if there is no such camera.
class FLOCKSTEP_API Batch::Camera {
 public:
  std::size_t index() const { return index_; }  // into config().cameras
  const CameraConfig& config() const;           // with the current capture mode
  CameraConfig config(DroneIndex drone) const;  // one drone's, run-time changes included
  const CameraImages& images() const;           // the latest of all drones
  void capture(DroneMask mask = {});            // renders now, whatever the capture mode is
  void set_capture_mode(CaptureMode mode);      // not on_demand if the task observes the camera
  // Marks the images stale. With width_px or height_px, the mask must select all drones.
  void set(const CameraChange& change, DroneMask mask = {});
  // Returns a JPEG file of one drone's rgb image, or of its grey image if it has no rgb. The image must not be stale. quality:
  // [1, 100].
  std::string jpeg(DroneIndex drone, int quality) const;
  // Returns the same image uncompressed, (height, width, 3) sRGB, with the visible move lines of the drones of its env in green.
  std::vector<std::uint8_t> picture(DroneIndex drone) const;

 private:
  friend class Batch;
  Camera(Batch& batch, std::size_t index) : batch_(&batch), index_(index) {}

  Batch* batch_;
  std::size_t index_;
};

// The paths of drones, recorded after every motion while they are visible; not part of a snapshot.
class FLOCKSTEP_API Batch::MoveLines {
 public:
  void set_visible(bool visible, DroneMask mask = {});        // begins a line at the drone's position; false discards it
  void set_beams_visible(bool visible, DroneMask mask = {});  // of all LiDARs, for Camera::picture()
  const MoveLineState& state() const;                         // the drones whose lines and beams are visible
  // Returns the recorded positions of a drone (K, 3) in m, world frame, oldest first; K is at most 4096. A row of NaN separates
  // two pieces: a new one begins when the drone is placed by set_pose(), a reset, spawn() or restore().
  std::vector<Vec3> path(DroneIndex drone) const;

 private:
  friend class Batch;
  explicit MoveLines(Batch& batch) : batch_(&batch) {}

  Batch* batch_;
};

}  // namespace flockstep
