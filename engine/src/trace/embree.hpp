// The only file that depends on the version of Embree: 3.13 or 4.x.
#pragma once

#if FLOCKSTEP_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cstddef>

#include "trace/masks.hpp"

namespace flockstep::trace {

// Sixteen or eight rays and their hits, in Embree's structure-of-arrays layout.
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

// Coherence of a packet. `tile`: its rays point in similar directions and always come together. Only such packets use Embree's
// coherent traversal, since it lets the last bits of a ray's result at shared triangle edges depend on the other rays of the
// packet.
enum class Coherence : bool { none, tile };

// The context of a packet's query, which geometry filters can read.
struct PacketContext {
#if FLOCKSTEP_EMBREE_MAJOR >= 4
  RTCRayQueryContext embree;
#else
  RTCIntersectContext embree;
#endif
  Through through;
};

inline Through through_of(const RTCFilterFunctionNArguments& asked) {
  return reinterpret_cast<const PacketContext*>(asked.context)->through;  // `embree` is its first member
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
