// Masks: triangles that cameras see through in places, because the texture's alpha is below the material's cutoff.
//
// The alpha at (s, t) is interpolated between the four nearest texels of the finest level, at every distance. A mask cuts a
// shape out of a triangle, and that shape covers the same share of a picture from afar. Masks apply to cameras and to sunlight;
// every other query hits the whole triangle.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep::trace {

// The surfaces that rays pass through: none, or the masked parts of triangles.
enum class Through : bool { nothing, masks };

// Returns a flag for each material: true if it has a texture with an alpha below the material's cutoff.
std::vector<bool> masking_materials(const World& world);

class Masks {
 public:
  Masks() = default;  // no masks
  // Keeps no reference to the world.
  explicit Masks(const World& world);

  // The texture alphas and the cutoff of a masking material.
  struct Mask {
    std::size_t first = 0;  // index of its first alpha
    std::int32_t width = 0, height = 0;
    std::array<TextureWrap, 2> wrap{};
    float cutoff = 0.0F;  // compared with alphas in [0, 255]
  };
  struct Triangle {
    std::uint32_t mask = 0;
    std::array<std::array<float, 2>, 3> uv{};
  };

  bool empty() const { return triangles_.empty(); }
  // Returns null for a triangle without a mask.
  const Triangle* find(std::size_t triangle) const {
    return empty() || numbers_[triangle] < 0 ? nullptr : &triangles_[static_cast<std::size_t>(numbers_[triangle])];
  }
  std::span<const Mask> masks() const { return masks_; }
  std::span<const std::uint8_t> alphas() const { return alphas_; }  // row by row

  // Returns true if rays pass through the triangle at the point where its second and third corner have the weights u and v.
  bool lets_through(std::size_t triangle, float u, float v) const;

 private:
  std::vector<std::int32_t> numbers_;  // index into triangles_ for each triangle of the world, -1 without a mask
  std::vector<Triangle> triangles_;
  std::vector<Mask> masks_;
  std::vector<std::uint8_t> alphas_;
};

}  // namespace flockstep::trace
