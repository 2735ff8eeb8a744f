// Client of a flockstep server: commands and observes the drones of a batch in another process. docs/protocol.md explains the
// messages.
//
//   client::Connection connection({.address = "127.0.0.1:41451"});
//   client::GameModeController simulation(connection);
//   client::DroneController drone(connection, simulation.spawn_drone().drone);
//   const client::Impact impact = drone.set_location({2, 0, 1});
//   const client::LidarData scan = drone.get_lidar_data();
//
// Each operation has two forms. The first one waits for the reply. The second one begins with the argument client::later; it
// sends the request and returns a Future at once: drone.get_lidar_data(client::later). Both throw Error.
//
// Units are SI. The world frame is right-handed: x east, y north, z up. The body frame is x forward, y left, z up.
#pragma once

#include <array>
#include <chrono>
#include <cstddef>
#include <cstdint>
#include <cstring>
#include <functional>
#include <map>
#include <memory>
#include <optional>
#include <span>
#include <stdexcept>
#include <string>
#include <string_view>
#include <type_traits>
#include <utility>
#include <variant>
#include <vector>

#include "flockstep/export.hpp"

namespace flockstep::client {

// -------------------------------------------------------------------------------------------------------------------- errors

// Reason of an Error. The server sends the first eight.
enum class ErrorCode {
  invalid_argument = 1,  // a value is wrong: the text names the field, the expected value and the actual one
  not_found,             // there is no such drone, sensor, world or stream
  permission_denied,     // another client has claimed the drone
  unauthenticated,       // the token is missing or wrong
  resource_exhausted,    // too many clients or unanswered requests, or a message that is too long
  failed_precondition,   // not possible now, such as a step of the task before the first reset
  unimplemented,         // this server does not have the operation
  internal,              // an error in the server
  unavailable,           // there is no server, or the connection has ended
  timeout,               // no reply within the time; the connection is still usable
  bad_reply              // the server does not speak this protocol; the connection has ended
};

// An operation failed.
class FLOCKSTEP_API Error : public std::runtime_error {
 public:
  // Makes an error with a text that names the problem.
  Error(ErrorCode code, const std::string& text);
  ~Error() override;
  // Returns the reason.
  ErrorCode code() const noexcept { return code_; }

 private:
  ErrorCode code_;
};

// -------------------------------------------------------------------------------------------------------------------- values

using Vector3 = std::array<float, 3>;     // x, y, z
using Quaternion = std::array<float, 4>;  // w, x, y, z; rotates from body to world; of any length above 0

// Angles in degrees: intrinsic rotations about z (yaw), y (pitch) and x (roll), in this order. Positive pitch is nose down.
struct Angles {
  float roll_deg = 0.0F;   // about x
  float pitch_deg = 0.0F;  // about y
  float yaw_deg = 0.0F;    // about z
};

// A rotation that a client sends: drone.set_rotation(Angles{.yaw_deg = 90}).
using Orientation = std::variant<Quaternion, Angles>;

// Type of an array's values.
enum class DType { boolean = 1, uint8, uint16, int32, int64, uint64, float32, float64 };

// The DType of a C++ type.
template <class T>
constexpr DType dtype_of() {
  if constexpr (std::is_same_v<T, bool>) return DType::boolean;
  if constexpr (std::is_same_v<T, std::uint8_t>) return DType::uint8;
  if constexpr (std::is_same_v<T, std::uint16_t>) return DType::uint16;
  if constexpr (std::is_same_v<T, std::int32_t>) return DType::int32;
  if constexpr (std::is_same_v<T, std::int64_t>) return DType::int64;
  if constexpr (std::is_same_v<T, std::uint64_t>) return DType::uint64;
  if constexpr (std::is_same_v<T, float>) return DType::float32;
  if constexpr (std::is_same_v<T, double>) return DType::float64;
}

// An array in C order.
struct Array {
  DType dtype = DType::float32;    // type of the values
  std::vector<std::size_t> shape;  // sizes of the dimensions
  std::vector<std::byte> bytes;    // the values; booleans are bytes of 0 or 1

