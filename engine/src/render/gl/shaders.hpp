// GlShaders: the shader programs. Each is compiled on first use, and writes only the required outputs.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "render/gl/objects.hpp"

namespace flockstep::render {

// Outputs drawn for each pixel, and their attachments.
struct Attachments {
  bool color = false;   // attachment 0, RGBA8
  bool depth = false;   // depth buffer; always present, but accurate enough to be read only if set
  bool ids = false;     // attachment 1, RG16UI
  bool normal = false;  // attachment 2, RGBA32F

  bool operator==(const Attachments&) const = default;
};

struct ShaderTraits {
  Attachments writes;
  bool textured = false;  // some triangles have textures
  bool masked = false;    // some triangles are transparent in places
};

// How an item is drawn for one camera, in the layout of the shaders; each row is a vec4. Those with an axis are in the item's own
// frame. The ray through a pixel is ray_0 + ray_u u + ray_v v, with u and v taken at the centre of the pixel and counted from the
// upper left of its tile; its planar depth is one metre.
struct GlView {
  std::array<float, 4> eye_middle;  // the eye, m; w: y of the tile's middle in the atlas, from -1 to 1
  std::array<float, 4> w, x, y;     // dot products with a point relative to the eye: the planar depth, and x and y in the tile
  std::array<float, 4> ray_0, ray_u, ray_v;
  std::array<float, 4> turn_x, turn_y, turn_z;  // axes of the item, world frame
  std::array<float, 4> scale;                   // a corner is scale.xyz * position, and scale.w farther from z = 0
  std::array<float, 3> color;                   // multiplies those of the materials
  std::uint32_t ids;                            // the whole item's; 0: each triangle's
  std::array<float, 4> middle_gamma, slope;     // ambient light: middle + slope * n.z; w: 1 / gamma
  std::array<float, 4> sun, sun_direction;      // world frame
  std::array<float, 4> horizon, zenith_glow;    // see SunDisc
  std::array<float, 4> disc_steepness;
  float edge;                 // edge of the sun's disc
  std::uint32_t first_color;  // the world's first material
  std::array<float, 2> unused;
};
static_assert(sizeof(GlView) == 20 * 16);

// Numbers in the shaders' layout qualifiers.
inline constexpr GLint kTilesUniform = 0;    // (tile height in px, 1 / tile height, tile height / atlas height, unused)
inline constexpr GLint kRangeUniform = 1;    // (1 / far, 1 / (1 / near - 1 / far), unused, unused), m
inline constexpr GLint kSamplesUniform = 2;  // side of the sample grid within a pixel
inline constexpr GLuint kViewsBinding = 0;
inline constexpr GLuint kTrianglesBinding = 1;
inline constexpr GLuint kColorsBinding = 2;
inline constexpr GLuint kTexelsBinding = 3;
inline constexpr GLuint kTexturesBinding = 4;

class GlShaders {
 public:
  enum class Role : std::uint8_t { triangles, sky, resolve };  // resolve averages samples
  GLuint get(Role role, const ShaderTraits& traits);           // throws GlUnavailable if the driver rejects the source

 private:
  std::unordered_map<std::uint32_t, GlObject> programs_;
};

}  // namespace flockstep::render
