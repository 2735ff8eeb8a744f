// Tracing a block of rays by Embree, in packets.
#pragma once

#include <cstdint>

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"

namespace swiftlet::trace {

// Takes what the scene has nearer than the block's t_hit and element. Hits get the element first_element + primID.
void trace_packets(RTCScene scene, std::int32_t first_element, RayBlock& rays);

}  // namespace swiftlet::trace
