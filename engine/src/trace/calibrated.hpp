// Which way rays go. Written by `./dev calibrate` (here with AVX3); nothing is timed at run time,
// since the choice decides the last bits of a distance.
#pragma once

#include <cstddef>

namespace flockstep::trace {

// Shapes in view up to which a bundle's rays are tested against every one.
inline constexpr std::size_t kMaxDirect = 384;
// Shapes of a world up to which rays of any origins are tested against every one.
inline constexpr std::size_t kMaxDirectAnyOrigin = 16;
// Rays of a sensor from which on they meet triangles in tiles, and how many triangles there may be for each.
inline constexpr std::size_t kFewestInTiles = 256;
inline constexpr std::size_t kTrianglesPerRay = 1024;

}  // namespace flockstep::trace
