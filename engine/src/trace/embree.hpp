// The one place that knows which Embree this is: 3.13 or 4.x.
#pragma once

#if SWIFTLET_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cstddef>

namespace swiftlet::trace {

inline constexpr std::size_t kPacketSize = 16;

// Sixteen rays and their hits, structure of arrays, as Embree reads and writes them. (Where registers hold eight, Embree
// halves it itself.)
using RayPacket = RTCRayHit16;

// Traces a packet. Always incoherent: Embree's coherent traversal lets a ray's last bits, at the edges triangles share, depend on
// the rays beside it; and with few primitives it is the slower one.
inline void intersect_packet(const int* valid, RTCScene scene, RayPacket& packet) {
#if SWIFTLET_EMBREE_MAJOR >= 4
  rtcIntersect16(valid, scene, &packet, nullptr);
#else
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect16(valid, scene, &context, &packet);
#endif
}

}  // namespace swiftlet::trace
