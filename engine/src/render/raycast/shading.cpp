#include "render/raycast/shading.hpp"

#undef HWY_TARGET_INCLUDE
#define HWY_TARGET_INCLUDE "render/raycast/shading.cpp"
#include <hwy/foreach_target.h>
// Highway's own headers come after foreach_target.
#include <hwy/highway.h>

#include <algorithm>
#include <bit>
#include <cfloat>
#include <cmath>
#include <cstddef>
#include <cstring>
#include <limits>
#include <type_traits>

#include "base/near_memory.hpp"
#include "base/wide-inl.hpp"
#include "render/raycast/shaded_bodies.hpp"
#include "render/raycast/soft_light.hpp"
#include "trace/normals-inl.hpp"

#ifndef FLOCKSTEP_RENDER_COMMON_FACE
#define FLOCKSTEP_RENDER_COMMON_FACE
namespace flockstep::render {

// Returns the visible face of a box (-x, +x, -y, ...) that all rays of a tile hit, or -1 if that is uncertain. All rays must
// hit the box. A face is convex, and so is its projection, so a rectangle of rays shows the face that its corners show. This
// may fail if the near plane cuts the box, so the result is -1 in that case.
inline int common_face(const trace::Shape& shape, const trace::RayBundle& rays) {
  if (shape.kind != trace::ShapeKind::box || !rays.is_rectangle) return -1;
  const float* const half = shape.half_extents;
  const Vec3 origin = trace::rotated(shape.to_local, rays.origin - Vec3(shape.center[0], shape.center[1], shape.center[2]));
  const std::array<std::size_t, 4> corners{0, PixelTile::kSide - 1, rays.count - PixelTile::kSide, rays.count - 1};
  std::array<Vec3, 4> directions;
  float longest = 0.0F;
  for (std::size_t i = 0; i < 4; ++i) {
    directions[i] = trace::rotated(shape.to_local, rays.direction(corners[i]));
    longest = std::max(longest, directions[i].norm());
  }
  const float near = rays.near * longest;
  bool inside = true;
  bool outside = false;
  for (int axis = 0; axis < 3; ++axis) {
    inside &= std::abs(origin[axis]) + near < half[axis];
    outside |= std::abs(origin[axis]) - near > half[axis];
  }
  if (!inside && !outside) return -1;
  int face = -1;
  for (std::size_t i = 0; i < 4; ++i) {
    const Vec3 point = origin + rays.t_hit[corners[i]] * directions[i];
    int axis = half[2] > 0.0F ? 0 : 2;
    for (int other = axis + 1; other < 3; ++other) {
      if (std::abs(point[other]) - half[other] > std::abs(point[axis]) - half[axis]) axis = other;
    }
    const int seen = 2 * axis + (directions[i][axis] < 0.0F ? 1 : 0);
    if (i > 0 && seen != face) return -1;
    face = seen;
  }
  return face;
}

}  // namespace flockstep::render
#endif

HWY_BEFORE_NAMESPACE();
namespace flockstep::render::HWY_NAMESPACE {
using namespace flockstep::HWY_NAMESPACE;  // the wide type
using namespace flockstep::trace::HWY_NAMESPACE;

using F = WideUpTo<PixelTile::kSide>;
using I = F::Int;
using Mask = F::Mask;
using F3 = Wide3<F>;
using Color = std::array<F, 3>;

// Kernels for worlds that Shading::Tables::is_plain() describes, for other worlds without fog, for fog, and for soft light with
// or without fog. The last two compute the light of each pixel, the others look most of it up.
enum class Detail : std::uint8_t { plain, full, fog, soft };
constexpr bool lights_pixels(Detail detail) { return detail >= Detail::fog; }

// One vector of rays. kShadows: some hits may be in shadow.
template <bool kShadows, Detail kDetail>
struct Rays {
  F3 direction;  // world frame
  F t;
  Mask shaded;                   // empty without kShadows
  F sun = 1.0F, ambient = 1.0F;  // shares of the light, for Detail::soft only
};
struct Pixels {
  I color;  // r | g << 8 | b << 16
  I semantic, instance;
  F3 normal;
};
HWY_INLINE Pixels empty_pixels() { return {0, 0, 0, {0.0F, 0.0F, 0.0F}}; }

// Flips the normal to the visible side.
HWY_INLINE F3 towards_camera(const F3& normal, const F3& direction) {
  const F away = -dot(normal, direction);
  return {flip_sign(normal.x, away), flip_sign(normal.y, away), flip_sign(normal.z, away)};
}

// Returns the entry of a table that is nearest to `share` in [0, 1]. The table has kLast + 1 entries.
template <int kLast>
HWY_INLINE I entry(const std::int32_t* table, F share) {
  return I::gather(table, convert<I>(share * static_cast<float>(kLast) + 0.5F));
}

HWY_INLINE I level(const Shading::Tables& tables, F value) {
  // Lanes that show something else may hold any value, but must not read outside the table: max turns a NaN into 0.
  return entry<Shading::kLevels>(tables.levels.data(), sqrt(min(max(value, 0.0F), 1.0F)));
}

HWY_INLINE I packed(I red, I green, I blue) { return red | shift_left<8>(green) | shift_left<16>(blue); }

HWY_INLINE F3 up_of(const Shading::Tables& tables) { return {tables.up[0], tables.up[1], tables.up[2]}; }

struct Nothing {};  // no emission

// Returns the linear colour of a surface with this base colour. sunward: cosine of the angle between the normal and the sun.
// upward: z of the normal.
template <bool kShadows, Detail kDetail, class Base, class Emitted = Nothing>
HWY_INLINE Color linear(const Shading::Tables& tables, const Base& base, F sunward, F upward, const Rays<kShadows, kDetail>& rays,
                        const Emitted& emitted = {}) {
  const Light& light = tables.light;
  F sun = max(sunward, 0.0F);
  if constexpr (kShadows) sun = zero_if(rays.shaded, sun);
  if constexpr (kDetail == Detail::soft) sun = sun * rays.sun;
  const F sky = max(upward * 0.5F + 0.5F, 0.0F);
  const auto channel = [&](std::size_t c) HWY_ATTR {
    F ambient = light.ground_ambient[c] + (light.sky_ambient[c] - light.ground_ambient[c]) * sky;
    if constexpr (kDetail == Detail::soft) ambient = ambient * rays.ambient;
    F value = base(c) * (ambient + light.sun_color[c] * sun);
    if constexpr (!std::is_same_v<Emitted, Nothing>) value = value + emitted(c);
    return value;
  };
  return {channel(0), channel(1), channel(2)};
}

// Returns e^-x for x >= 0, to a relative error of 1e-6: 2^-n of an integer n, times a polynomial.
HWY_INLINE F exp_of_minus(F x) {
  const F power = max(x * -1.44269504F, -126.0F);
  const F whole = floor(power);
  const F y = (power - whole - 0.5F) * 0.693147181F;  // in [-ln(2) / 2, ln(2) / 2]
  const F high = (y * (1.0F / 720.0F) + 1.0F / 120.0F) * y + 1.0F / 24.0F;
  const F sum = (((high * y + 1.0F / 6.0F) * y + 0.5F) * y + 1.0F) * y + 1.0F;
  return sum * 1.41421356F * bit_cast<F>(shift_left<23>(convert<I>(whole) + 127));
}

// The part of a surface's light that comes through the fog, and the height of the sky behind it; see Light.
struct FogView {
  F clear = 1.0F, up = 0.0F;

