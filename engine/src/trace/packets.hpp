// Between plain arrays of rays and the packets that Embree takes.
#pragma once

#include <cstdint>
#include <span>

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace swiftlet::trace {

// A room and its index into World::primitives().
struct RoomShape {
  Shape shape;
  std::int32_t element;
};

// What trace_packets looks for hits in.
struct PacketTarget {
  std::span<const RoomShape> rooms;   // traced directly: every ray inside meets them, no tree helps
  RTCScene scene = nullptr;           // all the rest; null if there is nothing else
  unsigned int primitive_geometry;    // primID there is the element
  unsigned int triangle_geometry;     // primID there is the element less first_triangle
  std::int32_t first_triangle;
};

// Traces all rays of the block, a packet at a time.
void trace_packets(const PacketTarget& target, RayBlock& rays, Coherence coherence);

}  // namespace swiftlet::trace
