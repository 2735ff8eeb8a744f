// Beams: where a LiDAR's rays point in the body frame, and turning them into the world frame.
#pragma once

#include <cstddef>
#include <vector>

#include "swiftlet/config.hpp"
#include "swiftlet/pose.hpp"
#include "trace/ray_block.hpp"

namespace swiftlet::sensors {

// The beams of one setting (mounting rotation included), structure of arrays, padded so that whole vectors can be read.
struct BeamPattern {
  std::vector<float> x, y, z;  // (rays + RayBlock::kPadding,) unit, body frame
};

BeamPattern make_pattern(const LidarConfig& config);

// Appends beams [first, first + count) of a drone to the block: rotation is body to world. The block has room for them.
void append_rays(const BeamPattern& pattern, std::size_t first, std::size_t count, const Mat3& rotation, const Vec3& origin,
                 float max_range_m, trace::RayBlock& rays);

}  // namespace swiftlet::sensors