  template <bool kShadows, Detail kDetail>
  HWY_INLINE FogView(const Shading::Tables& tables, const Rays<kShadows, kDetail>& rays) {
    if (kDetail == Detail::soft && tables.light.fog_visibility_m == 0.0F) return;
    const F length = sqrt(dot(rays.direction, rays.direction));
    clear = exp_of_minus(rays.t * length * (3.9F / tables.light.fog_visibility_m));
    up = max(dot(rays.direction, up_of(tables)) / length, 0.0F);
  }
  HWY_INLINE FogView(F clear_part, F up_part) : clear(clear_part), up(up_part) {}

  HWY_INLINE Color operator()(const Shading::Tables& tables, const Color& color) const {
    const auto channel = [&](std::size_t c) HWY_ATTR {
      const float horizon = tables.light.horizon_color[c];
      const F behind = horizon + (tables.light.zenith_color[c] - horizon) * up;
      return behind + (color[c] - behind) * clear;
    };
    return {channel(0), channel(1), channel(2)};
  }
};

// Converts a linear colour to the levels that are written.
HWY_INLINE I written(const Shading::Tables& tables, const Color& color) {
  return packed(level(tables, color[0]), level(tables, color[1]), level(tables, color[2]));
}

// Packs a linear colour into one negative number: the square roots of its channels, ten bits each from the lowest bit on.
// unit: linear colour of roots of 1.
HWY_INLINE I as_roots(const Color& color, const Color& unit) {
  const auto root = [&](std::size_t c) HWY_ATTR {
    const F number = sqrt(max(color[c], 0.0F) / max(unit[c], FLT_MIN));
    return min(convert<I>(number + 0.5F), Shading::kRoots);
  };
  return root(0) | shift_left<10>(root(1)) | shift_left<20>(root(2)) | std::numeric_limits<std::int32_t>::min();
}
// Returns the square of one of the roots.
template <int kChannel>
HWY_INLINE F squared_root(I roots) {
  const F root = convert<F>(shift_right<10 * kChannel>(roots) & Shading::kRoots);
  return root * root;
}
HWY_INLINE Color of_roots(I roots, const Color& unit) {
  return {squared_root<0>(roots) * unit[0], squared_root<1>(roots) * unit[1], squared_root<2>(roots) * unit[2]};
}

template <bool kShadows, Detail kDetail>
HWY_INLINE I on_ramp(const std::int32_t* ramp, F sunward, const Rays<kShadows, kDetail>& rays) {
  F sun = min(max(sunward, 0.0F), 1.0F);
  if constexpr (kShadows) sun = zero_if(rays.shaded, sun);
  return entry<Shading::kRamp>(ramp, sqrt(sun));
}

// Returns the sun's share of the sky colour in a direction; see Light.
HWY_INLINE F sun_share(const Shading::Tables& tables, const F3& direction, F length) {
  const SunDisc& disc = tables.sun_disc;
  const auto& to_sun = tables.light.sun_direction;
  const F3 apart = direction / length - F3{to_sun[0], to_sun[1], to_sun[2]};
  const F q = dot(apart, apart);
  return max(min((disc.edge - q) * disc.steepness, 1.0F), disc.glow / (1.0F + SunDisc::kFocus * q));
}

template <Detail kDetail>
HWY_INLINE I sky(const Shading::Tables& tables, const F3& direction) {
  const F length = sqrt(dot(direction, direction));
  const F up = max(direction.z / length, 0.0F);
  if (!tables.sky.empty()) return entry<Shading::kSky>(tables.sky.data(), min(up, 1.0F));
  const bool disc = kDetail != Detail::plain && tables.sun_disc.shows;
  const F share = disc ? sun_share(tables, direction, length) : F(0.0F);
  const auto channel = [&](std::size_t c) HWY_ATTR {
    const float horizon = tables.light.horizon_color[c];
    F color = horizon + (tables.light.zenith_color[c] - horizon) * up;
    if (disc) color = color + (tables.sun_disc.color[c] - color) * share;
    return level(tables, color);
  };
  return packed(channel(0), channel(1), channel(2));
}

// Returns the colour of a flat face across an axis, on the side that faces the ray's origin.
template <bool kShadows, Detail kDetail>
HWY_INLINE I face_color(const ShadedSolid& solid, std::size_t axis, F along, const Rays<kShadows, kDetail>& rays) {
  const auto side = [&](std::size_t sign) HWY_ATTR {
    const I lit_color = solid.faces[0][2 * axis + sign];
    if constexpr (!kShadows) return lit_color;
    return select(rays.shaded, solid.faces[1][2 * axis + sign], lit_color);
  };
  return select(along < 0.0F, side(1), side(0));
}
HWY_INLINE F face_normal(F along) { return copy_sign(1.0F, -along); }

template <bool kShadows, Detail kDetail>
HWY_INLINE void color_box(const ShadedSolid& solid, const F3& at, const F3& dir, const Rays<kShadows, kDetail>& rays,
                          bool with_normal, Pixels& pixels) {
  const auto [y_over_x, z_over_xy] = nearest_face(*solid.shape, at);
  pixels.color = select(y_over_x, face_color(solid, 1, dir.y, rays), face_color(solid, 0, dir.x, rays));
  pixels.color = select(z_over_xy, face_color(solid, 2, dir.z, rays), pixels.color);
  if (!with_normal) return;
  pixels.normal = {zero_if(y_over_x | z_over_xy, face_normal(dir.x)), value_if(without(y_over_x, z_over_xy), face_normal(dir.y)),
                   value_if(z_over_xy, face_normal(dir.z))};
}

template <bool kShadows, Detail kDetail>
HWY_INLINE void color_round(const Shading::Tables& tables, const ShadedSolid& solid, const F3& at, const F3& dir,
                            const Rays<kShadows, kDetail>& rays, const CameraOutputs& wanted, Pixels& pixels) {
  pixels.normal = towards_camera(outward_normal(*solid.shape, at), dir);
  if (!lights_pixels(kDetail) && wanted.any_color()) {
    const auto cosine = [&](const std::array<float, 3>& to) HWY_ATTR { return dot(pixels.normal, F3{to[0], to[1], to[2]}); };
    const auto base = [&](std::size_t c) { return solid.surface.color[c]; };
    const auto emitted = [&](std::size_t c) { return solid.surface.emissive[c]; };
    if (solid.ramp != nullptr) {
      pixels.color = on_ramp(solid.ramp, cosine(solid.sun), rays);
    } else if (kDetail != Detail::plain && solid.surface.emits()) {
      pixels.color = written(tables, linear(tables, base, cosine(solid.sun), cosine(solid.up), rays, emitted));
    } else {
      pixels.color = written(tables, linear(tables, base, cosine(solid.sun), cosine(solid.up), rays));
    }
  }
  if (solid.shape->kind != trace::ShapeKind::cylinder) return;
  const Mask cap = is_on_cap(*solid.shape, at);
  if (none(cap)) return;
  pixels.color = select(cap, face_color(solid, 2, dir.z, rays), pixels.color);
  pixels.normal = select(cap, {0.0F, 0.0F, face_normal(dir.z)}, pixels.normal);
}

// Returns the colours of a solid in fog or soft light. normal: in the solid's frame.
template <bool kShadows, Detail kDetail>
HWY_INLINE I lit_pixels(const Shading::Tables& tables, const ShadedSolid& solid, const F3& normal,
                        const Rays<kShadows, kDetail>& rays) {
  const auto cosine = [&](const std::array<float, 3>& to) HWY_ATTR { return dot(normal, F3{to[0], to[1], to[2]}); };
  const auto base = [&](std::size_t c) { return solid.surface.color[c]; };
  const auto emitted = [&](std::size_t c) { return solid.surface.emissive[c]; };
  return written(tables, FogView(tables, rays)(tables, linear(tables, base, cosine(solid.sun), cosine(solid.up), rays, emitted)));
}

// Shades a solid at the hit points of its rays.
template <bool kShadows, Detail kDetail>
HWY_INLINE Pixels solid_pixels(const Shading::Tables& tables, const ShadedSolid& solid, const Vec3& origin,
                               const Rays<kShadows, kDetail>& rays, const CameraOutputs& wanted) {
  const trace::Shape& shape = *solid.shape;
  const Vec3 offset(origin.x() - shape.center[0], origin.y() - shape.center[1], origin.z() - shape.center[2]);
  const Vec3 o = shape.aligned ? offset : trace::rotated(shape.to_local, offset);
  const F3 dir = shape.aligned ? rays.direction : rotate(shape.to_local, rays.direction);
  const F3 at{o.x() + rays.t * dir.x, o.y() + rays.t * dir.y, o.z() + rays.t * dir.z};
  Pixels pixels{0, solid.surface.semantic, solid.surface.instance, {0.0F, 0.0F, 0.0F}};
  if (shape.kind == trace::ShapeKind::box) {
    color_box(solid, at, dir, rays, wanted.normal || lights_pixels(kDetail), pixels);
  } else {
    color_round(tables, solid, at, dir, rays, wanted, pixels);
  }
  if constexpr (lights_pixels(kDetail)) {
    if (wanted.any_color()) pixels.color = lit_pixels(tables, solid, pixels.normal, rays);
  }
  if (wanted.normal && !shape.aligned) {
    const auto to_world = [&shape](int row, int column) { return shape.to_local(column, row); };
    pixels.normal = rotate(to_world, pixels.normal);
  }
  return pixels;
}

// Wraps a texture coordinate into [0, 1]: repeated, mirrored or clamped.
HWY_INLINE F wrapped(F x, I wrap) {
  const auto is = [&](TextureWrap which) HWY_ATTR { return wrap == static_cast<std::int32_t>(which); };
  const auto within = [](F value) HWY_ATTR { return min(max(value, 0.0F), 1.0F); };
  const F repeated = x - floor(x);
  if (all(is(TextureWrap::repeat))) return within(repeated);  // the usual case
  const F there_and_back = x - 2.0F * floor(x * 0.5F);
  const F mirrored = select(there_and_back > 1.0F, 2.0F - there_and_back, there_and_back);
  return within(select(is(TextureWrap::repeat), repeated, select(is(TextureWrap::mirror), mirrored, x)));
}

// The texel before a position along an axis, -1 on the border, and the distance to it in texels.
struct Before {
  I texel;
  F towards;
};

HWY_INLINE Before before(F x, I size) {
  const F at = x * convert<F>(size) - 0.5F;
  const F below = floor(at);
  return {convert<I>(below), at - below};
}

// Returns the texels with these numbers and the texels after them. They are read in pairs, which halves the number of reads.
struct Pairs {
  I first, second;
};

HWY_INLINE Pairs pairs(const std::int32_t* texels, I numbers) {
  const I::Tag one;
  const hn::Repartition<std::uint64_t, I::Tag> pair;  // at any texel, aligned or not
  const hn::RebindToSigned<decltype(pair)> offsets;
  const auto* const base = reinterpret_cast<const std::uint64_t*>(texels);
  const auto two = [&](auto first)
                       HWY_ATTR { return hn::GatherOffset(pair, base, hn::BitCast(offsets, hn::ShiftLeft<2>(first))); };
  const auto each = hn::BitCast(pair, numbers.part[0]);
  const auto even = two(hn::And(each, hn::Set(pair, 0xFFFFFFFFU))), odd = two(hn::ShiftRight<32>(each));
  Pairs result;
  result.first.part[0] = hn::OddEven(hn::BitCast(one, hn::ShiftLeft<32>(odd)), hn::BitCast(one, even));
  result.second.part[0] = hn::OddEven(hn::BitCast(one, odd), hn::BitCast(one, hn::ShiftRight<32>(even)));
  return result;
}

// Texture levels requested by some lanes. The other lanes have negative numbers and get an arbitrary level. At least one lane
// must request a level.
struct Levels {
  I offset, width, height, stride;
};

// Neighbouring pixels usually request the same level. Its data is then read once instead of once per lane.
HWY_INLINE Levels levels_at(const Shading::Images& images, const std::int32_t* numbers) {
  const I number = I::load(numbers);
  const Mask asks = number > -1;
  const std::int32_t one = numbers[std::countr_zero(bits(asks))];
  const I safe = select(asks, number, one);
  const auto of = [](I offset, I size) HWY_ATTR {
    const I width = size & 0xFFFF;
    return Levels{offset, width, shift_right<16>(size), width + 2};  // includes the border
  };
  if (all(safe == one)) {
    const auto at = static_cast<std::size_t>(one);
    return of(images.textures.offset[at], images.sizes[at]);
  }
  return of(I::gather(images.textures.offset.data(), safe), I::gather(images.sizes.data(), safe));
}

// The four texels around a position: the number of the first, the distance between the two rows, and the position within
// them.
struct Place {
  I first, stride;
  F across, down;
};

HWY_INLINE Place place_in(const Levels& level, F s, F t) {
  const Before x = before(s, level.width), y = before(t, level.height);
  return {level.offset + y.texel * level.stride + x.texel, level.stride, x.towards, y.towards};
}

// Returns the linear colours at these places.
HWY_INLINE Color colors_at(const Shading::Images& images, const Place& place) {
  const Pairs upper = pairs(images.texels(), place.first);
  const Pairs lower = pairs(images.texels(), place.first + place.stride);
  const auto mix = [](F from, F to, F share) HWY_ATTR { return from + (to - from) * share; };
  const auto channel = [&](auto number) HWY_ATTR {
    const auto between = [&](const Pairs& row) HWY_ATTR {
      return mix(squared_root<number.value>(row.first), squared_root<number.value>(row.second), place.across);
    };
    constexpr float kScale = 1.0F / (static_cast<float>(Shading::kRoots) * static_cast<float>(Shading::kRoots));
    return mix(between(upper), between(lower), place.down) * kScale;
  };
  return {channel(std::integral_constant<int, 0>()), channel(std::integral_constant<int, 1>()),
          channel(std::integral_constant<int, 2>())};
}

// Calls f(number, lanes) for each distinct number in the lanes. Neighbouring pixels usually have the same number.
template <class Function>
HWY_INLINE void for_each_number(const std::int32_t* numbers, Mask which, const Function& f) {
  const I each = I::load(numbers);
  for (std::uint32_t left = bits(which); left != 0;) {
    const std::int32_t number = numbers[std::countr_zero(left)];
    const Mask where = which & (each == number);
    left &= ~bits(where);
    f(number, where);
  }
}

// Sets these lanes.
template <class Number>
HWY_INLINE void set(Number& to, Mask where, const std::type_identity_t<Number>& value) {
  to = select(where, value, to);
}

// Weights of a triangle's corners at the hit points.
struct Weights {
  F a, b, c;

