// Primitives as Embree user geometry: the callback that intersects packets with one primitive, for the best SIMD target of
// this machine.
#pragma once

#include "trace/embree.hpp"

namespace flockstep::trace {

// The callback; its user pointer is an array of Shape indexed by primID.
RTCIntersectFunctionN primitive_intersect_function();

// The SIMD target it was chosen for, e.g. "AVX2".
const char* simd_target();

}  // namespace flockstep::trace
