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

#include "base/prefetch.hpp"
#include "base/srgb.hpp"
#include "trace/intersect-inl.hpp"

#ifndef FLOCKSTEP_RENDER_COMMON_FACE
#define FLOCKSTEP_RENDER_COMMON_FACE
namespace flockstep::render {

// The face (-x, +x, -y, ..., as seen) of a box that all rays of a tile meet, or -1 where that is not certain. All rays meet the
// box. A face of a box is convex, and so is its picture: what the tile's corners show, the whole tile shows. That may fail where
// the near plane cuts the box.
inline int common_face(const trace::Shape& shape, const trace::RayBundle& rays) {
  if (shape.kind != trace::ShapeKind::box) return -1;
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
namespace hn = hwy::HWY_NAMESPACE;
using trace::HWY_NAMESPACE::rotate;
using trace::HWY_NAMESPACE::Vec3V;

using Floats = hn::CappedTag<float, PixelTile::kSide>;
using Ints = hn::RebindToSigned<Floats>;
using V = hn::Vec<Floats>;
using I = hn::Vec<Ints>;
using Mask = hn::Mask<Floats>;

// One vector of pixels. kShadows: some may be in the shadow of something. kPlain: as Shading::Tables says.
template <bool kShadows, bool kPlain>
struct Rays {
  Vec3V<V> direction;  // world frame
  V t;
  Mask shaded;  // none without kShadows
};
struct Pixels {
  I color;  // r | g << 8 | b << 16
  I semantic, instance;
  Vec3V<V> normal;
};

HWY_INLINE Mask every(Floats d) { return hn::Eq(hn::Zero(d), hn::Zero(d)); }

HWY_INLINE std::uint64_t bits_of(Floats d, Mask mask) {
  std::uint8_t bytes[8] = {};
  hn::StoreMaskBits(d, mask, bytes);
  std::uint64_t bits = 0;
  for (std::size_t i = 0; i < 2; ++i) bits |= static_cast<std::uint64_t>(bytes[i]) << (8 * i);
  return bits;
}

HWY_INLINE V dot(const Vec3V<V>& a, const Vec3V<V>& b) {
  return hn::Add(hn::Add(hn::Mul(a.x, b.x), hn::Mul(a.y, b.y)), hn::Mul(a.z, b.z));
}

HWY_INLINE Vec3V<V> normalised(const Vec3V<V>& v) {
  const V length = hn::Sqrt(dot(v, v));
  return {hn::Div(v.x, length), hn::Div(v.y, length), hn::Div(v.z, length)};
}

// The normal of the side that is seen.
HWY_INLINE Vec3V<V> towards_camera(Floats d, const Vec3V<V>& normal, const Vec3V<V>& direction) {
  const V flip = hn::And(hn::Neg(dot(normal, direction)), hn::SignBit(d));
  return {hn::Xor(normal.x, flip), hn::Xor(normal.y, flip), hn::Xor(normal.z, flip)};
}

HWY_INLINE I level(Floats d, Ints di, const Shading::Tables& tables, V value) {
  // Lanes that show something else may hold anything, but must not read outside the table: Max turns a NaN into 0.
  const V root = hn::Sqrt(hn::Min(hn::Max(value, hn::Zero(d)), hn::Set(d, 1.0F)));
  const V index = hn::Add(hn::Mul(root, hn::Set(d, static_cast<float>(Shading::kLevels))), hn::Set(d, 0.5F));
  return hn::GatherIndex(di, tables.levels.data(), hn::ConvertTo(di, index));
}

HWY_INLINE I packed(I red, I green, I blue) { return hn::Or(red, hn::Or(hn::ShiftLeft<8>(green), hn::ShiftLeft<16>(blue))); }

struct Nothing {};  // is emitted

// What a base colour shows, as linear values, where the cosine of the angle between normal and sun is `sunward`, and the normal's
// z `upward`.
template <bool kShadows, bool kPlain, class Base, class Emitted = Nothing>
HWY_INLINE std::array<V, 3> linear(Floats d, const Shading::Tables& tables, const Base& base, V sunward, V upward,
                                   const Rays<kShadows, kPlain>& rays, const Emitted& emitted = {}) {
  const Light& light = tables.light;
  V sun = hn::Max(sunward, hn::Zero(d));
  if constexpr (kShadows) sun = hn::IfThenZeroElse(rays.shaded, sun);
  const V sky = hn::Add(hn::Mul(upward, hn::Set(d, 0.5F)), hn::Set(d, 0.5F));
  const auto channel = [&](std::size_t c) HWY_ATTR {
    const V ambient = hn::Add(hn::Set(d, light.ground_ambient[c]),
                              hn::Mul(hn::Set(d, light.sky_ambient[c] - light.ground_ambient[c]), hn::Max(sky, hn::Zero(d))));
    V value = hn::Mul(base(c), hn::Add(ambient, hn::Mul(hn::Set(d, light.sun_color[c]), sun)));
    if constexpr (!std::is_same_v<Emitted, Nothing>) value = hn::Add(value, emitted(c));
    return value;
  };
  return {channel(0), channel(1), channel(2)};
}

// The same as it is written.
HWY_INLINE I written(Floats d, Ints di, const Shading::Tables& tables, const std::array<V, 3>& color) {
  return packed(level(d, di, tables, color[0]), level(d, di, tables, color[1]), level(d, di, tables, color[2]));
}

// Linear values as one negative number: their roots, ten bits each from the lowest on. Units: the values of roots of 1.
HWY_INLINE I as_roots(Floats d, Ints di, const std::array<V, 3>& color, const std::array<V, 3>& unit) {
  const auto root = [&](std::size_t c) HWY_ATTR {
    const V number = hn::Sqrt(hn::Div(hn::Max(color[c], hn::Zero(d)), hn::Max(unit[c], hn::Set(d, FLT_MIN))));
    return hn::Min(hn::ConvertTo(di, hn::Add(number, hn::Set(d, 0.5F))), hn::Set(di, Shading::kRoots));
  };
  const I all = hn::Or(root(0), hn::Or(hn::ShiftLeft<10>(root(1)), hn::ShiftLeft<20>(root(2))));
  return hn::Or(all, hn::Set(di, std::numeric_limits<std::int32_t>::min()));
}
HWY_INLINE std::array<V, 3> of_roots(Floats d, Ints di, I roots, const std::array<V, 3>& unit) {
  const auto value = [&](auto shift, std::size_t c) HWY_ATTR {
    const V root = hn::ConvertTo(d, hn::And(hn::ShiftRight<shift.value>(roots), hn::Set(di, Shading::kRoots)));
    return hn::Mul(hn::Mul(root, root), unit[c]);
  };
  return {value(std::integral_constant<int, 0>(), 0), value(std::integral_constant<int, 10>(), 1),
          value(std::integral_constant<int, 20>(), 2)};
}

template <bool kShadows, bool kPlain>
HWY_INLINE I on_ramp(Floats d, Ints di, const std::int32_t* ramp, V sunward, const Rays<kShadows, kPlain>& rays) {
  V sun = hn::Min(hn::Max(sunward, hn::Zero(d)), hn::Set(d, 1.0F));
  if constexpr (kShadows) sun = hn::IfThenZeroElse(rays.shaded, sun);
  const V index = hn::Add(hn::Mul(hn::Sqrt(sun), hn::Set(d, static_cast<float>(Shading::kRamp))), hn::Set(d, 0.5F));
  return hn::GatherIndex(di, ramp, hn::ConvertTo(di, index));
}

// How much of the sky's colour in a direction is the sun's; see Light.
HWY_INLINE V sun_share(Floats d, const Shading::Tables& tables, const Vec3V<V>& direction, V length) {
  const SunDisc& disc = tables.sun_disc;
  const auto& to_sun = tables.light.sun_direction;
  const Vec3V<V> apart{hn::Sub(hn::Div(direction.x, length), hn::Set(d, to_sun[0])),
                       hn::Sub(hn::Div(direction.y, length), hn::Set(d, to_sun[1])),
                       hn::Sub(hn::Div(direction.z, length), hn::Set(d, to_sun[2]))};
  const V q = dot(apart, apart);
  const V one = hn::Set(d, 1.0F);
  const V within = hn::Mul(hn::Sub(hn::Set(d, disc.edge), q), hn::Set(d, disc.steepness));
  const V glow = hn::Div(hn::Set(d, disc.glow), hn::Add(one, hn::Mul(hn::Set(d, SunDisc::kFocus), q)));
  return hn::Max(hn::Min(within, one), glow);
}

template <bool kPlain>
HWY_INLINE I sky(Floats d, Ints di, const Shading::Tables& tables, const Vec3V<V>& direction) {
  const V length = hn::Sqrt(dot(direction, direction));
  const V up = hn::Max(hn::Div(direction.z, length), hn::Zero(d));
  if (!tables.sky.empty()) {
    const V index =
        hn::Add(hn::Mul(hn::Min(up, hn::Set(d, 1.0F)), hn::Set(d, static_cast<float>(Shading::kSky))), hn::Set(d, 0.5F));
    return hn::GatherIndex(di, tables.sky.data(), hn::ConvertTo(di, index));
  }
  const bool disc = !kPlain && tables.sun_disc.shows;
  const V share = disc ? sun_share(d, tables, direction, length) : hn::Zero(d);
  const auto channel = [&](std::size_t c) HWY_ATTR {
    const float horizon = tables.light.horizon_color[c];
    V color = hn::Add(hn::Set(d, horizon), hn::Mul(hn::Set(d, tables.light.zenith_color[c] - horizon), up));
    if (disc) {
      color = hn::Add(color, hn::Mul(hn::Sub(hn::Set(d, tables.sun_disc.color[c]), color), share));
    }
    return level(d, di, tables, color);
  };
  return packed(channel(0), channel(1), channel(2));
}

// A solid at the points its rays have hit.
template <bool kShadows, bool kPlain>
HWY_INLINE Pixels solid_pixels(Floats d, Ints di, const Shading::Tables& tables, const ShadedSolid& solid, const Vec3& origin,
                               const Rays<kShadows, kPlain>& rays, const CameraOutputs& wanted) {
  const trace::Shape& shape = *solid.shape;
  const float* const half = shape.half_extents;
  const Vec3 offset(origin.x() - shape.center[0], origin.y() - shape.center[1], origin.z() - shape.center[2]);
  const Vec3 o = shape.aligned ? offset : trace::rotated(shape.to_local, offset);
  const Vec3V<V> dir = shape.aligned ? rays.direction : rotate(d, shape.to_local, rays.direction);
  const V x = hn::Add(hn::Set(d, o.x()), hn::Mul(rays.t, dir.x));
  const V y = hn::Add(hn::Set(d, o.y()), hn::Mul(rays.t, dir.y));
  const V z = hn::Add(hn::Set(d, o.z()), hn::Mul(rays.t, dir.z));

  Pixels pixels{hn::Zero(di),
                hn::Set(di, solid.surface.semantic),
                hn::Set(di, solid.surface.instance),
                {hn::Zero(d), hn::Zero(d), hn::Zero(d)}};
  // A flat face across an axis shows the side that looks against the ray.
  const auto face_color = [&](std::size_t axis, V along) HWY_ATTR {
    const auto side = [&](std::size_t sign) HWY_ATTR {
      const I lit_color = hn::Set(di, solid.faces[0][2 * axis + sign]);
      if constexpr (!kShadows) return lit_color;
      return hn::IfThenElse(hn::RebindMask(di, rays.shaded), hn::Set(di, solid.faces[1][2 * axis + sign]), lit_color);
    };
    return hn::IfThenElse(hn::RebindMask(di, hn::Lt(along, hn::Zero(d))), side(1), side(0));
  };
  const auto face_normal = [&](V along) HWY_ATTR { return hn::CopySign(hn::Set(d, 1.0F), hn::Neg(along)); };
  const auto curved = [&](const Vec3V<V>& outward) HWY_ATTR {
    const Vec3V<V> normal = towards_camera(d, outward, dir);
    const auto cosine = [&](const std::array<float, 3>& to)
                            HWY_ATTR { return dot(normal, {hn::Set(d, to[0]), hn::Set(d, to[1]), hn::Set(d, to[2])}); };
    const auto base = [&](std::size_t c) HWY_ATTR { return hn::Set(d, solid.surface.color[c]); };
    if (wanted.any_color() && solid.ramp != nullptr) {
      pixels.color = on_ramp(d, di, solid.ramp, cosine(solid.sun), rays);
    } else if (!kPlain && wanted.any_color() && solid.surface.emits()) {
      const auto emitted = [&](std::size_t c) HWY_ATTR { return hn::Set(d, solid.surface.emissive[c]); };
      pixels.color = written(d, di, tables, linear(d, tables, base, cosine(solid.sun), cosine(solid.up), rays, emitted));
    } else if (wanted.any_color()) {
      pixels.color = written(d, di, tables, linear(d, tables, base, cosine(solid.sun), cosine(solid.up), rays));
    }
    pixels.normal = normal;
  };

  switch (shape.kind) {
    case trace::ShapeKind::box: {
      // The face whose plane is nearest; of a plane, which has no thickness, the one it is.
      const V outside_x = hn::Sub(hn::Abs(x), hn::Set(d, half[0]));
      const V outside_y = hn::Sub(hn::Abs(y), hn::Set(d, half[1]));
      const V outside_z = half[2] > 0.0F ? hn::Sub(hn::Abs(z), hn::Set(d, half[2])) : hn::Inf(d);
      const auto y_over_x = hn::Gt(outside_y, outside_x);
      const auto z_over_xy = hn::Gt(outside_z, hn::Max(outside_x, outside_y));
      pixels.color = hn::IfThenElse(hn::RebindMask(di, y_over_x), face_color(1, dir.y), face_color(0, dir.x));
      pixels.color = hn::IfThenElse(hn::RebindMask(di, z_over_xy), face_color(2, dir.z), pixels.color);
      if (wanted.normal) {
        const auto is_y = hn::AndNot(z_over_xy, y_over_x);
        pixels.normal = {hn::IfThenZeroElse(hn::Or(y_over_x, z_over_xy), face_normal(dir.x)),
                         hn::IfThenElseZero(is_y, face_normal(dir.y)), hn::IfThenElseZero(z_over_xy, face_normal(dir.z))};
      }
      break;
    }
    case trace::ShapeKind::cylinder: {
      // A point of the side is `radius` away from the axis, up to rounding; r^2 - radius^2 is 2 radius times that rounding.
      const float radius = half[0];
      const V beyond = hn::Sub(hn::Add(hn::Mul(x, x), hn::Mul(y, y)), hn::Set(d, radius * radius));
      const V from_cap = hn::Abs(hn::Sub(hn::Abs(z), hn::Set(d, half[2])));
      const auto cap = half[2] > 0.0F ? hn::Lt(hn::Mul(from_cap, hn::Set(d, 2.0F * radius)), hn::Abs(beyond)) : every(d);
      const V inverse = hn::Set(d, 1.0F / radius);
      curved({hn::Mul(x, inverse), hn::Mul(y, inverse), hn::Zero(d)});
      if (hn::AllFalse(d, cap)) break;
      pixels.color = hn::IfThenElse(hn::RebindMask(di, cap), face_color(2, dir.z), pixels.color);
      pixels.normal = Vec3V<V>{hn::IfThenZeroElse(cap, pixels.normal.x), hn::IfThenZeroElse(cap, pixels.normal.y),
                               hn::IfThenElse(cap, face_normal(dir.z), pixels.normal.z)};
      break;
    }
    case trace::ShapeKind::capsule: {
      const V middle = hn::Set(d, half[2] - half[0]);
      curved(normalised({x, y, hn::Sub(z, hn::Min(hn::Max(z, hn::Neg(middle)), middle))}));
      break;
    }
    case trace::ShapeKind::sphere:
      curved(normalised({x, y, z}));
      break;
  }
  if (wanted.normal && !shape.aligned) {
    const auto to_world = [&shape](int row, int column) { return shape.to_local(column, row); };
    pixels.normal = rotate(d, to_world, pixels.normal);
  }
  return pixels;
}

// A texture coordinate within [0, 1]: repeated, mirrored or clamped.
HWY_INLINE V wrapped(Floats d, V x, I wrap) {
  const Ints di;
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0F), two = hn::Set(d, 2.0F);
  const auto is = [&](TextureWrap which)
                      HWY_ATTR { return hn::RebindMask(d, hn::Eq(wrap, hn::Set(di, static_cast<std::int32_t>(which)))); };
  const V repeated = hn::Sub(x, hn::Floor(x));
  if (hn::AllTrue(d, is(TextureWrap::repeat))) return hn::Min(hn::Max(repeated, zero), one);  // as mostly
  const V there_and_back = hn::Sub(x, hn::Mul(two, hn::Floor(hn::Mul(x, hn::Set(d, 0.5F)))));
  const V mirrored = hn::IfThenElse(hn::Gt(there_and_back, one), hn::Sub(two, there_and_back), there_and_back);
  const V inside = hn::IfThenElse(is(TextureWrap::repeat), repeated, hn::IfThenElse(is(TextureWrap::mirror), mirrored, x));
  return hn::Min(hn::Max(inside, zero), one);
}

// The texel before a place along an axis, -1 on the border, and how far it is to the next one.
struct Before {
  I texel;
  V towards;
};

HWY_INLINE Before before(Floats d, Ints di, V x, I size) {
  const V at = hn::Sub(hn::Mul(x, hn::ConvertTo(d, size)), hn::Set(d, 0.5F));
  const V below = hn::Floor(at);
  return {hn::ConvertTo(di, below), hn::Sub(at, below)};
}

// The texels of these numbers and those after them, read in pairs: half as many reads.
struct Pairs {
  I first, second;
};

HWY_INLINE Pairs pairs(Ints di, const std::int32_t* texels, I first) {
  const hn::Repartition<std::uint64_t, Ints> pair;  // at any texel, aligned or not
  const hn::RebindToSigned<decltype(pair)> offsets;
  const auto* const base = reinterpret_cast<const std::uint64_t*>(texels);
  const auto two = [&](auto numbers)
                       HWY_ATTR { return hn::GatherOffset(pair, base, hn::BitCast(offsets, hn::ShiftLeft<2>(numbers))); };
  const auto numbers = hn::BitCast(pair, first);
  const auto even = two(hn::And(numbers, hn::Set(pair, 0xFFFFFFFFU))), odd = two(hn::ShiftRight<32>(numbers));
  return {hn::OddEven(hn::BitCast(di, hn::ShiftLeft<32>(odd)), hn::BitCast(di, even)),
          hn::OddEven(hn::BitCast(di, odd), hn::BitCast(di, hn::ShiftRight<32>(even)))};
}

// The levels of textures that some lanes ask for; the others, with negative numbers, get any. Some lane asks.
struct Levels {
  I offset, width, height, stride;
};

// Neighbouring pixels mostly ask for the same, and then numbers are read once and not for each lane.
HWY_INLINE Levels levels_at(Floats d, Ints di, const Shading::Images& images, const std::int32_t* numbers) {
  const I number = hn::Load(di, numbers);
  const auto asks = hn::Gt(number, hn::Set(di, -1));
  const std::int32_t one = numbers[std::countr_zero(bits_of(d, hn::RebindMask(d, asks)))];
  const I ones = hn::Set(di, one);
  const I safe = hn::IfThenElse(asks, number, ones);
  const auto of = [&](I offset, I size) HWY_ATTR {
    const I width = hn::And(size, hn::Set(di, 0xFFFF));
    return Levels{offset, width, hn::ShiftRight<16>(size), hn::Add(width, hn::Set(di, 2))};  // with a border
  };
  if (hn::AllTrue(di, hn::Eq(safe, ones))) {
    const auto at = static_cast<std::size_t>(one);
    return of(hn::Set(di, images.textures.offset[at]), hn::Set(di, images.sizes[at]));
  }
  return of(hn::GatherIndex(di, images.textures.offset.data(), safe), hn::GatherIndex(di, images.sizes.data(), safe));
}

// The four texels around a place: the number of the first, how far apart the two rows are, and how far it is to the next ones.
struct Place {
  I first, stride;
  V across, down;
};

HWY_INLINE Place place_in(Floats d, Ints di, const Levels& level, V s, V t) {
  const Before x = before(d, di, s, level.width), y = before(d, di, t, level.height);
  return {hn::Add(hn::Add(level.offset, hn::Mul(y.texel, level.stride)), x.texel), level.stride, x.towards, y.towards};
}

// The linear colours there.
HWY_INLINE std::array<V, 3> colors_at(Floats d, Ints di, const Shading::Images& images, const Place& place) {
  const Pairs upper = pairs(di, images.texels(), place.first);
  const Pairs lower = pairs(di, images.texels(), hn::Add(place.first, place.stride));
  const auto mix = [&](V from, V to, V share) HWY_ATTR { return hn::Add(from, hn::Mul(hn::Sub(to, from), share)); };
  const auto channel = [&](auto shift) HWY_ATTR {
    const auto value = [&](I texel_roots) HWY_ATTR {
      const V root = hn::ConvertTo(d, hn::And(hn::ShiftRight<shift.value>(texel_roots), hn::Set(di, Shading::kRoots)));
      return hn::Mul(root, root);
    };
    const auto between = [&](const Pairs& row) HWY_ATTR { return mix(value(row.first), value(row.second), place.across); };
    constexpr float kScale = 1.0F / (static_cast<float>(Shading::kRoots) * static_cast<float>(Shading::kRoots));
    return hn::Mul(mix(between(upper), between(lower), place.down), hn::Set(d, kScale));
  };
  return {channel(std::integral_constant<int, 0>()), channel(std::integral_constant<int, 10>()),
          channel(std::integral_constant<int, 20>())};
}

// f(number, lanes) for each number that some of the lanes have: neighbouring pixels mostly have the same.
template <class F>
HWY_INLINE void for_each_number(Floats d, Ints di, const std::int32_t* numbers, Mask which, const F& f) {
  const I all = hn::Load(di, numbers);
  for (std::uint64_t left = bits_of(d, which); left != 0;) {
    const std::int32_t number = numbers[std::countr_zero(left)];
    const Mask its = hn::And(which, hn::RebindMask(d, hn::Eq(all, hn::Set(di, number))));
    left &= ~bits_of(d, its);
    f(number, its);
  }
}

// How much the corners of a triangle weigh at the points that rays have hit.
struct Weights {
  V a, b, c;