  // Interpolates values given at the corners.
  HWY_INLINE F operator()(float of_a, float of_b, float of_c) const { return a * of_a + b * of_b + c * of_c; }
};

// Textures and texture coordinates at the hit points. Lanes without a texture hold harmless values.
struct Textured {
  Mask lanes;
  F across, down;
  F3 normal;  // Print::normal
  I wrap_across, wrap_down, first_level, last_level;

  // Adds a triangle, or the paint of its material, in these lanes.
  HWY_INLINE void add(const Shading::Images::Print& print, Mask where, const Weights& weights) {
    const auto& [a, b, c] = print.uv;
    set(across, where, weights(a[0], b[0], c[0]));
    set(down, where, weights(a[1], b[1], c[1]));
    set(normal, where, {print.normal[0], print.normal[1], print.normal[2]});
  }
  HWY_INLINE void add(const Shading::Paint& paint, Mask where) {
    lanes = lanes | where;
    set(wrap_across, where, paint.wrap_across);
    set(wrap_down, where, paint.wrap_down);
    set(first_level, where, paint.first_level);
    set(last_level, where, paint.last_level);
  }
};

// Pixels of a tile whose colours must still be multiplied by textures or vertex colours. All of them finish a step before any
// starts the next one. Each step waits for memory or for long instructions, and a processor overlaps the waits of several
// vectors only if little code lies between them.
class TintedTile {
 public:
  // Adds the vector that begins at this pixel. Its colours follow in set_color().
  HWY_INLINE void add(std::size_t pixel, const Color& unit, const Color* of_vertices) {
    tinted_[num_tinted_++] = static_cast<std::uint16_t>(pixel);
    for (std::size_t c = 0; c < 3; ++c) {
      unit[c].store(unit_[c] + pixel);
      if (of_vertices != nullptr) (*of_vertices)[c].store(of_vertices_[c] + pixel);
    }
  }
  // Adds the textures of the vector added last. pixel_area: see Shading::shade().
  template <bool kShadows, Detail kDetail>
  HWY_INLINE void add(const Textured& textured, const Rays<kShadows, kDetail>& rays, float pixel_area) {
    const std::size_t pixel = tinted_[num_tinted_ - 1];
    // Square of the number of texels that a pixel covers along its longer side.
    const F across = dot(textured.normal, rays.direction);
    const F area = rays.t * rays.t * pixel_area;
    const F texels = max(area * dot(rays.direction, rays.direction) / (across * across), 0.0F);
    // Exponent and mantissa, read as one number, approximate the logarithm by straight lines between powers of two. Half of
    // it is the logarithm of the root.
    const F log2 = convert<F>(bit_cast<I>(texels)) * 0x1p-23F - 127.0F;
    const F detail = min(max(log2 * 0.5F, 0.0F), convert<F>(textured.last_level));
    const I fine = convert<I>(detail);
    const F towards = value_if(textured.lanes, detail - convert<F>(fine));
    const I finer = textured.first_level + fine;
    const I coarser = finer + min(textured.last_level - fine, 1);
    wrapped(textured.across, textured.wrap_across).store(s_ + pixel);
    wrapped(textured.down, textured.wrap_down).store(t_ + pixel);
    towards.store(towards_ + pixel);
    select(textured.lanes, finer, -1).store(finer_ + pixel);
    select(textured.lanes, coarser, -1).store(coarser_ + pixel);
    textured_[num_textured_++] = tinted_[num_tinted_ - 1];
    // Near surfaces use only the largest level.
    if (!none(towards > 0.0F)) mixed_[num_mixed_++] = tinted_[num_tinted_ - 1];
  }
  // Adds the fog in front of the vector added last.
  HWY_INLINE void add(const FogView& fog) {
    fog.clear.store(clear_ + tinted_[num_tinted_ - 1]);
    fog.up.store(up_ + tinted_[num_tinted_ - 1]);
  }
  HWY_INLINE void add_none() {
    for (auto& texel : texel_) F(1.0F).store(texel + tinted_[num_tinted_ - 1]);
  }
  HWY_INLINE bool waits_for(std::size_t pixel) const { return num_tinted_ > 0 && tinted_[num_tinted_ - 1] == pixel; }
  HWY_INLINE void set_color(std::size_t pixel, I color) { color.store(color_ + pixel); }

