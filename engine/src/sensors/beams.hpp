// Beams: the ray directions of a LiDAR in the body frame.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "trace/frustum.hpp"
#include "trace/ray_block.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

// A part of a pattern that is traced together. It is a rectangle of the grid, so its beams have similar directions.
struct BeamTile {
  std::size_t first;          // index of its first beam in the pattern's arrays; its beams follow row by row
  std::size_t rows, width;    // rows * width beams
  std::size_t channel, beam;  // channel and number of its first beam
  trace::Frustum frustum;     // body frame
  std::int32_t view = -1;     // index into the pattern's views; -1 if its beams are too far apart for a view
  std::int32_t fan = -1;      // index into the pattern's fans; -1 if it is not traced as a slice
};

// The beams of one setting, mounting rotation included. They are stored as a structure of arrays, tile by tile, and padded so
// that whole vectors can be read.
struct BeamPattern {
  std::vector<float> x, y, z;  // (rays + trace::kRayPadding,) unit, body frame
  std::vector<BeamTile> tiles;
  std::vector<trace::TileView> views;
  std::vector<trace::Fan> fans;
  std::size_t columns;  // beams per channel
};

// Makes the tiles, and their views and fans if the policy has them. The rays have this angle to the beams, each to another side.
BeamPattern make_pattern(const LidarConfig& config, const trace::TracePolicy& policy, double beside_rad = 0.0);

// Returns true if some of the beams are traced as fans.
bool has_fans(const LidarConfig& config, TracerKind tracer);

// Returns the rotation of beams by this angle about the z axis of a LiDAR that is mounted so, in the body frame.
Mat3 turn_about_z(const std::array<float, 4>& quat_wxyz, float angle_deg);

// Writes the pattern's directions to out, shape (channels, beams, 3).
void write_directions(const BeamPattern& pattern, float* out);

}  // namespace flockstep::sensors
