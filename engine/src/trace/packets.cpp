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

// What one vector of rays has hit so far.
template <class V, class I>
struct Nearest {
  V distance;  // m; the range where nothing is hit
  I element;   // -1 where nothing is hit
};

// A hit at the range itself counts, at infinity none does; of two shapes at one distance the earlier is taken.
template <class D, class V, class I>
HWY_INLINE void meet(D d, const NumberedShape& shape, const Vec3V<V>& origin, const Vec3V<V>& direction, Nearest<V, I>& nearest) {
  const hn::RebindToSigned<D> di;
  const V distance = hit_distance(d, shape.shape, origin, direction, hn::Zero(d));
  const auto free = hn::RebindMask(d, hn::Eq(nearest.element, hn::Set(di, -1)));
  const auto nearer = hn::Or(hn::Lt(distance, nearest.distance), hn::And(hn::Eq(distance, nearest.distance), free));
  const auto take = hn::And(nearer, hn::Lt(distance, hn::Set(d, std::numeric_limits<float>::infinity())));
  nearest.distance = hn::IfThenElse(take, distance, nearest.distance);
  nearest.element = hn::IfThenElse(hn::RebindMask(di, take), hn::Set(di, shape.element), nearest.element);
}

void trace_shapes(std::span<const NumberedShape* const> shapes, RayBlock& rays) {
  const hn::CappedTag<float, RayBlock::kPadding> d;
  const hn::RebindToSigned<decltype(d)> di;
  using Floats = hn::Vec<decltype(d)>;
  using Ints = hn::Vec<decltype(di)>;
  for (std::size_t i = 0; i < rays.count; i += hn::Lanes(d)) {
    const Vec3V<Floats> origin{hn::Load(d, rays.org_x + i), hn::Load(d, rays.org_y + i), hn::Load(d, rays.org_z + i)};
    const Vec3V<Floats> direction{hn::Load(d, rays.dir_x + i), hn::Load(d, rays.dir_y + i), hn::Load(d, rays.dir_z + i)};
    Nearest<Floats, Ints> nearest{hn::Load(d, rays.range + i), hn::Set(di, -1)};
    for (const NumberedShape* shape : shapes) meet(d, *shape, origin, direction, nearest);
    const auto missed = hn::RebindMask(d, hn::Eq(nearest.element, hn::Set(di, -1)));
    const auto infinity = hn::Set(d, std::numeric_limits<float>::infinity());
    hn::Store(hn::IfThenElse(missed, infinity, nearest.distance), d, rays.t_hit + i);
    hn::Store(nearest.element, di, rays.element + i);
  }
}

void trace_packets(const PacketTarget& target, RayBlock& rays) {
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
      Nearest<Floats, Ints> nearest{hn::Load(d, rays.range + first + i), miss};
      for (const NumberedShape& room : target.rooms) meet(d, room, origin, direction, nearest);
      const auto hit_room = hn::Ne(nearest.element, miss);
      const Ints geometry = hn::IfThenElse(hit_room, hn::Set(di, static_cast<std::int32_t>(target.primitive_geometry)), miss);
      hn::Store(origin.x, d, packet.ray.org_x + i);
      hn::Store(origin.y, d, packet.ray.org_y + i);
      hn::Store(origin.z, d, packet.ray.org_z + i);
      hn::Store(direction.x, d, packet.ray.dir_x + i);
      hn::Store(direction.y, d, packet.ray.dir_y + i);
      hn::Store(direction.z, d, packet.ray.dir_z + i);
      hn::Store(nearest.distance, d, packet.ray.tfar + i);
      hn::Store(geometry, di, reinterpret_cast<std::int32_t*>(packet.hit.geomID + i));
      hn::Store(nearest.element, di, reinterpret_cast<std::int32_t*>(packet.hit.primID + i));
    }
    if (target.scene != nullptr) intersect_packet(valid, target.scene, packet);
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
HWY_EXPORT(trace_shapes);

void trace_shapes(std::span<const NumberedShape* const> shapes, RayBlock& rays) {
  HWY_DYNAMIC_DISPATCH(trace_shapes)(shapes, rays);
}

void trace_packets(const PacketTarget& target, RayBlock& rays) { HWY_DYNAMIC_DISPATCH(trace_packets)(target, rays); }

}  // namespace swiftlet::trace
#endif
