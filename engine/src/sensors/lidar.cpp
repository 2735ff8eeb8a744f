#include "sensors/lidar.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <span>
#include <string>
#include <string_view>
#include <vector>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/sensors/lidar.hpp"
#include "sensors/preset.hpp"
#include "sensors/range_errors.hpp"

namespace flockstep {

void RangeErrors::validate() const { check_fields(*this, "lidar.errors."); }

void LidarConfig::validate() const {
  check_fields(*this, "lidar.");
  require(azimuth_deg.size() == elevation_deg.size(), "lidar.elevation_deg",
          "as many values as azimuth_deg (" + std::to_string(azimuth_deg.size()) + ")", elevation_deg.size());
  if (has_pattern()) {  // a pattern replaces the fields of the grid
    const LidarConfig grid;
    const auto beams_of_pattern = static_cast<int>(azimuth_deg.size());
    const char* const unset = "its default, since azimuth_deg and elevation_deg define the beams (leave it out)";
    require(beams == grid.beams || beams == beams_of_pattern, "lidar.beams", unset, beams);
    require(channels == grid.channels, "lidar.channels", unset, channels);
    require(hfov_deg == grid.hfov_deg, "lidar.hfov_deg", unset, hfov_deg);
    require(vfov_deg == grid.vfov_deg, "lidar.vfov_deg", unset, vfov_deg);
  }
  require(errors.resolution_m <= max_range_m, "lidar.errors.resolution_m", "at most lidar.max_range_m", errors.resolution_m);
  require(errors.min_range_m < max_range_m, "lidar.errors.min_range_m", "less than lidar.max_range_m", errors.min_range_m);
  const long long rays = static_cast<long long>(rows()) * columns();
  require(rays <= kMaxRays, "lidar.channels x lidar.beams", "at most 262144 rays", rays);
}

LidarConfig LidarConfig::preset(std::string_view product) {
  // The Mid-360 scans a rosette. The grid of as many beams has its field of view, which is not centred.
  constexpr int kChannels = 40, kBeams = 500;
  LidarConfig mid360{.name = "mid-360", .max_range_m = 40.0F};
  for (int i = 0; i < kChannels * kBeams; ++i) {
    mid360.azimuth_deg.push_back(-180.0F + 360.0F * static_cast<float>(i % kBeams) / kBeams);
    mid360.elevation_deg.push_back(-7.0F + 59.0F * static_cast<float>(i / kBeams) / (kChannels - 1));
  }
  mid360.errors = {.noise_std_m = 0.02F, .resolution_m = 0.001F, .min_range_m = 0.1F};
  constexpr float kZones = 45.0F * 7 / 8;  // deg, between the centres of the outer ones of eight zones in 45 degrees
  const std::array presets{
      LidarConfig{
          .name = "os0-128",
          .channels = 128,
          .beams = 512,
          .hfov_deg = 360.0F,
          .vfov_deg = 90.0F,
          .max_range_m = 35.0F,
          .errors =
              {.noise_std_m = 0.0028F, .noise_per_m = 0.00086F, .resolution_m = 0.001F, .min_range_m = 0.2F, .dropout = 0.01F}},
      LidarConfig{.name = "vlp-16",
                  .channels = 16,
                  .beams = 1800,
                  .hfov_deg = 360.0F,
                  .vfov_deg = 30.0F,
                  .max_range_m = 100.0F,
                  .errors = {.noise_std_m = 0.03F, .resolution_m = 0.002F, .min_range_m = 0.4F}},
      mid360,
      LidarConfig{.name = "tfmini",
                  .beams = 1,
                  .max_range_m = 12.0F,
                  .errors = {.noise_std_m = 0.06F, .noise_per_m = 0.005F, .resolution_m = 0.005F, .min_range_m = 0.3F}},
      LidarConfig{.name = "vl53l1x",
                  .beams = 1,
                  .max_range_m = 4.0F,
                  .errors = {.noise_std_m = 0.02F, .resolution_m = 0.001F, .min_range_m = 0.04F}},
      LidarConfig{.name = "vl53l5cx",
                  .channels = 8,
                  .beams = 8,
                  .hfov_deg = kZones,
                  .vfov_deg = kZones,
                  .max_range_m = 4.0F,
                  .errors = {.noise_std_m = 0.0053F, .resolution_m = 0.001F, .min_range_m = 0.02F, .dropout = 0.01F}},
  };
  return sensors::preset_named(product, presets, "LidarConfig.preset");
}

}  // namespace flockstep