  // What has these values at the corners.
  HWY_INLINE V operator()(float of_a, float of_b, float of_c) const {
    const Floats d;
    return hn::Add(hn::Add(hn::Mul(a, hn::Set(d, of_a)), hn::Mul(b, hn::Set(d, of_b))), hn::Mul(c, hn::Set(d, of_c)));
  }
};

// Where in which texture the points lie that rays have hit. Lanes without a texture hold what is harmless.
struct Textured {
  Mask lanes;
  V across, down;
  Vec3V<V> normal;  // of Print
  I wrap_across, wrap_down, first_level, last_level;

  explicit HWY_INLINE Textured(Floats d)
      : lanes(hn::Not(every(d))),
        across(hn::Zero(d)),
        down(across),
        normal{across, across, across},
        wrap_across(hn::Zero(Ints())),
        wrap_down(wrap_across),
        first_level(wrap_across),
        last_level(wrap_across) {}

  // A triangle, and the paint of its material.
  HWY_INLINE void add(const Shading::Images::Print& print, Mask its, const Weights& weights) {
    const auto& [a, b, c] = print.uv;
    across = hn::IfThenElse(its, weights(a[0], b[0], c[0]), across);
    down = hn::IfThenElse(its, weights(a[1], b[1], c[1]), down);
    const auto set = [&](V& to, float value) HWY_ATTR { to = hn::IfThenElse(its, hn::Set(Floats(), value), to); };
    set(normal.x, print.normal[0]);
    set(normal.y, print.normal[1]);
    set(normal.z, print.normal[2]);
  }
  HWY_INLINE void add(const Shading::Paint& paint, Mask its) {
    const Ints di;
    const auto set = [&](I& to, std::int32_t value)
                         HWY_ATTR { to = hn::IfThenElse(hn::RebindMask(di, its), hn::Set(di, value), to); };
    lanes = hn::Or(lanes, its);
    set(wrap_across, paint.wrap_across);
    set(wrap_down, paint.wrap_down);
    set(first_level, paint.first_level);
    set(last_level, paint.last_level);
  }
};

// The pixels of a tile whose colours are still to be multiplied, by textures or by the colours of vertices. All of them take a
// step before any takes the next one. Each step waits, for memory or for long instructions, and a processor waits for several
// vectors at once only if little code lies between them.
class TintedTile {
 public:
  // The vector that begins at this pixel; its colours follow by set_color().
  HWY_INLINE void add(std::size_t pixel, const std::array<V, 3>& unit, const std::array<V, 3>* of_vertices) {
    const Floats d;
    tinted_[num_tinted_++] = static_cast<std::uint16_t>(pixel);
    for (std::size_t c = 0; c < 3; ++c) {
      hn::Store(unit[c], d, unit_[c] + pixel);
      if (of_vertices != nullptr) hn::Store((*of_vertices)[c], d, of_vertices_[c] + pixel);
    }
  }
  // Textures of the vector that was added last. pixel_area: as Shading::shade() says.
  template <bool kShadows, bool kPlain>
  HWY_INLINE void add(const Textured& textured, const Rays<kShadows, kPlain>& rays, float pixel_area) {
    const Floats d;
    const Ints di;
    const std::size_t pixel = tinted_[num_tinted_ - 1];
    // The square of how many texels a pixel covers along its longer side.
    const V across = dot(textured.normal, rays.direction);
    const V area = hn::Mul(hn::Mul(rays.t, rays.t), hn::Set(d, pixel_area));
    const V texels = hn::Max(hn::Div(hn::Mul(area, dot(rays.direction, rays.direction)), hn::Mul(across, across)), hn::Zero(d));
    // Exponent and mantissa as one number are the logarithm, a straight line between powers of two; half of it, for the root.
    const V log2 = hn::Sub(hn::Mul(hn::ConvertTo(d, hn::BitCast(di, texels)), hn::Set(d, 0x1p-23F)), hn::Set(d, 127.0F));
    const V most = hn::ConvertTo(d, textured.last_level);
    const V detail = hn::Min(hn::Max(hn::Mul(log2, hn::Set(d, 0.5F)), hn::Zero(d)), most);
    const I fine = hn::ConvertTo(di, detail);
    const V towards = hn::IfThenElseZero(textured.lanes, hn::Sub(detail, hn::ConvertTo(d, fine)));
    const I finer = hn::Add(textured.first_level, fine);
    const I coarser = hn::Add(finer, hn::Min(hn::Sub(textured.last_level, fine), hn::Set(di, 1)));
    const auto numbered = [&](I level)
                              HWY_ATTR { return hn::IfThenElse(hn::RebindMask(di, textured.lanes), level, hn::Set(di, -1)); };
    hn::Store(wrapped(d, textured.across, textured.wrap_across), d, s_ + pixel);
    hn::Store(wrapped(d, textured.down, textured.wrap_down), d, t_ + pixel);
    hn::Store(towards, d, towards_ + pixel);
    hn::Store(numbered(finer), di, finer_ + pixel);
    hn::Store(numbered(coarser), di, coarser_ + pixel);
    textured_[num_textured_++] = tinted_[num_tinted_ - 1];
    // What is near shows the largest level alone.
    if (!hn::AllFalse(d, hn::Gt(towards, hn::Zero(d)))) mixed_[num_mixed_++] = tinted_[num_tinted_ - 1];
  }
  HWY_INLINE void add_none() {
    for (auto& texel : texel_) hn::Store(hn::Set(Floats(), 1.0F), Floats(), texel + tinted_[num_tinted_ - 1]);
  }
  HWY_INLINE bool waits_for(std::size_t pixel) const { return num_tinted_ > 0 && tinted_[num_tinted_ - 1] == pixel; }
  HWY_INLINE void set_color(std::size_t pixel, I color) { hn::Store(color, Ints(), color_ + pixel); }

