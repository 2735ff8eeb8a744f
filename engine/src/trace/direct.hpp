// Direct tracing: rays against a list of shapes, with no tree.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>

#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace flockstep::trace {

// Where the sensor is, which may leave little to test.
enum class OriginHint : std::uint8_t {
  anywhere,
  in_room,          // its inside: only walls within reach can be hit
  beside_cylinder,  // outside it, between the planes of its caps: only its side can be hit
  outside_marker,   // a sphere that is seen from outside only
};

// A shape within reach of a sensor, and what all rays of that sensor have in common.
struct Candidate {
  const Shape* shape;
  std::int32_t element;
  OriginHint hint;
  std::array<bool, 3> walls;          // of a room: the axes across which a wall is within reach
  std::array<float, 3> local_origin;  // m, of the rays, in the shape's frame
};

inline constexpr std::size_t kMaxCandidates = 512;

// Traces all rays of the bundle against those of the candidates that its frustum holds. False, and nothing done, if these are
// more than max_seen (at most kMaxCandidates).
bool trace_direct(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays);

// Traces all rays of the block against these shapes: takes what is nearer than its t_hit.
void trace_direct(std::span<const NumberedShape> shapes, RayBlock& rays);

// The same for spheres that are seen from outside only.
void trace_markers(std::span<const NumberedShape> markers, RayBlock& rays);

}  // namespace flockstep::trace
