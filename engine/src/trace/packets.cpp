#include "trace/packets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/packets.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <limits>

HWY_BEFORE_NAMESPACE();
namespace swiftlet::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void trace_packets(RTCScene scene, RayBlock& rays, Coherence coherence, unsigned int triangle_geometry,
                   std::int32_t first_triangle) {
  const hn::CappedTag<float, kPacketSize> d;
  const hn::RebindToSigned<decltype(d)> di;
  const std::size_t lanes = hn::Lanes(d);
  const auto infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const auto miss = hn::Set(di, -1);  // RTC_INVALID_GEOMETRY_ID

  alignas(64) RayPacket packet;
  for (std::size_t i = 0; i < kPacketSize; i += lanes) {
    hn::Store(hn::Zero(d), d, packet.ray.tnear + i);
    hn::Store(hn::Zero(d), d, packet.ray.time + i);
    hn::Store(hn::Zero(di), di, reinterpret_cast<std::int32_t*>(packet.ray.id + i));
    hn::Store(hn::Zero(di), di, reinterpret_cast<std::int32_t*>(packet.ray.flags + i));
    hn::Store(miss, di, reinterpret_cast<std::int32_t*>(packet.ray.mask + i));
    hn::Store(miss, di, reinterpret_cast<std::int32_t*>(packet.hit.primID + i));
    hn::Store(miss, di, reinterpret_cast<std::int32_t*>(packet.hit.instID[0] + i));
  }
  alignas(64) std::int32_t valid[kPacketSize];
  std::fill_n(valid, kPacketSize, -1);

  for (std::size_t first = 0; first < rays.count; first += kPacketSize) {
    if (rays.count - first < kPacketSize) std::fill(valid + (rays.count - first), valid + kPacketSize, 0);
    for (std::size_t i = 0; i < kPacketSize; i += lanes) {
      hn::Store(hn::Load(d, rays.org_x + first + i), d, packet.ray.org_x + i);
      hn::Store(hn::Load(d, rays.org_y + first + i), d, packet.ray.org_y + i);
      hn::Store(hn::Load(d, rays.org_z + first + i), d, packet.ray.org_z + i);
      hn::Store(hn::Load(d, rays.dir_x + first + i), d, packet.ray.dir_x + i);
      hn::Store(hn::Load(d, rays.dir_y + first + i), d, packet.ray.dir_y + i);
      hn::Store(hn::Load(d, rays.dir_z + first + i), d, packet.ray.dir_z + i);
      hn::Store(hn::Load(d, rays.range + first + i), d, packet.ray.tfar + i);
      hn::Store(miss, di, reinterpret_cast<std::int32_t*>(packet.hit.geomID + i));
    }
    intersect_packet(valid, scene, packet, coherence);
    for (std::size_t i = 0; i < kPacketSize; i += lanes) {
      const auto geometry = hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.geomID + i));
      const auto primitive = hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.primID + i));
      const auto missed = hn::Eq(geometry, miss);
      const auto is_triangle = hn::Eq(geometry, hn::Set(di, static_cast<std::int32_t>(triangle_geometry)));
      const auto element = hn::Add(primitive, hn::IfThenElseZero(is_triangle, hn::Set(di, first_triangle)));
      hn::Store(hn::IfThenElse(hn::RebindMask(d, missed), infinity, hn::Load(d, packet.ray.tfar + i)), d, rays.t_hit + first + i);
      hn::Store(hn::IfThenElse(missed, miss, element), di, rays.element + first + i);
    }
  }
}

}  // namespace swiftlet::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace swiftlet::trace {

HWY_EXPORT(trace_packets);

void trace_packets(RTCScene scene, RayBlock& rays, Coherence coherence, unsigned int triangle_geometry,
                   std::int32_t first_triangle) {
  HWY_DYNAMIC_DISPATCH(trace_packets)(scene, rays, coherence, triangle_geometry, first_triangle);
}

}  // namespace swiftlet::trace
#endif
