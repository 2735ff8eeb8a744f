// Beams: where a LiDAR's rays point in the body frame.
#pragma once

#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/config.hpp"
#include "flockstep/pose.hpp"
#include "trace/frustum.hpp"
#include "trace/ray_block.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

// A part of a pattern that is traced at once: a rectangle of its grid, so that its beams point much the same way.
struct BeamTile {
  std::size_t first;          // of its beams in the pattern's arrays; there they follow row by row
  std::size_t rows, width;    // rows * width beams
  std::size_t channel, beam;  // of its first
  trace::Frustum frustum;     // body frame
  std::int32_t view = -1;     // into the pattern's views; -1: its beams are too far apart for one
};

// The beams of one setting (mounting rotation included), structure of arrays, tile by tile, padded so that whole vectors can be
// read.
struct BeamPattern {
  std::vector<float> x, y, z;  // (rays + trace::kRayPadding,) unit, body frame
  std::vector<BeamTile> tiles;
  std::vector<trace::TileView> views;
  std::size_t columns;  // beams per channel
};

// views: of those tiles that can have one; else of none.
BeamPattern make_pattern(const LidarConfig& config, bool views);

// Writes the pattern's directions to out (channels, beams, 3).
void write_directions(const BeamPattern& pattern, float* out);

}  // namespace flockstep::sensors
