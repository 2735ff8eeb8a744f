#include "sensors/beams.hpp"

#include <algorithm>
#include <array>
#include <cmath>
#include <numbers>
#include <span>
#include <utility>

#include "trace/packets.hpp"

namespace flockstep::sensors {
namespace {

constexpr double kRadPerDeg = std::numbers::pi / 180.0;
constexpr std::size_t kTileWidth = trace::kTileWidth;  // beams; a full vector, and few enough for a narrow view
constexpr std::size_t kTileHeightOfWaves = 8;          // channels; few enough for a view, though they rise and fall
constexpr std::size_t kFan = 64;                       // largest number of beams of a single channel that form one tile

// Returns the angle of element `index`, evenly spaced over [-fov/2, fov/2]. A full circle omits the end, which equals the
// start.
double spread_deg(int index, int count, double fov_deg) {
  if (count == 1) return 0.0;
  const int intervals = fov_deg >= 360.0 ? count : count - 1;
  return fov_deg * (static_cast<double>(index) / intervals - 0.5);
}

// Returns a unit vector in the frame of the LiDAR, before the mounting rotation.
Eigen::Vector3d beam_direction(const LidarConfig& config, std::size_t channel, std::size_t beam) {
  double azimuth_deg = 0.0;
  double elevation_deg = 0.0;
  if (config.has_pattern()) {
    azimuth_deg = config.azimuth_deg[beam];
    elevation_deg = config.elevation_deg[beam];
  } else {
    azimuth_deg = spread_deg(static_cast<int>(beam), config.beams, config.hfov_deg);
    elevation_deg = static_cast<double>(config.vfov_center_deg);
    if (config.waves > 0.0F) {
      const double waves = static_cast<double>(config.waves) * static_cast<double>(beam) / config.beams +
                           static_cast<double>(channel) / config.channels;
      elevation_deg += 0.5 * static_cast<double>(config.vfov_deg) * std::sin(2.0 * std::numbers::pi * waves);
    } else {
      elevation_deg += spread_deg(static_cast<int>(channel), config.channels, config.vfov_deg);
    }
  }
  const double azimuth = azimuth_deg * kRadPerDeg;
  const double elevation = elevation_deg * kRadPerDeg;
  return {std::cos(elevation) * std::cos(azimuth), std::cos(elevation) * std::sin(azimuth), std::sin(elevation)};
}

Eigen::Matrix3d mounting_of(const std::array<float, 4>& q) {
  return Eigen::Quaterniond(q[0], q[1], q[2], q[3]).normalized().toRotationMatrix();
}

// Returns a direction at an angle from a beam. The golden angle turns the side from beam to beam.
Eigen::Vector3d beside(const Eigen::Vector3d& beam, double angle_rad, std::size_t number) {
  const double turn = std::numbers::pi * (3.0 - std::sqrt(5.0)) * static_cast<double>(number);
  const Eigen::Vector3d u = beam.unitOrthogonal();
  return std::cos(angle_rad) * beam + std::sin(angle_rad) * (std::cos(turn) * u + std::sin(turn) * beam.cross(u));
}

// Adds a view for the pattern's last tile if the tile has enough beams and they lie within a narrow cone.
void add_view(BeamPattern& pattern, BeamTile& tile) {
  constexpr std::size_t kMinBeams = 64;  // beams, in rows that fill the kernel's sub-tiles of 4 x 4
  constexpr double kMinAhead = 0.9;      // cosine of the largest angle to the tile's axis, 26 degrees
  const std::size_t beams = tile.rows * tile.width;
  if (tile.rows < 4 || tile.width > trace::kTileWidth || beams < kMinBeams) return;
  const auto direction = [&](std::size_t i) {
    return Eigen::Vector3d(pattern.x[tile.first + i], pattern.y[tile.first + i], pattern.z[tile.first + i]);
  };
  Eigen::Vector3d axis = Eigen::Vector3d::Zero();
  for (std::size_t i = 0; i < beams; ++i) axis += direction(i);
  axis.normalize();
  Eigen::Matrix3d to_sensor;
  to_sensor.col(0) = axis;
  to_sensor.col(1) = (std::abs(axis.z()) < 0.7 ? Eigen::Vector3d::UnitZ() : Eigen::Vector3d::UnitX()).cross(axis).normalized();
  to_sensor.col(2) = axis.cross(to_sensor.col(1));
  trace::TileView view{.to_sensor = to_sensor.cast<float>(), .u = {}, .v = {}};
  std::array<float, trace::kMaxRays> u{}, v{};
  for (std::size_t i = 0; i < beams; ++i) {
    const Eigen::Vector3d seen = to_sensor.transpose() * direction(i);
    if (!(seen.x() >= kMinAhead)) return;
    const std::size_t at = i / tile.width * trace::kTileWidth + i % tile.width;
    u[at] = static_cast<float>(seen.y() / seen.x());
    v[at] = static_cast<float>(seen.z() / seen.x());
    view.ahead[at] = static_cast<float>(seen.x());
    view.per_ahead[at] = static_cast<float>(1.0 / seen.x());
  }
  // Gives rays beside the tile the direction of the nearest beam, so that they do not widen the view.
  for (std::size_t row = 0; row < trace::kMaxRays / trace::kTileWidth; ++row) {
    for (std::size_t i = row < tile.rows ? tile.width : 0; i < trace::kTileWidth; ++i) {
      const std::size_t from = std::min(row, tile.rows - 1) * trace::kTileWidth + std::min(i, tile.width - 1);
      u[row * trace::kTileWidth + i] = u[from];
      v[row * trace::kTileWidth + i] = v[from];
    }
  }
  view.u = trace::make_tile_axis(u.data());
  view.v = trace::make_tile_axis(v.data());
  tile.view = static_cast<std::int32_t>(pattern.views.size());
  pattern.views.push_back(view);
}

// Cuts the grid of a LiDAR into tiles.
class PatternMaker {
 public:
  static constexpr int kMinChannels = 4;  // for tiles with views; others keep their fans