  // Calls f(pixel, colour) for each vector. of_vertices: whether their colours were added.
  template <Detail kDetail, class Function>
  HWY_INLINE void finish(const Shading::Tables& tables, bool of_vertices, const Function& f) {
    if (num_tinted_ == 0) return;
    multiply(tables, of_vertices, lights_pixels(kDetail));
    for (std::size_t k = 0; k < num_tinted_; ++k) f(tinted_[k], I::load(color_ + tinted_[k]));
  }

 private:
  // Multiplies all colours. Not inlined: it is called once a tile, and in each kernel would take a compiler as long as the rest.
  HWY_NOINLINE void multiply(const Shading::Tables& tables, bool of_vertices, bool in_fog) {
    look_up(tables, finer_, std::span(textured_).first(num_textured_), [&](std::size_t i, const Color& color) HWY_ATTR {
      const Mask lanes = I::load(finer_ + i) > -1;
      for (std::size_t c = 0; c < 3; ++c) select(lanes, color[c], 1.0F).store(texel_[c] + i);
    });
    look_up(tables, coarser_, std::span(mixed_).first(num_mixed_), [&](std::size_t i, const Color& color) HWY_ATTR {
      const F towards = F::load(towards_ + i);
      for (std::size_t c = 0; c < 3; ++c) {
        const F fine = F::load(texel_[c] + i);
        (fine + (color[c] - fine) * towards).store(texel_[c] + i);
      }
    });
    for (std::size_t k = 0; k < num_tinted_; ++k) {
      const std::size_t i = tinted_[k];
      const I known = I::load(color_ + i);
      Color color = of_roots(known, {F::load(unit_[0] + i), F::load(unit_[1] + i), F::load(unit_[2] + i)});
      for (std::size_t c = 0; c < 3; ++c) {
        F tint = F::load(texel_[c] + i);
        if (of_vertices) tint = F::load(of_vertices_[c] + i) * tint;
        color[c] = color[c] * tint;
      }
      if (in_fog) color = FogView(F::load(clear_ + i), F::load(up_ + i))(tables, color);
      select(known < 0, written(tables, color), known).store(color_ + i);
    }
  }