  // Makes an array of values: Array::of<float>({2, 3}, {1, 0, 0, 0, 1, 0}).
  template <class T>
  static Array of(std::vector<std::size_t> shape, std::span<const T> values) {
    Array array{.dtype = dtype_of<T>(), .shape = std::move(shape), .bytes = std::vector<std::byte>(values.size_bytes())};
    if (!values.empty()) std::memcpy(array.bytes.data(), values.data(), values.size_bytes());
    return array;
  }
  template <class T>
  static Array of(std::vector<std::size_t> shape, const std::vector<T>& values) {
    return of(std::move(shape), std::span<const T>(values));
  }
  // Returns the values. Throws Error if they have another type.
  template <class T>
  std::span<const T> values() const {
    require_type(dtype_of<T>());
    return {reinterpret_cast<const T*>(bytes.data()), bytes.size() / sizeof(T)};
  }

 private:
  FLOCKSTEP_API void require_type(DType type) const;
};

using Arrays = std::map<std::string, Array, std::less<>>;  // arrays by name

// ------------------------------------------------------------------------------------------------------------- a connection

// Parameters of a connection.
struct Options {
  std::string address = "127.0.0.1:41451";   // HOST:PORT, [HOST]:PORT or unix:PATH
  std::string token;                         // secret of the server; empty: none
  std::chrono::milliseconds timeout{10000};  // of connecting and of each operation that waits
  bool tls = false;                          // encrypt, and check the certificate of the server
  std::string ca_file;          // PEM file of the certificates that sign the server's one; empty: those of the system
  std::string host_name;        // that the certificate must name; empty: the host of the address
  std::string program = "C++";  // name of this program, for messages of the server
  std::size_t max_message_bytes = std::size_t{1} << 30;  // a longer reply ends the connection
};

// The server that a connection leads to.
struct ServerInfo {
  std::string version;                   // of flockstep
  std::uint32_t client = 0;              // number of this client, as in Drone::owner
  std::int64_t num_envs = 0;             // E
  std::int64_t drones_per_env = 0;       // slots for drones in each env: the batch has N = E * drones_per_env of them
  std::int64_t generation = 0;           // counts how often the arrays of the batch changed their shapes
  std::vector<std::string> lidars;       // names
  std::vector<std::string> cameras;      // names
  std::vector<std::string> imus;         // names
  std::vector<std::string> imu_configs;  // ImuConfig of each IMU, as JSON
  bool flies_by_rotors = false;          // otherwise drones move kinematically
  bool has_task = false;                 // otherwise get_task(), reset_envs() and step_envs() are refused
  double step_s = 0.0;                   // simulated time of a step
  std::vector<std::string> array_names;  // of get_arrays(), without those of sensors
  std::vector<std::string> array_rows;   // kind of the rows of each: "drone", "env", "task", or "body": B bodies of each env
  std::int64_t bodies_per_env = 0;       // slots for bodies in each env, B
};

namespace detail {
class Link;
class Call;
FLOCKSTEP_API void wait(Call& call);
FLOCKSTEP_API bool wait_for(Call& call, std::chrono::nanoseconds timeout);
}  // namespace detail

// A connection to a server. Copies share it, and threads may: operations of several threads do not disturb each other. The
// connection closes with its last copy, controller, Future and Stream. It has no thread.
class FLOCKSTEP_API Connection {
 public:
  // Connects. Throws Error.
  explicit Connection(const Options& options = {});

  // The server, at the time of the connection.
  const ServerInfo& server() const;
  // Returns false after an error that ended the connection.
  bool is_open() const;

 private:
  friend class GameModeController;
  friend class DroneController;
  std::shared_ptr<detail::Link> link_;
};

// Begins the arguments of an operation that returns a Future.
struct Later {};
inline constexpr Later later{};  // drone.get_location(client::later)

// A result that arrives later. Whoever waits for one also receives the replies of others, so futures may be waited for in any
// order. A Future that is destroyed discards its result.
template <class T>
class Future {
 public:
  // Result of get_for().
  using Maybe = std::conditional_t<std::is_void_v<T>, bool, std::optional<std::conditional_t<std::is_void_v<T>, bool, T>>>;

