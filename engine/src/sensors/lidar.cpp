#include "sensors/lidar.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <span>
#include <string>
#include <string_view>

#include "base/check_fields.hpp"
#include "base/random.hpp"
#include "base/require.hpp"
#include "flockstep/sensors/lidar.hpp"
#include "sensors/presets.hpp"
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
    require(vfov_center_deg == grid.vfov_center_deg, "lidar.vfov_center_deg", unset, vfov_center_deg);
  }
  require(channels == 1 || std::abs(vfov_center_deg) + 0.5F * vfov_deg <= 90.0F, "lidar.vfov_center_deg",
          "at most 90 - vfov_deg / 2 from 0", vfov_center_deg);
  require(errors.resolution_m <= max_range_m, "lidar.errors.resolution_m", "at most lidar.max_range_m", errors.resolution_m);
  require(errors.min_range_m < max_range_m, "lidar.errors.min_range_m", "less than lidar.max_range_m", errors.min_range_m);
  const long long rays = static_cast<long long>(rows()) * columns();
  require(rays <= kMaxRays, "lidar.channels x lidar.beams", "at most 262144 rays", rays);
}

LidarConfig LidarConfig::preset(std::string_view product) {
  const LidarConfig vl53l1x{.name = "vl53l1x",
                            .beams = 1,
                            .max_range_m = 4.0F,
                            .errors = {.noise_std_m = 0.02F, .resolution_m = 0.001F, .min_range_m = 0.04F}};
  const auto turned = [&](const char* name, const std::array<float, 4>& quat_wxyz) {
    LidarConfig lidar = vl53l1x;
    lidar.name = name;
    lidar.quat_wxyz = quat_wxyz;
    return lidar;
  };
  constexpr auto kHalf = static_cast<float>(std::numbers::sqrt2 / 2.0);
  constexpr float kZones = 45.0F * 7 / 8;  // deg, between the centres of the outer ones of eight zones in 45 degrees
  const std::array presets{
      LidarConfig{.name = "os0-128",
                  .channels = 128,
                  .beams = 512,
                  .hfov_deg = 360.0F,
                  .vfov_deg = 90.0F,
                  .max_range_m = 35.0F,
                  .errors = {.noise_std_m = 0.0028F, .noise_per_m = 0.00086F, .resolution_m = 0.001F, .min_range_m = 0.2F}},
      LidarConfig{.name = "vlp-16",
                  .channels = 16,
                  .beams = 1800,
                  .hfov_deg = 360.0F,
                  .vfov_deg = 30.0F,
                  .max_range_m = 100.0F,
                  .errors = {.noise_std_m = 0.03F, .resolution_m = 0.002F, .min_range_m = 0.4F}},
      // It scans a rosette. This is the grid of as many beams with its field of view.
      LidarConfig{.name = "mid-360",
                  .channels = 40,
                  .beams = 500,
                  .hfov_deg = 360.0F,
                  .vfov_deg = 59.0F,
                  .vfov_center_deg = 22.5F,
                  .max_range_m = 40.0F,
                  .errors = {.noise_std_m = 0.02F, .resolution_m = 0.001F, .min_range_m = 0.1F}},
      LidarConfig{.name = "tfmini",
                  .beams = 1,
                  .max_range_m = 12.0F,
                  .errors = {.noise_std_m = 0.06F, .noise_per_m = 0.005F, .resolution_m = 0.005F, .min_range_m = 0.3F}},
      vl53l1x,
      turned("multi-ranger-front", {1, 0, 0, 0}),
      turned("multi-ranger-up", {kHalf, 0, -kHalf, 0}),
      turned("flow-deck", {kHalf, 0, kHalf, 0}),
      LidarConfig{.name = "vl53l5cx",
                  .channels = 8,
                  .beams = 8,
                  .hfov_deg = kZones,
                  .vfov_deg = kZones,
                  .max_range_m = 4.0F,
                  .errors = {.noise_per_m = 0.02F, .resolution_m = 0.001F, .min_range_m = 0.02F, .dropout = 0.01F}},
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

BeamTargets targets_of(DroneIndex drone, const Surroundings& surroundings) {
  return {surroundings.scene_of(drone), surroundings.bodies_of(drone), surroundings.drones_seen_by(drone)};
}

LeastReturn least_return_of(const RangeErrors& errors) {
  const float max_incidence = errors.max_incidence_deg * (std::numbers::pi_v<float> / 180.0F);  // rad
  return {errors.max_incidence_deg < 90.0F ? std::cos(max_incidence) : 0.0F, errors.min_intensity};
}

BeamOptics optics_of(const LidarConfig& config, const trace::TracePolicy& policy) {
  const double half_width_rad = 0.0005 * static_cast<double>(config.errors.divergence_mrad);
  return {make_pattern(config, policy), half_width_rad > 0.0 ? make_pattern(config, policy, half_width_rad) : BeamPattern()};
}

// Without fans, no change of the beams makes any: worlds may lack the tree that slices need.
trace::TracePolicy policy_of(const LidarConfig& config, TracerKind tracer) {
  trace::TracePolicy policy = trace::trace_policy_of(tracer, rays_of(config));
  if (!has_fans(config, tracer)) policy.min_rays_in_slice = trace::TracePolicy::kNever;
  return policy;
}

// Returns the arrays that a LiDAR writes; others stay empty.
LidarReadings cleared(const LidarConfig& config, std::size_t num_drones) {
  LidarReadings readings;
  for_each_listed(readings, [&](const auto& entry, auto& values) {
    if (is_written(config, entry.name)) allocate(entry, values, {.num_drones = num_drones, .num_rays = rays_of(config)});
  });
  return readings;
}

}  // namespace

// Errors are added in place: nothing reads the exact ranges, so that they need no memory of their own.
Lidar::Lidar(const LidarConfig& config, const SensorSetup& setup)
    : SensorOf("lidar", config.name, config, setup, cleared(config, setup.num_drones), false),
      config_(config),
      policy_(policy_of(config, setup.tracer)),
      rays_(rays_of(config)),
      number_(setup.number),
      settings_(config, setup.num_drones, true, [policy = policy_](const LidarConfig& of) { return optics_of(of, policy); }),
      errs_(config.errors != RangeErrors()),
      scan_ticks_(static_cast<float>(static_cast<double>(config.scan_time_s) / setup.clock.dt_s())),
      motion_(config.scan_time_s > 0.0F ? setup.num_drones : 0) {
  std::ranges::fill(readings_.published().max_range_m, config.max_range_m);
  if (config.needs_hits()) {
    elements_.resize(setup.num_drones * rays_);
    triangles_.resize(setup.num_drones * rays_);
    if (!config.outputs.intensity) cosines_.resize(setup.num_drones * rays_);
  }
  if (config.errors.divergence_mrad > 0.0F) edges_.resize(setup.num_drones * rays_);
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
    config.errors = change.errors.value_or(config.errors);
    return config;
  };
  if (drones.empty()) check_setting(changed(config_));  // a bad field is refused even if no drone is listed
  for (const DroneIndex drone : drones) check_setting(changed(config_of(drone)));
  for (const DroneIndex drone : drones) set_config(drone, changed(config_of(drone)));
}

