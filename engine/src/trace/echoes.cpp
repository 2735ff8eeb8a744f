#include "trace/echoes.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/echoes.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/cache_control.h>
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "base/wide-inl.hpp"
#include "trace/ray_block.hpp"
#include "world/triangle_normal.hpp"

HWY_BEFORE_NAMESPACE();
namespace flockstep::trace::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type

using Beams = WideUpTo<kRayPadding>;
using BeamInts = Beams::Int;
using BeamIds = Wide<hn::Rebind<std::uint16_t, Beams::Tag>>;

// Stores the first numbers of a vector, and prefetches the place of a later tile's: tiles are written row by row, which the
// processor does not foresee.
template <class Values>
HWY_INLINE void store_ahead(Values values, std::size_t left, typename Values::T* to) {
  values.store_first(left, to);
  hwy::Prefetch(to + 3 * kRayPadding);
}

HWY_INLINE void write_ids(const EchoRows& to, std::size_t at, std::size_t left, BeamInts ids) {
  if (to.semantic != nullptr) store_ahead(truncate<BeamIds>(ids), left, to.semantic + at);
  if (to.instance != nullptr) store_ahead(truncate<BeamIds>(shift_right<16>(ids)), left, to.instance + at);
}

// Writes the intensity by the LiDAR equation of a surface that scatters light evenly (Lambert), in the units of LidarReadings,
// and returns the ranges, negative for beams that return too little, unless they are unread. Directions are rounded.
HWY_INLINE Beams write_intensity(const EchoRows& to, std::size_t at, std::size_t left, Beams range, Beams reflectance,
                                 Beams cosine, Beams::Mask unread) {
  const Beams distance = max(range, 1.0F);
  const Beams intensity = min(reflectance * cosine / (distance * distance), 1.0F);
  if (to.intensity != nullptr) store_ahead(intensity, left, to.intensity + at);
  if (to.least.cosine <= 0.0F && to.least.intensity <= 0.0F) return range;
  const Beams::Mask misses = without((cosine < to.least.cosine) | (intensity < to.least.intensity), unread);
  return select(misses, -range, range);
}

// Returns the cosines of the next beams, with those of triangles among them.
HWY_INLINE Beams with_triangles(const Echoes& echoes, const BeamHits& hits, std::size_t beam, BeamInts element, Beams cosine) {
  const BeamInts::Mask is_triangle = (element > echoes.first_triangle - 1) & (element < echoes.num_elements);
  if (none(is_triangle)) return cosine;
  const BeamInts triangle = value_if(is_triangle, element - echoes.first_triangle);
  const auto component = [&](const std::vector<float>& axis) HWY_ATTR { return Beams::gather(axis.data(), triangle); };
  const Wide3<Beams> normal{component(echoes.normal_x), component(echoes.normal_y), component(echoes.normal_z)};
  const auto direction = rotate(hits.rotation, Wide3<Beams>::load_unaligned(hits.x + beam, hits.y + beam, hits.z + beam));
  return select(is_triangle, abs(dot(direction, normal)), cosine);
}

// Writes the next beams of a row, at most a vector of them. Returns those that need a closer look.
template <std::size_t kVectors, bool kIds, bool kCosines>
HWY_INLINE Beams::Mask write_next(const Echoes& echoes, const BeamHits& hits, std::size_t beam, const EchoRows& to,
                                  std::size_t at, std::size_t left) {
  const BeamInts element = BeamInts::load_first(left, hits.elements + beam);
  Beams::Mask unread = element > echoes.num_elements - 1;
  const BeamInts entry = zero_if(unread, element + 1);
  if constexpr (kIds) write_ids(to, at, left, BeamInts::look_up<kVectors>(echoes.ids.data(), entry));
  Beams range = Beams::load_first(left, hits.ranges + beam);
  if constexpr (kCosines) {
    Beams cosine = Beams::load_first(left, hits.cosines + beam);
    if (echoes.first_triangle < echoes.num_elements) cosine = with_triangles(echoes, hits, beam, element, cosine);
    cosine = value_if(element > -1, cosine);
    unread = unread | (cosine < 0.0F);
    const Beams reflectance = Beams::look_up<kVectors>(echoes.reflectance.data(), entry);
    range = write_intensity(to, at, left, range, reflectance, cosine, unread);
  }
  store_ahead(range, left, to.ranges + at);
  return unread;
}

// Writes all beams but those that need a closer look, of which it writes the ranges only. Returns true if there are some. The
// inner loops have one number of beams, known to the compiler if it is a whole vector.
template <std::size_t kVectors, bool kIds, bool kCosines>
bool write_rows(const Echoes& echoes, const BeamHits& hits, const EchoRows& to) {
  constexpr std::size_t kCount = Beams::kCount;
  const bool is_single = to.width == hits.count;  // a single row is cut into some of a vector each
  const std::size_t width = is_single ? kCount : to.width, stride = is_single ? kCount : to.stride;
  const std::size_t whole = to.width / kCount * kCount, left = to.width - whole;
  Beams::Mask unread(false);
  for (std::size_t first = 0; first + kCount <= width; first += kCount) {
    for (std::size_t beam = first, at = first; beam + kCount <= hits.count; beam += width, at += stride) {
      unread = unread | write_next<kVectors, kIds, kCosines>(echoes, hits, beam, to, at, kCount);
    }
  }
  for (std::size_t beam = whole, at = whole; left > 0 && beam < hits.count; beam += width, at += stride) {
    unread = unread | write_next<kVectors, kIds, kCosines>(echoes, hits, beam, to, at, left);
  }
  return !none(unread);
}

