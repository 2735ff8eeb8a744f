// Tracing a block of rays: directly against a few shapes, or through packets in the form that Embree takes.
#pragma once

#include <cstdint>
#include <span>

#include "trace/embree.hpp"
#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace swiftlet::trace {

// A shape and its index into World::primitives().
struct NumberedShape {
  Shape shape;
  std::int32_t element;
};

// What trace_packets looks for hits in.
struct PacketTarget {
  std::span<const NumberedShape> rooms;  // traced directly: every ray inside meets them, no tree helps
  RTCScene scene = nullptr;              // all the rest; null if there is nothing else
  unsigned int primitive_geometry;       // primID there is the element
  unsigned int triangle_geometry;        // primID there is the element less first_triangle
  std::int32_t first_triangle;
};

// Traces all rays of the block against these shapes alone, in the order of their elements.
void trace_shapes(std::span<const NumberedShape* const> shapes, RayBlock& rays);

// Traces all rays of the block, a packet at a time.
void trace_packets(const PacketTarget& target, RayBlock& rays);

}  // namespace swiftlet::trace
