// GlShaders: the shader programs. Each is compiled on first use, and writes only the required outputs.
#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "render/gl/model.hpp"
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
  bool shadows = false;  // shadows cast by the sun
  bool bodies = false;   // bodies cast shadows, too
  bool meshes = false;   // some of these are meshes
  bool painted = false;  // some triangles have textures or vertex colours
  bool masked = false;   // some triangles are transparent in places
  bool sun = false;      // the sun is visible in the sky
  bool air = false;      // the air of some worlds is not clear
};

// Numbers in the shaders' layout qualifiers.
inline constexpr GLint kTilesUniform = 0;    // (tile height in px, 1 / tile height, tile height / atlas height, unused)
inline constexpr GLint kRangeUniform = 1;    // (near, far, 1 / far, 1 / (1 / near - 1 / far)), m
inline constexpr GLint kSamplesUniform = 2;  // side of the sample grid within a pixel
inline constexpr GLint kBoxesUniform = 3;    // 1: draw a box around each shape; 0: draw a rectangle in front of it
inline constexpr GLuint kCamerasBinding = 0;
inline constexpr GLuint kVisibleBinding = 1;
inline constexpr GLuint kShapesBinding = 2;  // shapes of the kind being drawn
inline constexpr GLuint kTexelsBinding = 1;  // flat geometry does not use the two bindings above
inline constexpr GLuint kTexturesBinding = 2;
inline constexpr GLuint kPaintsBinding = 7;
inline constexpr GLuint kGridsBinding = 3;
inline constexpr GLuint kStartsBinding = 4;
inline constexpr GLuint kEntriesBinding = 5;
inline constexpr GLuint kCastersBinding = 6;
inline constexpr GLuint kBodyCastersBinding = 8;
inline constexpr GLuint kCasterNodesBinding = 9;
inline constexpr GLuint kPosedMeshesBinding = 10;

class GlShaders {
 public:
  // Each function throws GlUnavailable if the driver rejects the source.
  GLuint flat(const ShaderTraits& traits);
  GLuint posed(const ShaderTraits& traits);  // draws the flat geometry of mesh bodies
  GLuint round(RoundKind kind, const ShaderTraits& traits);
  GLuint sky(const ShaderTraits& traits);
  GLuint resolve();  // averages samples

 private:
  enum class Role : std::uint8_t { flat, posed, cylinder, sphere, capsule, disc, box, sky, resolve };
  GLuint get(Role role, const ShaderTraits& traits);

  std::unordered_map<std::uint32_t, GlProgram> programs_;
};

}  // namespace flockstep::render
