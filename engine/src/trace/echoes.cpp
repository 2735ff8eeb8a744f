#include "trace/echoes.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "trace/echoes.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <cstddef>
#include <cstdint>
#include <limits>
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

// Places of the next beams: the first one's, how many there are, and how far apart.
struct Places {
  std::size_t first, count, apart;
};

template <class Values>
HWY_INLINE void store_at(Values values, const Places& places, typename Values::T* to) {
  if (places.apart == 1) return values.store_first(places.count, to + places.first);
  alignas(64) typename Values::T lanes[Values::kCount];
  values.store(lanes);
  const std::size_t count = std::min(places.count, Values::kCount);
  for (std::size_t i = 0; i < count; ++i) to[places.first + i * places.apart] = lanes[i];
}

HWY_INLINE void write_ids(const EchoRows& to, const Places& places, BeamInts ids) {
  if (to.semantic != nullptr) store_at(truncate<BeamIds>(ids), places, to.semantic);
  if (to.instance != nullptr) store_at(truncate<BeamIds>(shift_right<16>(ids)), places, to.instance);
}

// Writes the intensity by the LiDAR equation of a surface that scatters light evenly (Lambert), in the units of LidarReadings,
// and returns the ranges, inf for beams that return too little. Directions are rounded.
HWY_INLINE Beams write_intensity(const EchoRows& to, const Places& places, Beams range, Beams reflectance, Beams cosine) {
  const Beams distance = max(range, 1.0F);
  const Beams intensity = min(reflectance * cosine / (distance * distance), 1.0F);
  if (to.intensity != nullptr) store_at(intensity, places, to.intensity);
  if (to.least.cosine <= 0.0F && to.least.intensity <= 0.0F) return range;
  const Beams::Mask misses = (cosine < to.least.cosine) | (intensity < to.least.intensity);
  return select(misses, std::numeric_limits<float>::infinity(), range);
}

// Returns the entries of a table of kVectors vectors, or of any length for 0.
template <class Values, std::size_t kVectors>
HWY_INLINE Values of_entries(const typename Values::T* table, BeamInts entry) {
  if constexpr (kVectors == 0) {
    return Values::gather(table, entry);
  } else {
    return Values::template look_up<kVectors>(table, entry);
  }
}

// Returns the cosines of the next beams, with those of triangles among them.
HWY_INLINE Beams with_triangles(const Echoes& echoes, const BeamHits& hits, std::size_t beam, BeamInts element, Beams cosine) {
  const BeamInts::Mask is_triangle = (element > echoes.first_triangle - 1) & (element < echoes.num_elements);
  if (none(is_triangle)) return cosine;
  const BeamInts triangle = value_if(is_triangle, element - echoes.first_triangle);
  const auto component = [&](const std::vector<float>& axis) HWY_ATTR { return Beams::gather(axis.data(), triangle); };
  const Wide3<Beams> normal{component(echoes.normal_x), component(echoes.normal_y), component(echoes.normal_z)};
  const auto direction =
      rotate(hits.rotation, Wide3<Beams>::load_unaligned(hits.x + beam, hits.y + beam, hits.z + beam));
  return select(is_triangle, abs(dot(direction, normal)), cosine);
}

// Writes all beams but those that need a closer look, of which it writes the ranges only. Returns true if there are some. `to`
// is a copy, because what is stored could be a part of it for all that the compiler knows.
template <std::size_t kVectors>
HWY_INLINE bool write_beams(const Echoes& echoes, const BeamHits& hits, EchoRows to) {
  const bool has_triangles = echoes.first_triangle < echoes.num_elements;
  const BeamInts last_element = echoes.num_elements - 1;
  const std::int32_t* const ids = echoes.ids.data();
  const float* const reflectance = echoes.reflectance.data();
  const std::int32_t* const elements = hits.elements;
  const float *const ranges = hits.ranges, *const cosines = hits.cosines;
  const std::size_t count = hits.count;
  // Columns, as of scans that take time, are written as one row of beams that are apart.
  const std::size_t apart = to.width == 1 ? to.stride : 1, width = to.width == 1 ? count : to.width;
  Beams::Mask is_any_unread(false);
  for (std::size_t row = 0, at = 0; row < count; row += width, at += to.stride) {
    for (std::size_t i = 0; i < width; i += Beams::kCount) {
      const std::size_t beam = row + i;
      const Places places{at + i * apart, width - i, apart};
      const BeamInts element = BeamInts::load_first(places.count, elements + beam);
      Beams::Mask unread = element > last_element;
      const BeamInts entry = zero_if(unread, element + 1);
      if (to.semantic != nullptr || to.instance != nullptr) {
        write_ids(to, places, of_entries<BeamInts, kVectors>(ids, entry));
      }
      Beams range = Beams::load_first(places.count, ranges + beam);
      if (to.needs_cosines) {
        Beams cosine = Beams::load_first(places.count, cosines + beam);
        if (has_triangles) cosine = with_triangles(echoes, hits, beam, element, cosine);
        cosine = value_if(element > -1, cosine);
        unread = unread | (cosine < 0.0F);
        const Beams reading = write_intensity(to, places, range, of_entries<Beams, kVectors>(reflectance, entry), cosine);
        range = select(unread, range, reading);
      }
      store_at(range, places, to.ranges);
      is_any_unread = is_any_unread | unread;
    }
  }
  return !none(is_any_unread);
}

bool write_world(const Echoes& echoes, const BeamHits& hits, const EchoRows& to) {
  const auto entries = static_cast<std::size_t>(echoes.num_elements) + 1;
  return entries <= Beams::kLanes       ? write_beams<1>(echoes, hits, to)
         : entries <= 2 * Beams::kLanes ? write_beams<2>(echoes, hits, to)
                                        : write_beams<0>(echoes, hits, to);
}

void write_row(const Echo& echo, const float* cosines, const BeamHits& hits, const EchoRows& to) {
  for (std::size_t i = 0; i < hits.count; i += Beams::kCount) {
    const Places places{i, hits.count - i, 1};
    write_ids(to, places, echo.ids);
    if (!to.needs_cosines) continue;
    const Beams range = Beams::load_first(places.count, hits.ranges + i);
    store_at(write_intensity(to, places, range, echo.reflectance, Beams::load_unaligned(cosines + i)), places, to.ranges);
  }
}

}  // namespace flockstep::trace::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::trace {

HWY_EXPORT(write_world);
HWY_EXPORT(write_row);

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
  if (HWY_DYNAMIC_DISPATCH(write_world)(echoes, hits, to)) reader->look_closer(drone, hits, to);
}

void write_echo(const Echo& echo, const float* cosines, const BeamHits& hits, const EchoRows& to) {
  HWY_DYNAMIC_DISPATCH(write_row)(echo, cosines, hits, to);
}

}  // namespace flockstep::trace
#endif
