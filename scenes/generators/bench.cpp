// Generates the two benchmark scenes, which have the same layout: one is made of boxes, one of detailed textured meshes.
#include <algorithm>
#include <array>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <functional>
#include <memory>
#include <numbers>
#include <string>
#include <vector>

#include "flockstep/generators.hpp"
#include "flockstep/world_builder.hpp"
#include "planning/draws.hpp"

namespace flockstep {
namespace {

constexpr double kPi = std::numbers::pi;
constexpr float kSide = 24.0F;                   // m
constexpr int kStepsAround = 40, kStepsUp = 38;  // vertices of a mesh

using Rgb = std::array<double, 3>;  // sRGB in [0, 255]

struct Place {
  double x, y, width, height;  // m
};

// The objects on the floor: every other square of a chessboard.
std::vector<Place> places() {
  Draws draws(Draws::kBench, 1, 0);
  std::vector<Place> all;
  for (int row = 0; row < 6; ++row) {
    for (int column = row % 2; column < 12; column += 2) {
      const double width = draws.uniform(0.9, 1.3);
      all.push_back({2.0 * column + 1.0, 4.0 * row + 2.0, width, draws.uniform(1.2, 2.8)});
    }
  }
  return all;
}

std::uint16_t add_texture(WorldBuilder& builder, const std::string& name, int size, const std::function<Rgb(int, int)>& color) {
  Texture texture{.name = name, .width_px = size, .height_px = size, .rgba = {}};
  for (int row = 0; row < size; ++row) {
    for (int column = 0; column < size; ++column) {
      for (const double value : color(row, column)) {
        texture.rgba.push_back(static_cast<std::uint8_t>(std::clamp(value, 0.0, 255.0)));
      }
      texture.rgba.push_back(255);
    }
  }
  return builder.material({.name = name, .base_color = {1.0F, 1.0F, 1.0F}, .texture = builder.texture(std::move(texture))});
}

void add_floor(WorldBuilder& builder) {
  const std::uint16_t floor = add_texture(builder, "floor", 128, [](int row, int column) {
    const int shade = 150 + 40 * ((row / 64 + column / 64) % 2) - (row % 64 < 2 || column % 64 < 2 ? 60 : 0);
    return Rgb{static_cast<double>(shade), static_cast<double>(shade), static_cast<double>(shade)};
  });
  builder.heightfield({.cell_m = kSide, .columns = 2, .rows = 2, .heights = {0.0F, 0.0F, 0.0F, 0.0F}, .texture_m = 4.0F}, floor);
  builder.start({1.0F, 4.0F, 1.5F});
  builder.goal({23.0F, 20.0F, 1.5F});
  builder.spawn_box({{0.8F, 3.8F, 1.3F}, {1.2F, 4.2F, 1.7F}});
}

// Ornamental bands, mottled.
std::uint16_t add_clay(WorldBuilder& builder) {
  Draws draws(Draws::kBench, 2, 0);
  return add_texture(builder, "clay", 256, [&](int row, int column) {
    const double down = row / 256.0, across = column / 256.0;
    const bool is_band = std::sin(2 * kPi * 4 * down) > 0.2;
    const bool is_figure = std::sin(2 * kPi * (6 * across + std::sin(2 * kPi * 8 * down))) > 0;
    Rgb color = is_band && is_figure ? Rgb{46, 34, 30} : is_band ? Rgb{196, 150, 96} : Rgb{164, 84, 50};
    const double grain = draws.uniform(-12, 12);
    for (double& value : color) value += grain;
    return color;
  });
}

// Grey noise of several sizes.
std::uint16_t add_stone(WorldBuilder& builder) {
  Draws draws(Draws::kBench, 3, 0);
  constexpr std::array kSteps{2, 4, 16, 64};
  std::array<std::vector<double>, kSteps.size()> cells;
  for (std::size_t i = 0; i < kSteps.size(); ++i) {
    const int count = 256 / kSteps[i];
    while (cells[i].size() < static_cast<std::size_t>(count * count)) cells[i].push_back(draws.uniform(-19, 19));
  }
  return add_texture(builder, "stone", 256, [&](int row, int column) {
    double grey = 128;
    for (std::size_t i = 0; i < kSteps.size(); ++i) {
      grey += cells[i][static_cast<std::size_t>(row / kSteps[i] * (256 / kSteps[i]) + column / kSteps[i])];
    }
    return Rgb{grey, 0.97 * grey, 0.91 * grey};
  });
}

// A mesh around a place: point(angle, share) has its vertex at an angle (rad) and a share of the way up. around, up: repetitions
// of the texture.
void add_turned(WorldBuilder& builder, const Place& place, std::uint16_t material, float around, float up,
                const std::function<Vec3d(double, double)>& point) {
  MeshPart part;
  for (int i = 0; i <= kStepsUp; ++i) {
    for (int j = 0; j <= kStepsAround; ++j) {
      const double share = static_cast<double>(i) / kStepsUp, turn = static_cast<double>(j) / kStepsAround;
      const Vec3d vertex = point(2 * kPi * turn, share) + Vec3d(place.x, place.y, 0);
      constexpr double kGrid = 1e4;  // per m: sines differ in their last bit from machine to machine
      part.vertices.push_back(((vertex * kGrid).array().round() / kGrid).matrix().cast<float>());
      part.uv.push_back({around * static_cast<float>(turn), -up * static_cast<float>(share)});
    }
  }
  for (int i = 0; i < kStepsUp; ++i) {
    for (int j = 0; j < kStepsAround; ++j) {
      const int a = i * (kStepsAround + 1) + j, d = a + kStepsAround + 1;
      part.triangles.push_back({a, a + 1, d + 1});
      part.triangles.push_back({a, d + 1, d});
    }
  }
  builder.mesh(part, material);
}

// A vase with a fluted belly.
void add_vase(WorldBuilder& builder, const Place& place, std::uint16_t material, Draws& draws) {
  const double phase = draws.uniform(0, 0.4);
  const int flutes = 6 + draws.below(8);
  add_turned(builder, place, material, 3, 2, [&](double angle, double share) {
    const double belly = 0.32 + 0.1 * std::sin(kPi * (1.5 * share + phase)) - 0.25 * share * share + 0.2 * std::pow(share, 12);
    const double radius = place.width * belly * (1 + 0.06 * std::sin(kPi * share) * std::cos(flutes * angle));
    return Vec3d(radius * std::cos(angle), radius * std::sin(angle), place.height * share);
  });
}

// A half-ball, dented by waves from all sides.
void add_boulder(WorldBuilder& builder, const Place& place, std::uint16_t material, Draws& draws) {
  struct Wave {
    Vec3d way;
    double phase;
  };
  std::vector<Wave> waves(6);
  for (Wave& wave : waves) {
    for (double& along : wave.way) along = draws.uniform(-8.7, 8.7);
    wave.phase = draws.uniform(0, 6);
  }
  add_turned(builder, place, material, 4, 2, [&](double angle, double share) {
    const double height = 0.5 * kPi * 0.97 * share, across = std::cos(height);
    const Vec3d way(across * std::cos(angle), across * std::sin(angle), std::sin(height));
    double dents = 0;
    for (const Wave& wave : waves) dents += std::sin(way.dot(wave.way) + wave.phase);
    return Vec3d(0.6 * (1 + 0.05 * dents) * way.cwiseProduct(Vec3d(place.width, place.width, place.height)));
  });
}

}  // namespace

std::shared_ptr<const World> bench_simple() {
  WorldBuilder builder("bench/simple");
  add_floor(builder);
  constexpr std::array<std::array<float, 3>, 3> kColors{{{0.55F, 0.16F, 0.1F}, {0.14F, 0.3F, 0.5F}, {0.55F, 0.42F, 0.12F}}};
  std::vector<std::uint16_t> materials;
  for (const auto& color : kColors) materials.push_back(builder.material({"box " + std::to_string(materials.size() + 1), color}));
  const std::vector<Place> all = places();
  for (std::size_t i = 0; i < all.size(); i += 3) {
    const Vec3d size(all[i].width, all[i].width, all[i].height);
    builder.box(Vec3d(all[i].x, all[i].y, size.z() / 2).cast<float>(), size.cast<float>(), materials[i / 3 % kColors.size()]);
  }
  return builder.build();
}

std::shared_ptr<const World> bench_complex() {
  WorldBuilder builder("bench/complex");
  add_floor(builder);
  const std::uint16_t clay = add_clay(builder), stone = add_stone(builder);
  Draws draws(Draws::kBench, 4, 0);
  const std::vector<Place> all = places();
  for (std::size_t i = 0; i < all.size(); ++i) {
    if (i % 3 == 2) {
      add_boulder(builder, all[i], stone, draws);
    } else {
      add_vase(builder, all[i], clay, draws);
    }
  }
  return builder.build();
}

}  // namespace flockstep
