// Where direct tracing ends and Embree begins. `./dev calibrate` measures both and prints these numbers; nothing is timed at run
// time, since the choice decides the last bits of a distance.
#pragma once

#include <cstddef>

namespace swiftlet::trace {

// Shapes up to which a bundle's rays are tested against every one.
inline constexpr std::size_t kMaxDirect = 24;
// The same where rays share no origin and nothing can be left out.
inline constexpr std::size_t kMaxDirectAnyOrigin = 8;

}  // namespace swiftlet::trace
