// Shading: computes the outputs of a traced tile.
#pragma once

#include <array>
#include <cstdint>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <vector>

#include "flockstep/config.hpp"
#include "render/appearance.hpp"
#include "render/camera_optics.hpp"
#include "render/textures.hpp"
#include "trace/ray_block.hpp"
#include "trace/scene.hpp"

namespace flockstep::render {

// Outputs of a tile as plain arrays. Rows are PixelTile::kSide wide.
struct TilePixels {
  static constexpr std::size_t kCount = PixelTile::kSide * PixelTile::kSide;
  alignas(64) std::uint8_t r[kCount], g[kCount], b[kCount];
  alignas(64) float depth[kCount];
  alignas(64) std::uint16_t semantic[kCount], instance[kCount];
  alignas(64) float nx[kCount], ny[kCount], nz[kCount];
};

// A solid in the form that the shading kernels need.
struct ShadedSolid {
  const trace::Shape* shape;
  Surface surface;
  std::array<float, 3> sun, up;  // directions to the sun and up, shape's frame
  // For flat faces: the colours of surfaces with the normals -x, +x, -y, +y, -z, +z of the shape's frame, in the sun and in
  // shade, as r | g << 8 | b << 16.
  std::array<std::array<std::int32_t, 6>, 2> faces;
  // For an upright cylinder: all points of its side receive the same share of the sky, so the colour depends only on the
  // cosine c of the angle between the normal and the sun. ramp[sqrt(c) * kRamp] is that colour. Null for other solids.
  const std::int32_t* ramp = nullptr;
};

class ShadedBodies;
struct SoftLight;

// Tables of all data that the colours of a world depend on; built once.
class Shading {
 public:
  // The arguments must outlive this object, and the scene must be of that world. original: shading of the world's original(),
  // whose images are shared.
  Shading(const World& world, const trace::Scene& scene, const Shading* original = nullptr);

  // Writes the wanted outputs of a traced tile. details: of the triangles that were hit. shaded: empty, or one value per ray,
  // 1 if its hit lies in the shadow of something else, otherwise 0. soft: if not null, the light of the hits instead; their
  // details have normals. pixel_area: m^2, area of a pixel, or of one of its samples, at planar depth 1. bodies: of the frame.
  void shade(const trace::RayBundle& rays, const trace::HitDetails& details, std::span<const std::uint8_t> shaded,
             const SoftLight* soft, float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind, ShadedBodies& bodies,
             TilePixels& out) const;

  // Computes the colours of triangles in shade, unless they exist. Call it before calling shade() with shaded hits.
  void prepare_shadows() const;

  // Result of shading_room().
  const std::optional<Aabb>& room() const { return room_; }

  // Returns tables for a body that is this world's mesh, in a world of that shading. They have no solids, no sky and no colours
  // of triangles; light_triangles() computes those. The caller turns the light and `up` into the body's frame.
  struct Tables;
  Tables tables_of_body(const Shading& world) const;
  // Computes the colours of these triangles in tables_of_body() of this shading.
  void light_triangles(Tables& tables, std::span<const std::int32_t> triangles, bool shaded) const;

  // Element number of the first body; bodies follow the markers.
  std::int32_t first_body() const { return tables_.first_marker + static_cast<std::int32_t>(tables_.markers.size()); }

  // A linear value v >= 0 is written as 255 * min(v, 1)^(1 / gamma), rounded. This is entry sqrt(min(v, 1)) * kLevels of the
  // levels table.
  static constexpr int kLevels = 1023;
  static constexpr int kRamp = 511;
  static constexpr int kSky = 2047;
  static constexpr int kRoots = 1023;
  using Ramp = std::array<std::int32_t, kRamp + 1>;

  // Returns a solid without a ramp. The shape must outlive it.
  ShadedSolid make_solid(const trace::Shape& shape, const Surface& surface) const;
  // Computes the ramp of the sides of upright cylinders with this surface.
  void make_ramp(const Surface& surface, Ramp& ramp) const;
  const Light& light() const { return tables_.light; }