  // f(pixel, colour) for each vector.
  template <class F>
  HWY_INLINE void finish(const Shading::Tables& tables, bool of_vertices, const F& f) {
    const Floats d;
    const Ints di;
    look_up(tables, finer_, std::span(textured_).first(num_textured_),
            [&](std::size_t i, const std::array<V, 3>& color) HWY_ATTR {
              const auto lanes = hn::RebindMask(d, hn::Gt(hn::Load(di, finer_ + i), hn::Set(di, -1)));
              for (std::size_t c = 0; c < 3; ++c) hn::Store(hn::IfThenElse(lanes, color[c], hn::Set(d, 1.0F)), d, texel_[c] + i);
            });
    look_up(tables, coarser_, std::span(mixed_).first(num_mixed_), [&](std::size_t i, const std::array<V, 3>& color) HWY_ATTR {
      const V towards = hn::Load(d, towards_ + i);
      for (std::size_t c = 0; c < 3; ++c) {
        const V fine = hn::Load(d, texel_[c] + i);
        hn::Store(hn::Add(fine, hn::Mul(hn::Sub(color[c], fine), towards)), d, texel_[c] + i);
      }
    });
    for (std::size_t k = 0; k < num_tinted_; ++k) {
      const std::size_t i = tinted_[k];
      const I known = hn::Load(di, color_ + i);
      const auto unit = [&](std::size_t c) HWY_ATTR { return hn::Load(d, unit_[c] + i); };
      std::array<V, 3> color = of_roots(d, di, known, {unit(0), unit(1), unit(2)});
      for (std::size_t c = 0; c < 3; ++c) {
        V tint = hn::Load(d, texel_[c] + i);
        if (of_vertices) tint = hn::Mul(hn::Load(d, of_vertices_[c] + i), tint);
        color[c] = hn::Mul(color[c], tint);
      }
      f(i, hn::IfThenElse(hn::Lt(known, hn::Zero(di)), written(d, di, tables, color), known));
    }
  }

