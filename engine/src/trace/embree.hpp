// The one place that knows which Embree this is: 3.13 or 4.x.
#pragma once

#if FLOCKSTEP_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cstddef>

#include "trace/masks.hpp"

namespace flockstep::trace {

// Sixteen or eight rays and their hits, structure of arrays, as Embree reads and writes them.
template <std::size_t kSize>
struct Packet;
template <>
struct Packet<8> {
  RTCRayHit8 rays;
};
template <>
struct Packet<16> {
  RTCRayHit16 rays;
};

// Whether the rays of a packet point much the same way and always come together. Embree's coherent traversal lets a ray's last
// bits, at the edges triangles share, depend on the rays beside it.
enum class Coherence : bool { none, tile };

// What the filters of geometry are told of a packet.
struct PacketContext {
#if FLOCKSTEP_EMBREE_MAJOR >= 4
  RTCRayQueryContext embree;
#else
  RTCIntersectContext embree;
#endif
  Through through;
};

inline Through through_of(const RTCFilterFunctionNArguments& asked) {
  return reinterpret_cast<const PacketContext*>(asked.context)->through;  // whose first member that is
}

template <std::size_t kSize>
void intersect_packet(const int* valid, RTCScene scene, Packet<kSize>& packet, Coherence coherence, Through through) {
  PacketContext context;
  context.through = through;
#if FLOCKSTEP_EMBREE_MAJOR >= 4
  rtcInitRayQueryContext(&context.embree);
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.context = &context.embree;
  if (coherence == Coherence::tile) arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  if constexpr (kSize == 8) {
    rtcIntersect8(valid, scene, &packet.rays, &arguments);
  } else {
    rtcIntersect16(valid, scene, &packet.rays, &arguments);
  }
#else
  rtcInitIntersectContext(&context.embree);
  if (coherence == Coherence::tile) context.embree.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  if constexpr (kSize == 8) {
    rtcIntersect8(valid, scene, &context.embree, &packet.rays);
  } else {
    rtcIntersect16(valid, scene, &context.embree, &packet.rays);
  }
#endif
}

}  // namespace flockstep::trace
