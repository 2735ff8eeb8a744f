// GlShaders: the programs that draw, each compiled when it is first needed, for just what it has to write.
#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "render/gl/model.hpp"
#include "render/gl/objects.hpp"

namespace flockstep::render {

// What is drawn for each pixel, into which attachment.
struct Attachments {
  bool color = false;   // 0: RGBA8
  bool depth = false;   // the depth buffer, which is always there: accurate enough to be read
  bool ids = false;     // 1: RG16UI
  bool normal = false;  // 2: RGBA32F

  bool operator==(const Attachments&) const = default;
};

struct ShaderTraits {
  Attachments writes;
  bool shadows = false;  // of the sun
  bool painted = false;  // some triangles have textures or colours of vertices
  bool masked = false;   // some are seen through in places
  bool sun = false;      // stands in the sky
};

// Numbers in the shaders' layout qualifiers.
inline constexpr GLint kTilesUniform = 0;    // (height of a tile in px, one over that, over the height of the atlas, nothing)
inline constexpr GLint kRangeUniform = 1;    // (near, far, 1 / far, 1 / (1 / near - 1 / far)), m
inline constexpr GLint kSamplesUniform = 2;  // a side of the grid within a pixel
inline constexpr GLint kBoxesUniform = 3;    // 1: a box is drawn round each shape, else a rectangle before it
inline constexpr GLuint kCamerasBinding = 0;
inline constexpr GLuint kVisibleBinding = 1;
inline constexpr GLuint kShapesBinding = 2;  // of the kind that is drawn
inline constexpr GLuint kTexelsBinding = 1;  // flat geometry has no use for the two before
inline constexpr GLuint kTexturesBinding = 2;
inline constexpr GLuint kPaintsBinding = 7;
inline constexpr GLuint kGridsBinding = 3;
inline constexpr GLuint kStartsBinding = 4;
inline constexpr GLuint kEntriesBinding = 5;
inline constexpr GLuint kCastersBinding = 6;

class GlShaders {
 public:
  // Each throws GlUnavailable where the driver refuses the source.
  GLuint flat(const ShaderTraits& traits);
  GLuint round(RoundKind kind, const ShaderTraits& traits);
  GLuint sky(const ShaderTraits& traits);
  GLuint resolve();  // averages samples

 private:
  enum class Role : std::uint8_t { flat, cylinder, sphere, capsule, disc, sky, resolve };
  GLuint get(Role role, const ShaderTraits& traits);

  std::unordered_map<std::uint32_t, GlProgram> programs_;
};

}  // namespace flockstep::render
