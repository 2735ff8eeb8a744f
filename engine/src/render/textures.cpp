#include "render/textures.hpp"

#include <algorithm>
#include <cmath>
#include <cstddef>
#include <limits>
#include <span>

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

// A level in memory, without its border.
struct Level {
  const std::uint32_t* texels;
  int width, height, stride;

  const std::uint32_t* row(int y) const { return texels + std::ptrdiff_t{stride} * y; }
};

// Computes the rows of a level that is half as wide and high, but at least one texel, by averaging linear values.
class Halving {
 public:
  Halving(const Level& from, bool is_masked)
      : from_(from),
        is_masked_(is_masked),
        across_(covers(from.width, std::max(from.width / 2, 1))),
        down_(covers(from.height, std::max(from.height / 2, 1))) {}

  void write_row(int y, std::span<std::uint32_t> out) const {
    if (!is_masked_ && from_.width % 2 == 0 && from_.height % 2 == 0) return write_row_of_fours(y, out);
    const Cover& rows = down_[static_cast<std::size_t>(y)];
    std::transform(across_.begin(), across_.end(), out.begin(), [&](const Cover& columns) { return mean(rows, columns); });
  }

 private:
  // The usual case, with the operations of mean() in the same order.
  void write_row_of_fours(int y, std::span<std::uint32_t> out) const {
    const std::uint32_t* upper = from_.row(2 * y);
    const std::uint32_t* lower = from_.row(2 * y + 1);
    for (std::uint32_t& texel : out) {
      const auto channel = [&](unsigned int shift) {
        const auto quarter = [&](std::uint32_t from) { return 0.25F * linear_[from >> shift & 0xFFU]; };
        return linear_to_srgb(quarter(upper[0]) + quarter(upper[1]) + quarter(lower[0]) + quarter(lower[1]));
      };
      texel = packed(channel(0), channel(8), channel(16), 0);
      upper += 2;
      lower += 2;
    }
  }

  std::uint32_t mean(const Cover& rows, const Cover& columns) const {
    std::array<float, 3> sum{}, seen{};
    float alpha = 0.0F;
    for (int j = 0; j < 3; ++j) {
      for (int i = 0; i < 3; ++i) {
        const float share = rows.shares[static_cast<std::size_t>(j)] * columns.shares[static_cast<std::size_t>(i)];
        if (share == 0.0F) continue;
        const std::uint32_t texel =
            from_.row(std::min(rows.first + j, from_.height - 1))[std::min(columns.first + i, from_.width - 1)];
        for (std::size_t c = 0; c < 3; ++c) sum[c] += share * linear_[texel >> 8U * c & 0xFFU];
        if (!is_masked_) continue;
        const float weight = share * static_cast<float>(texel >> 24U);
        alpha += weight;
        for (std::size_t c = 0; c < 3; ++c) seen[c] += weight * linear_[texel >> 8U * c & 0xFFU];
      }
    }
    for (std::size_t c = 0; alpha > 0.0F && c < 3; ++c) sum[c] = seen[c] / alpha;
    return packed(linear_to_srgb(sum[0]), linear_to_srgb(sum[1]), linear_to_srgb(sum[2]),
                  static_cast<std::uint8_t>(std::lround(std::min(alpha, 255.0F))));
  }

  const Level from_;
  const bool is_masked_;
  const std::vector<Cover> across_, down_;
  const std::array<float, 256>& linear_ = srgb_to_linear();
};

// Returns the number of texels of all levels, with their borders.
std::size_t num_texels(const Texture& texture) {
  std::size_t count = 0;
  for (int width = texture.width_px, height = texture.height_px;;
       width = std::max(width / 2, 1), height = std::max(height / 2, 1)) {
    count += static_cast<std::size_t>(width + 2) * static_cast<std::size_t>(height + 2);
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

Textures::Textures(const World& world) : Textures(world.textures(), masked_textures(world)) {}

Textures::Textures(std::span<const Texture> textures, const std::vector<bool>& masked) {
  constexpr auto kMax = static_cast<std::size_t>(std::numeric_limits<std::int32_t>::max());
  std::size_t count = 0;
  for (const Texture& texture : textures) {
    count += num_texels(texture);
    require(count < kMax, "textures", "less than 2^31 texels, mip levels included", texture.name);
  }
  texels.reserve(count);  // levels are computed from levels in this memory
  for (const Texture& texture : textures) {
    first_level.push_back(static_cast<std::int32_t>(offset.size()));
    wrap_across.push_back(static_cast<std::int32_t>(texture.wrap[0]));
    wrap_down.push_back(static_cast<std::int32_t>(texture.wrap[1]));
    const bool is_masked = !masked.empty() && masked[first_level.size() - 1];
    const auto add_level = [&](int level_width, int level_height, const auto& write_row) {
      const int between = level_width + 2;
      const std::size_t first = texels.size(), length = static_cast<std::size_t>(between);
      width.push_back(level_width);
      height.push_back(level_height);
      stride.push_back(between);
      offset.push_back(static_cast<std::int32_t>(first) + between + 1);
      texels.resize(first + length * static_cast<std::size_t>(level_height + 2));
      const Level level{texels.data() + offset.back(), level_width, level_height, between};
      for (int y = 0; y < level_height; ++y) {
        const std::span row(texels.data() + first + static_cast<std::size_t>(y + 1) * length, length);
        write_row(y, row.subspan(1, static_cast<std::size_t>(level_width)));
        row.front() = row[static_cast<std::size_t>(source(-1, level_width, texture.wrap[0]) + 1)];
        row.back() = row[static_cast<std::size_t>(source(level_width, level_width, texture.wrap[0]) + 1)];
      }
      for (const int y : {-1, level_height}) {
        std::copy_n(level.row(source(y, level_height, texture.wrap[1])) - 1, length,
                    texels.data() + first + static_cast<std::size_t>(y + 1) * length);
      }
      return level;
    };
    Level level = add_level(texture.width_px, texture.height_px, [&](int y, std::span<std::uint32_t> row) {
      const std::uint8_t* rgba = texture.rgba.data() + std::ptrdiff_t{4} * texture.width_px * y;
      for (std::uint32_t& texel : row) {
        texel = packed(rgba[0], rgba[1], rgba[2], rgba[3]);
        rgba += 4;
      }
    });
    while (level.width > 1 || level.height > 1) {
      const Halving halving(level, is_masked);
      level = add_level(std::max(level.width / 2, 1), std::max(level.height / 2, 1),
                        [&](int y, std::span<std::uint32_t> row) { halving.write_row(y, row); });
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