void Lidar::check_setting(const LidarConfig& config) const {
  config.validate();
  const RangeErrors& errors = config.errors;
  const char* const unset = "its default, since the LiDAR was made without outputs and errors that depend on surfaces";
  if (!config_.needs_hits()) {
    require(errors.max_incidence_deg == 90.0F, "lidar.errors.max_incidence_deg", unset, errors.max_incidence_deg);
    require(errors.min_intensity == 0.0F, "lidar.errors.min_intensity", unset, errors.min_intensity);
  }
  require(errors.divergence_mrad == 0.0F || config_.errors.divergence_mrad > 0.0F, "lidar.errors.divergence_mrad",
          "0, since the LiDAR was made with beams of no width", errors.divergence_mrad);
}

void Lidar::set_config(DroneIndex drone, const LidarConfig& config) {
  settings_.set(drone, config);
  readings_.published().max_range_m[drone] = settings_[drone].max_range_m;
  errs_ = errs_ || config.errors != RangeErrors();
}

void Lidar::begin(DroneIndex drone, const State& state) {
  SensorOf::begin(drone, state);
  if (is_rolling()) motion_.forget(drone);
}

void Lidar::clear(DroneIndex drone) {
  SensorOf::clear(drone);
  if (is_rolling()) motion_.forget(drone);
  std::fill_n(readings_.published().ranges.data() + drone * rays_, rays_, kInfinity);
  for_each_output(readings_.published(), config_.outputs,
                  [&](const auto&, auto& values) { std::fill_n(values.data() + drone * rays_, rays_, 0); });
}

void Lidar::write_directions(DroneIndex drone, std::span<float> out) const {
  sensors::write_directions(settings_.optics(drone).beams, out.data());
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
  for_each_output(readings_.published(), config_.outputs,
                  [&](const auto& entry, auto& values) { visitor.array(entry.name, values); });
  if (is_rolling()) motion_.visit(visitor);
  visit_delay(visitor);
  settings_.visit(label(), visitor);
}