  // Calls f(pixel, colours) for each of the vectors, with colours from the levels of these numbers.
  template <class Function>
  HWY_INLINE void look_up(const Shading::Tables& tables, const std::int32_t* numbers, std::span<const std::uint16_t> vectors,
                          const Function& f) {
    const Shading::Images& images = *tables.images;
    for (const std::size_t i : vectors) {
      const Place place = place_in(levels_at(images, numbers + i), F::load(s_ + i), F::load(t_ + i));
      place.first.store(first_ + i);
      place.stride.store(stride_ + i);
      place.across.store(across_ + i);
      place.down.store(down_ + i);
      constexpr std::size_t kApart = 5;  // pixels; those between usually share cache lines
      for (std::size_t pixel = i; pixel < i + F::kCount; pixel += kApart) {
        hwy::Prefetch(images.texels() + first_[pixel]);
        hwy::Prefetch(images.texels() + first_[pixel] + stride_[pixel]);
      }
    }
    for (const std::size_t i : vectors) {
      f(i, colors_at(images, {I::load(first_ + i), I::load(stride_ + i), F::load(across_ + i), F::load(down_ + i)}));
    }
  }

  static constexpr std::size_t kCount = TilePixels::kCount, kVectors = kCount / 4;
  alignas(64) std::int32_t color_[kCount];  // negative means still to be multiplied
  alignas(64) float unit_[3][kCount], of_vertices_[3][kCount], texel_[3][kCount];
  alignas(64) float s_[kCount], t_[kCount], towards_[kCount];
  alignas(64) std::int32_t finer_[kCount], coarser_[kCount];  // levels; negative means no texture
  alignas(64) std::int32_t first_[kCount], stride_[kCount];   // fields of Place
  alignas(64) float across_[kCount], down_[kCount];
  alignas(64) float clear_[kCount], up_[kCount];  // fields of FogView
  std::uint16_t tinted_[kVectors], textured_[kVectors], mixed_[kVectors];
  std::size_t num_tinted_ = 0, num_textured_ = 0, num_mixed_ = 0;
};

// Returns the colours of the triangle table for lanes that show a triangle; 0 in other lanes.
template <bool kShadows, Detail kDetail>
HWY_INLINE I lit(const Shading::Tables& tables, I elements, Mask triangles, const trace::HitDetails& details, std::size_t first,
                 const Rays<kShadows, kDetail>& rays) {
  I place = shift_left<1>(elements - tables.first_triangle) + I::load(details.back + first);
  if constexpr (kShadows) place = place + value_if(rays.shaded, I(2 * (tables.first_marker - tables.first_triangle)));
  return value_if(triangles, I::gather(tables.lit.get(), value_if(triangles, place)));
}

template <bool kShadows, Detail kDetail>
HWY_INLINE Pixels triangle_pixels(const Shading::Tables& tables, const std::int32_t* each, Mask which,
                                  const trace::HitDetails& details, std::size_t first, const Rays<kShadows, kDetail>& rays,
                                  float pixel_area, const CameraOutputs& wanted, TintedTile& tile) {
  Pixels pixels = empty_pixels();
  if constexpr (kDetail == Detail::soft) {
    pixels.color = value_if(which, I(-1));  // follows below
  } else if (wanted.any_color()) {
    pixels.color = lit(tables, I::load(each), which, details, first, rays);
  }
  const Mask tinted = pixels.color < 0;
  const bool tints_some = !none(tinted), numbers = wanted.semantic || wanted.instance;
  if (!tints_some && !numbers && !wanted.normal) return pixels;

  if (wanted.normal || kDetail == Detail::soft) {
    const F3 normal = F3::load(details.normal_x + first, details.normal_y + first, details.normal_z + first);
    pixels.normal = towards_camera(normalised(normal), rays.direction);
  }

  const F u = F::load(details.u + first), v = F::load(details.v + first);
  const Weights weights{1.0F - u - v, u, v};
  const bool colored = kDetail != Detail::plain && !tables.colors.empty();
  const std::span<const Shading::Images::Print> prints(tables.images->prints);
  Color tints{1.0F, 1.0F, 1.0F}, unit{0.0F, 0.0F, 0.0F};
  Textured textured{Mask(false), 0.0F, 0.0F, {0.0F, 0.0F, 0.0F}, 0, 0, 0, 0};
  alignas(64) std::int32_t materials[PixelTile::kSide];  // valid in the tinted lanes
  I material_of = 0;
  const auto see = [&](std::int32_t element, Mask where) HWY_ATTR {
    const auto triangle = static_cast<std::size_t>(element - tables.first_triangle);
    if (wanted.semantic) set(pixels.semantic, where, tables.semantic[tables.triangle_material[triangle]]);
    if (wanted.instance) set(pixels.instance, where, tables.triangle_object[triangle] + tables.first_object);
    if (!tints_some) return;
    if (prints.empty()) {
      set(material_of, where, tables.triangle_material[triangle]);
    } else {
      set(material_of, where, prints[triangle].material);
      textured.add(prints[triangle], where, weights);
    }
    for (std::size_t c = 0; colored && c < 3; ++c) {
      const auto& corners = tables.triangles[triangle];
      const auto color = [&](std::size_t k) { return tables.colors[static_cast<std::size_t>(corners[k])][c]; };
      set(tints[c], where, weights(color(0), color(1), color(2)));
    }
  };
  for_each_number(each, numbers ? which : tinted, see);
  if (!tints_some) return pixels;

  material_of.store(materials);
  for_each_number(materials, tinted, [&](std::int32_t material, Mask where) HWY_ATTR {
    const Shading::Paint& paint = tables.paints[static_cast<std::size_t>(material)];
    for (std::size_t c = 0; c < 3; ++c) set(unit[c], where, paint.unit[c]);
    if (paint.texture >= 0) textured.add(paint, where);
  });
  if constexpr (kDetail == Detail::soft) {
    const I material = I::load(materials);
    const auto base = [&](std::size_t c) HWY_ATTR { return F::gather(tables.color[c].data(), material); };
    const auto emitted = [&](std::size_t c) HWY_ATTR { return F::gather(tables.emissive[c].data(), material); };
    const auto& sun = tables.light.sun_direction;
    const F sunward = dot(pixels.normal, F3{sun[0], sun[1], sun[2]}), upward = dot(pixels.normal, up_of(tables));
    pixels.color = value_if(which, as_roots(linear(tables, base, sunward, upward, rays, emitted), unit));
  }
  tile.add(first, unit, colored ? &tints : nullptr);
  if (none(textured.lanes)) {
    tile.add_none();
  } else {
    tile.add(textured, rays, pixel_area);
  }
  if constexpr (lights_pixels(kDetail)) tile.add(FogView(tables, rays));
  return pixels;
}

// Returns the linear colours of one side of a vector of triangles.
HWY_INLINE Color light_side(const Shading::Tables& tables, const F3& normal, I materials, bool shaded) {
  const Rays<true, Detail::full> rays{normal, 0.0F, Mask(shaded)};
  const auto base = [&](std::size_t c) HWY_ATTR { return F::gather(tables.color[c].data(), materials); };
  const auto emitted = [&](std::size_t c) HWY_ATTR { return F::gather(tables.emissive[c].data(), materials); };
  const auto& to_sun = tables.light.sun_direction;
  return linear(tables, base, dot(normal, F3{to_sun[0], to_sun[1], to_sun[2]}), dot(normal, up_of(tables)), rays, emitted);
}

// Fills one half of Shading::Tables::lit for these triangles, or for all if the list is empty.
void light_triangles(const Shading::Tables& tables, std::span<const std::int32_t> list, bool shaded, std::int32_t* out) {
  if (shaded) out += 2 * tables.triangles.size();
  const std::size_t total = list.empty() ? tables.triangles.size() : list.size();
  const auto number = [&](std::size_t i) { return list.empty() ? i : static_cast<std::size_t>(list[i]); };
  for (std::size_t first = 0; first < total; first += F::kCount) {
    const std::size_t count = std::min(F::kCount, total - first);
    alignas(64) float a[3][PixelTile::kSide] = {}, b[3][PixelTile::kSide] = {};
    alignas(64) std::int32_t material[PixelTile::kSide] = {};
    for (std::size_t i = 0; i < count; ++i) {
      const auto& corners = tables.triangles[number(first + i)];
      const auto corner = [&](std::size_t k) -> const Vec3& { return tables.vertices[static_cast<std::size_t>(corners[k])]; };
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto at = static_cast<Eigen::Index>(axis);
        a[axis][i] = corner(1)[at] - corner(0)[at];
        b[axis][i] = corner(2)[at] - corner(0)[at];
      }
      material[i] = tables.triangle_material[number(first + i)];
    }
    const F3 front = normalised(cross(F3::load(a[0], a[1], a[2]), F3::load(b[0], b[1], b[2])));
    Color unit{0.0F, 0.0F, 0.0F};
    for_each_number(material, Mask(true), [&](std::int32_t number, Mask where) HWY_ATTR {
      const Shading::Paint& paint = tables.paints[static_cast<std::size_t>(number)];
      for (std::size_t c = 0; c < 3; ++c) set(unit[c], where, paint.unit[c]);
    });
    alignas(64) std::int32_t plain[2][PixelTile::kSide], roots[2][PixelTile::kSide];
    for (std::size_t k = 0; k < 2; ++k) {
      const Color color = light_side(tables, k == 0 ? front : -front, I::load(material), shaded);
      written(tables, color).store(plain[k]);
      as_roots(color, unit).store(roots[k]);
    }
    for (std::size_t i = 0; i < count; ++i) {
      const bool tinted = !tables.colors.empty() || tables.light.fog_visibility_m > 0.0F ||
                          tables.paints[static_cast<std::size_t>(material[i])].texture >= 0;
      for (std::size_t k = 0; k < 2; ++k) out[2 * number(first + i) + k] = tinted ? roots[k][i] : plain[k][i];
    }
  }
}

