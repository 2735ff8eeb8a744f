#include "sensors/lidar.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <cstdint>
#include <limits>
#include <numbers>
#include <optional>
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
    require(waves == grid.waves, "lidar.waves", unset, waves);
  }
  const bool has_one_elevation = channels == 1 && waves == 0.0F;
  require(has_one_elevation || std::abs(vfov_center_deg) + 0.5F * vfov_deg <= 90.0F, "lidar.vfov_center_deg",
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
      // It scans a rosette that does not repeat. This one is ours, not Livox's: with its field of view, and as many points at 10
      // Hz. By the golden angle, the curves of a scan lie between those of the scans before.
      LidarConfig{.name = "mid-360",
                  .channels = 40,
                  .beams = 500,
                  .hfov_deg = 360.0F,
                  .vfov_deg = 59.0F,
                  .vfov_center_deg = 22.5F,
                  .waves = 3.0F,
                  .turn_deg = 137.50776F,
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

// Reads beams into the arrays of a LiDAR.
class LidarReader final : public trace::EchoReader {
 public:
  LidarReader(const Surroundings& surroundings, LidarReadings& to) : surroundings_(surroundings) {
    const auto begin = [](auto& values) { return values.empty() ? nullptr : values.data(); };
    semantic = begin(to.semantic);
    instance = begin(to.instance);
    intensity = begin(to.intensity);
  }

  void look_closer(std::size_t drone, const trace::BeamHits& hits, const trace::EchoRows& to) override {
    targets_of(DroneIndex(drone), surroundings_).read(hits, to);
  }

 private:
  const Surroundings& surroundings_;
};

// See add_range_errors().
void forget_signs(std::span<float> ranges) {
  for (float& range : ranges) range = std::abs(range);
}

trace::LeastReturn least_return_of(const RangeErrors& errors) {
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
    if (writes(config, entry.name)) allocate(entry, values, {.num_drones = num_drones, .num_rays = rays_of(config)});
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
  if (turns()) readings_.published().turn_deg[drone] = 0.0F;
  for_each_output(readings_.published(), config_.outputs,
                  [&](const auto&, auto& values) { std::fill_n(values.data() + drone * rays_, rays_, 0); });
}

void Lidar::write_directions(DroneIndex drone, std::span<float> out) const {
  sensors::write_directions(settings_.optics(drone).beams, out.data());
  const std::optional<Mat3> turn = turn_of(drone, turn_deg_of(readings(), drone));
  for (std::size_t ray = 0; turn && ray < rays_; ++ray) {
    Eigen::Map<Vec3> direction(out.data() + 3 * ray);
    direction = *turn * direction;
  }
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
  if (turns()) visitor.array("turn_deg", readings_.published().turn_deg);
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

void Lidar::turn_readings(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  for (const DroneIndex drone : drones) {
    const std::int64_t reading = reading_of(surroundings.state, EnvIndex(surroundings.env_of(drone)));
    const auto number = static_cast<double>(reading / std::max<std::int64_t>(period(), 1));
    readings_.truth().turn_deg[drone] = static_cast<float>(std::fmod(number * static_cast<double>(config_.turn_deg), 360.0));
  }
}

void Lidar::measure(std::span<const DroneIndex> drones, const Surroundings& surroundings) {
  if (drones.empty()) return;
  if (!has_scanned()) has_scanned_.store(true, std::memory_order_relaxed);
  if (turns()) turn_readings(drones, surroundings);
  bool has_slices = false;  // this env's drones are in slices
  LidarReader reader(surroundings, readings_.truth());
  trace::EchoReader* const used_reader = config_.needs_hits() ? &reader : nullptr;
  const bool is_plain = used_reader == nullptr && edges_.empty() && !turns() && !is_rolling();
  const bool is_world_alone = surroundings.bodies_per_env == 0 && surroundings.drones.count == 0;
  BeamTargets targets = targets_of(drones.front(), surroundings);
  for (std::size_t i = 0; i < drones.size(); ++i) {
    const DroneIndex drone = drones[i];
    if (is_world_alone) {
      targets.put_into(surroundings.scene_of(drone));
    } else {
      targets = targets_of(drone, surroundings);
    }
    if (targets.drones.count >= kManyDrones) {
      if (i == 0 || surroundings.env_of(drones[i - 1]) != surroundings.env_of(drone)) {
        has_slices = kDronesPerScan * count_of_env(drones.subspan(i), surroundings) >= targets.drones.count;
        if (has_slices) surroundings.slices.sort(targets.drones.balls());
      }
      if (has_slices) targets.drones.slices = &surroundings.slices;
    }
    if (i + 2 < drones.size()) {
      if (const trace::Scene& next = surroundings.scene_of(drones[i + 2]); &next != targets.scene) next.prefetch_parts();
    }
    if (surroundings.bodies_per_env > 0 && i + 1 < drones.size()) surroundings.bodies_of(drones[i + 1]).shapes.prefetch_balls();
    const Scan scan = scan_of(drone, used_reader);
    if (is_plain) {
      trace_beams<true>(targets, drone, surroundings.state, scan, surroundings.tracer);
    } else {
      trace_beams<false>(targets, drone, surroundings.state, scan, surroundings.tracer);
    }
  }
  surroundings.tracer.finish();
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
  std::vector<float> edges(has_errors && errors_of(drone).divergence_mrad > 0.0F ? rays_ : 0);
  const bool needs_hits = has_errors && errors_of(drone).need_surfaces();
  LidarReadings no_outputs;
  LidarReader reader(surroundings, no_outputs);
  const Scan scan{ranges, edges, needs_hits ? echoes_of(drone, reader, 0) : trace::EchoTarget(), turn_deg_of(readings(), drone)};
  trace_beams<false>(targets, drone, surroundings.state, scan, surroundings.tracer);
  surroundings.tracer.finish();
  if (!has_errors) return;
  add_errors(drone, surroundings.state, scan);
  forget_signs(ranges);
}

trace::EchoTarget Lidar::echoes_of(DroneIndex drone, trace::EchoReader& reader, std::size_t first) const {
  const RangeErrors& errors = errs_ ? errors_of(drone) : config_.errors;  // without errors, those of no drone are read
  if (!config_.outputs.any() && !errors.need_surfaces()) return {};
  return {&reader, drone, first, config_.outputs.intensity || errors.need_surfaces(), least_return_of(errors)};
}

// Beams whose surfaces are lost, or behind clutter, also lose their outputs.
void Lidar::add_errors(std::span<const DroneIndex> drones, const State& state) {
  if (!errs_) return;
  for (const DroneIndex drone : drones) {
    if (errors_of(drone) == RangeErrors()) continue;
    const Scan scan = scan_of(drone);
    add_errors(drone, state, scan);
    for_each_output(readings_.truth(), config_.outputs, [&](const auto&, auto& values) {
      for (std::size_t ray = 0; ray < rays_; ++ray) {
        if (scan.ranges[ray] == kInfinity || std::signbit(scan.ranges[ray])) values[drone * rays_ + ray] = 0;
      }
    });
    if (errors_of(drone).clutter_per_m > 0.0F) forget_signs(scan.ranges);
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
  add_range_errors(errors_of(drone), settings_[drone].max_range_m,
                   input_of_draw(state, key, stream_named("range errors"), draws * reading, number_), scan.ranges);
}

void Lidar::aim(const BeamTargets& targets, DroneIndex drone, const Pose& pose, const std::optional<Mat3>& turn,
                trace::Tracer& tracer) const {
  const Mat3 rotation = pose.rotation.toRotationMatrix();
  tracer.set_viewpoint(*targets.scene, {.origin = pose.position + trace::rotated(rotation, offset_of(drone)),
                                        .rotation = turn ? Mat3(rotation * *turn) : rotation,
                                        .range = settings_[drone].max_range_m,
                                        .bodies = &targets.bodies.shapes,
                                        .drones = &targets.drones,
                                        .policy = policy_});
}

template <bool kPlain>
void Lidar::trace_beams(const BeamTargets& targets, DroneIndex drone, const State& state, const Scan& scan,
                        trace::Tracer& tracer) const {
  const BeamOptics& optics = settings_.optics(drone);
  const std::optional<Mat3> turn = kPlain ? std::nullopt : turn_of(drone, scan.turn_deg);
  const bool rolls = !kPlain && is_rolling();
  if (!rolls) aim(targets, drone, pose_of(state, drone), turn, tracer);
  // One loop, so that compilers inline all of it: a scan of few beams takes as long as a few calls and copies.
  for (const bool at_edges : {false, true}) {
    const std::span<float> ranges = at_edges ? scan.edges : scan.ranges;
    if (at_edges && (kPlain || ranges.empty())) break;
    const BeamPattern& pattern = at_edges ? optics.edges : optics.beams;
    for (const BeamTile& tile : pattern.tiles) {
      if (rolls) aim(targets, drone, pose_at(path_of(drone, state), tile.beam), turn, tracer);
      const std::size_t first = tile.channel * pattern.columns + tile.beam;
      tracer.enqueue({.x = pattern.x.data() + tile.first,
                      .y = pattern.y.data() + tile.first,
                      .z = pattern.z.data() + tile.first,
                      .rows = tile.rows,
                      .width = tile.width,
                      .frustum = &tile.frustum,
                      .view = tile.view < 0 ? nullptr : &pattern.views[static_cast<std::size_t>(tile.view)],
                      .fan = tile.fan < 0 ? nullptr : &pattern.fans[static_cast<std::size_t>(tile.fan)]},
                     ranges.data() + first, pattern.columns, kPlain || at_edges ? trace::EchoTarget() : scan.echoes.from(first));
    }
  }
}

}  // namespace flockstep::sensors
