// Direct tracing: rays against a list of shapes, with no tree.
#pragma once

#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <span>

#include "trace/ray_block.hpp"
#include "trace/shape.hpp"

namespace flockstep::trace {

// Position of the sensor relative to a shape. It can reduce the surfaces to test.
enum class OriginHint : std::uint8_t {
  anywhere,
  in_room,          // inside the room: only walls within range can be hit
  beside_cylinder,  // outside the cylinder, between its cap planes: only its side can be hit
  outside_marker,   // a sphere that is visible from outside only
};

// A shape within range of a sensor, with the data that all rays of the sensor share.
struct Candidate {
  const Shape* shape;
  std::int32_t element;
  OriginHint hint;
  std::array<bool, 3> walls;          // rooms only: the axes across which a wall is within range
  std::array<float, 3> local_origin;  // m, shape's frame, origin of the rays
};

// Fills in a candidate, except walls, with no hint. The shape must outlive it. It is filled in place, since copying one that has
// just been written makes the processor wait.
inline void set_candidate(Candidate& candidate, const Shape& shape, std::int32_t element, const Vec3& origin) {
  candidate.shape = &shape;
  candidate.element = element;
  candidate.hint = OriginHint::anywhere;
  const Vec3 offset(origin.x() - shape.center[0], origin.y() - shape.center[1], origin.z() - shape.center[2]);
  const Vec3 local = shape.aligned ? offset : rotated(shape.to_local, offset);
  candidate.local_origin = {local.x(), local.y(), local.z()};
}

// Returns the hint for a solid. near: hits nearer than this are ignored.
inline OriginHint hint_at_solid(const Shape& shape, const std::array<float, 3>& local_origin, float near) {
  if (shape.kind != ShapeKind::cylinder) return OriginHint::anywhere;
  const auto [x, y, z] = local_origin;
  const float away = shape.half_extents[0] + near;
  const bool beside = x * x + y * y > away * away && std::abs(z) <= shape.half_extents[2];
  return beside ? OriginHint::beside_cylinder : OriginHint::anywhere;
}

inline constexpr std::size_t kMaxCandidates = 512;

// Traces all rays of the bundle against the candidates in its frustum. Returns false and does nothing if these are more than
// max_seen. max_seen is at most kMaxCandidates.
bool trace_direct(std::span<const Candidate> candidates, std::size_t max_seen, RayBundle& rays);

// The same for any number of candidates, but keeps hits nearer than t_hit only.
void trace_nearer(std::span<const Candidate> candidates, RayBundle& rays);

// Traces all rays of the block against these shapes and keeps hits nearer than t_hit.
void trace_direct(std::span<const NumberedShape> shapes, RayBlock& rays);

// The same for spheres that are visible from outside only.
void trace_markers(std::span<const NumberedShape> markers, RayBlock& rays);

}  // namespace flockstep::trace
