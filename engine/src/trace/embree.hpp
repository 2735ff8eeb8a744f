// The one place that knows which Embree this is: 3.13 or 4.x.
#pragma once

#if SWIFTLET_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cstdint>

namespace swiftlet::trace {

// Rays that start close together and point alike are coherent; Embree walks the tree for such packets together.
enum class Coherence : std::uint8_t { incoherent, coherent };

inline constexpr int kPacketSize = 8;

// Eight rays and their hits, structure of arrays, as Embree reads and writes them.
using RayPacket = RTCRayHit8;

#if SWIFTLET_EMBREE_MAJOR >= 4

inline void intersect_packet(const int* valid, RTCScene scene, RayPacket& packet, Coherence coherence) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = coherence == Coherence::coherent ? RTC_RAY_QUERY_FLAG_COHERENT : RTC_RAY_QUERY_FLAG_INCOHERENT;
  rtcIntersect8(valid, scene, &packet, &arguments);
}

#else

inline void intersect_packet(const int* valid, RTCScene scene, RayPacket& packet, Coherence coherence) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = coherence == Coherence::coherent ? RTC_INTERSECT_CONTEXT_FLAG_COHERENT : RTC_INTERSECT_CONTEXT_FLAG_INCOHERENT;
  rtcIntersect8(valid, scene, &context, &packet);
}

#endif

}  // namespace swiftlet::trace