  // Texture data, which does not depend on the light.
  struct Images {
    explicit Images(const World& world);

    // Textures whose texels are the square roots of their linear colours times kRoots, ten bits each from the lowest bit on.
    // Roots are about as uniform to the eye as sRGB, and squaring them needs no table.
    Textures textures;
    const std::int32_t* texels() const { return reinterpret_cast<const std::int32_t*>(textures.texels.data()); }
    std::vector<std::int32_t> sizes;  // per level: width, and height from bit 16 on
    // Data of a triangle, kept together because it is rarely in the cache: the texture coordinates of its corners, its unit
    // normal times the side of a texel in metres, and its material.
    struct Print {
      std::array<std::array<float, 2>, 3> uv;
      std::array<float, 3> normal;
      std::int32_t material;
    };
    std::vector<Print> prints;  // one per triangle; empty if no material has a texture
  };

  // Units of the triangle colours of a material, and its texture.
  struct Paint {
    std::array<float, 3> unit;
    std::int32_t texture = -1;  // -1 means none
    std::int32_t wrap_across = 0, wrap_down = 0;
    std::int32_t first_level = 0, last_level = 0;  // index into the levels of Textures; number of levels after the first
  };

  struct Tables {
    std::vector<ShadedSolid> solids;                    // one per element of World::primitives()
    std::vector<ShadedSolid> markers;                   // start, waypoints, goal
    std::int32_t first_triangle = 0, first_marker = 0;  // element numbers
    std::span<const std::uint16_t> triangle_material, triangle_object;
    std::array<std::vector<float>, 3> color, emissive;  // per material: red, green, blue
    bool emits = false;                                 // true if any material emits light
    std::vector<std::int32_t> semantic;                 // one per material
    std::vector<Paint> paints;                          // one per material
    std::shared_ptr<const Images> images;
    std::span<const Vec3> vertices;
    std::span<const std::array<std::int32_t, 3>> triangles;
    std::span<const std::array<float, 3>> colors;  // one per vertex; empty if all are white
    // Colours of the front and the back of each triangle: first all of them in the sun, then all in shade. The memory of the
    // second half stays untouched until prepare_shadows(). A colour that must still be multiplied by a texture or vertex
    // colours, or that the air changes, is negative and linear: the square roots of its channels, ten bits each. A root of 1023
    // is the maximum of the material, 1023^2 times the `unit` of its paint.
    std::unique_ptr<std::int32_t[]> lit;
    std::vector<std::int32_t> sky;  // (kSky + 1,) from the horizon to the zenith; empty if too coarse or with a sun disc
    std::int32_t first_object = 0;
    Light light;
    std::array<float, 3> up{0.0F, 0.0F, 1.0F};  // direction of the zenith
    SunDisc sun_disc;
    std::array<std::int32_t, kLevels + 1> levels{};
    std::vector<Ramp> ramps;  // one per material
    // True without a sun disc, emission and vertex colours. The kernels then omit the code for them.
    bool is_plain() const { return !sun_disc.shows && !emits && colors.empty(); }
    explicit Tables(const Light& of) : light(of), sun_disc(light) {}
  };

 private:
  void add_mesh(const Appearance& appearance, Tables& tables) const;
  void light_triangles(bool shaded) const;

  const World& world_;
  Tables tables_;
  std::optional<Aabb> room_;
  mutable std::mutex shadows_mutex_;
  mutable bool has_shadows_ = false;
};

// Returns whether the nearest entry of a table of colours is exact enough: no channel skips a level between adjacent entries.
bool is_fine(std::span<const std::int32_t> colors);

// Returns whether a solid can use a ramp: whether it is an upright cylinder.
bool takes_ramp(const ShadedSolid& solid);

}  // namespace flockstep::render