  PatternMaker(const LidarConfig& config, const trace::TracePolicy& policy, double beside_rad = 0.0)
      : policy_(policy),
        range_m_(config.max_range_m),
        is_rolling_(config.scan_time_s > 0.0F),
        channels_(static_cast<std::size_t>(config.rows())),
        columns_(static_cast<std::size_t>(config.columns())),
        tallest_(config.waves > 0.0F ? kTileHeightOfWaves : trace::kMaxRays / kTileWidth),
        mounting_(mounting_of(config.quat_wxyz)) {
    for (std::size_t channel = 0; channel < channels_; ++channel) {
      for (std::size_t beam = 0; beam < columns_; ++beam) directions_.push_back(beam_direction(config, channel, beam));
    }
    for (std::size_t i = 0; beside_rad > 0.0 && i < directions_.size(); ++i)
      directions_[i] = beside(directions_[i], beside_rad, i);
  }

  bool has_fans() const {
    for (std::size_t channel = 0; channel < channels_; ++channel) {
      if (is_channel_a_fan(channel)) return true;
    }
    return is_column_a_fan();
  }

  BeamPattern make() {
    pattern_.columns = columns_;
    std::size_t begun = 0;  // the first channel that is in no tile
    if (is_column_a_fan()) {
      add_fan(0, channels_);
      begun = channels_;
    }
    for (std::size_t channel = begun; channel < channels_; ++channel) {
      if (!is_channel_a_fan(channel)) continue;
      add_grid(begun, channel);
      add_fan(channel, 1);
      begun = channel + 1;
    }
    add_grid(begun, channels_);
    for (auto* component : {&pattern_.x, &pattern_.y, &pattern_.z}) component->resize(component->size() + trace::kRayPadding);
    return std::move(pattern_);
  }

 private:
  // Returns the directions of channels, before the mounting rotation.
  std::span<const Eigen::Vector3d> directions(std::size_t channel, std::size_t rows) const {
    return std::span(directions_).subspan(channel * columns_, rows * columns_);
  }

  bool is_column_a_fan() const { return columns_ == 1 && is_fan(directions(0, channels_)); }
  bool is_channel_a_fan(std::size_t channel) const {
    return channels_ < std::size_t{kMinChannels} && is_fan(directions(channel, 1));
  }

  // Returns true if the policy traces these rays as a fan.
  bool is_fan(std::span<const Eigen::Vector3d> rays) const {
    if (is_rolling_ || rays.size() < policy_.min_rays_in_slice || !trace::are_in_plane(rays)) return false;
    const trace::Fan first = trace::make_fan(rays.first(std::min(rays.size(), trace::kMaxRays)), mounting_);
    return range_m_ * first.between_rad <= policy_.widest_in_slice;
  }