 private:
  // f(pixel, colours) for each of the vectors, in the levels of these numbers.
  template <class F>
  HWY_INLINE void look_up(const Shading::Tables& tables, const std::int32_t* numbers, std::span<const std::uint16_t> vectors,
                          const F& f) {
    const Floats d;
    const Ints di;
    const Shading::Images& images = *tables.images;
    for (const std::size_t i : vectors) {
      const Levels levels = levels_at(d, di, images, numbers + i);
      const Place place = place_in(d, di, levels, hn::Load(d, s_ + i), hn::Load(d, t_ + i));
      hn::Store(place.first, di, first_ + i);
      hn::Store(place.stride, di, stride_ + i);
      hn::Store(place.across, d, across_ + i);
      hn::Store(place.down, d, down_ + i);
      constexpr std::size_t kApart = 5;  // pixels; those between mostly share their cache lines
      for (std::size_t pixel = i; pixel < i + hn::Lanes(d); pixel += kApart) {
        hwy::Prefetch(images.texels() + first_[pixel]);
        hwy::Prefetch(images.texels() + first_[pixel] + stride_[pixel]);
      }
    }
    for (const std::size_t i : vectors) {
      f(i, colors_at(d, di, images,
                     {hn::Load(di, first_ + i), hn::Load(di, stride_ + i), hn::Load(d, across_ + i), hn::Load(d, down_ + i)}));
    }
  }