  // Makes a Future of a request that was sent.
  Future(std::shared_ptr<detail::Call> call, T (*read)(detail::Call&)) : call_(std::move(call)), read_(read) {}

  // Waits for the result, up to Options::timeout. To be called once, except after a timeout.
  T get() {
    detail::wait(*call_);
    return read_(*call_);
  }
  // Waits for the result; returns nothing, or false for an operation without a result, if the time has passed.
  Maybe get_for(std::chrono::nanoseconds timeout) {
    if (!detail::wait_for(*call_, timeout)) return {};
    if constexpr (std::is_void_v<T>) {
      read_(*call_);
      return true;
    } else {
      return read_(*call_);
    }
  }
  // Returns whether get() returns or throws at once.
  bool is_ready() const { return detail::wait_for(*call_, std::chrono::nanoseconds(0)); }

 private:
  std::shared_ptr<detail::Call> call_;
  T (*read_)(detail::Call&);
};

// The newest of values that the server sends again and again. Destroying it ends the stream.
template <class T>
class Stream {
 public:
  // Makes a Stream of a request that was sent.
  Stream(std::shared_ptr<detail::Call> call, T (*read)(detail::Call&)) : call_(std::move(call)), read_(read) {}

  // Returns the newest value if it was not returned before; otherwise waits for the next one. Returns nothing if the time has
  // passed. Throws Error if the stream has ended.
  std::optional<T> next(std::chrono::nanoseconds timeout) {
    if (!detail::wait_for(*call_, timeout)) return std::nullopt;
    return read_(*call_);
  }

 private:
  std::shared_ptr<detail::Call> call_;
  T (*read_)(detail::Call&);
};

// ------------------------------------------------------------------------------------------------------------------- results

// An active drone.
struct Drone {
  std::int64_t drone = 0;   // index in the batch
  std::int64_t env = 0;     // index of its env
  std::uint32_t owner = 0;  // number of the client that has claimed it, or 0
};

// Place of a drone to spawn.
struct Spawn {
  // m, where the drone touches nothing; by default the start of the world, or a free place near it if that is taken
  std::optional<Vector3> location;
  std::optional<Quaternion> rotation;  // by default level
  std::optional<std::int64_t> env;     // by default any with a free slot
  bool claim = false;                  // as by claim()
};

// When cameras render.
enum class CaptureMode { every_step, on_movement, on_demand };

// Speed of the simulation over the last seconds.
struct Fps {
  double fps = 0.0;               // steps per second of wall time
  double real_time_factor = 0.0;  // simulated time over wall time
};

// A rotation that the server sends, in both forms.
struct Rotation {
  Quaternion quaternion{1.0F, 0.0F, 0.0F, 0.0F};  // unit
  Angles angles;                                  // the same rotation
};

// Result of a motion.
struct Impact {
  bool hit = false;                             // the drone touched something and stopped there
  float fraction = 0.0F;                        // of the motion that was flown
  Vector3 location{};                           // of the drone afterwards, m
  Quaternion rotation{1.0F, 0.0F, 0.0F, 0.0F};  // of the drone afterwards
  Vector3 point{};                              // of the contact, on the obstacle, m; if hit
  Vector3 normal{};                             // unit, from the obstacle towards the drone; if hit
};

// Form of an image.
enum class ImageFormat { jpeg, png, raw };

// A camera's image to get.
struct ImageRequest {
  std::string camera;                      // name; empty: the only one
  ImageFormat format = ImageFormat::jpeg;  // raw gives the values of the pixels
  int quality = 90;                        // of a JPEG, 1 to 100
  std::string output;                      // such as "depth", which needs raw; empty: "rgb", or "grey" without it
};

// An image.
struct CameraData {
  std::int64_t step = 0;  // number of the reading in the episode
  int width_px = 0;       // of the image
  int height_px = 0;      // of the image
  Array image;            // the bytes of a JPEG or PNG file, (size,) uint8; or pixels, (height, width, channels)
};

// A scan to make.
struct ScanRequest {
  std::string lidar;                // name; empty: the first
  bool without_directions = false;  // leave them out: they change only with the configuration
};

// A scan.
struct LidarData {
  int channels = 0;                             // rows of beams
  int beams = 0;                                // beams of each row
  std::vector<float> ranges;                    // (channels, beams) m; inf: no hit
  std::vector<Vector3> directions;              // (channels, beams) unit vectors, body frame
  Vector3 origin{};                             // of the beams, m, world frame
  Quaternion rotation{1.0F, 0.0F, 0.0F, 0.0F};  // of the body

