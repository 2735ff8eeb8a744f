// Messages of the protocol, as structs. Generated from flockstep.proto by server/generate.py.
#pragma once

#include <cstdint>
#include <optional>
#include <protozero/pbf_reader.hpp>
#include <protozero/pbf_writer.hpp>
#include <string>
#include <variant>
#include <vector>

// read() throws std::invalid_argument or protozero::exception if the bytes are not such a message. Unknown fields are
// skipped. flockstep.proto documents the fields.
namespace flockstep::protocol {

enum class DType : std::int32_t {
  kDtypeUnspecified = 0,
  kDtypeBool = 1,
  kDtypeUint8 = 2,
  kDtypeUint16 = 3,
  kDtypeInt32 = 4,
  kDtypeInt64 = 5,
  kDtypeUint64 = 6,
  kDtypeFloat32 = 7,
  kDtypeFloat64 = 8
};
inline constexpr std::int32_t kLastDType = 8;

enum class Code : std::int32_t {
  kCodeUnspecified = 0,
  kInvalidArgument = 1,
  kNotFound = 2,
  kPermissionDenied = 3,
  kUnauthenticated = 4,
  kResourceExhausted = 5,
  kFailedPrecondition = 6,
  kUnimplemented = 7,
  kInternal = 8
};
inline constexpr std::int32_t kLastCode = 8;

enum class CaptureModeName : std::int32_t { kEveryStep = 0, kOnMovement = 1, kOnDemand = 2 };
inline constexpr std::int32_t kLastCaptureModeName = 2;

enum class ImageFormat : std::int32_t { kJpeg = 0, kPng = 1, kRaw = 2 };
inline constexpr std::int32_t kLastImageFormat = 2;

struct Array {
  std::string name;
  DType dtype = {};
  std::vector<std::uint64_t> shape;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Hello {
  std::uint32_t protocol = 0;
  std::string token;
  std::string client;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Ping {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Claim {
  std::vector<std::int64_t> drones;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Release {
  std::vector<std::int64_t> drones;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetDrones {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Vector3 {
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Quaternion {
  float w = 0.0F;
  float x = 0.0F;
  float y = 0.0F;
  float z = 0.0F;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SpawnDrone {
  std::optional<Vector3> location;
  std::optional<Quaternion> rotation;
  std::optional<std::int64_t> env;
  bool claim = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct RemoveDrone {
  std::int64_t drone = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetCameraCaptureMode {
  std::string camera;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetCameraCaptureMode {
  std::string camera;
  CaptureModeName mode = {};

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetFps {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetLocation {
  std::int64_t drone = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetLocation {
  std::int64_t drone = 0;
  std::optional<Vector3> location;
  bool teleport = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetRotation {
  std::int64_t drone = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Angles {
  float roll_deg = 0.0F;
  float pitch_deg = 0.0F;
  float yaw_deg = 0.0F;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetRotation {
  std::int64_t drone = 0;
  std::variant<std::monostate, Quaternion, Angles> rotation;
  bool teleport = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetLocationAndRotation {
  std::int64_t drone = 0;
  std::optional<Vector3> location;
  std::variant<std::monostate, Quaternion, Angles> rotation;
  bool teleport = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetCameraData {
  std::int64_t drone = 0;
  std::string camera;
  ImageFormat format = {};
  std::uint32_t quality = 0;
  std::string output;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetLidarData {
  std::int64_t drone = 0;
  std::string lidar;
  bool without_directions = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetLidarConfig {
  std::int64_t drone = 0;
  std::string lidar;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct LidarConfig {
  std::optional<std::int32_t> channels;
  std::optional<std::int32_t> beams;
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  std::optional<float> max_range_m;
  std::optional<Vector3> offset_m;
  std::optional<Quaternion> rotation;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetLidarConfig {
  std::int64_t drone = 0;
  std::string lidar;
  std::optional<LidarConfig> config;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetCameraConfig {
  std::int64_t drone = 0;
  std::string camera;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct CameraConfig {
  std::optional<std::int32_t> width_px;
  std::optional<std::int32_t> height_px;
  std::optional<float> hfov_deg;
  std::optional<float> vfov_deg;
  std::optional<Vector3> offset_m;
  std::optional<Quaternion> rotation;
  std::optional<float> near_m;
  std::optional<float> far_m;
  std::vector<std::string> outputs;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetCameraConfig {
  std::int64_t drone = 0;
  std::string camera;
  std::optional<CameraConfig> config;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetMoveLineVisible {
  std::int64_t drone = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetMoveLineVisible {
  std::int64_t drone = 0;
  bool visible = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetArrays {
  std::vector<std::string> names;
  std::string sensor;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetPoses {
  bool teleport = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Fly {
  std::uint32_t ticks = 0;
  std::string control;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetCommand {
  std::optional<std::int64_t> drone;
  std::string control;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Step {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetClock {
  double rate_hz = 0.0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct JoinLockstep {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct LeaveLockstep {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Sense {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Snapshot {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Restore {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetWorlds {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetWorld {
  std::int64_t env = 0;
  std::uint32_t world = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetLight {
  std::uint32_t world = 0;
  std::optional<std::int64_t> env;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Light {
  std::optional<Vector3> sun_direction;
  std::optional<Vector3> sun_color;
  std::optional<Vector3> sky_ambient;
  std::optional<Vector3> ground_ambient;
  std::optional<Vector3> zenith_color;
  std::optional<Vector3> horizon_color;
  std::optional<float> gamma;
  std::optional<float> sun_radius_deg;
  std::optional<float> sun_glow;
  std::optional<float> fog_visibility_m;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetLight {
  std::uint32_t world = 0;
  std::optional<Light> light;
  std::vector<std::int64_t> envs;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetMesh {
  std::uint32_t world = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetPointCloud {
  std::uint32_t world = 0;
  float spacing_m = 0.0F;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetBoxes {
  std::uint32_t world = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Subscribe {
  double rate_hz = 0.0;
  std::variant<std::monostate, GetArrays, GetLidarData, GetCameraData, GetFps> what;
  bool only_new = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Unsubscribe {
  std::uint64_t stream = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetTask {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct ResetEnvs {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct StepEnvs {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SpawnBodies {
  std::string config_json;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct RemoveBodies {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetBodyPoses {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct SetBodyVelocities {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct GetBodyConfigs {
  std::vector<std::int64_t> envs;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Request {
  std::uint64_t id = 0;
  std::vector<Array> arrays;
  std::variant<std::monostate, Hello, Ping, Claim, Release, GetDrones, SpawnDrone, RemoveDrone, GetCameraCaptureMode,
               SetCameraCaptureMode, GetFps, GetLocation, SetLocation, GetRotation, SetRotation, SetLocationAndRotation,
               GetCameraData, GetLidarData, GetLidarConfig, SetLidarConfig, GetCameraConfig, SetCameraConfig, GetMoveLineVisible,
               SetMoveLineVisible, GetArrays, SetPoses, Fly, SetCommand, Step, SetClock, JoinLockstep, LeaveLockstep, Sense,
               Snapshot, Restore, GetWorlds, SetWorld, GetLight, SetLight, GetMesh, GetPointCloud, GetBoxes, Subscribe,
               Unsubscribe, GetTask, ResetEnvs, StepEnvs, SpawnBodies, RemoveBodies, SetBodyPoses, SetBodyVelocities,
               GetBodyConfigs>
      operation;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Done {
  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Error {
  Code code = {};
  std::string text;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Mounting {
  std::optional<Vector3> offset_m;
  std::optional<Quaternion> rotation;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Welcome {
  std::uint32_t protocol = 0;
  std::string version;
  std::uint32_t client = 0;
  std::int64_t num_envs = 0;
  std::int64_t drones_per_env = 0;
  std::int64_t generation = 0;
  std::vector<std::string> lidars;
  std::vector<std::string> cameras;
  std::vector<std::string> imus;
  bool flies_by_rotors = false;
  bool has_task = false;
  double step_s = 0.0;
  std::vector<std::string> array_names;
  std::vector<Mounting> imu_mountings;
  std::vector<std::string> array_rows;
  std::int64_t bodies_per_env = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Drone {
  std::int64_t drone = 0;
  std::int64_t env = 0;
  std::uint32_t owner = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Drones {
  std::vector<Drone> drones;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct CaptureMode {
  CaptureModeName mode = {};

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Fps {
  double fps = 0.0;
  double real_time_factor = 0.0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Rotation {
  std::optional<Quaternion> quaternion;
  std::optional<Angles> angles;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Impact {
  bool hit = false;
  float fraction = 0.0F;
  std::optional<Vector3> location;
  std::optional<Quaternion> rotation;
  std::optional<Vector3> point;
  std::optional<Vector3> normal;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct CameraData {
  std::int64_t step = 0;
  std::uint32_t width_px = 0;
  std::uint32_t height_px = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct LidarData {
  std::optional<Vector3> origin;
  std::optional<Quaternion> rotation;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct MoveLineVisible {
  bool visible = false;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Time {
  std::int64_t step = 0;
  double time_s = 0.0;
  std::int64_t num_envs = 0;
  std::int64_t generation = 0;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct World {
  std::string name;
  std::uint64_t content_hash = 0;
  std::optional<Vector3> min;
  std::optional<Vector3> max;
  std::optional<Vector3> start;
  std::optional<Vector3> goal;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Worlds {
  std::vector<World> worlds;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Field {
  std::string name;
  DType dtype = {};
  std::vector<std::uint64_t> shape;
  std::vector<double> low;
  std::vector<double> high;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Task {
  std::optional<Field> action;
  std::vector<Field> observation;
  std::vector<std::string> reward_terms;
  std::int64_t num_rows = 0;
  bool row_is_env = false;
  std::string autoreset_mode;
  double policy_hz = 0.0;
  std::int32_t frame_skip = 0;
  std::string episodes;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct BodyConfigs {
  std::vector<std::string> config_json;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

struct Reply {
  std::uint64_t id = 0;
  std::vector<Array> arrays;
  std::variant<std::monostate, Done, Error, Welcome, Drones, Drone, CaptureMode, Fps, Vector3, Rotation, Impact, CameraData,
               LidarData, LidarConfig, CameraConfig, MoveLineVisible, Time, Worlds, Light, Task, BodyConfigs>
      result;

  void write(protozero::pbf_writer& writer) const;
  void read(protozero::pbf_reader reader);
};

}  // namespace flockstep::protocol
