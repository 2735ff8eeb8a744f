// The members of Batch that concern sensors.
#include <algorithm>
#include <cstdint>
#include <limits>
#include <memory>
#include <optional>
#include <stdexcept>
#include <string>
#include <string_view>
#include <utility>
#include <vector>

#include "base/nearest_name.hpp"
#include "base/require.hpp"
#include "batch/call_lock.hpp"
#include "batch/checks.hpp"
#include "batch/growth.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "batch/step.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/batch_lock.hpp"
#include "render/move_line.hpp"

namespace flockstep {

namespace {

const Vec3 kNoPoint = Vec3::Constant(std::numeric_limits<float>::quiet_NaN());  // separates two lines

[[noreturn]] void refuse_name(std::string_view kind, std::string_view name, const std::vector<std::string_view>& known) {
  std::string names;
  for (const std::string_view one : known) names += (names.empty() ? "\"" : ", \"") + std::string(one) + '"';
  refuse(kind, known.size() == 1 ? names : "one of " + names,
         name.empty() ? "no name" : '"' + std::string(name) + '"' + did_you_mean(name, known));
}

template <class Config>
std::vector<std::string_view> names_of(const std::vector<Config>& configs) {
  std::vector<std::string_view> names;
  for (const Config& config : configs) names.push_back(config.name);
  return names;
}

std::vector<DroneIndex> selected_list(const Simulation& sim, DroneMask mask) {
  std::vector<DroneIndex> drones;
  for_each_selected(sim, mask, [&](DroneIndex drone) { drones.push_back(drone); });
  return drones;
}

const sensors::Lidar& lidar_of(const Simulation& sim, std::size_t lidar) {
  checks::has_lidar(sim, lidar);
  return *sim.suite.lidars()[lidar];
}

// Scans from the drone's pose, between steps.
void scan_now(const Simulation& sim, const sensors::Lidar& lidar, DroneIndex drone, bool has_errors, std::span<float> out) {
  lidar.scan(drone, surroundings_of(sim, *sim.scratches[0]), has_errors, out);
}

// Returns the lines of the beams of all LiDARs of a drone, scanned now. A beam without a hit is as long as the range.
std::vector<Vec3> beams_of(const Simulation& sim, DroneIndex drone) {
  std::vector<Vec3> lines;
  const Pose pose = pose_of(sim.state, drone);
  for (const auto& lidar : sim.suite.lidars()) {
    const LidarConfig config = lidar->config_of(drone);
    const Vec3 origin = pose.position + pose.rotation * Vec3::Map(config.offset_m.data());
    std::vector<float> ranges(lidar->rays_per_drone()), directions(3 * ranges.size());
    scan_now(sim, *lidar, drone, false, ranges);
    lidar->write_directions(drone, directions);
    for (std::size_t ray = 0; ray < ranges.size(); ++ray) {
      const float length = std::min(ranges[ray], config.max_range_m);
      lines.insert(lines.end(), {origin, origin + length * (pose.rotation * Vec3::Map(&directions[3 * ray])), kNoPoint});
    }
  }
  return lines;
}

}  // namespace

const PoseReadings& Batch::pose_readings() const { return sim_->suite.pose().readings(); }
const void* Batch::find_readings(const std::type_info& type, std::size_t index) const {
  return sim_->suite.find_readings(type, index);
}

std::vector<ArrayView> Batch::sensor_arrays(std::string_view name) const {
  std::vector<ArrayView> arrays;
  std::vector<std::string> names;
  const auto look = [&](const sensors::Sensor& sensor) {
    names.push_back(sensor.name());
    if (sensor.name() != name && sensor.label() != name) return;
    if (!arrays.empty()) {
      refuse("sensor", "its kind before the name that sensors of two kinds have, as in \"" + sensor.label() + '"',
             '"' + std::string(name) + '"');
    }
    sensor.list_arrays([&](const ArrayView& array) { arrays.push_back(array); });
  };
  for (const auto& sensor : sim_->suite) look(*sensor);
  for (std::size_t camera = 0; camera < sim_->cameras.size(); ++camera) look(sim_->cameras[camera]);
  if (arrays.empty()) refuse_name("sensor", name, {names.begin(), names.end()});
  return arrays;
}

// --- LiDARs. A facet for reading is const, and none of its calls changes the batch that it was made from.

Batch::Lidar Batch::lidar(std::size_t index) { return {*this, index}; }
const Batch::Lidar Batch::lidar(std::size_t index) const { return {const_cast<Batch&>(*this), index}; }
Batch::Lidar Batch::lidar(std::string_view name) { return {*this, std::as_const(*this).lidar(name).index()}; }
const Batch::Lidar Batch::lidar(std::string_view name) const {
  const auto& lidars = sim_->config.lidars;
  if (lidars.empty()) throw std::invalid_argument("this Batch has no LiDAR: give it one (lidar=...; a Task declares lidar)");
  if (name.empty()) return lidar(0);
  const auto found = std::ranges::find(lidars, name, &LidarConfig::name);
  if (found == lidars.end()) refuse_name("lidar", name, names_of(lidars));
  return lidar(static_cast<std::size_t>(found - lidars.begin()));
}

const LidarReadings& Batch::Lidar::readings() const { return batch_->sim_->lidar_readings(index_); }

void Batch::Lidar::require_scan() const { checks::has_scanned(lidar_of(*batch_->sim_, index_)); }

void Batch::Lidar::set(const LidarChange& change, DroneMask mask) {
  if (!change.beams && !change.channels) {
    const CallGuard guard(*batch_->lock_);
    checks::mask(*batch_->sim_, mask);
    checks::has_lidar(*batch_->sim_, index_);
    batch_->sim_->suite.lidars()[index_]->change(change, selected_list(*batch_->sim_, mask));
    return;
  }
  const LongCallGuard guard(*batch_->lock_);
  checks::mask(*batch_->sim_, mask);
  checks::has_lidar(*batch_->sim_, index_);
  const char* const field = change.beams ? "beams" : "channels";
  const int got = change.beams ? *change.beams : *change.channels;
  BatchConfig config = batch_->sim_->config;
  LidarConfig& of_all = config.lidars[index_];
  require(!of_all.has_pattern(), field, "None for a LiDAR with a beam pattern", got);
  checks::concerns_all(*batch_->sim_, mask, field);
  checks::has_no_task(*batch_->sim_, field, got);
  checks::can_grow(*batch_->lock_, "set_lidar");
  of_all.beams = change.beams.value_or(of_all.beams);
  of_all.channels = change.channels.value_or(of_all.channels);
  std::shared_ptr<Simulation> next = resized(*batch_->sim_, std::move(config));
  next->suite.lidars()[index_]->change(change, selected_list(*next, mask));
  batch_->replace(std::move(next));
}

LidarConfig Batch::Lidar::config(DroneIndex drone) const {
  const CallGuard guard(*batch_->lock_);
  const sensors::Lidar& found = lidar_of(*batch_->sim_, index_);
  checks::index(*batch_->sim_, drone);
  return found.config_of(drone);
}

void Batch::Lidar::directions(std::span<float> out) const {
  const CallGuard guard(*batch_->lock_);
  const sensors::Lidar& found = lidar_of(*batch_->sim_, index_);
  checks::size(out.size(), 3 * batch_->sim_->num_drones() * found.rays_per_drone(), "out");
  found.write_directions(out);
}

void Batch::Lidar::directions(DroneIndex drone, std::span<float> out) const {
  const CallGuard guard(*batch_->lock_);
  const sensors::Lidar& found = lidar_of(*batch_->sim_, index_);
  checks::index(*batch_->sim_, drone);
  checks::size(out.size(), 3 * found.rays_per_drone(), "out");
  found.write_directions(drone, out);
}

void Batch::Lidar::scan(DroneIndex drone, std::span<float> out) const {
  const CallGuard guard(*batch_->lock_);
  checks::not_stepping(*batch_->sim_, "scan");
  const sensors::Lidar& found = lidar_of(*batch_->sim_, index_);
  checks::index(*batch_->sim_, drone);
  checks::size(out.size(), found.rays_per_drone(), "out");
  scan_now(*batch_->sim_, found, drone, true, out);
}

void Batch::Lidar::points(std::span<float> out) const {
  const CallGuard guard(*batch_->lock_);
  const sensors::Lidar& found = lidar_of(*batch_->sim_, index_);
  checks::size(out.size(), 3 * batch_->sim_->num_drones() * found.rays_per_drone(), "out");
  found.write_points(batch_->sim_->state, out);
}

// --- cameras

Batch::Camera Batch::camera(std::size_t index) { return {*this, index}; }
const Batch::Camera Batch::camera(std::size_t index) const { return {const_cast<Batch&>(*this), index}; }
Batch::Camera Batch::camera(std::string_view name) { return {*this, std::as_const(*this).camera(name).index()}; }
const Batch::Camera Batch::camera(std::string_view name) const {
  const auto& cameras = sim_->config.cameras;
  if (cameras.empty()) {
    throw std::invalid_argument("this Batch has no camera: give it one (cameras=[...]; a Task declares camera)");
  }
  if (name.empty() && cameras.size() == 1) return camera(0);
  const auto found = std::ranges::find(cameras, name, &CameraConfig::name);
  if (found == cameras.end()) refuse_name("camera", name, names_of(cameras));
  return camera(static_cast<std::size_t>(found - cameras.begin()));
}

const CameraConfig& Batch::Camera::config() const {
  checks::has_camera(*batch_->sim_, index_);
  return batch_->sim_->cameras[index_].config();
}

const CameraImages& Batch::Camera::images() const {
  checks::has_camera(*batch_->sim_, index_);
  return batch_->sim_->cameras[index_].images();
}

CameraConfig Batch::Camera::config(DroneIndex drone) const {
  const CallGuard guard(*batch_->lock_);
  checks::has_camera(*batch_->sim_, index_);
  checks::index(*batch_->sim_, drone);
  return batch_->sim_->cameras[index_].config_of(drone);
}

void Batch::Camera::capture(DroneMask mask) {
  const LongCallGuard guard(*batch_->lock_);
  checks::has_camera(*batch_->sim_, index_);
  checks::mask(*batch_->sim_, mask);
  std::vector<DroneIndex>& drones = batch_->sim_->captured;  // in block order: drones of one world are consecutive
  drones.clear();
  for (const Block& block : batch_->sim_->schedule.blocks()) {
    for (const DroneIndex drone : selected_drones(*batch_->sim_, block.envs, Part::active, mask, *batch_->sim_->scratches[0]))
      drones.push_back(drone);
  }
  batch_->sim_->cameras.ask_now(index_, drones);
  batch_->sim_->cameras.start();
  batch_->sim_->cameras.finish(batch_->sim_->workers);
}

void Batch::Camera::set_capture_mode(CaptureMode mode) {
  const CallGuard guard(*batch_->lock_);
  checks::has_camera(*batch_->sim_, index_);
  checks::capture_mode(*batch_->sim_, index_, mode);
  batch_->sim_->cameras[index_].set_capture_mode(mode);
}

void Batch::Camera::set(const CameraChange& change, DroneMask mask) {
  if (!change.width_px && !change.height_px) {
    const CallGuard guard(*batch_->lock_);
    checks::has_camera(*batch_->sim_, index_);
    checks::mask(*batch_->sim_, mask);
    batch_->sim_->cameras[index_].change(change, selected_list(*batch_->sim_, mask));
    return;
  }
  const LongCallGuard guard(*batch_->lock_);
  checks::has_camera(*batch_->sim_, index_);
  checks::mask(*batch_->sim_, mask);
  const char* const field = change.width_px ? "width_px" : "height_px";
  checks::concerns_all(*batch_->sim_, mask, field);
  checks::has_no_task(*batch_->sim_, field, change.width_px ? *change.width_px : *change.height_px);
  checks::can_grow(*batch_->lock_, "set_camera");
  BatchConfig config = batch_->sim_->config;
  CameraConfig& of_all = config.cameras[index_];
  of_all.width_px = change.width_px.value_or(of_all.width_px);
  of_all.height_px = change.height_px.value_or(of_all.height_px);
  std::shared_ptr<Simulation> next = resized(*batch_->sim_, std::move(config));
  next->cameras[index_].change(change, selected_list(*next, mask));
  batch_->replace(std::move(next));
}

std::string Batch::Camera::jpeg(DroneIndex drone, int quality) const {
  const CallGuard guard(*batch_->lock_);
  checks::has_camera(*batch_->sim_, index_);
  checks::index(*batch_->sim_, drone);
  return batch_->sim_->cameras.jpeg(index_, drone, quality);
}

std::vector<std::uint8_t> Batch::Camera::picture(DroneIndex drone) const {
  const CallGuard guard(*batch_->lock_);
  checks::not_stepping(*batch_->sim_, "picture");  // its frames and tracers may be in use
  checks::has_camera(*batch_->sim_, index_);
  checks::index(*batch_->sim_, drone);
  std::vector<std::uint8_t> rgb = batch_->sim_->cameras.rgb(index_, drone);
  const FlagArray& beams = batch_->sim_->move_lines.flags().beams_visible;
  if (!batch_->sim_->move_lines.is_any_visible() && std::ranges::count(beams, 1) == 0) return rgb;
  // A line in the current world does not belong into the frame of another, or into one of a while ago.
  if (batch_->sim_->cameras[index_].is_late() ||
      batch_->sim_->cameras[index_].taken_world(drone) != batch_->sim_->state.world_index[batch_->sim_->env_of(drone)])
    return rgb;
  std::vector<Vec3> lines;  // the scans use the painter's tracer, so they come first
  for (std::size_t member = 0; member < batch_->sim_->drones_per_env(); ++member) {
    const DroneIndex other = batch_->sim_->drone_of(batch_->sim_->env_of(drone), member);
    if (!beams[other]) continue;
    const std::vector<Vec3> of_drone = beams_of(*batch_->sim_, other);
    lines.insert(lines.end(), of_drone.begin(), of_drone.end());
  }
  const render::RenderRequest view = batch_->sim_->cameras.retake(index_, drone);
  const CameraConfig& config = batch_->sim_->cameras[index_].config();
  render::LinePainter painter(view, config.image_width_px(), config.image_height_px(), batch_->sim_->scratches[0]->tracer);
  painter.add(lines);
  painter.draw(rgb, render::kBeamColor);
  for (std::size_t member = 0; member < batch_->sim_->drones_per_env(); ++member) {
    painter.add(batch_->sim_->move_lines.rows(batch_->sim_->drone_of(batch_->sim_->env_of(drone), member)));
  }
  painter.draw(rgb);
  return rgb;
}

const std::string& Batch::camera_backend_report() const { return sim_->cameras.report(); }

std::string Batch::take_warning() {
  const std::optional<BatchLock> lock = BatchLock::try_lock(*this);  // a thread that is in a call takes it afterwards
  if (!lock) return {};
  return sim_->warning.empty() ? sim_->cameras.take_warning() : std::exchange(sim_->warning, std::string());
}

// --- move lines

Batch::MoveLines Batch::move_lines() { return MoveLines(*this); }
const Batch::MoveLines Batch::move_lines() const { return MoveLines(const_cast<Batch&>(*this)); }

void Batch::MoveLines::set_visible(bool visible, DroneMask mask) {
  const CallGuard guard(*batch_->lock_);
  checks::mask(*batch_->sim_, mask);
  batch_->sim_->move_lines.set_visible(visible, selected_list(*batch_->sim_, mask));
}

void Batch::MoveLines::set_beams_visible(bool visible, DroneMask mask) {
  const CallGuard guard(*batch_->lock_);
  checks::mask(*batch_->sim_, mask);
  batch_->sim_->move_lines.set_beams_visible(visible, selected_list(*batch_->sim_, mask));
}

const MoveLineState& Batch::MoveLines::state() const { return batch_->sim_->move_lines.flags(); }

std::vector<Vec3> Batch::MoveLines::path(DroneIndex drone) const {
  const CallGuard guard(*batch_->lock_);
  checks::index(*batch_->sim_, drone);
  const std::span<const Vec3> rows = batch_->sim_->move_lines.rows(drone);
  return {rows.begin(), rows.end()};
}

}  // namespace flockstep