  // Returns the points that were hit, m, world frame. Needs the directions.
  FLOCKSTEP_API std::vector<Vector3> points() const;
};

// A moment of the simulation.
struct Time {
  std::int64_t step = 0;        // steps of clients and of the server's clock since the server started
  double time_s = 0.0;          // simulated time of these steps
  std::int64_t num_envs = 0;    // of the batch
  std::int64_t generation = 0;  // counts how often the arrays of the batch changed their shapes
};

// Arrays of one moment.
struct Readings {
  Time time;      // the moment
  Arrays arrays;  // by name

  // Returns the values of an array. Throws Error if there is none of this name and type.
  template <class T>
  std::span<const T> values(std::string_view name) const {
    return array(name).template values<T>();
  }
  // Returns an array. Throws Error if there is none of this name.
  FLOCKSTEP_API const Array& array(std::string_view name) const;
};

// Poses of all N drones. Arrays may be empty: then they stay unchanged. An empty mask selects all drones.
struct Poses {
  std::span<const float> position;       // (N, 3) m
  std::span<const float> quat_wxyz;      // (N, 4)
  std::span<const std::uint8_t> mask{};  // (N,) 0 or 1
};

// Commands to the rotors of all N drones.
struct Commands {
  std::span<const float> command;        // (N, 4)
  std::string control;                   // meaning of the commands, such as "velocity"; empty: that of the batch
  std::span<const std::uint8_t> mask{};  // (N,) 0 or 1; empty: all drones
};

// Initial poses and velocities of bodies, one row per env. Empty arrays: as in the configuration.
struct BodySpawn {
  std::span<const float> position{};          // (E, 3) m
  std::span<const float> quat_wxyz{};         // (E, 4)
  std::span<const float> velocity{};          // (E, 3) m/s, world frame
  std::span<const float> angular_velocity{};  // (E, 3) rad/s, body frame
  std::span<const std::uint8_t> mask{};       // (E,) 0 or 1; empty: all envs
};

// Poses of bodies, B slots of each env. Empty arrays: unchanged.
struct BodyPoses {
  std::span<const float> position{};     // (E, B, 3) m
  std::span<const float> quat_wxyz{};    // (E, B, 4)
  std::span<const std::uint8_t> mask{};  // (E, B) 0 or 1; empty: all bodies
};

// Velocities of bodies, B slots of each env. Empty arrays: unchanged.
struct BodyVelocities {
  std::span<const float> velocity{};          // (E, B, 3) m/s, world frame
  std::span<const float> angular_velocity{};  // (E, B, 3) rad/s, body frame
  std::span<const std::uint8_t> mask{};       // as of BodyPoses
};

// Configurations of the bodies in K envs.
struct BodyConfigs {
  std::vector<std::string> configs;   // the different ones: JSON objects with the fields of BodyConfig
  std::vector<std::int32_t> numbers;  // (K, B): index in `configs`; -1 for a free slot
};

// A world of the server.
struct World {
  std::string name;                // as in its file
  std::uint64_t content_hash = 0;  // equal for equal worlds
  Vector3 min{};                   // m, of all geometry
  Vector3 max{};                   // m, of all geometry
  std::optional<Vector3> start;    // m
  std::optional<Vector3> goal;     // m
};

// All surfaces of a world as triangles.
struct Mesh {
  std::vector<Vector3> vertices;                       // m
  std::vector<std::array<std::int32_t, 3>> triangles;  // indices of vertices
  std::vector<std::int32_t> objects;                   // object of each triangle
};

// Points on all surfaces of a world.
struct PointCloud {
  std::vector<Vector3> points;          // m
  std::vector<Vector3> normals;         // unit
  std::vector<std::uint16_t> semantic;  // class of each point
  std::vector<std::int32_t> objects;    // object of each point
};

// The smallest box around each object of a world.
struct Boxes {
  std::vector<Vector3> min;             // m
  std::vector<Vector3> max;             // m
  std::vector<std::int32_t> materials;  // material of each object
};

// An array that a task takes or gives.
struct Field {
  std::string name;                // as in Readings
  DType dtype = DType::float32;    // type of the values
  std::vector<std::size_t> shape;  // of a row
  std::vector<double> low;         // lowest value: one for all, or one for each
  std::vector<double> high;        // highest value
};

// The task of the batch.
struct Task {
  Field action;                           // of each row
  std::vector<Field> observation;         // of each row
  std::vector<std::string> reward_terms;  // names
  std::int64_t num_rows = 0;              // of actions, observations and rewards
  bool row_is_env = false;                // otherwise a row is a drone
  std::string autoreset_mode;             // as in Gymnasium
  double policy_hz = 0.0;                 // actions per second of simulated time
  int frame_skip = 0;                     // steps of the simulation for each action
  std::string episodes;                   // how those of an env's drones belong together: "team", "each" or "last"
};

// --------------------------------------------------------------------------------------------------------------- controllers

// Controls the simulation: its drones, time, worlds and task. Copies are cheap.
class FLOCKSTEP_API GameModeController {
 public:
  // Makes a controller; nothing is sent.
  explicit GameModeController(Connection connection);