void Lidar::restored() {
  settings_.restored();
  for (std::size_t i = 0; i < settings_.size(); ++i) {
    readings_.published().max_range_m[i] = settings_[DroneIndex(i)].max_range_m;
    errs_ = errs_ || errors_of(DroneIndex(i)) != RangeErrors();
  }
  has_scanned_ = true;
}

void Lidar::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  if (!drones.empty() && !has_scanned()) has_scanned_.store(true, std::memory_order_relaxed);
  bool has_slices = false;  // this env's drones are in slices
  // Hits are read whenever no rays wait. They take the places of the first drones, which thus stay in the cache.
  std::size_t unread = 0;  // the first drone whose hits are not read
  const auto scan = [&](std::size_t i) { return scan_of(drones[i], drones[i - unread]); };
  const auto read_until = [&](std::size_t end) {
    for (std::size_t i = unread; i < end; ++i) {
      if (const Scan hits = scan(i); !hits.elements.empty()) read_hits(drones[i], surroundings, hits);
    }
    unread = end;
  };
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const DroneIndex drone = drones[i];
    BeamTargets targets = targets_of(drone, surroundings);
    if (targets.drones.count >= kManyDrones) {
      if (i == 0 || surroundings.env_of(drones[i - 1]) != surroundings.env_of(drone)) {
        has_slices = kDronesPerScan * count_of_env(drones.subspan(i), surroundings) >= targets.drones.count;
        if (has_slices) surroundings.slices.sort(targets.drones.balls());
      }
      if (has_slices) targets.drones.slices = &surroundings.slices;
    }
    if (i + 2 < drones.size()) {
      if (const trace::Scene& next = surroundings.scene_of(drones[i + 2]); &next != &targets.scene) next.prefetch_parts();
    }
    if (surroundings.bodies_per_env > 0 && i + 1 < drones.size()) surroundings.bodies_of(drones[i + 1]).shapes.prefetch_balls();
    trace_beams(targets, drone, surroundings.state, scan(i), surroundings.tracer);
    if (!elements_.empty() && surroundings.tracer.is_finished()) read_until(i + 1);
  }
  surroundings.tracer.finish();
  if (!elements_.empty()) read_until(drones.size());
  if (!is_rolling()) return;
  const State& state = surroundings.state;
  for (const DroneIndex drone : drones) motion_.add(drone, pose_of(state, drone), tick_of(drone, state));
}

// The last column is traced at the reading.
Pose Lidar::pose_at(const PosePath& path, std::size_t column) const {
  const auto columns = static_cast<float>(config_.columns());
  return path.before(scan_ticks_ * (1.0F - static_cast<float>(column + 1) / columns));
}

void Lidar::scan(DroneIndex drone, const Surroundings& surroundings, bool has_errors, std::span<float> ranges) const {
  const BeamTargets targets = targets_of(drone, surroundings);
  const std::size_t hits = has_errors && errors_of(drone).need_surfaces() ? rays_ : 0;
  std::vector<std::int32_t> elements(hits), triangles(hits);
  std::vector<float> cosines(hits), edges(has_errors && errors_of(drone).divergence_mrad > 0.0F ? rays_ : 0);
  const Scan scan{.ranges = ranges, .elements = elements, .triangles = triangles, .intensity = cosines, .edges = edges};
  trace_beams(targets, drone, surroundings.state, scan, surroundings.tracer);
  surroundings.tracer.finish();
  if (hits > 0) read_hits(drone, surroundings, scan);
  if (has_errors) add_errors(drone, surroundings.state, scan);
}

void Lidar::read_hits(DroneIndex drone, const Surroundings& surroundings, const Scan& scan) const {
  const trace::Echoes& echoes = *surroundings.scene_of(drone).echoes();
  // Calls f(run, first) for beams side by side, of which the first one begins at `first` in the scan.
  const auto for_each_run = [&](const auto& f) {
    const PosePath path = path_of(drone, surroundings.state);
    const BeamPattern& beams = settings_.optics(drone).beams;
    BeamRun run{};
    const auto aim = [&](const Pose& pose) {
      run.rotation = pose.rotation.toRotationMatrix();
      run.origin = pose.position + trace::rotated(run.rotation, offset_of(drone));
    };
    aim(path.to);
    for_each_row(beams, [&](std::size_t from, std::size_t to, std::size_t count) {
      if (is_rolling()) aim(pose_at(path, to % beams.columns));
      run.x = beams.x.data() + from;
      run.y = beams.y.data() + from;
      run.z = beams.z.data() + from;
      run.ranges = scan.ranges.data() + to;
      run.count = count;
      f(run, to);
    });
  };
  if (!scan.intensity.empty() && echoes.first_triangle < echoes.num_elements) {
    for_each_run([&](const BeamRun& run, std::size_t first) {
      write_triangle_cosines(echoes, run, scan.elements.data() + first, scan.intensity.data() + first);
    });
  }
  const LeastReturn least = least_return_of(errors_of(drone));
  if (!read_world(echoes, least, scan)) return;
  const BeamTargets targets = targets_of(drone, surroundings);
  for_each_run([&](const BeamRun& run, std::size_t first) {
    const auto has_same_hit = [&](std::size_t beam, std::size_t as) {
      return scan.elements[beam] == scan.elements[as] && scan.triangles[beam] == scan.triangles[as] &&
             scan.is_unread(beam, echoes);
    };
    for (std::size_t i = 0, same = 1; i < run.count; i += same) {  // neighbours mostly hit the same
      same = 1;
      const std::size_t beam = first + i;
      if (!scan.is_unread(beam, echoes)) continue;
      while (i + same < run.count && has_same_hit(beam + same, beam)) ++same;
      targets.read(scan.elements[beam], scan.triangles[beam], run.part(i, same), least, scan.outputs(beam, same));
    }
  });
}

