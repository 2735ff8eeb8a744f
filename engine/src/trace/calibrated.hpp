// Where direct tracing ends and Embree begins. Written by `./dev calibrate` (here with AVX3); nothing is timed at run time,
// since the choice decides the last bits of a distance.
#pragma once

#include <cstddef>

namespace flockstep::trace {

// Shapes in view up to which a bundle's rays are tested against every one.
inline constexpr std::size_t kMaxDirect = 384;
// Shapes of a world up to which rays of any origins are tested against every one.
inline constexpr std::size_t kMaxDirectAnyOrigin = 16;

}  // namespace flockstep::trace