  // --- session
  // Returns when the server has answered.
  void ping() { ping(later).get(); }
  Future<void> ping(Later);
  // Claims drones: a server that was started with ownership then refuses other clients' operations that change them. Claims end
  // with the connection.
  void claim(std::span<const std::int64_t> drones) { claim(later, drones).get(); }
  Future<void> claim(Later, std::span<const std::int64_t> drones);
  // Ends claims.
  void release(std::span<const std::int64_t> drones) { release(later, drones).get(); }
  Future<void> release(Later, std::span<const std::int64_t> drones);

  // --- drones
  // Returns the active drones.
  std::vector<Drone> get_drones() { return get_drones(later).get(); }
  Future<std::vector<Drone>> get_drones(Later);
  // Spawns a drone in a free slot. Enlarges the batch if it has none.
  Drone spawn_drone(const Spawn& spawn = {}) { return spawn_drone(later, spawn).get(); }
  Future<Drone> spawn_drone(Later, const Spawn& spawn = {});
  // Removes a drone.
  void remove_drone(std::int64_t drone) { remove_drone(later, drone).get(); }
  Future<void> remove_drone(Later, std::int64_t drone);
  // Returns when a camera of all drones renders. An empty name means the only camera.
  CaptureMode get_camera_capture_mode(std::string_view camera = {}) { return get_camera_capture_mode(later, camera).get(); }
  Future<CaptureMode> get_camera_capture_mode(Later, std::string_view camera = {});
  // Sets when a camera of all drones renders.
  void set_camera_capture_mode(CaptureMode mode, std::string_view camera = {}) {
    set_camera_capture_mode(later, mode, camera).get();
  }
  Future<void> set_camera_capture_mode(Later, CaptureMode mode, std::string_view camera = {});