  static constexpr std::size_t kCount = TilePixels::kCount, kVectors = kCount / 4;
  alignas(64) std::int32_t color_[kCount];  // negative: to be multiplied
  alignas(64) float unit_[3][kCount], of_vertices_[3][kCount], texel_[3][kCount];
  alignas(64) float s_[kCount], t_[kCount], towards_[kCount];
  alignas(64) std::int32_t finer_[kCount], coarser_[kCount];  // levels; negative: no texture
  alignas(64) std::int32_t first_[kCount], stride_[kCount];   // of Place
  alignas(64) float across_[kCount], down_[kCount];
  std::uint16_t tinted_[kVectors], textured_[kVectors], mixed_[kVectors];
  std::size_t num_tinted_ = 0, num_textured_ = 0, num_mixed_ = 0;
};

// What the table of triangles has for the lanes that show one; 0 elsewhere.
template <bool kShadows, bool kPlain>
HWY_INLINE I lit(Ints di, const Shading::Tables& tables, I elements, hn::Mask<Ints> triangles, const trace::HitDetails& details,
                 std::size_t first, const Rays<kShadows, kPlain>& rays) {
  const I number = hn::Sub(elements, hn::Set(di, tables.first_triangle));
  I place = hn::Add(hn::ShiftLeft<1>(number), hn::Load(di, details.back + first));
  if constexpr (kShadows) {
    const I in_shade = hn::Set(di, 2 * (tables.first_marker - tables.first_triangle));
    place = hn::Add(place, hn::IfThenElseZero(hn::RebindMask(di, rays.shaded), in_shade));
  }
  return hn::IfThenElseZero(triangles, hn::GatherIndex(di, tables.lit.get(), hn::IfThenElseZero(triangles, place)));
}

template <bool kShadows, bool kPlain>
HWY_INLINE Pixels triangle_pixels(Floats d, Ints di, const Shading::Tables& tables, const std::int32_t* each, Mask which,
                                  const trace::HitDetails& details, std::size_t first, const Rays<kShadows, kPlain>& rays,
                                  float pixel_area, const CameraOutputs& wanted, TintedTile& tile) {
  const V zero = hn::Zero(d), one = hn::Set(d, 1.0F);
  const I elements = hn::Load(di, each);
  Pixels pixels{hn::Zero(di), hn::Zero(di), hn::Zero(di), {zero, zero, zero}};
  if (wanted.any_color()) pixels.color = lit(di, tables, elements, hn::RebindMask(di, which), details, first, rays);
  const auto tinted = hn::RebindMask(d, hn::Lt(pixels.color, hn::Zero(di)));
  const bool tints_some = !hn::AllFalse(d, tinted), numbers = wanted.semantic || wanted.instance;
  if (!tints_some && !numbers && !wanted.normal) return pixels;

  if (wanted.normal) {
    const Vec3V<V> normal{hn::Load(d, details.normal_x + first), hn::Load(d, details.normal_y + first),
                          hn::Load(d, details.normal_z + first)};
    pixels.normal = towards_camera(d, normalised(normal), rays.direction);
  }

  const V u = hn::Load(d, details.u + first), v = hn::Load(d, details.v + first);
  const Weights weights{hn::Sub(hn::Sub(one, u), v), u, v};
  const bool colored = !kPlain && !tables.colors.empty();
  const std::span<const Shading::Images::Print> prints(tables.images->prints);
  std::array<V, 3> tints{one, one, one}, unit{zero, zero, zero};
  Textured textured(d);
  alignas(64) std::int32_t materials[PixelTile::kSide];  // of the lanes that are tinted
  I material_of = hn::Zero(di);
  const auto set = [&](std::int32_t value, Mask its, I& to)
                       HWY_ATTR { to = hn::IfThenElse(hn::RebindMask(di, its), hn::Set(di, value), to); };
  const auto see = [&](std::int32_t element, Mask its) HWY_ATTR {
    const auto triangle = static_cast<std::size_t>(element - tables.first_triangle);
    if (wanted.semantic) set(tables.semantic[tables.triangle_material[triangle]], its, pixels.semantic);
    if (wanted.instance) set(tables.triangle_object[triangle] + tables.first_object, its, pixels.instance);
    if (!tints_some) return;
    if (prints.empty()) {
      set(tables.triangle_material[triangle], its, material_of);
    } else {
      set(prints[triangle].material, its, material_of);
      textured.add(prints[triangle], its, weights);
    }
    for (std::size_t c = 0; colored && c < 3; ++c) {
      const auto& corners = tables.triangles[triangle];
      const auto color = [&](std::size_t k) { return tables.colors[static_cast<std::size_t>(corners[k])][c]; };
      tints[c] = hn::IfThenElse(its, weights(color(0), color(1), color(2)), tints[c]);
    }
  };
  for_each_number(d, di, each, numbers ? which : tinted, see);
  if (!tints_some) return pixels;

  hn::Store(material_of, di, materials);
  for_each_number(d, di, materials, tinted, [&](std::int32_t material, Mask its) HWY_ATTR {
    const Shading::Paint& paint = tables.paints[static_cast<std::size_t>(material)];
    for (std::size_t c = 0; c < 3; ++c) unit[c] = hn::IfThenElse(its, hn::Set(d, paint.unit[c]), unit[c]);
    if (paint.texture >= 0) textured.add(paint, its);
  });
  tile.add(first, unit, colored ? &tints : nullptr);
  if (hn::AllFalse(d, textured.lanes)) {
    tile.add_none();
  } else {
    tile.add(textured, rays, pixel_area);
  }
  return pixels;
}

// What one side of a vector of triangles shows.
HWY_INLINE std::array<V, 3> light_side(Floats d, const Shading::Tables& tables, const Vec3V<V>& normal, I materials,
                                       bool shaded) {
  const Rays<true, false> rays{normal, hn::Zero(d), shaded ? every(d) : hn::Not(every(d))};
  const auto base = [&](std::size_t c) HWY_ATTR { return hn::GatherIndex(d, tables.color[c].data(), materials); };
  const auto emitted = [&](std::size_t c) HWY_ATTR { return hn::GatherIndex(d, tables.emissive[c].data(), materials); };
  const auto& to_sun = tables.light.sun_direction;
  const V sunward = dot(normal, {hn::Set(d, to_sun[0]), hn::Set(d, to_sun[1]), hn::Set(d, to_sun[2])});
  return linear(d, tables, base, sunward, normal.z, rays, emitted);
}

// Fills a half of Shading::Tables::lit.
void light_triangles(const Shading::Tables& tables, std::span<const Vec3> vertices, bool shaded, std::int32_t* out) {
  const Floats d;
  const Ints di;
  for (std::size_t first = 0; first < tables.triangles.size(); first += hn::Lanes(d)) {
    const std::size_t count = std::min(hn::Lanes(d), tables.triangles.size() - first);
    alignas(64) float a[3][PixelTile::kSide] = {}, b[3][PixelTile::kSide] = {};
    alignas(64) std::int32_t material[PixelTile::kSide] = {};
    for (std::size_t i = 0; i < count; ++i) {
      const auto& corners = tables.triangles[first + i];
      const auto corner = [&](std::size_t k) -> const Vec3& { return vertices[static_cast<std::size_t>(corners[k])]; };
      for (std::size_t axis = 0; axis < 3; ++axis) {
        const auto at = static_cast<Eigen::Index>(axis);
        a[axis][i] = corner(1)[at] - corner(0)[at];
        b[axis][i] = corner(2)[at] - corner(0)[at];
      }
      material[i] = tables.triangle_material[first + i];
    }
    const auto product = [&](std::size_t j, std::size_t k) HWY_ATTR {
      return hn::Sub(hn::Mul(hn::Load(d, a[j]), hn::Load(d, b[k])), hn::Mul(hn::Load(d, a[k]), hn::Load(d, b[j])));
    };
    const Vec3V<V> front = normalised({product(1, 2), product(2, 0), product(0, 1)});
    const Vec3V<V> back{hn::Neg(front.x), hn::Neg(front.y), hn::Neg(front.z)};
    const I materials = hn::Load(di, material);
    std::array<V, 3> unit{hn::Zero(d), hn::Zero(d), hn::Zero(d)};
    for_each_number(d, di, material, every(d), [&](std::int32_t number, Mask its) HWY_ATTR {
      const Shading::Paint& paint = tables.paints[static_cast<std::size_t>(number)];
      for (std::size_t c = 0; c < 3; ++c) unit[c] = hn::IfThenElse(its, hn::Set(d, paint.unit[c]), unit[c]);
    });
    alignas(64) std::int32_t plain[2][PixelTile::kSide], roots[2][PixelTile::kSide];
    for (std::size_t k = 0; k < 2; ++k) {
      const std::array<V, 3> color = light_side(d, tables, k == 0 ? front : back, materials, shaded);
      hn::Store(written(d, di, tables, color), di, plain[k]);
      hn::Store(as_roots(d, di, color, unit), di, roots[k]);
    }
    for (std::size_t i = 0; i < count; ++i) {
      const bool tinted = !tables.colors.empty() || tables.paints[static_cast<std::size_t>(material[i])].texture >= 0;
      for (std::size_t k = 0; k < 2; ++k) out[2 * (first + i) + k] = tinted ? roots[k][i] : plain[k][i];
    }
  }
}

HWY_INLINE Pixels select(Ints di, Mask mask, const Pixels& yes, const Pixels& no) {
  const auto ints = hn::RebindMask(di, mask);
  return {hn::IfThenElse(ints, yes.color, no.color),
          hn::IfThenElse(ints, yes.semantic, no.semantic),
          hn::IfThenElse(ints, yes.instance, no.instance),
          {hn::IfThenElse(mask, yes.normal.x, no.normal.x), hn::IfThenElse(mask, yes.normal.y, no.normal.y),
           hn::IfThenElse(mask, yes.normal.z, no.normal.z)}};
}

HWY_INLINE void write_depth(Floats d, const trace::RayBundle& rays, std::size_t i, DepthKind depth_kind, TilePixels& out) {
  V depth = hn::Load(d, rays.t_hit + i);
  if (depth_kind == DepthKind::range) {
    const Vec3V<V> direction{hn::LoadU(d, rays.x + i), hn::LoadU(d, rays.y + i), hn::LoadU(d, rays.z + i)};
    depth = hn::Mul(depth, hn::Sqrt(dot(direction, direction)));
  }
  hn::Store(depth, d, out.depth + i);
}

// Every pixel of the tile shows the same.
void fill(std::int32_t color, const Surface& surface, const Vec3& normal, const CameraOutputs& wanted,
          const trace::RayBundle& rays, DepthKind depth_kind, TilePixels& out) {
  const Floats d;
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
  for (std::size_t i = 0; wanted.depth && i < rays.count; i += hn::Lanes(d)) write_depth(d, rays, i, depth_kind, out);
}

bool all_equal(const std::int32_t* values, std::size_t count) {
  const Ints di;
  const I first = hn::Set(di, values[0]);
  I differing = hn::Zero(di);
  for (std::size_t i = 0; i < count; i += hn::Lanes(di)) differing = hn::Or(differing, hn::Xor(hn::Load(di, values + i), first));
  return hn::AllTrue(di, hn::Eq(differing, hn::Zero(di)));
}

template <bool kShadows, bool kPlain>
void shade_tile(const Shading::Tables& tables, const trace::RayBundle& bundle, const trace::HitDetails& details,
                const std::uint8_t* shaded, float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind,
                TilePixels& out) {
  const Floats d;
  const Ints di;
  const hn::Rebind<std::uint8_t, Floats> du8;
  const hn::Rebind<std::uint16_t, Floats> du16;
  const std::size_t lanes = hn::Lanes(d);
  TintedTile tinted;
  const auto put_color = [&](std::size_t i, I color) HWY_ATTR {
    const I byte = hn::Set(di, 0xFF);
    hn::StoreU(hn::DemoteTo(du8, hn::And(color, byte)), du8, out.r + i);
    hn::StoreU(hn::DemoteTo(du8, hn::And(hn::ShiftRight<8>(color), byte)), du8, out.g + i);
    hn::StoreU(hn::DemoteTo(du8, hn::ShiftRight<16>(color)), du8, out.b + i);
  };
  for (std::size_t i = 0; i < bundle.count; i += lanes) {
    const std::int32_t* const elements = bundle.element + i;
    const I element = hn::Load(di, elements);
    const auto triangles =
        hn::And(hn::Gt(element, hn::Set(di, tables.first_triangle - 1)), hn::Lt(element, hn::Set(di, tables.first_marker)));
    Rays<kShadows, kPlain> rays{
        rotate(d, bundle.rotation, {hn::LoadU(d, bundle.x + i), hn::LoadU(d, bundle.y + i), hn::LoadU(d, bundle.z + i)}),
        hn::Load(d, bundle.t_hit + i), hn::Not(every(d))};
    if constexpr (kShadows) {
      rays.shaded = hn::RebindMask(d, hn::Ne(hn::PromoteTo(di, hn::LoadU(du8, shaded + i)), hn::Zero(di)));
    }
    if (wanted.depth) write_depth(d, bundle, i, depth_kind, out);
    const V zero = hn::Zero(d);
    Pixels pixels{hn::Zero(di), hn::Zero(di), hn::Zero(di), {zero, zero, zero}};
    std::uint64_t left = bits_of(d, every(d));
    for (bool first = true; left != 0; first = false) {
      const std::int32_t number = elements[std::countr_zero(left)];
      Pixels shown = pixels;
      Mask mask;
      if (number < 0) {
        mask = hn::RebindMask(d, hn::Lt(element, hn::Zero(di)));
        shown.semantic = shown.instance = hn::Zero(di);
        shown.normal = {zero, zero, zero};
        if (wanted.any_color()) shown.color = sky<kPlain>(d, di, tables, rays.direction);
      } else if (number >= tables.first_triangle && number < tables.first_marker) {
        mask = hn::RebindMask(d, triangles);
        shown = triangle_pixels(d, di, tables, elements, mask, details, i, rays, pixel_area, wanted, tinted);
      } else {
        mask = hn::RebindMask(d, hn::Eq(element, hn::Set(di, number)));
        const ShadedSolid& solid = number < tables.first_triangle
                                       ? tables.solids[static_cast<std::size_t>(number)]
                                       : tables.markers[static_cast<std::size_t>(number - tables.first_marker)];
        shown = solid_pixels(d, di, tables, solid, bundle.origin, rays, wanted);
      }
      pixels = first ? shown : select(di, mask, shown, pixels);
      left &= ~bits_of(d, mask);
    }
    if (wanted.any_color()) tinted.waits_for(i) ? tinted.set_color(i, pixels.color) : put_color(i, pixels.color);
    if (wanted.semantic) hn::StoreU(hn::DemoteTo(du16, pixels.semantic), du16, out.semantic + i);
    if (wanted.instance) hn::StoreU(hn::DemoteTo(du16, pixels.instance), du16, out.instance + i);
    if (wanted.normal) {
      hn::Store(pixels.normal.x, d, out.nx + i);
      hn::Store(pixels.normal.y, d, out.ny + i);
      hn::Store(pixels.normal.z, d, out.nz + i);
    }
  }
  tinted.finish(tables, !kPlain && !tables.colors.empty(), put_color);
}

void shade(const Shading::Tables& tables, const trace::RayBundle& bundle, const trace::HitDetails& details,
           const std::uint8_t* shaded, float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind, TilePixels& out) {
  if (shaded == nullptr) {
    const std::int32_t element = bundle.element[0];
    if (element >= 0 && element < tables.first_triangle && all_equal(bundle.element, bundle.count)) {
      const ShadedSolid& solid = tables.solids[static_cast<std::size_t>(element)];
      if (const int face = common_face(*solid.shape, bundle); face >= 0) {
        const Vec3 outward = solid.shape->to_local.row(face / 2).transpose();
        fill(solid.faces[0][static_cast<std::size_t>(face)], solid.surface, face % 2 == 0 ? Vec3(-outward) : outward, wanted,
             bundle, depth_kind, out);
        return;
      }
    }
    const auto tile = tables.is_plain() ? shade_tile<false, true> : shade_tile<false, false>;
    tile(tables, bundle, details, shaded, pixel_area, wanted, depth_kind, out);
  } else {
    const auto tile = tables.is_plain() ? shade_tile<true, true> : shade_tile<true, false>;
    tile(tables, bundle, details, shaded, pixel_area, wanted, depth_kind, out);
  }
}

}  // namespace flockstep::render::HWY_NAMESPACE
HWY_AFTER_NAMESPACE();

