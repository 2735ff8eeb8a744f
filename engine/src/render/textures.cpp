#include "render/textures.hpp"

#include <algorithm>
#include <cmath>
#include <limits>

#include "base/require.hpp"
#include "base/srgb.hpp"
#include "trace/masks.hpp"

namespace flockstep::render {
namespace {

std::uint32_t packed(std::uint8_t red, std::uint8_t green, std::uint8_t blue, std::uint8_t alpha) {
  return red | static_cast<std::uint32_t>(green) << 8U | static_cast<std::uint32_t>(blue) << 16U |
         static_cast<std::uint32_t>(alpha) << 24U;
}

// The texels of a row that one texel of a row half as long covers: up to three, each with its share.
struct Cover {
  int first = 0;
  std::array<float, 3> shares{};
};

std::vector<Cover> covers(int size, int half) {
  std::vector<Cover> covers(static_cast<std::size_t>(half));
  const double ratio = static_cast<double>(size) / half;
  for (int i = 0; i < half; ++i) {
    Cover& cover = covers[static_cast<std::size_t>(i)];
    const double begin = i * ratio;
    const double end = begin + ratio;
    cover.first = static_cast<int>(begin);
    for (int k = 0; k < 3; ++k) {
      const double low = std::max(begin, static_cast<double>(cover.first + k));
      const double high = std::min(end, static_cast<double>(cover.first + k + 1));
      cover.shares[static_cast<std::size_t>(k)] = static_cast<float>(std::max(high - low, 0.0) / ratio);
    }
  }
  return covers;
}

struct Level {
  std::vector<std::uint32_t> texels;
  int width, height;
};

Level largest(const Texture& texture) {
  Level level{{}, texture.width_px, texture.height_px};
  level.texels.resize(texture.rgba.size() / 4);
  for (std::size_t i = 0; i < level.texels.size(); ++i) {
    const std::uint8_t* const rgba = texture.rgba.data() + 4 * i;
    level.texels[i] = packed(rgba[0], rgba[1], rgba[2], rgba[3]);
  }
  return level;
}

// Halves width and height, to at least one texel, by averaging linear values.
Level halved(const Level& from, bool is_masked) {
  const std::array<float, 256>& linear = srgb_to_linear();
  Level half{{}, std::max(from.width / 2, 1), std::max(from.height / 2, 1)};
  const std::vector<Cover> across = covers(from.width, half.width);
  const std::vector<Cover> down = covers(from.height, half.height);
  for (const Cover& rows : down) {
    for (const Cover& columns : across) {
      std::array<float, 3> sum{}, seen{};
      float alpha = 0.0F;
      for (int j = 0; j < 3; ++j) {
        for (int i = 0; i < 3; ++i) {
          const float share = rows.shares[static_cast<std::size_t>(j)] * columns.shares[static_cast<std::size_t>(i)];
          if (share == 0.0F) continue;
          const int row = std::min(rows.first + j, from.height - 1);
          const int column = std::min(columns.first + i, from.width - 1);
          const std::uint32_t texel = from.texels[static_cast<std::size_t>(row) * static_cast<std::size_t>(from.width) +
                                                  static_cast<std::size_t>(column)];
          for (std::size_t c = 0; c < 3; ++c) sum[c] += share * linear[texel >> 8U * c & 0xFFU];
          if (!is_masked) continue;
          const float weight = share * static_cast<float>(texel >> 24U);
          alpha += weight;
          for (std::size_t c = 0; c < 3; ++c) seen[c] += weight * linear[texel >> 8U * c & 0xFFU];
        }
      }
      for (std::size_t c = 0; alpha > 0.0F && c < 3; ++c) sum[c] = seen[c] / alpha;
      half.texels.push_back(packed(linear_to_srgb(sum[0]), linear_to_srgb(sum[1]), linear_to_srgb(sum[2]),
                                   static_cast<std::uint8_t>(std::lround(std::min(alpha, 255.0F)))));
    }
  }
  return half;
}

// Returns the number of texels of all levels.
std::size_t num_texels(const Texture& texture, int border) {
  std::size_t count = 0;
  for (int width = texture.width_px, height = texture.height_px;;
       width = std::max(width / 2, 1), height = std::max(height / 2, 1)) {
    count += static_cast<std::size_t>(width + 2 * border) * static_cast<std::size_t>(height + 2 * border);
    if (width == 1 && height == 1) return count;
  }
}

// Returns the row or column that is shown at a position beyond the edge.
int source(int at, int size, TextureWrap wrap) {
  return wrap == TextureWrap::repeat ? (at + size) % size : std::clamp(at, 0, size - 1);
}

std::vector<bool> masked_textures(const World& world) {
  std::vector<bool> masked(world.textures().size());
  const std::vector<bool> masking = trace::masking_materials(world);
  for (std::size_t i = 0; i < masking.size(); ++i) {
    if (masking[i]) masked[*world.materials()[i].texture] = true;
  }
  return masked;
}

}  // namespace

Textures::Textures(const World& world, Border border) : Textures(world.textures(), masked_textures(world), border) {}

Textures::Textures(std::span<const Texture> textures, const std::vector<bool>& masked, Border border) {
  const int wide = border == Border::yes ? 1 : 0;
  constexpr auto kMost = static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max());
  std::size_t count = 0;
  for (const Texture& texture : textures) {
    count += num_texels(texture, wide);
    require(count < kMost, "textures", "less than 2^31 texels, mip levels included", texture.name);
  }
  texels.reserve(count);
  for (const Texture& texture : textures) {
    first_level.push_back(static_cast<std::int32_t>(offset.size()));
    wrap_across.push_back(static_cast<std::int32_t>(texture.wrap[0]));
    wrap_down.push_back(static_cast<std::int32_t>(texture.wrap[1]));
    const bool is_masked = !masked.empty() && masked[first_level.size() - 1];
    for (Level level = largest(texture);; level = halved(level, is_masked)) {
      width.push_back(level.width);
      height.push_back(level.height);
      stride.push_back(level.width + 2 * wide);
      offset.push_back(static_cast<std::int32_t>(texels.size()) + wide * (stride.back() + 1));
      for (int y = -wide; y < level.height + wide; ++y) {
        const auto row = level.texels.begin() + std::ptrdiff_t{level.width} * source(y, level.height, texture.wrap[1]);
        if (wide != 0) texels.push_back(row[source(-1, level.width, texture.wrap[0])]);
        texels.insert(texels.end(), row, row + level.width);
        if (wide != 0) texels.push_back(row[source(level.width, level.width, texture.wrap[0])]);
      }
      if (level.width == 1 && level.height == 1) break;
    }
    num_levels.push_back(static_cast<std::int32_t>(offset.size()) - first_level.back());
  }
}