namespace flockstep::sensors {
namespace {

constexpr float kInfinity = std::numeric_limits<float>::infinity();
constexpr std::size_t kManyDrones = 48;     // drones per env; fewer are searched as fast without slices
constexpr std::size_t kDronesPerScan = 16;  // whose slicing takes as long as slices save in one scan

// Returns how many drones at the front of a list are in one env.
std::size_t count_of_env(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  const std::size_t env = surroundings.env_of(drones.front());
  return static_cast<std::size_t>(
      std::ranges::find_if(drones, [&](DroneIndex drone) { return surroundings.env_of(drone) != env; }) - drones.begin());
}

std::size_t rays_of(const LidarConfig& config) {
  return static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns());
}

// Without fans, no change of the beams makes any: worlds may lack the tree that slices need.
trace::TracePolicy policy_of(const LidarConfig& config, TracerKind tracer) {
  trace::TracePolicy policy = trace::trace_policy_of(tracer, rays_of(config));
  if (!has_fans(config, tracer)) policy.min_rays_in_slice = trace::TracePolicy::kNever;
  return policy;
}

}  // namespace

// Errors are added in place: nothing reads the exact ranges, so that they need no memory of their own.
Lidar::Lidar(const LidarConfig& config, const SensorSetup& setup)
    : SensorOf("lidar", config.name, config, setup,
               allocated<LidarReadings>({.num_drones = setup.num_drones, .num_rays = rays_of(config)}), false),
      config_(config),
      policy_(policy_of(config, setup.tracer)),
      rays_(rays_of(config)),
      number_(setup.number),
      settings_(config, setup.num_drones, true, [policy = policy_](const LidarConfig& of) { return make_pattern(of, policy); }) {
  std::ranges::fill(readings_.published().max_range_m, config.max_range_m);
}

std::unique_ptr<BlockSensor> make_sensor(const LidarConfig& config, const SensorSetup& setup) {
  return std::make_unique<Lidar>(config, setup);
}

void Lidar::change(const LidarChange& change, std::span<const DroneIndex> drones) {
  const bool beams_move = change.hfov_deg || change.vfov_deg;
  require(!(beams_move && config_.has_pattern()), change.hfov_deg ? "hfov_deg" : "vfov_deg",
          "None for a LiDAR with a beam pattern", change.hfov_deg.value_or(change.vfov_deg.value_or(0.0F)));
  const auto changed = [&](LidarConfig config) {
    config.max_range_m = change.max_range_m.value_or(config.max_range_m);
    config.hfov_deg = change.hfov_deg.value_or(config.hfov_deg);
    config.vfov_deg = change.vfov_deg.value_or(config.vfov_deg);
    config.offset_m = change.offset_m.value_or(config.offset_m);
    config.quat_wxyz = change.quat_wxyz.value_or(config.quat_wxyz);
    return config;
  };
  changed(config_).validate();  // validates each field, so that a bad one is refused even if no drone is listed
  for (const DroneIndex drone : drones) set_config(drone, changed(config_of(drone)));
}

void Lidar::set_config(DroneIndex drone, const LidarConfig& config) {
  settings_.set(drone, config);
  readings_.published().max_range_m[drone] = settings_[drone].max_range_m;
}

void Lidar::clear(DroneIndex drone) {
  SensorOf::clear(drone);
  std::fill_n(readings_.published().ranges.data() + drone * rays_, rays_, kInfinity);
}

void Lidar::write_directions(DroneIndex drone, std::span<float> out) const {
  sensors::write_directions(settings_.optics(drone), out.data());
}

void Lidar::write_directions(std::span<float> out) const {
  for (std::size_t i = 0; i < settings_.size(); ++i) write_directions(DroneIndex(i), out.subspan(3 * i * rays_, 3 * rays_));
}

