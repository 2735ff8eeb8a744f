// Direct tracing: rays against a list of shapes, with no tree.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace swiftlet::trace {

// A shape within reach of a sensor, and what all rays of that sensor have in common.
struct Candidate {
  const Shape* shape;
  std::int32_t element;
  bool from_within;           // a room with the sensor in it
  std::array<bool, 3> walls;  // of such a room: the axes across which a wall is within reach
  std::array<float, 3> local_origin;  // m, of the rays, in the shape's frame
  Vec3 center, half;                  // m, of the bounding box; centre relative to the rays' origin
};

// Traces all rays of the bundle against these candidates alone.
void trace_direct(std::span<const Candidate* const> candidates, RayBundle& rays);

// Traces all rays of the block against these shapes alone.
void trace_direct(std::span<const NumberedShape> shapes, RayBlock& rays);

}  // namespace swiftlet::trace