template <bool kIds, bool kCosines>
HWY_INLINE bool write_kind(const Echoes& echoes, const BeamHits& hits, const EchoRows& to) {
  const auto entries = static_cast<std::size_t>(echoes.num_elements) + 1;
  return entries <= Beams::kLanes       ? write_rows<1, kIds, kCosines>(echoes, hits, to)
         : entries <= 2 * Beams::kLanes ? write_rows<2, kIds, kCosines>(echoes, hits, to)
                                        : write_rows<0, kIds, kCosines>(echoes, hits, to);
}

bool write_hits(const Echoes& echoes, const BeamHits& hits, const EchoRows& to) {
  if (to.semantic == nullptr && to.instance == nullptr) return write_kind<false, true>(echoes, hits, to);
  return to.needs_cosines ? write_kind<true, true>(echoes, hits, to) : write_kind<true, false>(echoes, hits, to);
}

void write_same(const Echo& echo, const float* cosines, const BeamHits& hits, const EchoRows& to) {
  for (std::size_t i = 0; i < hits.count; i += Beams::kCount) {
    const std::size_t left = hits.count - i;
    write_ids(to, i, left, echo.ids);
    if (!to.needs_cosines) continue;
    const Beams range = Beams::load_first(left, hits.ranges + i), cosine = Beams::load_unaligned(cosines + i);
    write_intensity(to, i, left, range, echo.reflectance, cosine, Beams::Mask(false)).store_first(left, to.ranges + i);
  }
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(write_hits);
HWY_EXPORT(write_same);

namespace {

// Writes rows of one beam, as of scans that take time. They are faster as a single row.
bool write_column(const Echoes& echoes, const BeamHits& hits, const EchoRows& to) {
  RayFloats ranges, intensity;
  std::uint16_t semantic[kMaxRays], instance[kMaxRays];
  const auto if_needed = [](auto* needed, auto* values) { return needed == nullptr ? nullptr : values; };
  const EchoRows row{ranges,
                     if_needed(to.semantic, semantic),
                     if_needed(to.instance, instance),
                     if_needed(to.intensity, intensity),
                     hits.count,
                     hits.count,
                     to.needs_cosines,
                     to.least};
  const bool has_unread = HWY_DYNAMIC_DISPATCH(write_hits)(echoes, hits, row);
  const auto copy = [&](const auto* from, auto* values) {
    for (std::size_t i = 0; values != nullptr && i < hits.count; ++i) values[i * to.stride] = from[i];
  };
  copy(ranges, to.ranges);
  copy(semantic, to.semantic);
  copy(instance, to.instance);
  copy(intensity, to.intensity);
  return has_unread;
}

}  // namespace

Echoes::Echoes(const World& world) {
  const TriangleMesh& mesh = world.triangles();
  const std::size_t triangles = mesh.triangles.size();
  first_triangle = static_cast<std::int32_t>(world.primitives().size());
  num_elements = first_triangle + static_cast<std::int32_t>(triangles);
  const auto add = [&](std::size_t material, std::size_t object) {
    const Echo echo = echo_of(world.materials()[material].base_color, world.semantic(material),
                              static_cast<std::uint16_t>(1 + object));  // numbers start at 1
    ids.push_back(echo.ids);
    reflectance.push_back(echo.reflectance);
  };
  const std::size_t entries = std::max(static_cast<std::size_t>(num_elements) + 1, 2 * kRayPadding);
  ids.reserve(entries);
  reflectance.reserve(entries);
  ids.push_back(0);
  reflectance.push_back(0.0F);
  for (const Primitive& primitive : world.primitives()) add(primitive.material, ids.size() - 1);
  for (std::vector<float>* const axis : {&normal_x, &normal_y, &normal_z}) axis->reserve(triangles);
  for (std::size_t i = 0; i < triangles; ++i) {
    add(mesh.materials[i], world.primitives().size() + mesh.objects[i]);
    const Vec3 normal = triangle_normal(mesh, i).cast<float>();
    normal_x.push_back(normal.x());
    normal_y.push_back(normal.y());
    normal_z.push_back(normal.z());
  }
  ids.resize(entries);
  reflectance.resize(entries);
}

void EchoTarget::write(const Echoes& echoes, const BeamHits& hits, float* ranges, std::size_t width, std::size_t stride) const {
  const auto row = [this](auto* values) { return values == nullptr ? nullptr : values + first; };
  if (width == stride) width = stride = hits.count;  // rows without gaps are one
  const EchoRows to{ranges, row(reader->semantic), row(reader->instance), row(reader->intensity), width, stride, needs_cosines,
                    least};
  const bool has_unread =
      width > 1 || hits.count == 1 ? HWY_DYNAMIC_DISPATCH(write_hits)(echoes, hits, to) : write_column(echoes, hits, to);
  if (has_unread) reader->look_closer(drone, hits, to);
}

void write_echo(const Echo& echo, const float* cosines, const BeamHits& hits, const EchoRows& to) {
  HWY_DYNAMIC_DISPATCH(write_same)(echo, cosines, hits, to);
}

}  // namespace flockstep::trace
#endif
