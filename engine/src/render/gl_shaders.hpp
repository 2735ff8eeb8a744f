// GlShaders: the programs that draw, each made on first need for just what it has to write.
#pragma once

#include <cstddef>
#include <cstdint>
#include <unordered_map>

#include "render/gl_model.hpp"
#include "render/gl_objects.hpp"

namespace swiftlet::render {

// What is drawn for each pixel, into which attachment.
struct Attachments {
  bool color = false;   // 0: RGBA8
  bool depth = false;   // 1: R32F
  bool ids = false;     // 2: RG16UI
  bool normal = false;  // 3: RGBA32F

  bool operator==(const Attachments&) const = default;
};

struct ShaderTraits {
  Attachments writes;
  bool range = false;    // depth from the camera, not along its axis
  bool shadows = false;  // of the sun

  bool operator==(const ShaderTraits&) const = default;
};

// Numbers in the shaders' layout qualifiers.
inline constexpr GLint kPassUniform = 0;  // (height of a tile, that over the atlas's height, near, far)
inline constexpr GLint kSamplesUniform = 1;
inline constexpr GLuint kViewsBinding = 0;
inline constexpr GLuint kSightsBinding = 1;
inline constexpr GLuint kShapesBinding = 2;  // of the kind that is drawn
inline constexpr GLuint kCellsBinding = 3;
inline constexpr GLuint kOccludersBinding = 4;

class GlShaders {
 public:
  // Each throws GlUnavailable where the driver refuses the source.
  GLuint flat(const ShaderTraits& traits);
  GLuint round(RoundKind kind, const ShaderTraits& traits);
  GLuint sky();
  GLuint resolve();  // averages samples

 private:
  enum class Role : std::uint8_t { flat, cylinder, sphere, capsule, disc, sky, resolve };
  GLuint get(Role role, const ShaderTraits& traits);

  std::unordered_map<std::uint32_t, GlProgram> programs_;
};

}  // namespace swiftlet::render
