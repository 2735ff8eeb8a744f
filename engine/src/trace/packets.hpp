// Tracing rays by Embree, in packets.
#pragma once

#include <cstddef>
#include <cstdint>

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::trace {

// Each takes what the scene has nearer than the rays' t_hit and element; a hit gets the element first_element + primID. Those for
// triangles return how many packets there were.

// Packets of 16, for geometry whose callback intersects a whole packet at once.
void trace_packets_of_16(RTCScene scene, std::int32_t first_element, RayBlock& rays);
// Packets of 8, for triangles: incoherent packets go through their tree ray by ray, and larger ones only cost more to fill.
// details: of the hits taken, if not null.
std::size_t trace_packets_of_8(RTCScene scene, std::int32_t first_element, Through through, RayBlock& rays, HitDetails* details);

// Rays that are rows of kTileWidth and point much the same way: packets of 4 x 4, if wide, or 4 x 2. Rows that fill up the last
// packets need directions, too.
inline constexpr std::size_t kTileWidth = 16;
std::size_t trace_tile(RTCScene scene, std::int32_t first_element, bool wide, Through through, RayBundle& rays,
                       HitDetails& details);

}  // namespace flockstep::trace
