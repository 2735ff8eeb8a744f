// SoftLight: the shares of the sun's and of the ambient light that the hits of a tile receive, and the rays that find them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>

#include "flockstep/pose.hpp"
#include "trace/ray_block.hpp"

namespace flockstep::render {

struct SoftLight {
  static constexpr float kReach = 1.5F;  // m; what is farther away hides no ambient light

  alignas(64) float sun[trace::kMaxRays], ambient[trace::kMaxRays];  // shares in [0, 1]

  // Sets the random numbers of a ray, which depend only on the other arguments. ambient_rays: per sample.
  void seed(std::size_t ray, std::size_t column, std::size_t row, std::size_t sample, int ambient_rays);
  // Turns the rays of the block, which point to the sun, to points of its disc. radius: tangent of half the angle across it.
  void aim_at_disc(float radius, trace::RayBlock& block) const;
  // Points the rays of the block away from the surfaces with these unit normals. Over `number`, their directions are distributed
  // like the cosine of the angle to the normal.
  void aim_at_sky(const float* nx, const float* ny, const float* nz, int number, trace::RayBlock& block) const;

 private:
  struct Words {
    std::array<std::uint32_t, 2> sun, ambient;
  };
  Words words_[trace::kMaxRays];
};

}  // namespace flockstep::render
