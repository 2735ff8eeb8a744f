// Primitives as Embree user geometry: the callback that intersects packets with one primitive, compiled for the best SIMD
// target of this machine.
#pragma once

#include "trace/embree.hpp"

namespace flockstep::trace {

// Returns the callback; its user pointer is an array of Shape indexed by primID.
RTCIntersectFunctionN primitive_intersect_function();

// Returns the SIMD target of the callback, e.g. "AVX2".
const char* simd_target();

}  // namespace flockstep::trace
