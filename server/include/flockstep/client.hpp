// Client of a flockstep server: commands and observes the drones of a batch in another process. docs/reference/protocol.md
// explains the messages.
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

}  // namespace flockstep::client

#include "flockstep/client_results.hpp"

namespace flockstep::client {

// ------------------------------------------------------------------------------------------------------------- a connection

// Parameters of a connection.
struct Options {
  std::string address = "127.0.0.1:41451";   // HOST:PORT, [HOST]:PORT or unix:PATH
  std::string token;                         // secret of the server; empty: none
  std::chrono::milliseconds timeout{10000};  // for connecting and for each operation that waits
  bool tls = false;                          // encrypt, and check the certificate of the server
  std::string ca_file;          // PEM file of the certificates that sign the server's one; empty: those of the system
  std::string host_name;        // that the certificate must name; empty: the host of the address
  std::string program = "C++";  // name of this program, for messages of the server
  std::size_t max_message_bytes = std::size_t{1} << 30;  // a longer reply ends the connection
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

// When cameras render.
enum class CaptureMode { every_step, on_movement, on_demand };

// Result of a motion.
struct Impact {
  bool hit = false;                             // the drone touched something and stopped there
  float fraction = 0.0F;                        // flown part of the motion
  Vector3 location{};                           // the drone's position afterwards, m
  Quaternion rotation{1.0F, 0.0F, 0.0F, 0.0F};  // the drone's rotation afterwards
  Vector3 point{};                              // contact point on the obstacle, m; if hit
  Vector3 normal{};                             // unit, from the obstacle towards the drone; if hit
};

// Form of an image.
enum class ImageFormat { jpeg, png, raw };

// An image.
struct CameraData {
  std::int64_t step = 0;  // number of the reading in the episode
  int width_px = 0;       // the image's
  int height_px = 0;      // the image's
  Array image;            // the bytes of a JPEG or PNG file, (size,) uint8; or pixels, (height, width, channels)
};

// A scan.
struct LidarData {
  int channels = 0;                             // rows of beams
  int beams = 0;                                // beams of each row
  std::vector<float> ranges;                    // (channels, beams) m; inf: no hit
  std::vector<Vector3> directions;              // (channels, beams) unit vectors, body frame
  Vector3 origin{};                             // the beams' origin, m, world frame
  Quaternion rotation{1.0F, 0.0F, 0.0F, 0.0F};  // the body frame's rotation

  // Returns the points that were hit, m, world frame. Needs the directions.
  FLOCKSTEP_API std::vector<Vector3> points() const;
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

// Configurations of the bodies in K envs.
struct BodyConfigs {
  std::vector<std::string> configs;   // the different ones: JSON objects with the fields of BodyConfig
  std::vector<std::int32_t> numbers;  // (K, B): index in `configs`; -1 for a free slot
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

// --------------------------------------------------------------------------------------------------------------- controllers

using Slots = std::vector<std::int64_t>;     // (E,) of spawned bodies; -1 for envs that are not selected
using Snapshot = std::vector<std::uint8_t>;  // the whole state of a batch

}  // namespace flockstep::client

#include "flockstep/client_operations.hpp"

namespace flockstep::client {

// ------------------------------------------------------------------------------------------------------------- operations

// Controls the simulation: its drones, time, worlds and task. Copies are cheap.
class GameModeController : public GameModeOperations {
 public:
  // Makes a controller; nothing is sent.
  explicit GameModeController(const Connection& connection) : GameModeOperations(connection.link_) {}

  // Returns one array, as get_arrays() does.
  Readings get_array(std::string_view name, std::string_view sensor = {}) { return get_array(later, name, sensor).get(); }
  Future<Readings> get_array(Later, std::string_view name, std::string_view sensor = {}) {
    const std::string names[]{std::string(name)};
    return get_arrays(later, names, sensor);
  }
};

// Controls one drone. Copies are cheap.
class DroneController : public DroneOperations {
 public:
  // Makes a controller of the drone with this index in the batch; nothing is sent.
  DroneController(const Connection& connection, std::int64_t drone)
      : DroneOperations(connection.link_, drone), simulation_(connection) {}

  // Index of the drone in the batch.
  std::int64_t drone() const { return drone_; }

  // Sets the command that later steps fly by rotors. control: its meaning, such as "velocity"; empty: that of the batch. Braces
  // hold four numbers; the commands of more rotors are a std::array of them.
  template <std::size_t kSize = 4>
  void set_command(const std::array<float, kSize>& command, std::string_view control = {}) {
    set_command(later, command, control).get();
  }
  template <std::size_t kSize = 4>
  Future<void> set_command(Later, const std::array<float, kSize>& command, std::string_view control = {}) {
    return simulation_.set_command(later, {.command = command}, drone_, control);
  }

 private:
  GameModeController simulation_;
};

}  // namespace flockstep::client