// Fills a ramp; see ShadedSolid::ramp.
void fill_ramp(const Shading::Tables& tables, const Surface& surface, Shading::Ramp& ramp) {
  const auto base = [&](std::size_t c) { return surface.color[c]; };
  const auto emitted = [&](std::size_t c) { return surface.emissive[c]; };
  const auto level = [&](F value) HWY_ATTR {
    const F at = sqrt(min(value, 1.0F)) * static_cast<float>(Shading::kLevels);
    const I below = convert<I>(at);
    return I::gather(tables.levels.data(), select(at - convert<F>(below) < 0.5F, below, below + 1));
  };
  for (std::size_t i = 0; i < ramp.size(); i += F::kCount) {
    alignas(64) float roots[F::kCount];
    for (std::size_t k = 0; k < F::kCount; ++k) roots[k] = static_cast<float>(i + k) / Shading::kRamp;
    const F root = F::load(roots);
    const Color color =
        linear(tables, base, root * root, 0.0F, Rays<false, Detail::full>{{0.0F, 0.0F, 0.0F}, 0.0F, Mask(false)}, emitted);
    packed(level(color[0]), level(color[1]), level(color[2])).store_unaligned(ramp.data() + i);
  }
}

HWY_INLINE Pixels select(Mask mask, const Pixels& yes, const Pixels& no) {
  return {select(mask, yes.color, no.color), select(mask, yes.semantic, no.semantic), select(mask, yes.instance, no.instance),
          select(mask, yes.normal, no.normal)};
}

