// Tracing a block of rays by Embree, in packets.
#pragma once

#include <cstdint>

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"

namespace swiftlet::trace {

// Each takes what the scene has nearer than the block's t_hit and element; a hit gets the element first_element + primID.

// Packets of 16, for geometry whose callback intersects a whole packet at once.
void trace_packets_of_16(RTCScene scene, std::int32_t first_element, RayBlock& rays);
// Packets of 8, for triangles: incoherent packets go through their tree ray by ray, and larger ones only cost more to fill.
void trace_packets_of_8(RTCScene scene, std::int32_t first_element, RayBlock& rays);

}  // namespace swiftlet::trace
