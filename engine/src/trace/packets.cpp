#include "trace/packets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/packets.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "trace/intersect-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
namespace hn = hwy::HWY_NAMESPACE;

// Writes what Embree tells of a vector of hits, of which `taken` count.
template <class D, class Packet>
HWY_INLINE void store_details(D d, const Packet& packet, std::size_t lane, hn::Mask<D> taken, HitDetails& details,
                              std::size_t ray) {
  const auto& hits = packet.hit;
  const auto store = [&](const float* from, float* to) HWY_ATTR {
    hn::Store(hn::IfThenElse(taken, hn::Load(d, from + lane), hn::Load(d, to + ray)), d, to + ray);
  };
  store(hits.u, details.u);
  store(hits.v, details.v);
  store(hits.Ng_x, details.normal_x);
  store(hits.Ng_y, details.normal_y);
  store(hits.Ng_z, details.normal_z);
  // Embree's normals point where the corners go around counterclockwise.
  const hn::RebindToSigned<D> di;
  const auto along = [&](const float* normal, const float* direction)
                         HWY_ATTR { return hn::Mul(hn::Load(d, normal + lane), hn::Load(d, direction + lane)); };
  const auto against = hn::Add(along(hits.Ng_x, packet.ray.dir_x),
                               hn::Add(along(hits.Ng_y, packet.ray.dir_y), along(hits.Ng_z, packet.ray.dir_z)));
  const auto back = hn::IfThenElseZero(hn::RebindMask(di, hn::Gt(against, hn::Zero(d))), hn::Set(di, 1));
  hn::Store(hn::IfThenElse(hn::RebindMask(di, taken), back, hn::Load(di, details.back + ray)), di, details.back + ray);
}

template <std::size_t kSize>
void trace_packets(RTCScene scene, std::int32_t first_element, Through through, RayBlock& rays, HitDetails* details) {
  const hn::CappedTag<float, kSize> d;
  const hn::RebindToSigned<decltype(d)> di;
  const std::size_t lanes = hn::Lanes(d);
  const auto invalid = hn::Set(di, -1);  // RTC_INVALID_GEOMETRY_ID
  const auto infinity = hn::Set(d, std::numeric_limits<float>::infinity());
  const auto least = hn::Set(d, std::numeric_limits<float>::min());

  alignas(64) Packet<kSize> buffer;
  auto& packet = buffer.rays;
  for (std::size_t i = 0; i < kSize; i += lanes) {
    hn::Store(hn::Set(d, rays.near), d, packet.ray.tnear + i);
    hn::Store(hn::Zero(d), d, packet.ray.time + i);
    hn::Store(hn::Zero(di), di, reinterpret_cast<std::int32_t*>(packet.ray.id + i));
    hn::Store(hn::Zero(di), di, reinterpret_cast<std::int32_t*>(packet.ray.flags + i));
    hn::Store(invalid, di, reinterpret_cast<std::int32_t*>(packet.ray.mask + i));
    hn::Store(invalid, di, reinterpret_cast<std::int32_t*>(packet.hit.instID[0] + i));
  }
  alignas(64) std::int32_t valid[kSize];
  std::fill_n(valid, kSize, -1);

  for (std::size_t first = 0; first < rays.count; first += kSize) {
    for (std::size_t i = 0; i < kSize; i += lanes) {
      const std::size_t ray = first + i;
      hn::Store(hn::Load(d, rays.org_x + ray), d, packet.ray.org_x + i);
      hn::Store(hn::Load(d, rays.org_y + ray), d, packet.ray.org_y + i);
      hn::Store(hn::Load(d, rays.org_z + ray), d, packet.ray.org_z + i);
      hn::Store(hn::Load(d, rays.dir_x + ray), d, packet.ray.dir_x + i);
      hn::Store(hn::Load(d, rays.dir_y + ray), d, packet.ray.dir_y + i);
      hn::Store(hn::Load(d, rays.dir_z + ray), d, packet.ray.dir_z + i);
      // Embree's rays end before tfar: the next number after the range lets a hit at the range itself count, and the least
      // normal number, where denormals are zero, one at 0.
      const auto range = hn::Load(d, rays.range + ray);
      const auto next = hn::BitCast(d, hn::Add(hn::BitCast(di, range), hn::Set(di, 1)));
      const auto beyond = hn::Max(hn::IfThenElse(hn::Lt(range, infinity), next, infinity), least);
      hn::Store(hn::Min(hn::Load(d, rays.t_hit + ray), beyond), d, packet.ray.tfar + i);
      hn::Store(invalid, di, reinterpret_cast<std::int32_t*>(packet.hit.geomID + i));
    }
    if (const std::size_t left = rays.count - first; left < kSize) {
      std::fill(valid + left, valid + kSize, 0);
      // On processors without packets of this size Embree ignores `valid`; it leaves out rays that end before they begin.
      std::fill(packet.ray.tfar + left, packet.ray.tfar + kSize, -1.0F);
    }
    intersect_packet(valid, scene, buffer, Coherence::none, through);
    for (std::size_t i = 0; i < kSize; i += lanes) {
      const std::size_t ray = first + i;
      const auto found = hn::Ne(hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.geomID + i)), invalid);
      const auto distance = hn::Load(d, packet.ray.tfar + i);
      const auto nearer = hn::And(hn::RebindMask(d, found), hn::Le(distance, hn::Load(d, rays.range + ray)));
      const auto element =
          hn::Add(hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.primID + i)), hn::Set(di, first_element));
      hn::Store(hn::IfThenElse(nearer, distance, hn::Load(d, rays.t_hit + ray)), d, rays.t_hit + ray);
      hn::Store(hn::IfThenElse(hn::RebindMask(di, nearer), element, hn::Load(di, rays.element + ray)), di, rays.element + ray);
      if (details != nullptr) store_details(d, packet, i, nearer, *details, ray);
    }
  }
}