void Lidar::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (!errs_) return;
  for (const DroneIndex drone : drones) {
    if (errors_of(drone) != RangeErrors()) add_errors(drone, state, scan_of(drone, drone));
  }
}

void Lidar::add_errors(DroneIndex drone, const State& state, const Scan& scan) const {
  const RandomKey key = RandomKey::of(drone, drones_per_env_);
  const std::uint32_t reading = reading_of(state, key.env);
  for (std::size_t ray = 0; ray < scan.edges.size(); ++ray) {
    constexpr float kApart = 0.2F;  // m
    float& range = scan.ranges[ray];
    const float gap = scan.edges[ray] - range;
    if (!std::isfinite(gap) || std::abs(gap) <= kApart || std::signbit(range)) continue;
    const auto index = static_cast<std::uint32_t>(rays_ * reading + ray);
    range += uniform01(draw(state, key, stream_named("mixed ranges"), index, number_)[0]) * gap;
  }
  const auto draws = static_cast<std::uint32_t>((rays_ + 1) / 2);  // of a reading
  const RangeErrors& errors = errors_of(drone);
  add_range_errors(errors, settings_[drone].max_range_m,
                   input_of_draw(state, key, stream_named("range errors"), draws * reading, number_), scan.ranges);
  if (!config_.outputs.any() && errors.clutter_per_m == 0.0F) return;
  for (std::size_t ray = 0; ray < rays_; ++ray) {
    float& range = scan.ranges[ray];
    if (range < kInfinity && !std::signbit(range)) continue;
    range = std::abs(range);
    scan.clear_outputs(ray);  // the surface is not what the beam reads
  }
}

void Lidar::trace_beams(const BeamTargets& targets, DroneIndex drone, const State& state, const Scan& scan,
                        trace::Tracer& tracer) const {
  const auto aim = [&](const Pose& pose) {
    const Mat3 rotation = pose.rotation.toRotationMatrix();
    tracer.set_viewpoint(targets.scene, {.origin = pose.position + trace::rotated(rotation, offset_of(drone)),
                                         .rotation = rotation,
                                         .range = settings_[drone].max_range_m,
                                         .bodies = &targets.bodies.shapes,
                                         .drones = &targets.drones,
                                         .policy = policy_});
  };
  const PosePath path = path_of(drone, state);
  if (!is_rolling()) aim(path.to);
  const auto trace_pattern = [&](const BeamPattern& pattern, std::span<float> ranges, const trace::HitRows& hits) {
    for (const BeamTile& tile : pattern.tiles) {
      const std::size_t first = tile.channel * pattern.columns + tile.beam;
      if (is_rolling()) aim(pose_at(path, tile.beam));
      tracer.enqueue({.x = pattern.x.data() + tile.first,
                      .y = pattern.y.data() + tile.first,
                      .z = pattern.z.data() + tile.first,
                      .rows = tile.rows,
                      .width = tile.width,
                      .frustum = &tile.frustum,
                      .view = tile.view < 0 ? nullptr : &pattern.views[static_cast<std::size_t>(tile.view)],
                      .fan = tile.fan < 0 ? nullptr : &pattern.fans[static_cast<std::size_t>(tile.fan)]},
                     ranges.data() + first, pattern.columns, hits.from(first));
    }
  };
  const BeamOptics& optics = settings_.optics(drone);
  const auto begin = [](auto values) { return values.empty() ? nullptr : values.data(); };
  trace_pattern(optics.beams, scan.ranges, {begin(scan.elements), begin(scan.triangles), begin(scan.intensity)});
  if (!scan.edges.empty()) trace_pattern(optics.edges, scan.edges, {});
}

}  // namespace flockstep::sensors
