// The members of Batch that concern sensors.
#include <algorithm>
#include <cstdint>
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
#include "flockstep/batch.hpp"
#include "flockstep/batch_lock.hpp"
#include "render/move_line.hpp"

namespace flockstep {

namespace {

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

}  // namespace

const PoseReadings& Batch::pose_readings() const { return sim_->suite.pose().readings(); }
const LidarReadings& Batch::lidar_readings(std::size_t lidar) const { return sim_->lidar_readings(lidar); }
const void* Batch::find_readings(const std::type_info& type, std::size_t index) const {
  return sim_->suite.find_readings(type, index);
}

std::vector<ArrayView> Batch::sensor_arrays(std::string_view name) const {
  std::vector<ArrayView> arrays;
  std::vector<std::string> names;
  const auto look = [&](const sensors::Sensor& sensor) {
    names.push_back(sensor.name());
    if (sensor.name() != name) return;
    if (!arrays.empty())
      refuse("sensor", "the name of one sensor", '"' + std::string(name) + "\", which two sensors of different kinds have");
    sensor.list_arrays([&](const ArrayView& array) { arrays.push_back(array); });
  };
  for (const auto& sensor : sim_->suite) look(*sensor);
  for (std::size_t camera = 0; camera < sim_->cameras.size(); ++camera) look(sim_->cameras[camera]);
  if (arrays.empty()) refuse_name("sensor", name, {names.begin(), names.end()});
  return arrays;
}

std::size_t Batch::lidar_index(std::string_view name) const {
  const auto& lidars = sim_->config.lidars;
  if (lidars.empty()) throw std::invalid_argument("this Batch has no LiDAR: give it one (lidar=...; a Task declares lidar)");
  if (name.empty()) return 0;
  const auto found = std::ranges::find(lidars, name, &LidarConfig::name);
  if (found == lidars.end()) refuse_name("lidar", name, names_of(lidars));
  return static_cast<std::size_t>(found - lidars.begin());
}

void Batch::require_scan(std::size_t lidar) const { checks::has_scanned(lidar_of(*sim_, lidar)); }

void Batch::set_lidar(const LidarChange& change, DroneMask mask, std::size_t lidar) {
  if (!change.beams && !change.channels) {
    const CallGuard guard(*lock_);
    checks::mask(*sim_, mask);
    checks::has_lidar(*sim_, lidar);
    sim_->suite.lidars()[lidar]->change(change, selected_list(*sim_, mask));
    return;
  }
  const LongCallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  checks::has_lidar(*sim_, lidar);
  const char* const field = change.beams ? "beams" : "channels";
  const int got = change.beams ? *change.beams : *change.channels;
  BatchConfig config = sim_->config;
  LidarConfig& of_all = config.lidars[lidar];
  require(!of_all.has_pattern(), field, "None for a LiDAR with a beam pattern", got);
  checks::concerns_all(*sim_, mask, field);
  checks::has_no_task(*sim_, field, got);
  checks::can_grow(*lock_, "set_lidar");
  of_all.beams = change.beams.value_or(of_all.beams);
  of_all.channels = change.channels.value_or(of_all.channels);
  std::shared_ptr<Simulation> next = resized(*sim_, std::move(config));
  next->suite.lidars()[lidar]->change(change, selected_list(*next, mask));
  replace(std::move(next));
}

LidarConfig Batch::lidar_config(std::int64_t index, std::size_t lidar) const {
  const CallGuard guard(*lock_);
  const sensors::Lidar& found = lidar_of(*sim_, lidar);
  checks::index(*sim_, index);
  return found.config_of(DroneIndex(index));
}

void Batch::lidar_directions(std::span<float> out, std::size_t lidar) const {
  const CallGuard guard(*lock_);
  const sensors::Lidar& found = lidar_of(*sim_, lidar);
  checks::size(out.size(), 3 * sim_->num_drones() * found.rays_per_drone(), "out");
  found.write_directions(out);
}

void Batch::lidar_directions(std::int64_t index, std::span<float> out, std::size_t lidar) const {
  const CallGuard guard(*lock_);
  const sensors::Lidar& found = lidar_of(*sim_, lidar);
  checks::index(*sim_, index);
  checks::size(out.size(), 3 * found.rays_per_drone(), "out");
  found.write_directions(DroneIndex(index), out);
}

void Batch::scan(std::int64_t index, std::span<float> out, std::size_t lidar) const {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "scan");
  const sensors::Lidar& found = lidar_of(*sim_, lidar);
  checks::index(*sim_, index);
  checks::size(out.size(), found.rays_per_drone(), "out");
  const DroneIndex drone(index);
  trace::Tracer& tracer = sim_->scratches[0]->tracer;
  const EnvIndex env = sim_->env_of(drone);
  const trace::Bodies bodies = sim_->bodies ? sim_->bodies->shapes().of_env(env, sim_->bodies->per_env()) : trace::Bodies();
  found.scan(*sim_->scenes[sim_->slot_of(env)], bodies, sim_->hulls().seen_by(drone, sim_->drones_per_env()),
             pose_of(sim_->state, drone), drone, out.data(), tracer);
  tracer.finish();
}

void Batch::lidar_points(std::span<float> out, std::size_t lidar) const {
  const CallGuard guard(*lock_);
  const sensors::Lidar& found = lidar_of(*sim_, lidar);
  checks::size(out.size(), 3 * sim_->num_drones() * found.rays_per_drone(), "out");
  found.write_points(sim_->state, out);
}

