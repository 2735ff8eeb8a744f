// Traces packets of rays with Embree.
#pragma once

#include <cstddef>
#include <cstdint>

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// Each keeps hits that are nearer than the rays' t_hit; a hit gets the element first_element + primID. The functions for
// triangles return the number of packets.

// Packets of 16, for geometry whose callback intersects a whole packet at once.
void trace_packets_of_16(RTCScene scene, std::int32_t first_element, RayBlock& rays);
// Packets of 8, for triangles. Incoherent packets traverse the tree ray by ray, and larger ones only cost more to fill.
// details: receives the details of these hits; may be null.
std::size_t trace_packets_of_8(RTCScene scene, std::int32_t first_element, Through through, RayBlock& rays, HitDetails* details);

// Rays in rows of kTileWidth that point in similar directions, in packets of 4 x 4 (if wide) or 4 x 2. Rows that fill up the
// last packets also need directions.
inline constexpr std::size_t kTileWidth = 16;
std::size_t trace_tile(RTCScene scene, std::int32_t first_element, bool wide, Through through, RayBundle& rays,
                       HitDetails& details);

}  // namespace flockstep::trace
