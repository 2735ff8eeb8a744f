// Shading: what each pixel of a traced tile shows.
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
#include "render/pinhole_camera.hpp"
#include "render/textures.hpp"
#include "trace/ray_block.hpp"
#include "trace/scene.hpp"

namespace flockstep::render {

// What a tile shows, as plain arrays. Rows are PixelTile::kSide wide.
struct TilePixels {
  static constexpr std::size_t kCount = PixelTile::kSide * PixelTile::kSide;
  alignas(64) std::uint8_t r[kCount], g[kCount], b[kCount];
  alignas(64) float depth[kCount];
  alignas(64) std::uint16_t semantic[kCount], instance[kCount];
  alignas(64) float nx[kCount], ny[kCount], nz[kCount];
};

// A solid as the shading kernels want it.
struct ShadedSolid {
  const trace::Shape* shape;
  Surface surface;
  std::array<float, 3> sun, up;  // the directions to the sun and upwards, in the shape's frame
  // For flat faces: the colour that a surface with the normal -x, +x, -y, +y, -z, +z of the shape's frame shows, in the sun and
  // in shade, as r | g << 8 | b << 16.
  std::array<std::array<std::int32_t, 6>, 2> faces;
  // For an upright cylinder: every point of its side sees the same share of the sky, so the colour depends only on the cosine c
  // of the angle between the normal and the sun. ramp[sqrt(c) * kRamp] is that colour. Null for other solids.
  const std::int32_t* ramp = nullptr;
};

// All that the colours of a world depend on, in the form of tables; built once.
class Shading {
 public:
  // All of which outlive it; the scene is of that world. original: that of the world's original(), whose images it shares.
  Shading(const World& world, const trace::Scene& scene, const Shading* original = nullptr);

  // Writes what is wanted of the traced tile. details: of the triangles that were hit. shaded: empty, or a value for each ray, 1
  // if its hit lies in the shadow of something else, otherwise 0. pixel_area: of a pixel, or a sample of one, at planar depth 1,
  // m^2.
  void shade(const trace::RayBundle& rays, const trace::HitDetails& details, std::span<const std::uint8_t> shaded,
             float pixel_area, const CameraOutputs& wanted, DepthKind depth_kind, TilePixels& out) const;

  // Lights triangles in shade, unless that is done: whoever is to call shade() with hits that are shaded calls this first.
  void prepare_shadows() const;

  // As shading_room() says.
  const std::optional<Aabb>& room() const { return room_; }

  // A linear value v >= 0 is written as 255 * min(v, 1)^(1 / gamma), rounded: the levels table at sqrt(min(v, 1)) * kLevels.
  static constexpr int kLevels = 1023;
  static constexpr int kRamp = 511;
  static constexpr int kSky = 2047;
  static constexpr int kRoots = 1023;

  // What textures show in whatever light.
  struct Images {
    explicit Images(const World& world);

    // Whose texels are the roots of their linear colours times kRoots, ten bits each from the lowest on. A root is about as even
    // to the eye as sRGB, and its square takes no table.
    Textures textures;
    const std::int32_t* texels() const { return reinterpret_cast<const std::int32_t*>(textures.texels.data()); }
    std::vector<std::int32_t> sizes;  // of levels: width and, from bit 16 on, height
    // Of a triangle, side by side, since it is seldom in the cache: where its corners lie in the texture, its unit normal times
    // the metres that a texel measures, and its material.
    struct Print {
      std::array<std::array<float, 2>, 3> uv;
      std::array<float, 3> normal;
      std::int32_t material;
    };
    std::vector<Print> prints;  // of each triangle; empty where no material has a texture
  };

  // Of a material, what the colours of triangles are in units of, and its texture.
  struct Paint {
    std::array<float, 3> unit;
    std::int32_t texture = -1;  // none
    std::int32_t wrap_across = 0, wrap_down = 0;
    std::int32_t first_level = 0, last_level = 0;  // of Textures; how many follow the first
  };

  struct Tables {
    std::vector<ShadedSolid> solids;                    // as World::primitives()
    std::vector<ShadedSolid> markers;                   // start, waypoints, goal
    std::int32_t first_triangle = 0, first_marker = 0;  // their elements
    std::span<const std::uint16_t> triangle_material, triangle_object;
    std::array<std::vector<float>, 3> color, emissive;  // of each material: red, green, blue
    bool emits = false;                                 // one of them does
    std::vector<std::int32_t> semantic;                 // likewise
    std::vector<Paint> paints;                          // likewise
    std::shared_ptr<const Images> images;
    std::span<const std::array<std::int32_t, 3>> triangles;
    std::span<const std::array<float, 3>> colors;  // of their vertices; empty where all are white
    // What the front and the back of each triangle show: in the sun, then of all of them in shade, which is memory that nobody
    // has touched until prepare_shadows(). Where that is still multiplied by a texture or by the colours of vertices, it is
    // negative, and linear: the roots of its channels, ten bits each, of which that of the material's most, its paint's `unit`
    // times 1023^2, is 1023.
    std::unique_ptr<std::int32_t[]> lit;
    std::vector<std::int32_t> sky;  // (kSky + 1,) colours from the horizon to the zenith; empty if too coarse or with a sun disc
    std::int32_t first_object = 0;
    Light light;
    SunDisc sun_disc;
    std::array<std::int32_t, kLevels + 1> levels{};
    std::vector<std::array<std::int32_t, kRamp + 1>> ramps;  // of each material
    // Neither a sun disc, nor what glows, nor colours of vertices: the kernels leave the code for them out.
    bool is_plain() const { return !sun_disc.shows && !emits && colors.empty(); }
    explicit Tables(const World& world) : light(world.light()), sun_disc(world.light()) {}
  };

 private:
  void light_triangles(bool shaded) const;

  const World& world_;
  Tables tables_;
  std::optional<Aabb> room_;
  mutable std::mutex shadows_mutex_;
  mutable bool has_shadows_ = false;
};

}  // namespace flockstep::render