std::vector<float> texels_per_square_metre(const World& world) {
  const TriangleMesh& mesh = world.triangles();
  std::vector<float> density;
  if (mesh.uv.empty()) return density;
  density.reserve(mesh.triangles.size());
  for (std::size_t i = 0; i < mesh.triangles.size(); ++i) {
    const auto& texture = world.materials()[mesh.materials[i]].texture;
    density.push_back(0.0F);
    if (!texture) continue;
    std::array<Eigen::Vector3d, 3> at;
    std::array<Eigen::Vector2d, 3> shown;
    for (std::size_t k = 0; k < 3; ++k) {
      const auto vertex = static_cast<std::size_t>(mesh.triangles[i][k]);
      at[k] = mesh.vertices[vertex].cast<double>();
      shown[k] = Eigen::Vector2d(static_cast<double>(mesh.uv[vertex][0]), static_cast<double>(mesh.uv[vertex][1]));
    }
    const double area = (at[1] - at[0]).cross(at[2] - at[0]).norm();
    const Eigen::Vector2d a = shown[1] - shown[0];
    const Eigen::Vector2d b = shown[2] - shown[0];
    const Texture& image = world.textures()[*texture];
    const double texels = std::abs(a.x() * b.y() - a.y() * b.x()) * image.width_px * image.height_px;
    density.back() = static_cast<float>(std::min(texels / area, 1e30));  // every triangle has an area
  }
  return density;
}

}  // namespace flockstep::render