#if HWY_ONCE
namespace flockstep::render {
namespace {

HWY_EXPORT(shade);
HWY_EXPORT(light_triangles);

// What the kernels' `linear` computes, of one surface, as it is written.
std::int32_t lit_color(const Shading::Tables& tables, const Surface& surface, float sunward, float upward) {
  const Light& light = tables.light;
  std::uint32_t color = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const float ambient = light.ground_ambient[c] + (light.sky_ambient[c] - light.ground_ambient[c]) * 0.5F * (1.0F + upward);
    const float reflected = surface.color[c] * (ambient + light.sun_color[c] * std::max(0.0F, sunward));
    const float root = std::sqrt(std::min(1.0F, reflected + surface.emissive[c]));
    const int level = tables.levels[static_cast<std::size_t>(std::lround(root * Shading::kLevels))];
    color |= static_cast<std::uint32_t>(level) << (8 * c);
  }
  return static_cast<std::int32_t>(color);
}

// What the kernels' `sky` computes, without a sun disc.
std::int32_t sky_color(const Shading::Tables& tables, float up) {
  std::uint32_t color = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const float horizon = tables.light.horizon_color[c];
    const float value = horizon + (tables.light.zenith_color[c] - horizon) * up;
    const float root = std::sqrt(std::clamp(value, 0.0F, 1.0F));
    color |= static_cast<std::uint32_t>(tables.levels[static_cast<std::size_t>(std::lround(root * Shading::kLevels))]) << (8 * c);
  }
  return static_cast<std::int32_t>(color);
}

