// Between plain arrays of rays and the packets that Embree takes.
#pragma once

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"

namespace swiftlet::trace {

// Traces all rays of the block through the scene, a packet at a time. An element is primID, plus first_triangle in the
// geometry triangle_geometry.
void trace_packets(RTCScene scene, RayBlock& rays, Coherence coherence, unsigned int triangle_geometry, std::int32_t first_triangle);

}  // namespace swiftlet::trace