  // --- all drones at once
  // Returns arrays of all drones or envs as they were after the last completed operation, even while a step runs. sensor: the
  // LiDAR, camera or IMU whose arrays are named; empty: those of the batch, see ServerInfo::array_names.
  Readings get_arrays(std::span<const std::string> names, std::string_view sensor = {}) {
    return get_arrays(later, names, sensor).get();
  }
  Future<Readings> get_arrays(Later, std::span<const std::string> names, std::string_view sensor = {});
  // Returns one array.
  Readings get_array(std::string_view name, std::string_view sensor = {}) { return get_array(later, name, sensor).get(); }
  Future<Readings> get_array(Later, std::string_view name, std::string_view sensor = {});
  // Moves drones in straight lines until they touch something, or with `teleport` places them. Returns the arrays "position",
  // "quat_wxyz", "hit", "point" and "normal".
  Readings set_poses(const Poses& poses, bool teleport = false) { return set_poses(later, poses, teleport).get(); }
  Future<Readings> set_poses(Later, const Poses& poses, bool teleport = false);
  // Flies drones by rotors for some ticks of the physics; 0: one step.
  Time fly(const Commands& commands, int ticks = 0) { return fly(later, commands, ticks).get(); }
  Future<Time> fly(Later, const Commands& commands, int ticks = 0);
  // Sets the commands that later steps fly.
  void set_command(const Commands& commands) { set_command(later, commands).get(); }
  Future<void> set_command(Later, const Commands& commands);
  // Streams arrays as of get_arrays(), at most `rate_hz` times per second of wall time; with `only_new` only after a change.
  Stream<Readings> stream_arrays(std::span<const std::string> names, double rate_hz, std::string_view sensor = {},
                                 bool only_new = false);

  // --- bodies: solids that move, in B slots of each env
  // Puts a body into the first free slot of each env. config: a JSON object with the fields of BodyConfig that differ from their
  // defaults. Without arrays its script moves the body. Returns the slots (E,); -1 for envs that are not selected.
  std::vector<std::int64_t> spawn_bodies(std::string_view config, const BodySpawn& spawn = {}) {
    return spawn_bodies(later, config, spawn).get();
  }
  Future<std::vector<std::int64_t>> spawn_bodies(Later, std::string_view config, const BodySpawn& spawn = {});
  // Removes bodies until the next episode. mask: as of BodyPoses.
  Time remove_bodies(std::span<const std::uint8_t> mask = {}) { return remove_bodies(later, mask).get(); }
  Future<Time> remove_bodies(Later, std::span<const std::uint8_t> mask = {});
  // Places bodies. They leave their scripts until the next episode.
  Time set_body_poses(const BodyPoses& poses) { return set_body_poses(later, poses).get(); }
  Future<Time> set_body_poses(Later, const BodyPoses& poses);
  // Sets the velocities of bodies. They leave their scripts until the next episode.
  Time set_body_velocities(const BodyVelocities& velocities) { return set_body_velocities(later, velocities).get(); }
  Future<Time> set_body_velocities(Later, const BodyVelocities& velocities);
  // Returns the configurations of the bodies in some envs; empty: in all.
  BodyConfigs get_body_configs(std::span<const std::int64_t> envs = {}) { return get_body_configs(later, envs).get(); }
  Future<BodyConfigs> get_body_configs(Later, std::span<const std::int64_t> envs = {});

  // --- time
  // Returns the speed of the simulation.
  Fps get_fps() { return get_fps(later).get(); }
  Future<Fps> get_fps(Later);
  // Streams the speed of the simulation.
  Stream<Fps> stream_fps(double rate_hz);
  // Steps a batch without a task. In lockstep the reply comes when every member has asked for the step.
  Time step() { return step(later).get(); }
  Future<Time> step(Later);
  // Lets the server step at a rate of wall time; 0 stops that.
  Time set_clock(double rate_hz) { return set_clock(later, rate_hz).get(); }
  Future<Time> set_clock(Later, double rate_hz);
  // Becomes a member of the lockstep: steps then wait until every member has asked for one.
  Time join_lockstep() { return join_lockstep(later).get(); }
  Future<Time> join_lockstep(Later);
  // Leaves the lockstep.
  void leave_lockstep() { leave_lockstep(later).get(); }
  Future<void> leave_lockstep(Later);
  // Reads the sensors now.
  Time sense() { return sense(later).get(); }
  Future<Time> sense(Later);
  // Returns the whole state of the batch.
  std::vector<std::uint8_t> snapshot() { return snapshot(later).get(); }
  Future<std::vector<std::uint8_t>> snapshot(Later);
  // Returns to the state of a snapshot.
  void restore(std::span<const std::uint8_t> snapshot) { restore(later, snapshot).get(); }
  Future<void> restore(Later, std::span<const std::uint8_t> snapshot);

