// GlModel: the arrays from which OpenGL draws a world or a solid, built without OpenGL.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "render/appearance.hpp"
#include "render/textures.hpp"

namespace flockstep::render {

// Returns the ids of a surface: semantic in the lower half, instance in the upper half.
std::uint32_t pack_ids(const Surface& surface);

struct GlVertex {
  std::array<float, 3> position;  // m
  std::array<float, 2> uv;
  std::array<float, 3> color;  // linear RGB, multiplies what the triangle shows
};

// A triangle in the layout of the shaders; each row is a vec4.
struct GlTriangle {
  std::array<float, 3> normal;  // unit, points out of the front side
  std::uint32_t ids;            // see pack_ids()
  std::uint32_t material;
  float density;          // texels per square metre
  std::uint32_t texture;  // index of the texture plus 1; 0 means none
  float cutoff;           // threshold of the texture's alpha in [0, 255], transparent below it; 0 means opaque
};
static_assert(sizeof(GlTriangle) == 2 * 16);

// Triangles that are drawn or culled as a whole.
struct GlChunk {
  Vec3 center, half;  // m, of its bounding box
  std::uint32_t first_triangle, num_triangles;
};

struct GlModel {
  // The geometry of a world without its markers. Colours of materials are not part of it: worlds that share geometry may
  // differ in them. focal_px: see chord_error_of().
  GlModel(const World& world, float focal_px);
  // A solid of radius or half extents 1 m, in one material. The ends of a capsule have the centres (0, 0, +-1).
  GlModel(PrimitiveKind kind, float chord_error);

  std::vector<GlVertex> vertices;
  std::vector<std::array<std::uint32_t, 3>> corners;  // vertex indices of each triangle
  std::vector<GlTriangle> triangles;
  std::vector<GlChunk> chunks;  // contiguous and in order
  Textures textures;
  bool masked = false;  // some triangles are transparent in places

 private:
  void add(const TriangleMesh& mesh, std::size_t triangle, std::uint32_t first_vertex, const GlTriangle& record);
  void make_chunks();
};

// Returns the distance between the surface of a round shape and the middle of a chord, m, that is small enough for the promised
// depths, which may be off by 1 mm and 0.1 %, in images of this focal length. A ray that passes the silhouette of a ball at the
// distance of a pixel meets the surface at an angle whose cosine is about sqrt(2 / focal_px), or larger if the eye is farther
// away than the radius, and sees the distance multiplied by its inverse. Normals are at most 5 degrees off. Cylinders and discs
// are finer, since they need few triangles and are seen from close by.
float chord_error_of(PrimitiveKind kind, float radius, float focal_px);
inline constexpr float kCoarsest = 4e-3F;  // share of the radius

}  // namespace flockstep::render