HWY_INLINE void write_depth(const trace::RayBundle& rays, std::size_t i, DepthKind depth_kind, TilePixels& out) {
  F depth = F::load(rays.t_hit + i);
  if (depth_kind == DepthKind::range) {
    const F3 direction = F3::load_unaligned(rays.x + i, rays.y + i, rays.z + i);
    depth = depth * sqrt(dot(direction, direction));
  }
  depth.store(out.depth + i);
}

// Fills the whole tile with one surface.
void fill(std::int32_t color, const Surface& surface, const Vec3& normal, const CameraOutputs& wanted,
          const trace::RayBundle& rays, DepthKind depth_kind, TilePixels& out) {
  if (wanted.any_color()) {
    std::memset(out.r, color & 0xFF, rays.count);
    std::memset(out.g, color >> 8 & 0xFF, rays.count);
    std::memset(out.b, color >> 16, rays.count);
  }
  if (wanted.semantic) std::fill_n(out.semantic, rays.count, surface.semantic);
  if (wanted.instance) std::fill_n(out.instance, rays.count, surface.instance);
  if (wanted.normal) {
    std::fill_n(out.nx, rays.count, normal.x());
    std::fill_n(out.ny, rays.count, normal.y());
    std::fill_n(out.nz, rays.count, normal.z());
  }
  for (std::size_t i = 0; wanted.depth && i < rays.count; i += F::kCount) write_depth(rays, i, depth_kind, out);
}

bool all_equal(const std::int32_t* values, std::size_t count) {
  I differing = 0;
  for (std::size_t i = 0; i < count; i += I::kCount) differing = differing | (I::load(values + i) ^ values[0]);
  return all(differing == 0);
}

// Returns the number of the body that an element is; negative for other elements.
HWY_INLINE std::int32_t body_of(const Shading::Tables& tables, std::int32_t element) {
  return element - tables.first_marker - static_cast<std::int32_t>(tables.markers.size());
}
HWY_INLINE bool is_mesh_body(const Shading::Tables& tables, std::int32_t element, const ShadedBodies& bodies) {
  const std::int32_t body = body_of(tables, element);
  return body >= 0 && bodies.is_mesh(static_cast<std::size_t>(body));
}

// Returns the solid of an element that is neither a triangle nor a mesh.
HWY_INLINE const ShadedSolid& solid_of(const Shading::Tables& tables, std::int32_t element, ShadedBodies& bodies) {
  if (element < tables.first_triangle) return tables.solids[static_cast<std::size_t>(element)];
  const auto marker = static_cast<std::size_t>(element - tables.first_marker);
  return marker < tables.markers.size() ? tables.markers[marker] : bodies.at(marker - tables.markers.size());
}

template <bool kShadows, Detail kDetail>
void shade_tile(const Shading::Tables& tables, const trace::RayBundle& bundle, const trace::HitDetails& details,
                const std::uint8_t* shaded, const SoftLight* soft, float pixel_area, const CameraOutputs& wanted,
                DepthKind depth_kind, ShadedBodies& bodies, TilePixels& out) {
  using Bytes = Wide<hn::Rebind<std::uint8_t, F::Tag>>;
  using Shorts = Wide<hn::Rebind<std::uint16_t, F::Tag>>;
  TintedTile tinted;
  const auto put_color = [&](std::size_t i, I color) HWY_ATTR {
    convert<Bytes>(color & 0xFF).store_unaligned(out.r + i);
    convert<Bytes>(shift_right<8>(color) & 0xFF).store_unaligned(out.g + i);
    convert<Bytes>(shift_right<16>(color)).store_unaligned(out.b + i);
  };
  for (std::size_t i = 0; i < bundle.count; i += F::kCount) {
    const std::int32_t* const elements = bundle.element + i;
    const I element = I::load(elements);
    const Mask triangles = (element > tables.first_triangle - 1) & (element < tables.first_marker);
    Rays<kShadows, kDetail> rays{rotate(bundle.rotation, F3::load_unaligned(bundle.x + i, bundle.y + i, bundle.z + i)),
                                 F::load(bundle.t_hit + i), Mask(false)};
    if constexpr (kShadows) rays.shaded = convert<I>(Bytes::load_unaligned(shaded + i)) != 0;
    if constexpr (kDetail == Detail::soft) {
      rays.sun = F::load(soft->sun + i);
      rays.ambient = F::load(soft->ambient + i);
    }
    if (wanted.depth) write_depth(bundle, i, depth_kind, out);
    Pixels pixels = empty_pixels();
    std::uint32_t left = bits(Mask(true));
    for (bool first = true; left != 0; first = false) {
      const std::int32_t number = elements[std::countr_zero(left)];
      Pixels shown = empty_pixels();
      Mask mask;
      if (number < 0) {
        mask = element < 0;
        if (wanted.any_color()) shown.color = sky<kDetail>(tables, rays.direction);
      } else if (number >= tables.first_triangle && number < tables.first_marker) {
        mask = triangles;
        shown = triangle_pixels(tables, elements, mask, details, i, rays, pixel_area, wanted, tinted);
      } else {
        mask = element == number;
        if (is_mesh_body(tables, number, bodies)) {
          bodies.see_mesh(body_of(tables, number));  // shade_mesh() writes these pixels
        } else {
          shown = solid_pixels(tables, solid_of(tables, number, bodies), bundle.origin, rays, wanted);
        }
      }
      pixels = first ? shown : select(mask, shown, pixels);
      left &= ~bits(mask);
    }
    if (wanted.any_color()) tinted.waits_for(i) ? tinted.set_color(i, pixels.color) : put_color(i, pixels.color);
    if (wanted.semantic) convert<Shorts>(pixels.semantic).store_unaligned(out.semantic + i);
    if (wanted.instance) convert<Shorts>(pixels.instance).store_unaligned(out.instance + i);
    if (wanted.normal) pixels.normal.store(out.nx + i, out.ny + i, out.nz + i);
  }
  tinted.finish<kDetail>(tables, kDetail != Detail::plain && !tables.colors.empty(), put_color);
}