  // --- worlds; `world` is an index in the result of get_worlds()
  // Returns the worlds that the server was started with.
  std::vector<World> get_worlds() { return get_worlds(later).get(); }
  Future<std::vector<World>> get_worlds(Later);
  // Puts an env into another world. Its drones stay where they are.
  void set_world(std::int64_t env, std::uint32_t world) { set_world(later, env, world).get(); }
  Future<void> set_world(Later, std::int64_t env, std::uint32_t world);
  // Returns the Light of a world, as JSON of its fields.
  std::string get_light(std::uint32_t world = 0) { return get_light(later, world).get(); }
  Future<std::string> get_light(Later, std::uint32_t world = 0);
  // Sets fields of the Light of a world, for all envs in it that have no light of their own: {"sun_glow": 0.3}.
  void set_light(std::string_view fields, std::uint32_t world = 0) { set_light(later, fields, world).get(); }
  Future<void> set_light(Later, std::string_view fields, std::uint32_t world = 0);
  // Returns the Light that the cameras of an env show.
  std::string get_env_light(std::int64_t env) { return get_env_light(later, env).get(); }
  Future<std::string> get_env_light(Later, std::int64_t env);
  // Gives envs their own lights, which differ from their current ones in the given fields. Without fields, the envs show the
  // lights of their worlds again.
  void set_env_lights(std::span<const std::int64_t> envs, std::string_view fields) { set_env_lights(later, envs, fields).get(); }
  Future<void> set_env_lights(Later, std::span<const std::int64_t> envs, std::string_view fields);

  // Returns the surfaces of a world.
  Mesh get_mesh(std::uint32_t world = 0) { return get_mesh(later, world).get(); }
  Future<Mesh> get_mesh(Later, std::uint32_t world = 0);
  // Returns points on the surfaces of a world, about `spacing_m` apart.
  PointCloud get_point_cloud(float spacing_m, std::uint32_t world = 0) { return get_point_cloud(later, spacing_m, world).get(); }
  Future<PointCloud> get_point_cloud(Later, float spacing_m, std::uint32_t world = 0);
  // Returns the boxes around the objects of a world.
  Boxes get_boxes(std::uint32_t world = 0) { return get_boxes(later, world).get(); }
  Future<Boxes> get_boxes(Later, std::uint32_t world = 0);

  // --- task
  // Returns the task of the batch.
  Task get_task() { return get_task(later).get(); }
  Future<Task> get_task(Later);
  // Begins new episodes. seeds: (E,) or empty; mask: (E,) 0 or 1, or empty for all envs. Without seeds, and unless
  // Task::episodes is "team", the mask may also be (N,). Returns the arrays "observation/NAME" and "waiting": 1 for rows that
  // take no part in the next step.
  Readings reset_envs(std::span<const std::uint64_t> seeds = {}, std::span<const std::uint8_t> mask = {}) {
    return reset_envs(later, seeds, mask).get();
  }
  Future<Readings> reset_envs(Later, std::span<const std::uint64_t> seeds = {}, std::span<const std::uint8_t> mask = {});
  // Steps the task. actions: of the shape (Task::num_rows, ...) and type of Task::action; actions of floats are float32, others
  // int64. Returns the arrays of reset_envs(), "reward", "terminated" and "truncated". If episodes have ended, there are more
  // arrays, such as "episode_return", with one row for each row whose "terminated" or "truncated" is set.
  Readings step_envs(const Array& actions) { return step_envs(later, actions).get(); }
  Future<Readings> step_envs(Later, const Array& actions);

 private:
  std::shared_ptr<detail::Link> link_;
};

// Controls one drone. Copies are cheap.
class FLOCKSTEP_API DroneController {
 public:
  // Makes a controller of the drone with this index in the batch; nothing is sent.
  DroneController(Connection connection, std::int64_t drone);
  // Index of the drone in the batch.
  std::int64_t drone() const { return drone_; }

  // Returns when the server has answered.
  void ping() { ping(later).get(); }
  Future<void> ping(Later);

