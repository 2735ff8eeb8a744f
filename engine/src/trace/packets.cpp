#include "trace/packets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/packets.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <limits>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace swiftlet::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

void trace_packets(const PacketTarget& target, RayBlock& rays, Coherence coherence) {
  const hn::CappedTag<float, kPacketSize> d;
  const hn::RebindToSigned<decltype(d)> di;
  using Floats = hn::Vec<decltype(d)>;
  using Ints = hn::Vec<decltype(di)>;
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
    hn::Store(miss, di, reinterpret_cast<std::int32_t*>(packet.hit.instID[0] + i));
  }
  alignas(64) std::int32_t valid[kPacketSize];
  std::fill_n(valid, kPacketSize, -1);

  for (std::size_t first = 0; first < rays.count; first += kPacketSize) {
    if (rays.count - first < kPacketSize) std::fill(valid + (rays.count - first), valid + kPacketSize, 0);
    for (std::size_t i = 0; i < kPacketSize; i += lanes) {
      const Vec3V<Floats> origin{hn::Load(d, rays.org_x + first + i), hn::Load(d, rays.org_y + first + i),
                                 hn::Load(d, rays.org_z + first + i)};
      const Vec3V<Floats> direction{hn::Load(d, rays.dir_x + first + i), hn::Load(d, rays.dir_y + first + i),
                                    hn::Load(d, rays.dir_z + first + i)};
      Floats nearest = hn::Load(d, rays.range + first + i);
      Ints geometry = miss;
      Ints primitive = miss;
      for (const RoomShape& room : target.rooms) {
        const Floats distance = hit_distance(d, room.shape, origin, direction, hn::Zero(d));
        // At the range itself is a hit, at infinity is none; of two rooms at one distance the earlier is taken.
        const auto within = hn::And(hn::Le(distance, nearest), hn::Lt(distance, infinity));
        const auto first_there = hn::Or(hn::Lt(distance, nearest), hn::RebindMask(d, hn::Eq(geometry, miss)));
        const auto take = hn::And(within, first_there);
        nearest = hn::IfThenElse(take, distance, nearest);
        geometry = hn::IfThenElse(hn::RebindMask(di, take), hn::Set(di, static_cast<std::int32_t>(target.primitive_geometry)), geometry);
        primitive = hn::IfThenElse(hn::RebindMask(di, take), hn::Set(di, room.element), primitive);
      }
      hn::Store(origin.x, d, packet.ray.org_x + i);
      hn::Store(origin.y, d, packet.ray.org_y + i);
      hn::Store(origin.z, d, packet.ray.org_z + i);
      hn::Store(direction.x, d, packet.ray.dir_x + i);
      hn::Store(direction.y, d, packet.ray.dir_y + i);
      hn::Store(direction.z, d, packet.ray.dir_z + i);
      hn::Store(nearest, d, packet.ray.tfar + i);
      hn::Store(geometry, di, reinterpret_cast<std::int32_t*>(packet.hit.geomID + i));
      hn::Store(primitive, di, reinterpret_cast<std::int32_t*>(packet.hit.primID + i));
    }
    if (target.scene != nullptr) intersect_packet(valid, target.scene, packet, coherence);
    for (std::size_t i = 0; i < kPacketSize; i += lanes) {
      const auto geometry = hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.geomID + i));
      const auto primitive = hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.primID + i));
      const auto missed = hn::Eq(geometry, miss);
      const auto is_triangle = hn::Eq(geometry, hn::Set(di, static_cast<std::int32_t>(target.triangle_geometry)));
      const auto element = hn::Add(primitive, hn::IfThenElseZero(is_triangle, hn::Set(di, target.first_triangle)));
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

void trace_packets(const PacketTarget& target, RayBlock& rays, Coherence coherence) {
  HWY_DYNAMIC_DISPATCH(trace_packets)(target, rays, coherence);
}

}  // namespace swiftlet::trace
#endif