// Whether a table of colours can be read where it is nearest: no channel skips a level from one entry to the next.
bool is_fine(std::span<const std::int32_t> colors) {
  const auto skips = [](std::int32_t a, std::int32_t b) {
    for (int shift = 0; shift < 24; shift += 8) {
      if (std::abs(((a >> shift) & 0xFF) - ((b >> shift) & 0xFF)) > 1) return true;
    }
    return false;
  };
  return std::adjacent_find(colors.begin(), colors.end(), skips) == colors.end();
}

ShadedSolid make_solid(const trace::Shape& shape, const Surface& surface, const Shading::Tables& tables) {
  ShadedSolid solid{.shape = &shape, .surface = surface, .sun = {}, .up = {}, .faces = {}};
  const Vec3 to_sun(tables.light.sun_direction[0], tables.light.sun_direction[1], tables.light.sun_direction[2]);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Vec3 outward = shape.to_local.row(static_cast<Eigen::Index>(axis)).transpose();
    solid.sun[axis] = outward.dot(to_sun);
    solid.up[axis] = outward.z();
    for (std::size_t shaded = 0; shaded < 2; ++shaded) {
      const float sunward = shaded != 0 ? 0.0F : outward.dot(to_sun);
      solid.faces[shaded][2 * axis] = lit_color(tables, surface, -sunward, -outward.z());
      solid.faces[shaded][2 * axis + 1] = lit_color(tables, surface, sunward, outward.z());
    }
  }
  return solid;
}

}  // namespace