  // --- motion
  // Returns the location, m.
  Vector3 get_location() { return get_location(later).get(); }
  Future<Vector3> get_location(Later);
  // Moves the drone in a straight line until it touches something, or with `teleport` places it there without a check.
  Impact set_location(const Vector3& location, bool teleport = false) { return set_location(later, location, teleport).get(); }
  Future<Impact> set_location(Later, const Vector3& location, bool teleport = false);
  // Returns the rotation.
  Rotation get_rotation() { return get_rotation(later).get(); }
  Future<Rotation> get_rotation(Later);
  // Turns the drone until it touches something, or with `teleport` without a check.
  Impact set_rotation(const Orientation& rotation, bool teleport = false) {
    return set_rotation(later, rotation, teleport).get();
  }
  Future<Impact> set_rotation(Later, const Orientation& rotation, bool teleport = false);
  // Moves and turns the drone until it touches something, or with `teleport` without a check.
  Impact set_location_and_rotation(const Vector3& location, const Orientation& rotation, bool teleport = false) {
    return set_location_and_rotation(later, location, rotation, teleport).get();
  }
  Future<Impact> set_location_and_rotation(Later, const Vector3& location, const Orientation& rotation, bool teleport = false);
  // Sets the command that later steps fly by rotors. control: its meaning, such as "velocity"; empty: that of the batch.
  void set_command(const std::array<float, 4>& command, std::string_view control = {}) {
    set_command(later, command, control).get();
  }
  Future<void> set_command(Later, const std::array<float, 4>& command, std::string_view control = {});

  // --- camera; an empty name means the only one
  // Returns an image: a JPEG file by default. A camera in the mode on_demand renders now; otherwise only if its image is stale.
  CameraData get_camera_data(const ImageRequest& request = {}) { return get_camera_data(later, request).get(); }
  Future<CameraData> get_camera_data(Later, const ImageRequest& request = {});
  // Streams images, at most `rate_hz` times per second of wall time; with `only_new` only after a change.
  Stream<CameraData> stream_camera(double rate_hz, const ImageRequest& request = {}, bool only_new = false);
  // Returns the CameraConfig of the drone, with both fields of view, as JSON of its fields.
  std::string get_camera_config(std::string_view camera = {}) { return get_camera_config(later, camera).get(); }
  Future<std::string> get_camera_config(Later, std::string_view camera = {});
  // Changes fields of a CameraConfig: {"hfov_deg": 60}. width_px and height_px change the cameras of all drones.
  void set_camera_config(std::string_view fields, std::string_view camera = {}) {
    set_camera_config(later, fields, camera).get();
  }
  Future<void> set_camera_config(Later, std::string_view fields, std::string_view camera = {});
  // Returns whether images show the line of the drone's past positions.
  bool get_move_line_visible() { return get_move_line_visible(later).get(); }
  Future<bool> get_move_line_visible(Later);
  // Shows the line of the drone's past positions in images.
  void set_move_line_visible(bool visible) { set_move_line_visible(later, visible).get(); }
  Future<void> set_move_line_visible(Later, bool visible);

  // --- LiDAR; an empty name means the first one
  // Scans now.
  LidarData get_lidar_data(const ScanRequest& request = {}) { return get_lidar_data(later, request).get(); }
  Future<LidarData> get_lidar_data(Later, const ScanRequest& request = {});
  // Streams scans, at most `rate_hz` times per second of wall time; with `only_new` only after a change.
  Stream<LidarData> stream_lidar(double rate_hz, const ScanRequest& request = {}, bool only_new = false);
  // Returns the LidarConfig of the drone, as JSON of its fields.
  std::string get_lidar_config(std::string_view lidar = {}) { return get_lidar_config(later, lidar).get(); }
  Future<std::string> get_lidar_config(Later, std::string_view lidar = {});
  // Changes fields of a LidarConfig: {"max_range_m": 5}. channels and beams change the LiDARs of all drones.
  void set_lidar_config(std::string_view fields, std::string_view lidar = {}) { set_lidar_config(later, fields, lidar).get(); }
  Future<void> set_lidar_config(Later, std::string_view fields, std::string_view lidar = {});

 private:
  std::shared_ptr<detail::Link> link_;
  std::int64_t drone_;
};

}  // namespace flockstep::client
