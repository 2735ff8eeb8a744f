// Mesh worlds: hills with trees of any size.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "flockstep/world.hpp"

namespace bench {

// Makes hills on a grid of cells x cells squares with a total side of side_m. For every 150 grid triangles there is a tree,
// whose trunk and crown have 36 triangles. The total is about 2.5 cells^2 triangles.
inline std::shared_ptr<const flockstep::World> mesh_world(int cells, float side_m) {
  using flockstep::Vec3;
  flockstep::SceneDescription description;
  description.materials = {{.name = "grass", .base_color = {0.25F, 0.4F, 0.12F}},
                           {.name = "bark", .base_color = {0.3F, 0.2F, 0.12F}},
                           {.name = "leaves", .base_color = {0.1F, 0.3F, 0.1F}}};
  flockstep::TriangleMesh& mesh = description.mesh;
  const auto height = [](float x, float y) {
    return 1.2F * std::sin(0.21F * x) * std::cos(0.17F * y) + 0.4F * std::sin(0.9F * x + 0.5F * y) + 0.15F * std::sin(2.3F * y);
  };
  const float step = side_m / static_cast<float>(cells);
  for (int row = 0; row <= cells; ++row) {
    for (int column = 0; column <= cells; ++column) {
      const float x = static_cast<float>(column) * step, y = static_cast<float>(row) * step;
      mesh.vertices.emplace_back(x, y, height(x, y));
    }
  }
  const auto add = [&](int a, int b, int c, std::uint16_t material) {
    mesh.triangles.push_back({a, b, c});
    mesh.materials.push_back(material);
  };
  for (int row = 0; row < cells; ++row) {
    for (int column = 0; column < cells; ++column) {
      const int corner = row * (cells + 1) + column;
      add(corner, corner + 1, corner + cells + 2, 0);
      add(corner, corner + cells + 2, corner + cells + 1, 0);
    }
  }
  std::mt19937 random(1);
  std::uniform_real_distribution<float> place(0.05F * side_m, 0.95F * side_m);
  // A ring of six points, and cones between rings or up to a tip.
  const auto ring = [&](const Vec3& center, float radius) {
    const auto first = static_cast<int>(mesh.vertices.size());
    for (int i = 0; i < 6; ++i) {
      const float angle = static_cast<float>(i) * std::numbers::pi_v<float> / 3.0F;
      mesh.vertices.push_back(center + radius * Vec3(std::cos(angle), std::sin(angle), 0.0F));
    }
    return first;
  };
  const auto join = [&](int lower, int upper, std::uint16_t material) {
    for (int i = 0; i < 6; ++i) {
      const int next = (i + 1) % 6;
      add(lower + i, lower + next, upper + next, material);
      add(lower + i, upper + next, upper + i, material);
    }
  };
  const int trees = cells * cells / 75 + 1;
  for (int tree = 0; tree < trees; ++tree) {
    const float x = place(random), y = place(random), z = height(x, y) - 0.2F;
    const int foot = ring({x, y, z}, 0.15F);
    const int fork = ring({x, y, z + 1.6F}, 0.1F);
    const int crown = ring({x, y, z + 1.4F}, 0.8F);
    const int top = ring({x, y, z + 3.5F}, 0.05F);
    join(foot, fork, 1);
    join(crown, top, 2);
    join(fork, crown, 2);
  }
  description.name = std::to_string(mesh.triangles.size()) + " triangles";
  return std::make_shared<const flockstep::World>(std::move(description));
}

// Returns a world with only the triangles: primitives tessellated, masks dropped. chord_error_m applies to round shapes.
inline std::shared_ptr<const flockstep::World> triangles_of(const flockstep::World& world, float chord_error_m) {
  flockstep::SceneDescription description;
  description.mesh = world.mesh(chord_error_m);
  description.materials.resize(world.materials().size());
  for (std::size_t i = 0; i < description.materials.size(); ++i) description.materials[i].name = std::to_string(i);
  description.mesh.uv.clear();
  return std::make_shared<const flockstep::World>(std::move(description));
}

}  // namespace bench