// Writes the pixels of a tile that show a body that is a mesh. to_local: rotation, sensor's to body's frame.
template <Detail kDetail>
void shade_mesh(const Shading::Tables& tables, const Mat3& to_local, const Mat3& to_world, std::int32_t body_element,
                const Surface& surface, const trace::RayBundle& bundle, const trace::HitDetails& details,
                const std::uint8_t* shaded, const SoftLight* soft, float pixel_area, const CameraOutputs& wanted,
                TilePixels& out) {
  constexpr bool kShadows = kDetail != Detail::soft;  // has shares of light instead
  using Bytes = Wide<hn::Rebind<std::uint8_t, F::Tag>>;
  using Shorts = Wide<hn::Rebind<std::uint16_t, F::Tag>>;
  TintedTile tinted;
  const auto shows = [&](std::size_t i) HWY_ATTR { return I::load(bundle.element + i) == body_element; };
  const auto put_byte = [](Mask mask, I value, std::uint8_t* to) HWY_ATTR {
    convert<Bytes>(select(mask, value & 0xFF, convert<I>(Bytes::load_unaligned(to)))).store_unaligned(to);
  };
  const auto put_short = [](Mask mask, I value, std::uint16_t* to) HWY_ATTR {
    convert<Shorts>(select(mask, value, convert<I>(Shorts::load_unaligned(to)))).store_unaligned(to);
  };
  const auto put_color = [&](std::size_t i, I color) HWY_ATTR {
    const Mask mask = shows(i);
    put_byte(mask, color, out.r + i);
    put_byte(mask, shift_right<8>(color), out.g + i);
    put_byte(mask, shift_right<16>(color), out.b + i);
  };
  CameraOutputs of_triangles = wanted;
  of_triangles.semantic = of_triangles.instance = false;
  for (std::size_t i = 0; i < bundle.count; i += F::kCount) {
    const Mask mask = shows(i);
    if (none(mask)) continue;
    Rays<kShadows, kDetail> rays{rotate(to_local, F3::load_unaligned(bundle.x + i, bundle.y + i, bundle.z + i)),
                                 F::load(bundle.t_hit + i), Mask(false)};
    if (kShadows && shaded != nullptr) rays.shaded = convert<I>(Bytes::load_unaligned(shaded + i)) != 0;
    if constexpr (kDetail == Detail::soft) {
      rays.sun = F::load(soft->sun + i);
      rays.ambient = F::load(soft->ambient + i);
    }
    const Pixels pixels = triangle_pixels(tables, details.triangle + i, mask, details, i, rays, pixel_area, of_triangles, tinted);
    if (wanted.any_color()) tinted.waits_for(i) ? tinted.set_color(i, pixels.color) : put_color(i, pixels.color);
    if (wanted.semantic) put_short(mask, surface.semantic, out.semantic + i);
    if (wanted.instance) put_short(mask, surface.instance, out.instance + i);
    if (!wanted.normal) continue;
    const F3 normal = rotate(to_world, pixels.normal);
    select(mask, normal, F3::load(out.nx + i, out.ny + i, out.nz + i)).store(out.nx + i, out.ny + i, out.nz + i);
  }
  tinted.finish<kDetail>(tables, !tables.colors.empty(), put_color);
}

template <bool kShadows>
auto tile_shader(const Shading::Tables& tables, bool has_fog) {
  if (has_fog) return shade_tile<kShadows, Detail::fog>;
  return tables.is_plain() ? shade_tile<kShadows, Detail::plain> : shade_tile<kShadows, Detail::full>;
}

void shade(const Shading::Tables& tables, const trace::RayBundle& bundle, const trace::HitDetails& details,
           const std::uint8_t* shaded, const SoftLight* soft, float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind,
           ShadedBodies& bodies, TilePixels& out) {
  const bool has_fog = tables.light.fog_visibility_m > 0.0F && wanted.any_color();
  if (soft == nullptr && shaded == nullptr) {
    const std::int32_t element = bundle.element[0];
    const bool is_solid = element >= 0 && (element < tables.first_triangle || element >= tables.first_marker) &&
                          !is_mesh_body(tables, element, bodies);
    if (is_solid && !has_fog && all_equal(bundle.element, bundle.count)) {
      const ShadedSolid& solid = solid_of(tables, element, bodies);
      if (const int face = common_face(*solid.shape, bundle); face >= 0) {
        const Vec3 outward = solid.shape->to_local.row(face / 2).transpose();
        fill(solid.faces[0][static_cast<std::size_t>(face)], solid.surface, face % 2 == 0 ? Vec3(-outward) : outward, wanted,
             bundle, depth_kind, out);
        return;
      }
    }
  }
  const auto tile_kernel = soft != nullptr     ? shade_tile<false, Detail::soft>
                           : shaded == nullptr ? tile_shader<false>(tables, has_fog)
                                               : tile_shader<true>(tables, has_fog);
  tile_kernel(tables, bundle, details, shaded, soft, pixel_area, wanted, depth_kind, bodies, out);
  const std::int32_t first_body = tables.first_marker + static_cast<std::int32_t>(tables.markers.size());
  for (const std::int32_t body : bodies.take_seen_meshes()) {
    const ShadedBodies::Mesh mesh = bodies.mesh_at(static_cast<std::size_t>(body));
    bodies.light(mesh, first_body + body, bundle, details, shaded != nullptr && wanted.any_color());
    const Shading::Tables& own = mesh.shaded->tables();
    const auto mesh_kernel = soft != nullptr ? shade_mesh<Detail::soft>
                             : has_fog       ? shade_mesh<Detail::fog>
                                             : shade_mesh<Detail::full>;
    mesh_kernel(own, mesh.posed.local_rotation(bundle.rotation), mesh.posed.to_local.transpose(), first_body + body, mesh.surface,
                bundle, details, shaded, soft, pixel_area, wanted, out);
  }
}

}  // namespace flockstep::render::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::render {
namespace {

HWY_EXPORT(shade);
HWY_EXPORT(light_triangles);
HWY_EXPORT(fill_ramp);

}  // namespace

void Shading::make_ramp(const Surface& surface, Ramp& ramp) const { HWY_DYNAMIC_DISPATCH(fill_ramp)(tables_, surface, ramp); }

void Shading::light_triangles(bool shaded) const {
  HWY_DYNAMIC_DISPATCH(light_triangles)(tables_, {}, shaded, tables_.lit.get());
}

void Shading::light_triangles(Tables& tables, std::span<const std::int32_t> triangles, bool shaded) const {
  HWY_DYNAMIC_DISPATCH(light_triangles)(tables, triangles, shaded, tables.lit.get());
}

void Shading::prepare_shadows() const {
  const std::lock_guard lock(shadows_mutex_);
  if (!has_shadows_) light_triangles(true);
  has_shadows_ = true;
}

void Shading::shade(const trace::RayBundle& rays, const trace::HitDetails& details, std::span<const std::uint8_t> shaded,
                    const SoftLight* soft, float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind,
                    ShadedBodies& bodies, TilePixels& out) const {
  HWY_DYNAMIC_DISPATCH(shade)
  (tables_, rays, details, shaded.empty() ? nullptr : shaded.data(), soft, pixel_area, wanted, depth_kind, bodies, out);
}

}  // namespace flockstep::render
#endif
