// GlModel: a world as the arrays that OpenGL draws it from, made without OpenGL.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/textures.hpp"

namespace flockstep::render {

// A corner of flat geometry: mesh triangles, rooms, boxes and planes. All but the position describes a whole triangle, the one
// whose last corner this is. Each corner is the last one of at most one triangle, so triangles share corners and yet have values
// of their own. A triangle's colour depends only on the side it is seen from, and on whether the sun reaches it.
struct FlatVertex {
  std::array<float, 3> position;         // m, world frame
  std::array<float, 3> normal;           // unit, out of the front side
  std::array<std::uint32_t, 2> sunlit;   // RGBA as written, of the front and the back
  std::array<std::uint32_t, 2> shadowy;  // the same without the sun
  std::uint32_t ids;                     // semantic, and instance in the upper half
};

// What a corner has besides, where a world has textures or colours of vertices. Density and paint describe a triangle, as in
// FlatVertex.
struct PaintedVertex {
  std::array<float, 2> uv;
  float density;               // texels to a square metre
  std::uint32_t paint;         // its number plus 1; 0: FlatVertex says its colour
  std::array<float, 3> color;  // linear RGB, by which that of the paint is multiplied
  float unused;
};
static_assert(sizeof(PaintedVertex) == 2 * 16);

// How a material shows on such triangles, as the shaders read it; each row is a vec4.
struct Paint {
  std::array<float, 3> middle;  // light that comes from all around, and what is emitted: middle + slope * n.z
  float gamma_exponent;         // 1 / gamma
  std::array<float, 3> slope;
  float texture;                       // its number plus 1; 0: none
  std::array<float, 3> sun;            // light of the sun from right above
  float cutoff;                        // of the texture's alpha in [0, 255], below which it is seen through; 0: nowhere
  std::array<float, 3> sun_direction;  // towards the sun, world frame
  float unused;
};
static_assert(sizeof(Paint) == 4 * 16);

// Flat geometry that is drawn or left out as a whole.
struct FlatChunk {
  Vec3 center, half;  // m, of its bounding box
  std::uint32_t first_index, index_count;
};

// Kinds of primitives that are not flat; each has its own shader.
enum class RoundKind : std::uint8_t { cylinder, sphere, capsule, disc };
inline constexpr std::size_t kNumRoundKinds = 4;

// A round primitive as the shaders read it; each row is a vec4.
struct RoundShape {
  std::array<float, 3> center;  // m, world frame
  float radius;                 // m
  std::array<float, 3> axis_x;  // of its own frame, in the world's
  float half_height;            // m
  std::array<float, 3> axis_y;
  float only_front;  // 1: not seen from within
  std::array<float, 3> axis_z;
  float gamma_exponent;         // 1 / gamma
  std::array<float, 3> middle;  // light that comes from all around, and what is emitted: middle + slope * n.z
  std::uint32_t ids;            // as in FlatVertex
  std::array<float, 3> slope;
  float unused_1;
  std::array<float, 3> sun;  // light of the sun from right above
  float unused_2;
  std::array<float, 3> sun_direction;  // towards the sun, world frame
  float unused_3;
};
static_assert(sizeof(RoundShape) == 8 * 16);

// Where a RoundShape is, to tell whether it is in view.
struct RoundBound {
  Vec3 center, axis;
  float radius;  // m
  float reach;   // m, radius of the ball round it
};

struct GlModel {
  explicit GlModel(const World& world);

  std::vector<FlatVertex> vertices;
  std::vector<PaintedVertex> painted;  // one for each of these, or none where all triangles have plain colours
  std::vector<Paint> paints;           // of each material, likewise
  bool masked = false;                 // one of them is seen through somewhere
  Textures textures;
  std::vector<std::uint32_t> indices;  // three a triangle
  std::vector<FlatChunk> chunks;       // in the order of their indices, without gaps
  std::array<std::vector<RoundShape>, kNumRoundKinds> shapes;
  std::array<std::vector<RoundBound>, kNumRoundKinds> bounds;  // of the shapes
  std::vector<Aabb> rooms;                                     // m; a camera inside one sees no sky
  Light light;
};

}  // namespace flockstep::render
