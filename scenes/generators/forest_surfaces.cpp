#include "generators/forest_surfaces.hpp"

#include <algorithm>
#include <cstddef>

#include "world/tessellate.hpp"

namespace flockstep {
namespace {

constexpr int kTexturePx = 128;
constexpr std::uint32_t kLooks = 1U << 24U;  // beyond the attempts of layouts, which have the other draws

Color scaled(const Color& color, double factor) {
  const auto f = static_cast<float>(factor);
  return {color[0] * f, color[1] * f, color[2] * f};
}

// Colours the vertices without a colour: color(vertex).
template <class Function>
void color_vertices(MeshPart& part, const Function& color) {
  while (part.colors.size() < part.vertices.size()) {
    part.colors.push_back(color(part.vertices[part.colors.size()].cast<double>()));
  }
}

// Lays a texture that repeats every metre around a ball of add_ball(): each octant is a triangle of it, mirrored at its edges.
void wrap_texture(MeshPart& part, const Vec3d& center, const Vec3d& half) {
  const double quarter = 1.5707963267948966 * half.sum() / 3.0;  // m, from pole to equator
  for (std::size_t i = 0; i < part.vertices.size(); ++i) {
    const Vec3d way = (part.vertices[i].cast<double>() - center).cwiseQuotient(half).cwiseAbs();
    const Vec3d share = way / way.sum();
    part.uv[i] = {static_cast<float>(quarter * (share.x() + 0.5 * share.z())),
                  static_cast<float>(quarter * 0.8660254037844386 * share.z())};
  }
}

}  // namespace

ForestSurfaces::ForestSurfaces(WorldBuilder& builder, std::uint64_t seed) : seed_(seed), draws_(Draws::kForest, seed, kLooks) {
  const auto material = [&](const std::string& name, std::uint16_t texture, std::uint16_t semantic) {
    return builder.material({name, {1.0F, 1.0F, 1.0F}, semantic, texture});
  };
  ground_ = material("ground", ground_texture(builder), 0);
  bark_ = material("bark", bark_texture(builder), 0);
  needles_ =
      material("needles", texture_of_cells(builder, "needles", {18, 7, {0.012F, 0.034F, 0.016F}, {0.11F, 0.23F, 0.08F}}), 0);
  leaves_ = material("leaves", texture_of_cells(builder, "leaves", {12, 14, {0.025F, 0.05F, 0.01F}, {0.33F, 0.48F, 0.13F}}), 0);
  rock_ = material("rock", rock_texture(builder), 0);
  birch_ = material("birch", birch_texture(builder), static_cast<std::uint16_t>(bark_ + 1));  // bark, to a camera
}

std::uint16_t ForestSurfaces::texture_of_cells(WorldBuilder& builder, const std::string& name, const Cells& cells) const {
  // Every cell has a spot at a random place in it.
  struct Spot {
    double x, y, tone;
  };
  const Noise noise(Draws::kForest, seed_, kLooks + static_cast<std::uint32_t>(cells.rows));
  std::vector<Spot> spots;
  for (int row = 0; row < cells.rows; ++row) {
    for (int column = 0; column < cells.columns; ++column) {
      const auto draw = [&](int number) { return noise.at(column, row + number * cells.rows); };
      spots.push_back({column + 0.1 + 0.8 * draw(0), row + 0.1 + 0.8 * draw(1), draw(2)});
    }
  }
  const Noise patches(Draws::kForest, seed_, kLooks + 100U + static_cast<std::uint32_t>(cells.rows));
  const auto color = [&](float s, float t) {
    const double x = cells.columns * static_cast<double>(s), y = cells.rows * static_cast<double>(t);
    const auto left = static_cast<int>(x), low = static_cast<int>(y);
    double nearest = 1e9, tone = 0.0;
    for (int row = low - 1; row <= low + 1; ++row) {
      for (int column = left - 1; column <= left + 1; ++column) {
        const int across = (column + cells.columns) % cells.columns, down = (row + cells.rows) % cells.rows;
        const Spot& spot = spots[static_cast<std::size_t>(down * cells.columns + across)];
        const double dx = x - (spot.x + column - across), dy = y - (spot.y + row - down);
        const double away = dx * dx + dy * dy;
        if (away >= nearest) continue;
        nearest = away;
        tone = spot.tone;
      }
    }
    const double patch = patches.octaves(4.0 * static_cast<double>(s), 4.0 * static_cast<double>(t), 2, 4);
    const double value = (0.35 + 0.65 * tone) * (1.0 - 1.1 * nearest) * (0.5 + patch);
    return mixed(cells.dark, cells.bright, std::clamp(value, 0.0, 1.0));
  };
  return builder.texture(name, kTexturePx, kTexturePx, color);
}

// Grass and moss with bare patches.
std::uint16_t ForestSurfaces::ground_texture(WorldBuilder& builder) const {
  const Noise fine(Draws::kForest, seed_, 5), coarse(Draws::kForest, seed_, 6);
  const auto color = [&](float s, float t) {
    const double blades = fine.octaves(48.0 * static_cast<double>(s), 48.0 * static_cast<double>(t), 2, 48);
    const double bare = coarse.octaves(4.0 * static_cast<double>(s), 4.0 * static_cast<double>(t), 4, 4);
    const double contrast = std::clamp(1.5 * blades - 0.25, 0.0, 1.0);
    const Color grass = mixed(Color{0.035F, 0.07F, 0.015F}, Color{0.24F, 0.30F, 0.085F}, contrast);
    const Color litter = mixed(Color{0.07F, 0.045F, 0.025F}, Color{0.30F, 0.22F, 0.13F}, contrast);
    return mixed(grass, litter, std::clamp(4.5 * bare - 2.1, 0.0, 0.85));
  };
  return builder.texture("ground", 2 * kTexturePx, 2 * kTexturePx, color);
}

// Furrows along the trunk.
std::uint16_t ForestSurfaces::bark_texture(WorldBuilder& builder) const {
  const Noise furrows(Draws::kForest, seed_, 1), flakes(Draws::kForest, seed_, kLooks + 1U);
  const auto color = [&](float s, float t) {
    const double bend = 0.6 * flakes.at(4.0 * static_cast<double>(s), 4.0 * static_cast<double>(t), 4);
    const double furrow = furrows.octaves(12.0 * static_cast<double>(s) + bend, 4.0 * static_cast<double>(t), 2, 4);
    const double flake = flakes.octaves(24.0 * static_cast<double>(s), 12.0 * static_cast<double>(t), 2, 12);
    return mixed(Color{0.05F, 0.033F, 0.022F}, Color{0.40F, 0.30F, 0.21F},
                 std::clamp(1.5 * furrow * (0.6 + 0.7 * flake) - 0.25, 0.0, 1.0));
  };
  return builder.texture("bark", kTexturePx, kTexturePx, color);
}

// Pale bark with dark bands across.
std::uint16_t ForestSurfaces::birch_texture(WorldBuilder& builder) const {
  const Noise bands(Draws::kForest, seed_, kLooks + 2U), stains(Draws::kForest, seed_, kLooks + 3U);
  const auto color = [&](float s, float t) {
    const double band = bands.octaves(4.0 * static_cast<double>(s), 24.0 * static_cast<double>(t), 2, 4);
    const double stain = stains.octaves(3.0 * static_cast<double>(s), 3.0 * static_cast<double>(t), 3, 3);
    const Color pale = mixed(Color{0.42F, 0.39F, 0.34F}, Color{0.78F, 0.75F, 0.69F}, stain);
    return mixed(pale, Color{0.05F, 0.045F, 0.04F}, std::clamp(7.0 * band * (0.7 + 0.6 * stain) - 5.2, 0.0, 0.9));
  };
  return builder.texture("birch", kTexturePx, kTexturePx, color);
}

std::uint16_t ForestSurfaces::rock_texture(WorldBuilder& builder) const {
  const Noise noise(Draws::kForest, seed_, 4);
  const auto color = [&](float s, float t) {
    const double value = noise.octaves(4.0 * static_cast<double>(s), 4.0 * static_cast<double>(t), 5, 4);
    return mixed(Color{0.10F, 0.10F, 0.095F}, Color{0.50F, 0.48F, 0.44F}, std::clamp(2.2 * value - 0.6, 0.0, 1.0));
  };
  return builder.texture("rock", kTexturePx, kTexturePx, color);
}

// Spruces, bluish to green, and every fifth a larch that turns golden.
ForestSurfaces::Tree ForestSurfaces::conifer() {
  const bool is_larch = draws_.uniform(0.0, 1.0) < 0.2;
  const Color bark_tint = between({0.75F, 0.7F, 0.68F}, {1.0F, 0.92F, 0.85F});
  const Color crown_tint =
      is_larch ? between({0.9F, 0.95F, 0.5F}, {1.0F, 0.85F, 0.45F}) : between({0.55F, 0.72F, 0.85F}, {0.85F, 0.95F, 0.75F});
  return {bark_, needles_, bark_tint, scaled(crown_tint, draws_.uniform(0.75, 1.0))};
}

// Birches, beeches, and some that have begun to turn.
ForestSurfaces::Tree ForestSurfaces::broadleaf() {
  const bool is_birch = draws_.uniform(0.0, 1.0) < 0.4;
  const bool turns = draws_.uniform(0.0, 1.0) < 0.25;
  const Color bark_tint = is_birch ? between({0.9F, 0.9F, 0.9F}, {1, 1, 1}) : between({0.6F, 0.62F, 0.6F}, {0.9F, 0.88F, 0.85F});
  const Color crown_tint =
      turns ? between({1.0F, 0.75F, 0.35F}, {1.0F, 0.58F, 0.3F}) : between({0.5F, 0.75F, 0.65F}, {1.0F, 1.0F, 0.75F});
  return {is_birch ? birch_ : bark_, leaves_, bark_tint, scaled(crown_tint, draws_.uniform(0.8, 1.0))};
}

void ForestSurfaces::color_trunk(MeshPart& part, const Tree& tree) {
  double low = 1e9;
  for (const Vec3& vertex : part.vertices) low = std::min(low, static_cast<double>(vertex.z()));
  color_vertices(part, [&](const Vec3d& at) { return scaled(tree.bark_tint, at.z() > low + 1.0 ? 0.45 : 1.0); });
}

void ForestSurfaces::color_tier(MeshPart& part, const Tree& tree, double share) {
  double low = 1e9, high = -1e9;
  for (std::size_t i = part.colors.size(); i < part.vertices.size(); ++i) {
    low = std::min(low, static_cast<double>(part.vertices[i].z()));
    high = std::max(high, static_cast<double>(part.vertices[i].z()));
  }
  color_vertices(part, [&](const Vec3d& at) {
    if (at.z() == high) return scaled(tree.crown_tint, 0.45 + 0.55 * share * share);  // lies below the next tier
    return scaled(tree.crown_tint, at.z() == low ? 0.8 + 0.2 * share : 0.2);          // the middle of the underside
  });
}

void ForestSurfaces::color_crown(MeshPart& part, const Tree& tree, const Vec3d& center, const Vec3d& half) {
  wrap_texture(part, center, half);
  color_vertices(part, [&](const Vec3d& at) {
    const double up = std::clamp(0.5 + 0.5 * (at.z() - center.z()) / half.z(), 0.0, 1.0);
    return scaled(tree.crown_tint, mixed(0.3, 1.0, up));
  });
}

void ForestSurfaces::color_rock(MeshPart& part, const Vec3d& center, const Vec3d& half) {
  wrap_texture(part, center, half);
  const Color top = between({0.62F, 0.78F, 0.42F}, {1.0F, 1.0F, 1.0F});  // mossy to bare
  color_vertices(part, [&](const Vec3d& at) {
    return mixed(Color{0.4F, 0.38F, 0.33F}, top, std::clamp(0.4 + 0.8 * (at.z() - center.z()) / half.z(), 0.0, 1.0));
  });
}

MeshPart ForestSurfaces::ground(const Heightfield& field, const std::vector<Shade>& trees) {
  constexpr Color kLitter{0.8F, 0.62F, 0.5F};
  MeshPart part = grid_of(field);
  std::vector<double> bare(part.vertices.size(), 0.0);
  for (const auto& [at, reach] : trees) {
    const auto clamped = [](double value, int count) { return std::clamp(static_cast<int>(value), 0, count - 1); };
    for (int row = clamped(at.y() - reach, field.rows); row <= clamped(at.y() + reach + 1.0, field.rows); ++row) {
      for (int column = clamped(at.x() - reach, field.columns); column <= clamped(at.x() + reach + 1.0, field.columns);
           ++column) {
        double& here = bare[static_cast<std::size_t>(row * field.columns + column)];
        here = std::max(here, 1.0 - (Vec2d(column, row) - at).norm() / reach);
      }
    }
  }
  for (const double share : bare) part.colors.push_back(mixed(Color{1, 1, 1}, kLitter, std::clamp(1.6 * share, 0.0, 1.0)));
  return part;
}

// A hazy morning.
Light ForestSurfaces::light() {
  Light light;
  light.sun_direction = {-0.7F, 0.12F, 0.7F};  // behind a drone that flies from the start to the goal
  light.sun_color = {2.6F, 2.0F, 1.3F};
  light.sky_ambient = {0.62F, 0.7F, 0.85F};
  light.ground_ambient = {0.34F, 0.3F, 0.22F};
  light.zenith_color = {0.17F, 0.37F, 0.72F};
  light.horizon_color = {0.71F, 0.79F, 0.87F};
  light.sun_radius_deg = 1.2F;  // as wide as glare makes it look in a camera
  light.sun_glow = 0.7F;
  light.fog_visibility_m = 800.0F;
  return light;
}

}  // namespace flockstep