std::size_t Batch::camera_index(std::string_view name) const {
  const auto& cameras = sim_->config.cameras;
  if (cameras.empty()) {
    throw std::invalid_argument("this Batch has no camera: give it one (cameras=[...]; a Task declares camera)");
  }
  if (name.empty() && cameras.size() == 1) return 0;
  const auto found = std::ranges::find(cameras, name, &CameraConfig::name);
  if (found == cameras.end()) refuse_name("camera", name, names_of(cameras));
  return static_cast<std::size_t>(found - cameras.begin());
}

const CameraConfig& Batch::camera_config(std::size_t camera) const {
  checks::has_camera(*sim_, camera);
  return sim_->cameras[camera].config();
}

const CameraImages& Batch::images(std::size_t camera) const {
  checks::has_camera(*sim_, camera);
  return sim_->cameras[camera].images();
}

CameraConfig Batch::camera_config(std::size_t camera, std::int64_t index) const {
  const CallGuard guard(*lock_);
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  return sim_->cameras[camera].config_of(DroneIndex(index));
}

void Batch::capture(std::size_t camera, DroneMask mask) {
  const LongCallGuard guard(*lock_);
  checks::has_camera(*sim_, camera);
  checks::mask(*sim_, mask);
  std::vector<DroneIndex>& drones = sim_->captured;  // in block order: drones of one world are consecutive
  drones.clear();
  for (const Block& block : sim_->schedule.blocks()) {
    for (const DroneIndex drone : selected_drones(*sim_, block.envs, Part::active, mask, *sim_->scratches[0]))
      drones.push_back(drone);
  }
  sim_->cameras.ask_now(camera, drones);
  sim_->cameras.start();
  sim_->cameras.finish(sim_->workers);
}

void Batch::set_capture_mode(std::size_t camera, CaptureMode mode) {
  const CallGuard guard(*lock_);
  checks::has_camera(*sim_, camera);
  checks::capture_mode(*sim_, camera, mode);
  sim_->cameras[camera].set_capture_mode(mode);
}

void Batch::set_camera(std::size_t camera, const CameraChange& change, DroneMask mask) {
  if (!change.width_px && !change.height_px) {
    const CallGuard guard(*lock_);
    checks::has_camera(*sim_, camera);
    checks::mask(*sim_, mask);
    sim_->cameras[camera].change(change, selected_list(*sim_, mask));
    return;
  }
  const LongCallGuard guard(*lock_);
  checks::has_camera(*sim_, camera);
  checks::mask(*sim_, mask);
  const char* const field = change.width_px ? "width_px" : "height_px";
  checks::concerns_all(*sim_, mask, field);
  checks::has_no_task(*sim_, field, change.width_px ? *change.width_px : *change.height_px);
  checks::can_grow(*lock_, "set_camera");
  BatchConfig config = sim_->config;
  CameraConfig& of_all = config.cameras[camera];
  of_all.width_px = change.width_px.value_or(of_all.width_px);
  of_all.height_px = change.height_px.value_or(of_all.height_px);
  std::shared_ptr<Simulation> next = resized(*sim_, std::move(config));
  next->cameras[camera].change(change, selected_list(*next, mask));
  replace(std::move(next));
}

const std::string& Batch::camera_backend_report() const { return sim_->cameras.report(); }

std::string Batch::take_warning() {
  const std::optional<BatchLock> lock = BatchLock::try_lock(*this);  // a thread that is in a call takes it afterwards
  if (!lock) return {};
  return sim_->warning.empty() ? sim_->cameras.take_warning() : std::exchange(sim_->warning, std::string());
}

std::string Batch::jpeg(std::size_t camera, std::int64_t index, int quality) const {
  const CallGuard guard(*lock_);
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  return sim_->cameras.jpeg(camera, DroneIndex(index), quality);
}

// --- move lines and pictures

void Batch::set_move_line_visible(bool visible, DroneMask mask) {
  const CallGuard guard(*lock_);
  checks::mask(*sim_, mask);
  std::vector<DroneIndex> drones;
  for_each_selected(*sim_, mask, [&](DroneIndex drone) { drones.push_back(drone); });
  sim_->move_lines.set_visible(visible, drones);
}

const MoveLineState& Batch::move_lines() const { return sim_->move_lines.flags(); }

std::vector<Vec3> Batch::move_line(std::int64_t index) const {
  const CallGuard guard(*lock_);
  checks::index(*sim_, index);
  const std::span<const Vec3> rows = sim_->move_lines.rows(DroneIndex(index));
  return {rows.begin(), rows.end()};
}

std::vector<std::uint8_t> Batch::picture(std::size_t camera, std::int64_t index) const {
  const CallGuard guard(*lock_);
  checks::not_stepping(*sim_, "picture");  // its frames and tracers may be in use
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  const DroneIndex drone(index);
  std::vector<std::uint8_t> rgb = sim_->cameras.rgb(camera, drone);
  if (!sim_->move_lines.is_any_visible()) return rgb;
  // A line in the current world does not belong into the frame of another.
  if (sim_->cameras[camera].taken_world(drone) != sim_->state.world_index[sim_->env_of(drone)]) return rgb;
  const render::RenderRequest view = sim_->cameras.retake(camera, drone);
  const CameraConfig& config = sim_->cameras[camera].config();
  render::LinePainter painter(view, config.image_width_px(), config.image_height_px(), sim_->scratches[0]->tracer);
  for (std::size_t member = 0; member < sim_->drones_per_env(); ++member) {
    painter.add(sim_->move_lines.rows(sim_->drone_of(sim_->env_of(drone), member)));
  }
  painter.draw(rgb);
  return rgb;
}

}  // namespace flockstep