// Calls f(lane of the packet, ray of the tile relative to the packet's first) for each vector of 4 x kRows rays.
template <std::size_t kRows, class F>
HWY_INLINE void for_4_by(std::size_t lanes, const F& f) {
  for (std::size_t row = 0; row < kRows; ++row) {
    for (std::size_t column = 0; column < 4; column += lanes) f(4 * row + column, kTileWidth * row + column);
  }
}

template <std::size_t kRows>
HWY_INLINE void trace_tile_by(RTCScene scene, std::int32_t first_element, Through through, RayBundle& rays, HitDetails& details) {
  const hn::CappedTag<float, 4> d;
  const hn::RebindToSigned<decltype(d)> di;
  using V = hn::Vec<decltype(d)>;
  const std::size_t lanes = hn::Lanes(d);
  const auto invalid = hn::Set(di, -1);                                                             // RTC_INVALID_GEOMETRY_ID
  const V beyond = hn::Set(d, std::nextafter(rays.range, std::numeric_limits<float>::infinity()));  // a hit at the range counts
  alignas(64) Packet<4 * kRows> buffer;
  auto& packet = buffer.rays;
  for_4_by<kRows>(lanes, [&](std::size_t lane, std::size_t) HWY_ATTR {
    hn::Store(hn::Set(d, rays.origin.x()), d, packet.ray.org_x + lane);
    hn::Store(hn::Set(d, rays.origin.y()), d, packet.ray.org_y + lane);
    hn::Store(hn::Set(d, rays.origin.z()), d, packet.ray.org_z + lane);
    hn::Store(hn::Set(d, rays.near), d, packet.ray.tnear + lane);
    hn::Store(hn::Zero(d), d, packet.ray.time + lane);
    hn::Store(hn::Zero(di), di, reinterpret_cast<std::int32_t*>(packet.ray.id + lane));
    hn::Store(hn::Zero(di), di, reinterpret_cast<std::int32_t*>(packet.ray.flags + lane));
    hn::Store(invalid, di, reinterpret_cast<std::int32_t*>(packet.ray.mask + lane));
    hn::Store(invalid, di, reinterpret_cast<std::int32_t*>(packet.hit.instID[0] + lane));
  });
  alignas(64) std::int32_t valid[4 * kRows];
  std::fill_n(valid, 4 * kRows, -1);
  // The rays that fill up the last packets end before they begin. Otherwise what was traced there before could decide which boxes
  // of Embree's tree the other rays enter.
  constexpr std::size_t kStrip = kRows * kTileWidth;
  std::fill(rays.t_hit + rays.count, rays.t_hit + (rays.count + kStrip - 1) / kStrip * kStrip, -1.0F);
  for (std::size_t row = 0; row * kTileWidth < rays.count; row += kRows) {
    for (std::size_t first = row * kTileWidth; first < (row + 1) * kTileWidth; first += 4) {
      for_4_by<kRows>(lanes, [&](std::size_t lane, std::size_t offset) HWY_ATTR {
        const std::size_t ray = first + offset;
        const Vec3V<V> direction =
            rotate(d, rays.rotation, {hn::LoadU(d, rays.x + ray), hn::LoadU(d, rays.y + ray), hn::LoadU(d, rays.z + ray)});
        hn::Store(direction.x, d, packet.ray.dir_x + lane);
        hn::Store(direction.y, d, packet.ray.dir_y + lane);
        hn::Store(direction.z, d, packet.ray.dir_z + lane);
        hn::Store(hn::Min(hn::Load(d, rays.t_hit + ray), beyond), d, packet.ray.tfar + lane);
        hn::Store(invalid, di, reinterpret_cast<std::int32_t*>(packet.hit.geomID + lane));
      });
      intersect_packet(valid, scene, buffer, Coherence::tile, through);
      for_4_by<kRows>(lanes, [&](std::size_t lane, std::size_t offset) HWY_ATTR {
        const std::size_t ray = first + offset;
        const auto found = hn::Ne(hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.geomID + lane)), invalid);
        const auto element =
            hn::Add(hn::Load(di, reinterpret_cast<const std::int32_t*>(packet.hit.primID + lane)), hn::Set(di, first_element));
        const V distance = hn::Load(d, packet.ray.tfar + lane);
        hn::Store(hn::IfThenElse(hn::RebindMask(d, found), distance, hn::Load(d, rays.t_hit + ray)), d, rays.t_hit + ray);
        hn::Store(hn::IfThenElse(found, element, hn::Load(di, rays.element + ray)), di, rays.element + ray);
        store_details(d, packet, lane, hn::RebindMask(d, found), details, ray);
      });
    }
  }
}

