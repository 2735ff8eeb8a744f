// Masks: the triangles that cameras see through in places, where the alpha of the texture is below the cutoff of the material.
//
// At (s, t) a texture has the alpha of the four texels around, of the finest level whatever the distance: a mask cuts a shape out
// of a triangle, and a shape covers the same share of a picture from afar. So cameras see it, and so the sun shines through;
// whatever else asks of a triangle meets the whole of it.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep::trace {

// What rays pass through.
enum class Through : bool { nothing, masks };

// The materials by which something is seen through: whose texture has an alpha below their cutoff.
std::vector<bool> masking_materials(const World& world);

class Masks {
 public:
  Masks() = default;  // none
  // Keeps no reference to the world.
  explicit Masks(const World& world);

  // Of a masking material.
  struct Mask {
    std::size_t first = 0;  // of its alphas
    std::int32_t width = 0, height = 0;
    std::array<TextureWrap, 2> wrap{};
    float cutoff = 0.0F;  // of alphas in [0, 255]
  };
  struct Triangle {
    std::uint32_t mask = 0;
    std::array<std::array<float, 2>, 3> uv{};
  };

  bool empty() const { return triangles_.empty(); }
  // Null: nowhere is it seen through.
  const Triangle* find(std::size_t triangle) const {
    return empty() || numbers_[triangle] < 0 ? nullptr : &triangles_[static_cast<std::size_t>(numbers_[triangle])];
  }
  std::span<const Mask> masks() const { return masks_; }
  std::span<const std::uint8_t> alphas() const { return alphas_; }  // row by row

  // Whether a triangle is seen through where its second and third corner have these weights.
  bool lets_through(std::size_t triangle, float u, float v) const;

 private:
  std::vector<std::int32_t> numbers_;  // of each triangle of the world, into triangles_; -1: none
  std::vector<Triangle> triangles_;
  std::vector<Mask> masks_;
  std::vector<std::uint8_t> alphas_;
};

}  // namespace flockstep::trace