void Lidar::write_points(const State& state, std::span<float> out) const {
  write_directions(out);
  for (std::size_t i = 0; i < settings_.size(); ++i) {
    const DroneIndex drone(i);
    const Pose pose = pose_of(state, drone);
    const Vec3 origin = pose.position + pose.rotation * offset_of(drone);
    for (std::size_t ray = 0; ray < rays_; ++ray) {
      float* const row = out.data() + 3 * (drone * rays_ + ray);
      const float range = readings().ranges[drone * rays_ + ray];
      const Vec3 point = std::isfinite(range) ? Vec3(origin + range * (pose.rotation * Vec3(row[0], row[1], row[2])))
                                              : Vec3::Constant(kInfinity);
      for (int axis = 0; axis < 3; ++axis) row[axis] = point[axis];
    }
  }
}

void Lidar::visit(ArrayVisitor& visitor) {
  visitor.array("ranges", readings_.published().ranges);
  if (has_age()) visitor.array("ranges_age_s", readings_.published().age_s);
  visit_delay(visitor);
  settings_.visit(label(), visitor);
}

void Lidar::restored() {
  settings_.restored();
  for (std::size_t i = 0; i < settings_.size(); ++i) readings_.published().max_range_m[i] = settings_[DroneIndex(i)].max_range_m;
  has_scanned_ = true;
}

void Lidar::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  if (!drones.empty() && !has_scanned()) has_scanned_.store(true, std::memory_order_relaxed);
  bool has_slices = false;  // this env's drones are in slices
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const DroneIndex drone = drones[i];
    const trace::Scene& scene = surroundings.scene_of(drone);
    trace::Bodies others = surroundings.drones_seen_by(drone);
    if (others.count >= kManyDrones) {
      if (i == 0 || surroundings.env_of(drones[i - 1]) != surroundings.env_of(drone)) {
        has_slices = kDronesPerScan * count_of_env(drones.subspan(i), surroundings) >= others.count;
        if (has_slices) surroundings.slices.sort(others.balls());
      }
      if (has_slices) others.slices = &surroundings.slices;
    }
    if (i + 2 < drones.size()) {
      if (const trace::Scene& next = surroundings.scene_of(drones[i + 2]); &next != &scene) next.prefetch_parts();
    }
    if (surroundings.bodies_per_env > 0 && i + 1 < drones.size()) surroundings.bodies_of(drones[i + 1]).prefetch_balls();
    scan(scene, surroundings.bodies_of(drone), others, pose_of(surroundings.state, drone), drone,
         readings_.truth().ranges.data() + drone * rays_, surroundings.tracer);
  }
  surroundings.tracer.finish();
}

void Lidar::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (config_.errors == RangeErrors()) return;
  float* const ranges = readings_.truth().ranges.data();
  for (const DroneIndex drone : drones) add_errors(drone, state, {ranges + drone * rays_, rays_});
}

void Lidar::add_errors(DroneIndex drone, const State& state, std::span<float> ranges) const {
  const RandomKey key = RandomKey::of(drone, drones_per_env_);
  const auto draws = static_cast<std::uint32_t>((rays_ + 1) / 2);  // of a reading
  const std::uint32_t first = draws * reading_of(state, key.env);
  add_range_errors(config_.errors, settings_[drone].max_range_m,
                   input_of_draw(state, key, stream_named("range errors"), first, number_), ranges);
}

void Lidar::scan(const trace::Scene& scene, const trace::Bodies& bodies, const trace::Bodies& drones, const Pose& pose,
                 DroneIndex drone, float* ranges, trace::Tracer& tracer) const {
  const BeamPattern& pattern = settings_.optics(drone);
  const Mat3 rotation = pose.rotation.toRotationMatrix();
  tracer.set_viewpoint(scene, {.origin = pose.position + trace::rotated(rotation, offset_of(drone)),
                               .rotation = rotation,
                               .range = settings_[drone].max_range_m,
                               .bodies = &bodies,
                               .drones = &drones,
                               .policy = policy_});
  for (const BeamTile& tile : pattern.tiles) {
    tracer.enqueue({.x = pattern.x.data() + tile.first,
                    .y = pattern.y.data() + tile.first,
                    .z = pattern.z.data() + tile.first,
                    .rows = tile.rows,
                    .width = tile.width,
                    .frustum = &tile.frustum,
                    .view = tile.view < 0 ? nullptr : &pattern.views[static_cast<std::size_t>(tile.view)],
                    .fan = tile.fan < 0 ? nullptr : &pattern.fans[static_cast<std::size_t>(tile.fan)]},
                   ranges + tile.channel * pattern.columns + tile.beam, pattern.columns);
  }
}

}  // namespace flockstep::sensors
