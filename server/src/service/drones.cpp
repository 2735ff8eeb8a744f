// Operations on one drone, and those that make and remove drones.
#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <sstream>

#include "base/pose_access.hpp"
#include "base/require.hpp"
#include "flockstep/planning.hpp"
#include "service/convert.hpp"
#include "service/service.hpp"

namespace flockstep::server {
namespace {

using protocol::Code;

constexpr float kDegree = std::numbers::pi_v<float> / 180.0F;

protocol::Quaternion quaternion_of(const protocol::Angles& angles) {
  const Quat q = quat_from_rpy(kDegree * angles.roll_deg, kDegree * angles.pitch_deg, kDegree * angles.yaw_deg);
  return {.w = q.w(), .x = q.x(), .y = q.y(), .z = q.z()};
}

protocol::Angles angles_of(const protocol::Quaternion& q) {
  const Vec3 degrees = (rpy_from_quat({q.w, q.x, q.y, q.z}) * (180.0 / std::numbers::pi)).cast<float>();
  return {.roll_deg = degrees[0], .pitch_deg = degrees[1], .yaw_deg = degrees[2]};
}

// A row of one of the batch's own arrays, which each source has.
template <class T>
const T* row(const ArraySource& arrays, const char* name, std::size_t row, std::size_t columns) {
  return static_cast<const T*>(arrays.find("", name)->data) + columns * row;
}

std::size_t require_active(const ArraySource& arrays, std::int64_t drone) {
  if (drone < 0 || drone >= arrays.num_drones || *row<std::uint8_t>(arrays, "active", static_cast<std::size_t>(drone), 1) == 0) {
    throw Refusal(Code::kNotFound, "drone: expected the index of an active drone, got " + std::to_string(drone));
  }
  return static_cast<std::size_t>(drone);
}

protocol::CaptureModeName message_of(CaptureMode mode) { return static_cast<protocol::CaptureModeName>(mode); }
static_assert(static_cast<int>(CaptureMode::every_step) == static_cast<int>(protocol::CaptureModeName::kEveryStep) &&
              static_cast<int>(CaptureMode::on_movement) == static_cast<int>(protocol::CaptureModeName::kOnMovement) &&
              static_cast<int>(CaptureMode::on_demand) == static_cast<int>(protocol::CaptureModeName::kOnDemand));

// The quaternion of a request that has one, or angles.
template <class Rotation>
protocol::Quaternion given_rotation(const Rotation& rotation) {
  require(rotation.index() != 0, "rotation", "a quaternion or angles", "none");
  const auto* const angles = std::get_if<protocol::Angles>(&rotation);
  return angles ? quaternion_of(*angles) : std::get<protocol::Quaternion>(rotation);
}

}  // namespace

// --------------------------------------------------------------------------------------------------------------- simulation

void Service::read(Call& call, const protocol::GetDrones&, const ArraySource& arrays) {
  auto& drones = call.result<protocol::Drones>().drones;
  const auto* const active = row<std::uint8_t>(arrays, "active", 0, 1);
  const std::scoped_lock lock(owners_mutex_);
  for (std::int64_t drone = 0; drone < arrays.num_drones; ++drone) {
    if (active[drone] == 0) continue;
    const auto owner = owners_.find(drone);
    drones.push_back({.drone = drone, .env = drone / arrays.drones_per_env, .owner = owner == owners_.end() ? 0 : owner->second});
  }
}

void Service::locked(Call& call, const protocol::SpawnDrone& spawn) {
  require(task_ == nullptr, "SpawnDrone", "a batch without a task, whose episodes place the drones", "one with a task");
  std::vector<std::int64_t> env;
  if (spawn.env) env.push_back(*spawn.env);
  const auto [its_env, renumbers] = ServedBatch::next_slot(batch_, env);
  if (renumbers) {
    throw Refusal(Code::kFailedPrecondition,
                  "no slot is free, and a batch with several envs of several drones cannot grow while it is served: that would "
                  "change the indices of its drones");
  }
  const std::array<float, 4> rotation = spawn.rotation ? array_of(*spawn.rotation) : std::array{1.0F, 0.0F, 0.0F, 0.0F};
  const std::optional<std::array<float, 3>> given = spawn.location ? std::optional(array_of(*spawn.location)) : std::nullopt;
  const std::array<float, 3> position = spawn_place(its_env, given, rotation);
  begin_change();
  const std::int64_t drone = batch_.spawn({}, position, rotation, {}, env).front();
  refresh_info();
  clear_command(static_cast<std::size_t>(drone));  // a drone that the program has removed keeps none, nor the claim
  {
    const std::scoped_lock lock(owners_mutex_);
    owners_.erase(drone);
    if (spawn.claim) owners_[drone] = call.client->number;
  }
  auto& result = call.result<protocol::Drone>();
  result.drone = drone;
  result.env = drone / batch_.config().drones_per_env;
  result.owner = spawn.claim ? call.client->number : 0;
}

std::array<float, 3> Service::spawn_place(EnvIndex env, const std::optional<std::array<float, 3>>& location,
                                          const std::array<float, 4>& rotation) const {
  const bool is_new = env >= static_cast<std::size_t>(batch_.config().num_envs);
  const World& world = is_new ? *batch_.worlds()[env % batch_.worlds().size()] : *batch_.world_of(env);
  const Vec3 start = world.drone_start();
  const std::array<float, 3> usual = location.value_or(std::array{start.x(), start.y(), start.z()});
  const Quat given(rotation[0], rotation[1], rotation[2], rotation[3]);
  const bool is_pose = is_in_world(Vec3::Map(usual.data())) && std::abs(given.norm() - 1.0F) < 1e-2F;
  if (!is_pose) return usual;  // which the batch refuses
  const Quat turned = given.normalized();
  const auto is_free = [&](const Vec3& place) {
    const float below = world.bounds().min.z();  // the hull touches nothing under a floor of triangles
    return place.z() >= below &&
           (is_new ? flockstep::is_free(world, batch_.drone(), {place, turned}) : batch_.is_free(env, {place, turned}));
  };
  const auto& [x, y, z] = usual;
  if (is_free({x, y, z})) return usual;
  if (location) {
    std::ostringstream text;
    text << "location: expected a place where the drone touches nothing, got (" << x << ", " << y << ", " << z << ')';
    throw Refusal(Code::kInvalidArgument, text.str());
  }
  // In larger and larger boxes, places that the drone can reach from the start.
  FreePlacesConfig config{.seed = static_cast<std::uint64_t>(std::ranges::count(batch_.state().active, 1))};
  if (flockstep::is_free(world, batch_.drone(), {start, Quat::Identity()})) config.reachable_from = start;
  for (const float half : {2.0F, 4.0F, 8.0F, 16.0F}) {
    const Vec3 reach = Vec3::Constant(half);
    config.box = Aabb{(start - reach).cwiseMax(world.bounds().min), (start + reach).cwiseMin(world.bounds().max)};
    try {
      for (const Vec3& place : free_places(world, batch_.drone(), 64, config)) {
        if (is_free(place)) return {place.x(), place.y(), place.z()};
      }
    } catch (const std::invalid_argument&) {  // no place in this box
    }
  }
  throw Refusal(Code::kFailedPrecondition, "no free place within 16 m of the start of the world: give a location");
}

void Service::locked(Call& call, const protocol::RemoveDrone& remove) {
  const std::size_t drone = require_drone(remove.drone);
  require_may_change(call, remove.drone);
  begin_change();
  batch_.remove(std::array{remove.drone});
  clear_command(drone);
  const std::scoped_lock lock(owners_mutex_);
  owners_.erase(remove.drone);
}

void Service::locked(Call& call, const protocol::GetCameraCaptureMode& get) {
  call.result<protocol::CaptureMode>().mode = message_of(batch_.camera(get.camera).config().capture_mode);
}

void Service::locked(Call& call, const protocol::SetCameraCaptureMode& set) {
  require_may_change(call, std::span<const std::uint8_t>());
  batch_.camera(set.camera).set_capture_mode(static_cast<CaptureMode>(set.mode));
  refresh_info();
}

// --------------------------------------------------------------------------------------------------------- position and motion

void Service::read(Call& call, const protocol::GetLocation& get, const ArraySource& arrays) {
  call.result<protocol::Vector3>() = vector_at(row<float>(arrays, "position", require_active(arrays, get.drone), 3));
}

void Service::read(Call& call, const protocol::GetRotation& get, const ArraySource& arrays) {
  auto& rotation = call.result<protocol::Rotation>();
  rotation.quaternion = quaternion_at(row<float>(arrays, "quat_wxyz", require_active(arrays, get.drone), 4));
  rotation.angles = angles_of(*rotation.quaternion);
}

void Service::locked(Call& call, const protocol::SetLocation& set) {
  require(set.location.has_value(), "location", "a value", "none");
  move(call, set.drone, set.location, {}, set.teleport);
}

void Service::locked(Call& call, const protocol::SetRotation& set) {
  move(call, set.drone, {}, given_rotation(set.rotation), set.teleport);
}

void Service::locked(Call& call, const protocol::SetLocationAndRotation& set) {
  require(set.location.has_value(), "location", "a value", "none");
  move(call, set.drone, set.location, given_rotation(set.rotation), set.teleport);
}

void Service::require_may_move(bool teleport) const {
  if (teleport || batch_.config().dynamics.is_kinematic()) return;
  throw Refusal(Code::kFailedPrecondition,
                "these drones fly by their rotors: Fly and SetCommand move them, and with teleport=true they are placed");
}

void Service::move(Call& call, std::int64_t index, const std::optional<protocol::Vector3>& location,
                   const std::optional<protocol::Quaternion>& rotation, bool teleport) {
  const std::size_t drone = require_drone(index);
  require_may_change(call, index);
  require_may_move(teleport);
  std::span<const float> positions, rotations;
  if (location) {
    std::ranges::copy(array_of(*location), positions_.begin() + static_cast<std::ptrdiff_t>(3 * drone));
    positions = positions_;
  }
  if (rotation || !batch_.config().dynamics.is_kinematic()) {  // without one, set_pose() would make a drone with rotors level
    const std::array<float, 4> q = array_of(rotation ? *rotation : quaternion_at(&batch_.state().quat_wxyz[4 * drone]));
    std::ranges::copy(q, rotations_.begin() + static_cast<std::ptrdiff_t>(4 * drone));
    rotations = rotations_;
  }
  changes_.fetch_add(1, std::memory_order_relaxed);
  if (teleport) {
    batch_.set_pose(positions, rotations, only(drone));
  } else {
    batch_.move(positions, rotations, only(drone));
  }
  const State& state = batch_.state();
  auto& impact = call.result<protocol::Impact>();
  impact.hit = state.contact.hit[drone] != 0;
  impact.fraction = teleport ? 1.0F : state.contact.fraction[drone];
  impact.location = vector_at(&state.position[3 * drone]);
  impact.rotation = quaternion_at(&state.quat_wxyz[4 * drone]);
  if (!impact.hit) return;
  impact.point = vector_at(&state.contact.point[3 * drone]);
  impact.normal = vector_at(&state.contact.normal[3 * drone]);
}

// --------------------------------------------------------------------------------------------------------------------- sensors

void Service::locked(Call& call, const protocol::GetLidarData& get) {
  const std::size_t drone = require_drone(get.drone), lidar = batch_.lidar(get.lidar).index();
  const LidarConfig config = batch_.lidar(lidar).config(DroneIndex(get.drone));
  const auto rows = static_cast<std::size_t>(config.rows()), columns = static_cast<std::size_t>(config.columns());
  ranges_.resize(rows * columns);
  batch_.lidar(lidar).scan(DroneIndex(get.drone), ranges_);
  call.writer.add("ranges", std::span<const float>(ranges_), {rows, columns});
  if (!get.without_directions) {
    directions_.resize(3 * rows * columns);
    batch_.lidar(lidar).directions(DroneIndex(get.drone), directions_);
    call.writer.add("directions", std::span<const float>(directions_), {rows, columns, std::size_t{3}});
  }
  const Pose pose = pose_of(batch_.state(), DroneIndex(drone));
  auto& data = call.result<protocol::LidarData>();
  data.origin = message_of(pose.position + pose.rotation * Vec3::Map(config.offset_m.data()));
  data.rotation = quaternion_at(&batch_.state().quat_wxyz[4 * drone]);
}

void Service::locked(Call& call, const protocol::GetLidarConfig& get) {
  require_drone(get.drone);
  call.result<protocol::Config>().config_json = json_of(batch_.lidar(get.lidar).config(DroneIndex(get.drone))).dump();
}

DroneMask Service::require_drones(const Call& call, std::int64_t index, bool concerns_all) {
  const std::size_t drone = index == -1 ? 0 : require_drone(index);
  if (index == -1 || concerns_all) {
    require_may_change(call, std::span<const std::uint8_t>());
    return {};
  }
  require_may_change(call, index);
  return only(drone);
}

void Service::locked(Call& call, const protocol::SetLidarConfig& set) {
  LidarChange change;
  read_json(set.config_json, "lidar", change);
  const DroneMask mask = require_drones(call, set.drone, change.beams || change.channels);
  begin_change();
  batch_.lidar(set.lidar).set(change, mask);
  refresh_info();
}

void Service::locked(Call& call, const protocol::GetCameraConfig& get) {
  require_drone(get.drone);
  CameraConfig config = batch_.camera(get.camera).config(DroneIndex(get.drone));
  const auto fov_deg = [&](int pixels, float focal) {
    const float half = static_cast<float>(pixels) / 2.0F / focal;
    return 2.0F * (config.projection == Projection::fisheye ? half : std::atan(half)) / kDegree;
  };
  const float hfov_deg = fov_deg(config.width_px, config.fx());
  config.vfov_deg = fov_deg(config.height_px, config.fy());
  config.hfov_deg = hfov_deg;
  call.result<protocol::Config>().config_json = json_of(config).dump();
}

void Service::locked(Call& call, const protocol::SetCameraConfig& set) {
  CameraChange change;
  read_json(set.config_json, "camera", change);
  const DroneMask mask = require_drones(call, set.drone, change.width_px || change.height_px);
  begin_change();
  batch_.camera(set.camera).set(change, mask);
  refresh_info();
}

void Service::locked(Call& call, const protocol::GetMoveLineVisible& get) {
  call.result<protocol::Visible>().visible = batch_.move_lines().state().move_line_visible[require_drone(get.drone)] != 0;
}

void Service::locked(Call& call, const protocol::SetMoveLineVisible& set) {
  const std::size_t drone = require_drone(set.drone);
  require_may_change(call, set.drone);
  has_lines_ = has_lines_ || set.visible;
  batch_.move_lines().set_visible(set.visible, only(drone));
}

void Service::locked(Call& call, const protocol::GetBeamsVisible& get) {
  call.result<protocol::Visible>().visible = batch_.move_lines().state().beams_visible[require_drone(get.drone)] != 0;
}

void Service::locked(Call& call, const protocol::SetBeamsVisible& set) {
  const std::size_t drone = require_drone(set.drone);
  require_may_change(call, set.drone);
  has_lines_ = has_lines_ || set.visible;
  batch_.move_lines().set_beams_visible(set.visible, only(drone));
}

}  // namespace flockstep::server
