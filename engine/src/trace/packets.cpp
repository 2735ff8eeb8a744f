#include "trace/packets.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/packets.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/wide-inl.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

// Reinterprets Embree's unsigned numbers as signed ones.
HWY_INLINE std::int32_t* as_signed(unsigned int* numbers) { return reinterpret_cast<std::int32_t*>(numbers); }

constexpr std::int32_t kInvalid = -1;  // RTC_INVALID_GEOMETRY_ID

// Sets the fields that are the same for all rays.
template <class F, class Packet>
HWY_INLINE void prepare(Packet& packet, std::size_t lane, float near) {
  using I = typename F::Int;
  F(near).store(packet.ray.tnear + lane);
  F(0.0F).store(packet.ray.time + lane);
  I(0).store(as_signed(packet.ray.id + lane));
  I(0).store(as_signed(packet.ray.flags + lane));
  I(-1).store(as_signed(packet.ray.mask + lane));
  I(kInvalid).store(as_signed(packet.hit.instID[0] + lane));
}

// Stores the hits that Embree found for a vector of rays, if they are within the range.
template <class F, class Packet, class Rays>
HWY_INLINE void store_hits(Packet& packet, std::size_t lane, F range, std::int32_t first_element, Rays& rays, HitDetails* details,
                           std::size_t ray) {
  using I = typename F::Int;
  auto& hits = packet.hit;
  const F distance = F::load(packet.ray.tfar + lane);
  const auto taken = (I::load(as_signed(hits.geomID + lane)) != kInvalid) & (distance <= range);
  const auto store = [&](const auto& value, auto* to) HWY_ATTR { select(taken, value, value.load(to + ray)).store(to + ray); };
  store(distance, rays.t_hit);
  store(I::load(as_signed(hits.primID + lane)) + first_element, rays.element);
  if (details == nullptr) return;
  const auto normal = Wide3<F>::load(hits.Ng_x + lane, hits.Ng_y + lane, hits.Ng_z + lane);
  store(F::load(hits.u + lane), details->u);
  store(F::load(hits.v + lane), details->v);
  store(normal.x, details->normal_x);
  store(normal.y, details->normal_y);
  store(normal.z, details->normal_z);
  // Embree's normals point to the side from which the corners appear counterclockwise.
  const auto direction = Wide3<F>::load(packet.ray.dir_x + lane, packet.ray.dir_y + lane, packet.ray.dir_z + lane);
  const F against = normal.x * direction.x + (normal.y * direction.y + normal.z * direction.z);
  store(value_if(against > 0.0F, I(1)), details->back);
}

template <std::size_t kSize>
void trace_packets(RTCScene scene, std::int32_t first_element, Through through, RayBlock& rays, HitDetails* details) {
  using F = WideUpTo<kSize>;
  using I = typename F::Int;
  using F3 = Wide3<F>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity(), kMin = std::numeric_limits<float>::min();

  alignas(64) Packet<kSize> buffer;
  auto& packet = buffer.rays;
  for (std::size_t i = 0; i < kSize; i += F::kCount) prepare<F>(packet, i, rays.near);
  alignas(64) std::int32_t valid[kSize];
  std::fill_n(valid, kSize, -1);

  for (std::size_t first = 0; first < rays.count; first += kSize) {
    for (std::size_t i = 0; i < kSize; i += F::kCount) {
      const std::size_t ray = first + i;
      F3::load(rays.org_x + ray, rays.org_y + ray, rays.org_z + ray)
          .store(packet.ray.org_x + i, packet.ray.org_y + i, packet.ray.org_z + i);
      F3::load(rays.dir_x + ray, rays.dir_y + ray, rays.dir_z + ray)
          .store(packet.ray.dir_x + i, packet.ray.dir_y + i, packet.ray.dir_z + i);
      // Embree's rays end before tfar. The next float after the range lets a hit at the range itself count. For a range of 0
      // the smallest normal number does, since denormals are zero.
      const F range = F::load(rays.range + ray);
      const F next = bit_cast<F>(bit_cast<I>(range) + 1);
      const F beyond = max(select(range < kInfinity, next, kInfinity), kMin);
      min(F::load(rays.t_hit + ray), beyond).store(packet.ray.tfar + i);
      I(kInvalid).store(as_signed(packet.hit.geomID + i));
    }
    if (const std::size_t left = rays.count - first; left < kSize) {
      std::fill(valid + left, valid + kSize, 0);
      // On processors without packets of this size, Embree ignores `valid`, but it skips rays that end before they begin.
      std::fill(packet.ray.tfar + left, packet.ray.tfar + kSize, -1.0F);
    }
    intersect_packet(valid, scene, buffer, Coherence::none, through);
    for (std::size_t i = 0; i < kSize; i += F::kCount) {
      store_hits(packet, i, F::load(rays.range + first + i), first_element, rays, details, first + i);
    }
  }
}

// Calls f(lane of the packet, ray of the tile relative to the packet's first) for each vector of 4 x kRows rays.
template <std::size_t kRows, class Function>
HWY_INLINE void for_4_by(std::size_t lanes, const Function& f) {
  for (std::size_t row = 0; row < kRows; ++row) {
    for (std::size_t column = 0; column < 4; column += lanes) f(4 * row + column, kTileWidth * row + column);
  }
}

template <std::size_t kRows>
HWY_INLINE void trace_tile_by(RTCScene scene, std::int32_t first_element, Through through, RayBundle& rays, HitDetails& details) {
  using F = WideUpTo<4>;
  using F3 = Wide3<F>;
  constexpr float kInfinity = std::numeric_limits<float>::infinity();
  const F beyond = std::nextafter(rays.range, kInfinity);  // a hit at the range counts
  alignas(64) Packet<4 * kRows> buffer;
  auto& packet = buffer.rays;
  for_4_by<kRows>(F::kCount, [&](std::size_t lane, std::size_t) HWY_ATTR {
    F3{rays.origin.x(), rays.origin.y(), rays.origin.z()}.store(packet.ray.org_x + lane, packet.ray.org_y + lane,
                                                                packet.ray.org_z + lane);
    prepare<F>(packet, lane, rays.near);
  });
  alignas(64) std::int32_t valid[4 * kRows];
  std::fill_n(valid, 4 * kRows, -1);
  // The rays that fill up the last packets end before they begin. Otherwise distances of earlier rays in their place could
  // decide which boxes of Embree's tree the other rays enter.
  constexpr std::size_t kStrip = kRows * kTileWidth;
  std::fill(rays.t_hit + rays.count, rays.t_hit + (rays.count + kStrip - 1) / kStrip * kStrip, -1.0F);
  for (std::size_t row = 0; row * kTileWidth < rays.count; row += kRows) {
    for (std::size_t first = row * kTileWidth; first < (row + 1) * kTileWidth; first += 4) {
      for_4_by<kRows>(F::kCount, [&](std::size_t lane, std::size_t offset) HWY_ATTR {
        const std::size_t ray = first + offset;
        rotate(rays.rotation, F3::load_unaligned(rays.x + ray, rays.y + ray, rays.z + ray))
            .store(packet.ray.dir_x + lane, packet.ray.dir_y + lane, packet.ray.dir_z + lane);
        min(F::load(rays.t_hit + ray), beyond).store(packet.ray.tfar + lane);
        typename F::Int(kInvalid).store(as_signed(packet.hit.geomID + lane));
      });
      intersect_packet(valid, scene, buffer, Coherence::tile, through);
      for_4_by<kRows>(F::kCount, [&](std::size_t lane, std::size_t offset) HWY_ATTR {
        store_hits(packet, lane, beyond, first_element, rays, &details, first + offset);
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
