// The sensors' part of Batch.
#include <algorithm>
#include <string>
#include <utility>
#include <vector>

#include "base/require.hpp"
#include "batch/checks.hpp"
#include "batch/selected.hpp"
#include "batch/simulation.hpp"
#include "batch/use.hpp"
#include "flockstep/batch.hpp"

namespace flockstep {

const std::vector<float>& Batch::sensed_position() const { return sim_->pose_sensor.position(); }
const std::vector<float>& Batch::sensed_quat_wxyz() const { return sim_->pose_sensor.quat_wxyz(); }

std::span<const float> Batch::accelerometer() const {
  return sim_->imu ? std::span<const float>(sim_->imu->accelerometer()) : std::span<const float>();
}

std::span<const float> Batch::gyroscope() const {
  return sim_->imu ? std::span<const float>(sim_->imu->gyroscope()) : std::span<const float>();
}

void Batch::require_lidar(std::string_view name) const {
  checks::has_lidar(*sim_);
  require(name.empty() || name == sim_->config.lidar->name, "lidar", '"' + sim_->config.lidar->name + '"',
          '"' + std::string(name) + '"');
}

void Batch::require_scan() const {
  checks::has_lidar(*sim_);
  checks::has_scanned(*sim_);
}

void Batch::set_lidar(const LidarChange& change, DroneMask mask) {
  const Use use(*sim_);
  checks::mask(*sim_, mask);
  checks::has_lidar(*sim_);
  std::vector<DroneIndex> drones;
  for_each_selected(*sim_, mask, [&](DroneIndex drone) { drones.push_back(drone); });
  sim_->lidar->change(change, drones);
}

const std::vector<float>& Batch::lidar_ranges() const {
  static const std::vector<float> none;
  return sim_->lidar ? sim_->lidar->ranges() : none;
}

std::span<const float> Batch::lidar_max_range_m() const {
  checks::has_lidar(*sim_);
  return sim_->lidar->max_range();
}

LidarConfig Batch::lidar_config(std::int64_t index) const {
  const Use use(*sim_);
  checks::has_lidar(*sim_);
  checks::index(*sim_, index);
  return sim_->lidar->config_of(DroneIndex(index));
}

void Batch::lidar_directions(std::span<float> out) const {
  const Use use(*sim_);
  checks::has_lidar(*sim_);
  checks::size(out.size(), 3 * sim_->num_drones() * sim_->lidar->rays_per_drone(), "out");
  sim_->lidar->write_directions(out);
}

void Batch::lidar_points(std::span<float> out) const {
  const Use use(*sim_);
  checks::has_lidar(*sim_);
  checks::size(out.size(), 3 * sim_->num_drones() * sim_->lidar->rays_per_drone(), "out");
  sim_->lidar->write_points(sim_->state, out);
}

std::size_t Batch::camera_index(std::string_view name) const {
  const auto& cameras = sim_->config.cameras;
  if (name.empty() && cameras.size() == 1) return 0;
  const auto found =
      std::find_if(cameras.begin(), cameras.end(), [&](const CameraConfig& camera) { return camera.name == name; });
  if (found == cameras.end()) {
    std::string names;
    for (const CameraConfig& camera : cameras) names += (names.empty() ? "\"" : ", \"") + camera.name + '"';
    refuse("camera", cameras.empty() ? "a Batch with cameras (cameras=[...]; a Task declares camera)" : "one of " + names,
           name.empty() ? "no name" : '"' + std::string(name) + '"');
  }
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
  const Use use(*sim_);
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  return sim_->cameras[camera].config_of(DroneIndex(index));
}

void Batch::capture(std::size_t camera, DroneMask mask) {
  const Use use(*sim_);
  checks::has_camera(*sim_, camera);
  checks::mask(*sim_, mask);
  std::vector<DroneIndex>& drones = sim_->captured;  // in the order of the blocks, so that drones of one world are consecutive
  drones.clear();
  for (const Block& block : sim_->schedule.blocks()) {
    for (const DroneIndex drone : selected_drones(*sim_, block.envs, mask, *sim_->scratches[0])) drones.push_back(drone);
  }
  sim_->cameras.ask_now(camera, drones);
  sim_->cameras.start();
  sim_->cameras.finish(sim_->workers);
}

void Batch::set_capture_mode(std::size_t camera, CaptureMode mode) {
  const Use use(*sim_);
  checks::has_camera(*sim_, camera);
  checks::capture_mode(*sim_, camera, mode);
  sim_->cameras[camera].set_capture_mode(mode);
}

void Batch::set_camera(std::size_t camera, const CameraChange& change, DroneMask mask) {
  const Use use(*sim_);
  checks::has_camera(*sim_, camera);
  checks::mask(*sim_, mask);
  std::vector<DroneIndex> drones;
  for_each_selected(*sim_, mask, [&](DroneIndex drone) { drones.push_back(drone); });
  sim_->cameras[camera].change(change, drones);
}

const std::string& Batch::camera_backend_report() const { return sim_->cameras.report(); }

std::string Batch::take_warning() {
  const Use use(*sim_, std::nothrow);  // whoever is in a call takes it after that
  if (!use.is_granted()) return {};
  return sim_->warning.empty() ? sim_->cameras.take_warning() : std::exchange(sim_->warning, std::string());
}

std::string Batch::jpeg(std::size_t camera, std::int64_t index, int quality) const {
  const Use use(*sim_);
  checks::has_camera(*sim_, camera);
  checks::index(*sim_, index);
  return sim_->cameras.jpeg(camera, DroneIndex(index), quality);
}

}  // namespace flockstep
