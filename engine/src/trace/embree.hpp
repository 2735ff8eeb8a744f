// The one place that knows which Embree this is: 3.13 or 4.x.
#pragma once

#if FLOCKSTEP_EMBREE_MAJOR >= 4
#include <embree4/rtcore.h>
#else
#include <embree3/rtcore.h>
#endif

#include <cstddef>

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

// Traces a packet whose rays may have anything to do with each other. Embree's coherent traversal would let a ray's last bits, at
// the edges triangles share, depend on the rays beside it.
#if FLOCKSTEP_EMBREE_MAJOR >= 4
inline void intersect_packet(const int* valid, RTCScene scene, Packet<8>& packet) {
  rtcIntersect8(valid, scene, &packet.rays, nullptr);
}
inline void intersect_packet(const int* valid, RTCScene scene, Packet<16>& packet) {
  rtcIntersect16(valid, scene, &packet.rays, nullptr);
}
// For rays that point the same way and always come together.
inline void intersect_coherent(const int* valid, RTCScene scene, Packet<8>& packet) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &packet.rays, &arguments);
}
inline void intersect_coherent(const int* valid, RTCScene scene, Packet<16>& packet) {
  RTCIntersectArguments arguments;
  rtcInitIntersectArguments(&arguments);
  arguments.flags = RTC_RAY_QUERY_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &packet.rays, &arguments);
}
#else
inline void intersect_packet(const int* valid, RTCScene scene, Packet<8>& packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect8(valid, scene, &context, &packet.rays);
}
inline void intersect_packet(const int* valid, RTCScene scene, Packet<16>& packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  rtcIntersect16(valid, scene, &context, &packet.rays);
}
inline void intersect_coherent(const int* valid, RTCScene scene, Packet<8>& packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect8(valid, scene, &context, &packet.rays);
}
inline void intersect_coherent(const int* valid, RTCScene scene, Packet<16>& packet) {
  RTCIntersectContext context;
  rtcInitIntersectContext(&context);
  context.flags = RTC_INTERSECT_CONTEXT_FLAG_COHERENT;
  rtcIntersect16(valid, scene, &context, &packet.rays);
}
#endif

}  // namespace flockstep::trace
