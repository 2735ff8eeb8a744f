// The one place that knows which Embree this is: 3.13 or 4.x.
#pragma once

#if SWIFTLET_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cstddef>

#include "trace/ray_block.hpp"

namespace swiftlet::trace {

inline constexpr std::size_t kPacketSize = 16;

// Sixteen rays and their hits, structure of arrays, as Embree reads and writes them. (Where registers hold eight, Embree
// halves it itself.)
using RayPacket = RTCRayHit16;

#if SWIFTLET_EMBREE_MAJOR >= 4

inline void intersect_packet(const int* valid, RTCScene scene, RayPacket& packet, Coherence coherence) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = coherence == Coherence::coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
  rtcIntersect16(valid, scene, &packet, &arguments);
}

#else

inline void intersect_packet(const int* valid, RTCScene scene, RayPacket& packet, Coherence coherence) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = coherence == Coherence::coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  rtcIntersect16(valid, scene, &context, &packet);
}

#endif

}  // namespace swiftlet::trace
