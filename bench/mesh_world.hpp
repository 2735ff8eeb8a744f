// Mesh worlds: hills with trees of any size, and rooms full of furniture.
#pragma once

#include <array>
#include <cmath>
#include <memory>
#include <numbers>
#include <random>
#include <string>
#include <utility>

#include "flockstep/world.hpp"
#include "flockstep/world_builder.hpp"

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

// Makes 6 x 4 closed rooms of 5 m with doors between them. Each has four desks with chairs, a bookshelf and a lamp. Most of it
// is boxes: small objects in front of large walls, as a very simple generator would make them.
inline std::shared_ptr<const flockstep::World> furnished_rooms() {
  using flockstep::Vec3;
  constexpr int kAlong = 6, kAcross = 4;
  constexpr float kSide = 5.0F, kHigh = 2.8F, kThick = 0.12F, kDoor = 1.0F, kDoorHigh = 2.1F;  // m
  flockstep::WorldBuilder builder("furnished rooms");
  const std::uint16_t wall = builder.material({.name = "wall"}), wood = builder.material({.name = "wood"});
  const auto box = [&](std::uint16_t material, float x, float y, float z, float width, float depth, float height) {
    builder.box({x, y, z}, {width, depth, height}, material);
  };
  const Vec3 size(kSide * kAlong, kSide * kAcross, 0.2F);
  builder.box({size.x() / 2, size.y() / 2, -0.1F}, size, wall);
  builder.box({size.x() / 2, size.y() / 2, kHigh + 0.1F}, size, wall);
  // Adds a room's wall from a corner along x or y. Inner walls, with another room behind them, have a door in the middle.
  const auto partition = [&](float x, float y, bool along_x, bool is_inner) {
    const auto piece = [&](float from, float to, float low, float high) {
      const float middle = (from + to) / 2, length = to - from;
      box(wall, along_x ? x + middle : x, along_x ? y : y + middle, (low + high) / 2, along_x ? length : kThick,
          along_x ? kThick : length, high - low);
    };
    const float door = is_inner ? kDoor : 0.0F;
    piece(0.0F, (kSide - door) / 2, 0.0F, kHigh);
    piece((kSide + door) / 2, kSide, 0.0F, kHigh);
    if (is_inner) piece((kSide - door) / 2, (kSide + door) / 2, kDoorHigh, kHigh);
  };
  std::mt19937 random(3);
  std::uniform_real_distribution<float> book_height(0.16F, 0.24F);
  for (int i = 0; i <= kAlong; ++i) {
    for (int j = 0; j <= kAcross; ++j) {
      const float x = kSide * static_cast<float>(i), y = kSide * static_cast<float>(j);
      if (i < kAlong) partition(x, y, true, j > 0 && j < kAcross);
      if (j < kAcross) partition(x, y, false, i > 0 && i < kAlong);
      if (i == kAlong || j == kAcross) continue;
      for (const float side_x : {1.0F, 4.0F}) {
        for (const bool is_far : {false, true}) {
          const float desk_x = x + side_x, desk_y = y + (is_far ? 4.2F : 0.8F), to_chair = is_far ? -1.0F : 1.0F;
          box(wood, desk_x, desk_y, 0.73F, 1.4F, 0.8F, 0.04F);
          for (const float leg_x : {-0.65F, 0.65F}) {
            for (const float leg_y : {-0.35F, 0.35F}) box(wood, desk_x + leg_x, desk_y + leg_y, 0.355F, 0.05F, 0.05F, 0.71F);
          }
          box(wood, desk_x, desk_y, 1.0F, 0.6F, 0.04F, 0.36F);                       // screen
          box(wood, desk_x, desk_y, 0.8F, 0.06F, 0.06F, 0.12F);                      // screen stand
          box(wood, desk_x, desk_y + 0.15F * to_chair, 0.76F, 0.44F, 0.16F, 0.02F);  // keyboard
          builder.cylinder({desk_x, desk_y + 0.7F * to_chair, 0.475F}, 0.25F, 0.05F, wood);
          builder.cylinder({desk_x, desk_y + 0.7F * to_chair, 0.25F}, 0.04F, 0.4F, wood);
          box(wood, desk_x, desk_y + 0.95F * to_chair, 0.8F, 0.44F, 0.04F, 0.5F);
        }
      }
      for (int board = 0; board < 6; ++board) {
        const float z = 0.2F + 0.35F * static_cast<float>(board);
        box(wood, x + 2.5F, y + 4.75F, z, 0.8F, 0.3F, 0.03F);
        for (int book = 0; book < 5; ++book) {
          const float height = book_height(random);
          box(wood, x + 2.24F + 0.13F * static_cast<float>(book), y + 4.75F, z + 0.015F + height / 2, 0.06F, 0.2F, height);
        }
      }
      builder.sphere({x + 2.5F, y + 2.5F, 2.5F}, 0.2F, wood);
    }
  }
  return builder.build();
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