void trace_tile(RTCScene scene, std::int32_t first_element, bool wide, Through through, RayBundle& rays, HitDetails& details) {
  if (wide) {
    trace_tile_by<4>(scene, first_element, through, rays, details);
  } else {
    trace_tile_by<2>(scene, first_element, through, rays, details);
  }
}

void trace_16(RTCScene scene, std::int32_t first_element, RayBlock& rays) {
  trace_packets<16>(scene, first_element, Through::nothing, rays, nullptr);
}
void trace_8(RTCScene scene, std::int32_t first_element, Through through, RayBlock& rays, HitDetails* details) {
  trace_packets<8>(scene, first_element, through, rays, details);
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(trace_16);
HWY_EXPORT(trace_tile);
HWY_EXPORT(trace_8);

void trace_packets_of_16(RTCScene scene, std::int32_t first_element, RayBlock& rays) {
  HWY_DYNAMIC_DISPATCH(trace_16)(scene, first_element, rays);
}
std::size_t trace_packets_of_8(RTCScene scene, std::int32_t first_element, Through through, RayBlock& rays, HitDetails* details) {
  HWY_DYNAMIC_DISPATCH(trace_8)(scene, first_element, through, rays, details);
  return (rays.count + 7) / 8;
}
std::size_t trace_tile(RTCScene scene, std::int32_t first_element, bool wide, Through through, RayBundle& rays,
                       HitDetails& details) {
  HWY_DYNAMIC_DISPATCH(trace_tile)(scene, first_element, wide, through, rays, details);
  const std::size_t strip = kTileWidth * (wide ? 4 : 2);
  return (rays.count + strip - 1) / strip * (kTileWidth / 4);
}

}  // namespace flockstep::trace
#endif
