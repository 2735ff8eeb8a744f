// Thresholds that select the method of ray tracing. Written by `./dev calibrate` (here with AVX3). They are not measured at run
// time, since the method affects the last bits of a distance.
#pragma once

#include <cstddef>

namespace flockstep::trace {

// Up to this many shapes in view, a bundle's rays are tested against each of them.
inline constexpr std::size_t kMaxDirect = 384;
// Up to this many shapes in the world, rays of arbitrary origins are tested against each of them.
inline constexpr std::size_t kMaxDirectAnyOrigin = 16;
// A sensor with at least kMinRaysInTiles rays traces triangles in tiles, if the world has at most kTrianglesPerRay triangles per
// ray.
inline constexpr std::size_t kMinRaysInTiles = 256;
inline constexpr std::size_t kTrianglesPerRay = 1024;
// A fan of at least kMinRaysInSlice rays is traced as a slice if their mean distance at its range is at most kWidestInSlice (m).
inline constexpr std::size_t kMinRaysInSlice = 6;
inline constexpr float kWidestInSlice = 1.0F;

}  // namespace flockstep::trace