Shading::Images::Images(const World& world) : textures(world, Border::yes) {
  std::array<std::uint32_t, 256> roots;
  for (std::size_t i = 0; i < roots.size(); ++i) {
    roots[i] = static_cast<std::uint32_t>(std::lround(std::sqrt(srgb_to_linear()[i]) * static_cast<float>(kRoots)));
  }
  for (std::uint32_t& texel : textures.texels) {
    const auto root = [&](unsigned int shift) { return roots[texel >> shift & 0xFFU]; };
    texel = root(0) | root(8) << 10U | root(16) << 20U;
  }
  for (std::size_t i = 0; i < textures.offset.size(); ++i) sizes.push_back(textures.width[i] | textures.height[i] << 16);
  const TriangleMesh& mesh = world.triangles();
  const std::vector<float> densities = texels_per_square_metre(world);
  prints.reserve(densities.size());
  for (std::size_t i = 0; i < densities.size(); ++i) {
    const auto uv = [&](std::size_t k) { return mesh.uv[static_cast<std::size_t>(mesh.triangles[i][k])]; };
    const auto corner = [&](std::size_t k) -> Eigen::Vector3d {
      return mesh.vertices[static_cast<std::size_t>(mesh.triangles[i][k])].cast<double>();
    };
    const Eigen::Vector3d normal = (corner(1) - corner(0)).cross(corner(2) - corner(0)).normalized();
    const Vec3 scaled = (normal / std::sqrt(std::max(static_cast<double>(densities[i]), 1e-30))).cast<float>();
    prints.push_back({{uv(0), uv(1), uv(2)}, {scaled.x(), scaled.y(), scaled.z()}, mesh.materials[i]});
  }
}

Shading::Shading(const World& world, const trace::Scene& scene, const Shading* original)
    : world_(world), tables_(world), room_(shading_room(world)) {
  const Appearance appearance(world);
  for (std::size_t i = 0; i < tables_.levels.size(); ++i) {
    const double value = std::pow(static_cast<double>(i) / kLevels, 2.0);
    tables_.levels[i] =
        static_cast<std::int32_t>(std::lround(255.0 * std::pow(value, 1.0 / static_cast<double>(tables_.light.gamma))));
  }
  for (const Surface& material : appearance.materials) {
    auto& ramp = tables_.ramps.emplace_back();
    for (std::size_t i = 0; i < ramp.size(); ++i) {
      const float root = static_cast<float>(i) / kRamp;
      ramp[i] = lit_color(tables_, material, root * root, 0.0F);
    }
  }
  for (std::size_t i = 0; i < appearance.primitives.size(); ++i) {
    const trace::Shape& shape = scene.shape(i);
    ShadedSolid& solid = tables_.solids.emplace_back(make_solid(shape, appearance.primitives[i], tables_));
    if (shape.kind == trace::ShapeKind::cylinder && solid.up[0] == 0.0F && solid.up[1] == 0.0F) {
      const auto& ramp = tables_.ramps[world.primitives()[i].material];
      if (is_fine(ramp)) solid.ramp = ramp.data();
    }
  }
  for (std::size_t i = 0; i < appearance.markers.size(); ++i) {
    tables_.markers.push_back(make_solid(scene.markers()[i].shape, appearance.markers[i].surface, tables_));
  }
  tables_.first_triangle = static_cast<std::int32_t>(world.primitives().size());
  tables_.first_marker = tables_.first_triangle + static_cast<std::int32_t>(world.triangles().triangles.size());
  tables_.images = original != nullptr ? original->tables_.images : std::make_shared<const Images>(world);
  tables_.triangle_material = world.triangles().materials;
  tables_.triangle_object = world.triangles().objects;
  for (const Surface& material : appearance.materials) {
    Paint& paint = tables_.paints.emplace_back();
    for (std::size_t c = 0; c < 3; ++c) {
      tables_.color[c].push_back(material.color[c]);
      tables_.emissive[c].push_back(material.emissive[c]);
      const Light& light = tables_.light;
      const float brightest = std::max(light.sky_ambient[c], light.ground_ambient[c]) + light.sun_color[c];
      const float most = static_cast<float>(Shading::kRoots);
      paint.unit[c] = (material.color[c] * brightest + material.emissive[c]) / (most * most);
    }
    tables_.emits |= material.emits();
    tables_.semantic.push_back(material.semantic);
    if (material.texture < 0) continue;
    const Textures& textures = tables_.images->textures;
    const auto texture = static_cast<std::size_t>(material.texture);
    paint.texture = material.texture;
    paint.wrap_across = textures.wrap_across[texture];
    paint.wrap_down = textures.wrap_down[texture];
    paint.first_level = textures.first_level[texture];
    paint.last_level = textures.num_levels[texture] - 1;
  }
  tables_.triangles = world.triangles().triangles;
  tables_.colors = world.triangles().colors;
  tables_.first_object = appearance.first_object;
  tables_.lit = std::make_unique_for_overwrite<std::int32_t[]>(4 * tables_.triangles.size());
  light_triangles(false);
  if (!tables_.sun_disc.shows) {
    for (int i = 0; i <= kSky; ++i) tables_.sky.push_back(sky_color(tables_, static_cast<float>(i) / kSky));
    if (!is_fine(tables_.sky)) tables_.sky.clear();
  }
}

void Shading::light_triangles(bool shaded) const {
  std::int32_t* const out = tables_.lit.get() + (shaded ? 2 * tables_.triangles.size() : 0);
  HWY_DYNAMIC_DISPATCH(light_triangles)(tables_, world_.triangles().vertices, shaded, out);
}

void Shading::prepare_shadows() const {
  const std::lock_guard lock(shadows_mutex_);
  if (!has_shadows_) light_triangles(true);
  has_shadows_ = true;
}

void Shading::shade(const trace::RayBundle& rays, const trace::HitDetails& details, std::span<const std::uint8_t> shaded,
                    float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind, TilePixels& out) const {
  HWY_DYNAMIC_DISPATCH(shade)
  (tables_, rays, details, shaded.empty() ? nullptr : shaded.data(), pixel_area, wanted, depth_kind, out);
}

}  // namespace flockstep::render
#endif