  // Adds tiles for the fan of one channel, or of channels of one beam.
  void add_fan(std::size_t channel, std::size_t rows) {
    const auto all = directions(channel, rows);
    const std::size_t parts = (all.size() + trace::kMaxRays - 1) / trace::kMaxRays;
    for (std::size_t part = 0; part < parts; ++part) {
      const std::size_t begin = part * all.size() / parts, count = (part + 1) * all.size() / parts - begin;
      columns_ == 1 ? add_tile(channel + begin, count, 0, 1) : add_tile(channel, 1, begin, count);
      pattern_.tiles.back().fan = static_cast<std::int32_t>(pattern_.fans.size());
      pattern_.fans.push_back(trace::make_fan(all.subspan(begin, count), mounting_));
    }
  }

  // Adds tiles for the channels from begin to end.
  void add_grid(std::size_t begin, std::size_t end) {
    const std::size_t height = std::min(end - begin, tallest_);
    const std::size_t width = is_rolling_ ? 1 : channels_ == 1 && columns_ <= kFan ? columns_ : kTileWidth;
    for (std::size_t channel = begin; channel < end; channel += height) {
      for (std::size_t beam = 0; beam < columns_; beam += width) {
        add_tile(channel, std::min(height, end - channel), beam, std::min(width, columns_ - beam));
        if (policy_.tile_triangle_limit > 0) add_view(pattern_, pattern_.tiles.back());
      }
    }
  }

  void add_tile(std::size_t channel, std::size_t rows, std::size_t beam, std::size_t width) {
    BeamTile tile{.first = pattern_.x.size(), .rows = rows, .width = width, .channel = channel, .beam = beam, .frustum = {}};
    for (std::size_t i = 0; i < rows * width; ++i) {
      const Eigen::Vector3d direction = mounting_ * directions_[(channel + i / width) * columns_ + beam + i % width];
      pattern_.x.push_back(static_cast<float>(direction.x()));
      pattern_.y.push_back(static_cast<float>(direction.y()));
      pattern_.z.push_back(static_cast<float>(direction.z()));
    }
    const auto part = [&tile](const std::vector<float>& all) { return std::span(all).subspan(tile.first); };
    tile.frustum = trace::make_frustum(part(pattern_.x), part(pattern_.y), part(pattern_.z));
    pattern_.tiles.push_back(tile);
  }

  const trace::TracePolicy policy_;
  const float range_m_;
  const bool is_rolling_;  // the beams of a column are in tiles of their own
  const std::size_t channels_, columns_;
  const std::size_t tallest_;  // largest number of channels in a tile
  const Eigen::Matrix3d mounting_;
  std::vector<Eigen::Vector3d> directions_;  // by channel and beam, before the mounting rotation
  BeamPattern pattern_;
};

}  // namespace

BeamPattern make_pattern(const LidarConfig& config, const trace::TracePolicy& policy, double beside_rad) {
  return PatternMaker(config, policy, beside_rad).make();
}

Mat3 turn_about_z(const std::array<float, 4>& quat_wxyz, float angle_deg) {
  const Eigen::Vector3d axis = mounting_of(quat_wxyz).col(2);
  return Eigen::AngleAxisd(static_cast<double>(angle_deg) * kRadPerDeg, axis).toRotationMatrix().cast<float>();
}

bool has_fans(const LidarConfig& config, TracerKind tracer) {
  if (config.rows() >= PatternMaker::kMinChannels && config.columns() > 1) return false;
  const std::size_t rays = static_cast<std::size_t>(config.rows()) * static_cast<std::size_t>(config.columns());
  return PatternMaker(config, trace::trace_policy_of(tracer, rays)).has_fans();
}

void write_directions(const BeamPattern& pattern, float* out) {
  for (const BeamTile& tile : pattern.tiles) {
    for (std::size_t i = 0; i < tile.rows * tile.width; ++i) {
      const std::size_t row = tile.channel + i / tile.width, beam = tile.beam + i % tile.width;
      float* const to = out + 3 * (row * pattern.columns + beam);
      to[0] = pattern.x[tile.first + i];
      to[1] = pattern.y[tile.first + i];
      to[2] = pattern.z[tile.first + i];
    }
  }
}

}  // namespace flockstep::sensors
