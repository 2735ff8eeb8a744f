// GlModel: the arrays from which OpenGL draws a world, built without OpenGL.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/appearance.hpp"
#include "render/gl/sun_grid.hpp"
#include "render/textures.hpp"

namespace flockstep::render {

// Returns the ids of a surface: semantic in the lower half, instance in the upper half.
std::uint32_t pack_ids(const Surface& surface);

// A vertex of flat geometry: mesh triangles, rooms, boxes and planes. Except for the position, its fields describe the
// triangle whose last corner it is. Each vertex is the last corner of at most one triangle, so triangles share vertices but
// have their own values. The colour of a triangle depends only on the side that is visible and on whether the sun reaches it.
struct FlatVertex {
  std::array<float, 3> position;         // m, world frame
  std::array<float, 3> normal;           // unit, points out of the front side
  std::array<std::uint32_t, 2> sunlit;   // RGBA as written, front and back
  std::array<std::uint32_t, 2> shadowy;  // the same without the sun
  std::uint32_t ids;                     // see pack_ids()
};

// Further vertex data, present if a world has textures, vertex colours or air that is not clear. `density` and `paint` describe a
// triangle, as in FlatVertex.
struct PaintedVertex {
  std::array<float, 2> uv;
  float density;               // texels per square metre
  std::uint32_t paint;         // index of the Paint plus 1; 0 means that FlatVertex has the colour, which the air does not change
  std::array<float, 3> color;  // linear RGB, multiplies the colour of the paint
  float unused;
};
static_assert(sizeof(PaintedVertex) == 2 * 16);

// The material of painted triangles in the layout of the shaders; each row is a vec4. The light on a mesh body depends on its env
// and its pose, so its paints hold the emitted light in `middle`, the base colour in `sun`, and no other light.
struct Paint {
  std::array<float, 3> middle;  // ambient and emitted light: middle + slope * n.z
  float gamma_exponent;         // 1 / gamma
  std::array<float, 3> slope;
  float texture;                       // index of the texture plus 1; 0 means none
  std::array<float, 3> sun;            // sunlight at normal incidence
  float cutoff;                        // threshold of the texture's alpha in [0, 255], transparent below it; 0 means opaque
  std::array<float, 3> sun_direction;  // towards the sun, world frame
  float unused;
};
static_assert(sizeof(Paint) == 4 * 16);

// A part of the flat geometry that is drawn or culled as a whole.
struct FlatChunk {
  Vec3 center, half;  // m, of its bounding box
  std::uint32_t first_index, index_count;
};

// Kinds of shapes that the fragment shader intersects exactly; each has its own shader. Only bodies have boxes among them:
// boxes of worlds are flat geometry.
enum class RoundKind : std::uint8_t { cylinder, sphere, capsule, disc, box };
inline constexpr std::size_t kNumRoundKinds = 5;

// A round primitive, or the box of a body, in the layout of the shaders; each row is a vec4.
struct RoundShape {
  std::array<float, 3> center;  // m, world frame
  float radius;                 // m; half size of a box along x
  std::array<float, 3> axis_x;  // x axis of its own frame, in the world frame
  float half_height;            // m
  std::array<float, 3> axis_y;
  float only_front;  // 1 if it is invisible from inside
  std::array<float, 3> axis_z;
  float gamma_exponent;         // 1 / gamma
  std::array<float, 3> middle;  // ambient and emitted light: middle + slope * n.z
  std::uint32_t ids;            // as in FlatVertex
  std::array<float, 3> slope;
  float half_y;              // m, half size of a box along y
  std::array<float, 3> sun;  // sunlight at normal incidence
  float unused_1;
  std::array<float, 3> sun_direction;  // towards the sun, world frame
  float unused_2;
};
static_assert(sizeof(RoundShape) == 8 * 16);

// Bounds of a RoundShape, for culling.
struct RoundBound {
  Vec3 center, axis;
  float radius;  // m
  float reach;   // m, radius of its bounding sphere
};

// Each takes the kind, the pose and the size of the primitive.
RoundShape make_round_shape(const Primitive& primitive, const Surface& surface, const Light& light);
RoundBound make_round_bound(RoundKind kind, const Primitive& primitive);

struct GlModel {
  // A world, or the world of a mesh body: its triangles only, all painted.
  enum class Of : bool { world, mesh_body };
  explicit GlModel(const World& world, Of of = Of::world);

  std::vector<FlatVertex> vertices;
  std::vector<PaintedVertex> painted;  // one per vertex, or none if all triangles have plain colours
  std::vector<Paint> paints;  // one per material, if the air is not clear followed by as many without textures; none in that case
  bool masked = false;        // true if a material is transparent in places
  Textures textures;
  std::vector<std::uint32_t> indices;  // three per triangle
  std::vector<FlatChunk> chunks;       // contiguous and in the order of their indices
  std::array<std::vector<RoundShape>, kNumRoundKinds> shapes;
  std::array<std::vector<RoundBound>, kNumRoundKinds> bounds;  // one per shape
  std::vector<Aabb> rooms;                                     // m; the sky is invisible from inside a room
  Light light;
};

// GlBody, GlMeshBody: bodies in the form that OpenGL draws.
struct GlBody {
  RoundKind kind;
  RoundShape shape;
  RoundBound bound;
  SunCaster caster;  // in the sun's frame of the env's world; empty without shadows
};

// A body that is a mesh. Its triangles are drawn as flat geometry in its own frame.
struct GlMeshBody {
  std::uint32_t model;  // number given by GlPainter::add()
  Vec3 position;        // m, world frame
  Mat3 rotation;        // body to world
  float radius;         // m, of the ball around the position that contains it
  std::uint32_t ids;    // as in FlatVertex
  SunCaster caster;     // as in GlBody, without its nodes
};

struct GlBodies {
  std::vector<GlBody> solids;
  std::vector<GlMeshBody> meshes;
};

// Appends the visible bodies or drones of an env. model_of: returns the model of a mesh body's world.
void append_bodies(const VisibleBodies& bodies, const World& world, bool shadows,
                   const std::function<std::uint32_t(const std::shared_ptr<const World>&)>& model_of, GlBodies& out);

}  // namespace flockstep::render
