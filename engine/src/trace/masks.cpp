#include "trace/masks.hpp"

#include <algorithm>
#include <cmath>
#include <map>

namespace flockstep::trace {
namespace {

constexpr float kOpaque = 255.0F;

float wrapped(float x, TextureWrap wrap) {
  if (wrap == TextureWrap::repeat) x -= std::floor(x);
  if (wrap == TextureWrap::mirror) {
    x -= 2.0F * std::floor(0.5F * x);
    if (x > 1.0F) x = 2.0F - x;
  }
  return std::clamp(x, 0.0F, 1.0F);
}

// Two neighbouring texels along an axis, and the interpolation weight of the second.
struct Neighbours {
  std::int32_t first, second;
  float towards;
};

Neighbours neighbours(float x, std::int32_t size, TextureWrap wrap) {
  const float at = wrapped(x, wrap) * static_cast<float>(size) - 0.5F;
  const float below = std::floor(at);
  const auto first = static_cast<std::int32_t>(below);
  const bool repeats = wrap == TextureWrap::repeat;
  return {first < 0 ? (repeats ? size - 1 : 0) : first, first + 1 < size ? first + 1 : (repeats ? 0 : size - 1), at - below};
}

}  // namespace

std::vector<bool> masking_materials(const World& world) {
  std::map<std::uint16_t, std::uint8_t> least;  // lowest alpha of each texture
  std::vector<bool> masking;
  for (const Material& material : world.materials()) {
    masking.push_back(false);
    if (!(material.alpha_cutoff > 0.0F) || !material.texture) continue;
    const auto [known, is_new] = least.try_emplace(*material.texture, std::uint8_t{255});
    const std::vector<std::uint8_t>& rgba = world.textures()[*material.texture].rgba;
    for (std::size_t i = 3; is_new && i < rgba.size(); i += 4) known->second = std::min(known->second, rgba[i]);
    masking.back() = static_cast<float>(known->second) < kOpaque * material.alpha_cutoff;
  }
  return masking;
}

Masks::Masks(const World& world) {
  const std::vector<bool> masking = masking_materials(world);
  const TriangleMesh& mesh = world.triangles();
  if (std::none_of(mesh.materials.begin(), mesh.materials.end(), [&](std::uint16_t material) { return masking[material]; })) {
    return;
  }
  std::vector<std::uint32_t> mask_of(masking.size());
  std::map<std::uint16_t, std::size_t> first_of;  // index of each texture's first alpha
  for (std::size_t i = 0; i < masking.size(); ++i) {
    if (!masking[i]) continue;
    const Material& material = world.materials()[i];
    const Texture& texture = world.textures()[*material.texture];
    const auto [first, is_new] = first_of.try_emplace(*material.texture, alphas_.size());
    for (std::size_t k = 3; is_new && k < texture.rgba.size(); k += 4) alphas_.push_back(texture.rgba[k]);
    mask_of[i] = static_cast<std::uint32_t>(masks_.size());
    masks_.push_back({first->second, texture.width_px, texture.height_px, texture.wrap, kOpaque * material.alpha_cutoff});
  }
  numbers_.reserve(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    numbers_.push_back(-1);
    if (!masking[mesh.materials[i]]) continue;
    numbers_.back() = static_cast<std::int32_t>(triangles_.size());
    Triangle& triangle = triangles_.emplace_back();
    triangle.mask = mask_of[mesh.materials[i]];
    for (std::size_t k = 0; k < 3; ++k) triangle.uv[k] = mesh.uv[static_cast<std::size_t>(mesh.triangles[i][k])];
  }
}

bool Masks::lets_through(std::size_t triangle, float u, float v) const {
  const Triangle* const found = find(triangle);
  if (found == nullptr) return false;
  const Mask& mask = masks_[found->mask];
  const auto& [a, b, c] = found->uv;
  const float w = 1.0F - u - v;
  const Neighbours x = neighbours(w * a[0] + u * b[0] + v * c[0], mask.width, mask.wrap[0]);
  const Neighbours y = neighbours(w * a[1] + u * b[1] + v * c[1], mask.height, mask.wrap[1]);
  const auto alpha = [&](std::int32_t row, std::int32_t column) {
    return static_cast<float>(alphas_[mask.first + static_cast<std::size_t>(row) * static_cast<std::size_t>(mask.width) +
                                      static_cast<std::size_t>(column)]);
  };
  const auto mix = [](float from, float to, float share) { return from + (to - from) * share; };
  const float upper = mix(alpha(y.first, x.first), alpha(y.first, x.second), x.towards);
  const float lower = mix(alpha(y.second, x.first), alpha(y.second, x.second), x.towards);
  return mix(upper, lower, y.towards) < mask.cutoff;
}

}  // namespace flockstep::trace
