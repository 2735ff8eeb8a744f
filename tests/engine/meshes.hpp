// Triangle meshes and primitives for tests of tracing.
#pragma once

#include "batch_helpers.hpp"

namespace flockstep::testing {

// Gives all triangles one material and object, and texture coordinates, which make the position of a hit matter.
inline void complete(TriangleMesh& mesh) {
  mesh.materials.assign(mesh.triangles.size(), 0);
  mesh.objects.assign(mesh.triangles.size(), 0);
  mesh.uv.assign(mesh.vertices.size(), {0.0F, 0.0F});
}

// A ball, or a deformed one whose points move along their radii. It is closed for any `bumps`.
inline TriangleMesh ball(int rings, int sides, float bumps, Random& random) {
  TriangleMesh mesh;
  const auto add = [&](float polar, float azimuth) {
    const float radius = 3.0F + bumps * random.within(-1, 1);
    mesh.vertices.push_back(radius *
                            Vec3(std::sin(polar) * std::cos(azimuth), std::sin(polar) * std::sin(azimuth), std::cos(polar)));
  };
  constexpr float kPi = 3.14159265F;
  add(0.0F, 0.0F);
  for (int ring = 1; ring < rings; ++ring) {
    for (int side = 0; side < sides; ++side) {
      add(kPi * static_cast<float>(ring) / static_cast<float>(rings),
          2 * kPi * static_cast<float>(side) / static_cast<float>(sides));
    }
  }
  add(kPi, 0.0F);
  const auto at = [&](int ring, int side) { return 1 + (ring - 1) * sides + side % sides; };
  const auto last = static_cast<std::int32_t>(mesh.vertices.size()) - 1;
  for (int side = 0; side < sides; ++side) {
    mesh.triangles.push_back({0, at(1, side), at(1, side + 1)});
    for (int ring = 1; ring + 1 < rings; ++ring) {
      mesh.triangles.push_back({at(ring, side), at(ring + 1, side), at(ring + 1, side + 1)});
      mesh.triangles.push_back({at(ring, side), at(ring + 1, side + 1), at(ring, side + 1)});
    }
    mesh.triangles.push_back({last, at(rings - 1, side + 1), at(rings - 1, side)});
  }
  complete(mesh);
  return mesh;
}

// Adds the triangles of squares whose corners stand row by row from a vertex on.
inline void add_squares(TriangleMesh& mesh, std::int32_t first, int rows, int columns) {
  for (int row = 0; row < rows; ++row) {
    for (int column = 0; column < columns; ++column) {
      const std::int32_t at = first + row * (columns + 1) + column;
      mesh.triangles.push_back({at, at + 1, at + columns + 2});
      mesh.triangles.push_back({at, at + columns + 2, at + columns + 1});
    }
  }
}

// Adds a closed box.
inline void add_box(TriangleMesh& mesh, const Vec3& center, const Vec3& half, const Quat& rotation = Quat::Identity()) {
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (int i = 0; i < 8; ++i) {
    const Vec3 side((i & 1) != 0 ? 1.0F : -1.0F, (i & 2) != 0 ? 1.0F : -1.0F, (i & 4) != 0 ? 1.0F : -1.0F);
    mesh.vertices.push_back(center + rotation * half.cwiseProduct(side));
  }
  for (const auto& [a, b, c, d] :
       {std::array{0, 1, 3, 2}, {4, 5, 7, 6}, {0, 1, 5, 4}, {2, 3, 7, 6}, {0, 2, 6, 4}, {1, 3, 7, 5}}) {
    mesh.triangles.push_back({first + a, first + b, first + c});
    mesh.triangles.push_back({first + a, first + c, first + d});
  }
  complete(mesh);
}

inline TriangleMesh cube(float half) {
  TriangleMesh mesh;
  add_box(mesh, Vec3::Zero(), Vec3::Constant(half));
  return mesh;
}

// A closed room of 12 m with boxes that stand, hang or lean in it.
inline TriangleMesh furnished_room(int boxes, Random& random) {
  TriangleMesh mesh = cube(6.0F);
  for (int i = 0; i < boxes; ++i) {
    const Quat rotation = i % 2 == 0 ? random.rotation() : Quat(Eigen::AngleAxisf(random.within(-3, 3), Vec3::UnitZ()));
    add_box(mesh, random.point(5.0F), Vec3(random.within(0.02F, 0.8F), random.within(0.02F, 0.8F), random.within(0.02F, 0.8F)),
            rotation);
  }
  return mesh;
}

// Adds triangles that are hard to classify: needles, and triangles that are edge-on as seen from `eye`. Also adds a level floor
// of squares just below.
inline void add_slivers(TriangleMesh& mesh, int count, const Vec3& eye, Random& random) {
  constexpr int kSquares = 12;
  const auto first_of_floor = static_cast<std::int32_t>(mesh.vertices.size());
  for (int row = 0; row <= kSquares; ++row) {
    for (int column = 0; column <= kSquares; ++column) {
      mesh.vertices.emplace_back(static_cast<float>(column - kSquares / 2), static_cast<float>(row - kSquares / 2),
                                 eye.z() - 1e-5F);
    }
  }
  add_squares(mesh, first_of_floor, kSquares, kSquares);
  for (int i = 0; i < count; ++i) {
    const Vec3 a = random.point(4.0F), b = random.point(4.0F);
    const float along = random.within(-1, 1);
    const Vec3 c = i % 3 == 0   ? Vec3(a + 0.5F * (b - a) + 1e-5F * random.point(1.0F))       // needle
                   : i % 3 == 1 ? Vec3(eye + (1.0F + along) * (a - eye) + along * (b - eye))  // edge-on, up to rounding
                                : Vec3(a.x() + 1e-3F, a.y(), a.z());
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    mesh.vertices.insert(mesh.vertices.end(), {a, b, c});
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  complete(mesh);
}

// Hills of cells x cells squares of 1 m, starting at -cells / 2, and a solid, invisible wall above them.
inline TriangleMesh hills(int cells) {
  TriangleMesh mesh;
  const float from = -0.5F * static_cast<float>(cells);
  for (int row = 0; row <= cells; ++row) {
    for (int column = 0; column <= cells; ++column) {
      const float x = from + static_cast<float>(column), y = from + static_cast<float>(row);
      mesh.vertices.emplace_back(x, y, std::sin(0.7F * x) * std::cos(0.5F * y));
    }
  }
  add_squares(mesh, 0, cells, cells);
  mesh.visibility.assign(mesh.triangles.size(), Visibility::full);
  const auto wall = static_cast<std::int32_t>(mesh.vertices.size());
  for (const Vec3& corner : {Vec3(-9, 0, 0), Vec3(9, 0, 0), Vec3(0, 0, 9)}) mesh.vertices.push_back(corner);
  mesh.triangles.push_back({wall, wall + 1, wall + 2});
  mesh.visibility.push_back(Visibility::solid);
  mesh.materials.assign(mesh.triangles.size(), 0);
  return mesh;
}

// Random triangles: some large, some small, some needles.
inline TriangleMesh loose_triangles(int count, Random& random) {
  TriangleMesh mesh;
  for (int i = 0; i < count; ++i) {
    const Vec3 center = random.point(9.0F);
    const float size = std::array{0.2F, 1.0F, 4.0F}[static_cast<std::size_t>(i) % 3];
    const auto first = static_cast<std::int32_t>(mesh.vertices.size());
    const Vec3 a = center + size * random.point(1.0F), b = center + size * random.point(1.0F);
    const Vec3 c = i % 5 == 0 ? Vec3(b + 1e-3F * random.point(1.0F)) : Vec3(center + size * random.point(1.0F));
    mesh.vertices.insert(mesh.vertices.end(), {a, b, c});
    mesh.triangles.push_back({first, first + 1, first + 2});
  }
  mesh.materials.assign(mesh.triangles.size(), 0);
  return mesh;
}

// Returns a room alone, 6 or 30 primitives of all other kinds: by the seed, in turns.
inline std::vector<Primitive> room_or_shapes(unsigned seed, Random& random) {
  using enum PrimitiveKind;
  std::vector<Primitive> primitives;
  if (seed % 3 == 0) primitives.push_back(primitive(room, random.point(0.5F), {12.0F, 11.0F, 8.0F}));
  const int count = std::array{0, 6, 30}[seed % 3];
  for (int i = 0; i < count; ++i) {
    const PrimitiveKind kind = std::array{box, cylinder, capsule, sphere, plane, disc}[static_cast<std::size_t>(i) % 6];
    const float size = random.within(0.1F, 1.0F);
    const Vec3 half(size, size, kind == plane || kind == disc ? 0.0F : kind == capsule ? 1.5F * size : size);
    primitives.push_back(primitive(kind, random.point(8.0F), half, kind == sphere ? Quat::Identity() : random.rotation()));
  }
  return primitives;
}

// A texture of patches of random colours, so that a wrong texel is visible, opaque or with random alphas.
inline Texture patches(int width, int height, int patch, unsigned seed, std::array<TextureWrap, 2> wrap,
                       bool has_alphas = false) {
  Random random(seed);
  Texture texture{"patches " + std::to_string(seed), width, height, {}, wrap};
  const auto byte = [&] { return static_cast<std::uint8_t>(random.within(0.0F, 255.0F)); };
  std::vector<std::array<std::uint8_t, 4>> texels;
  for (int i = 0; i < 64; ++i) texels.push_back({byte(), byte(), byte(), has_alphas ? byte() : std::uint8_t{255}});
  for (int row = 0; row < height; ++row) {
    for (int column = 0; column < width; ++column) {
      const auto& texel = texels[static_cast<std::size_t>((7 * (row / patch) + 3 * (column / patch)) % 64)];
      texture.rgba.insert(texture.rgba.end(), texel.begin(), texel.end());
    }
  }
  return texture;
}

// Adds a parallelogram of two triangles with the given uv at its corners.
inline void add_quad(SceneDescription& scene, const Vec3& at, const Vec3& u, const Vec3& v, std::uint16_t material,
                     const std::array<std::array<float, 2>, 4>& uv) {
  TriangleMesh& mesh = scene.mesh;
  const auto first = static_cast<std::int32_t>(mesh.vertices.size());
  for (const Vec3& corner : {at, Vec3(at + u), Vec3(at + u + v), Vec3(at + v)}) mesh.vertices.push_back(corner);
  mesh.uv.insert(mesh.uv.end(), uv.begin(), uv.end());
  mesh.triangles.push_back({first, first + 1, first + 2});
  mesh.triangles.push_back({first, first + 2, first + 3});
  mesh.materials.insert(mesh.materials.end(), 2, material);
  const auto object = static_cast<std::uint16_t>(mesh.objects.empty() ? 0 : mesh.objects.back() + 1);
  mesh.objects.insert(mesh.objects.end(), 2, object);
}

}  // namespace flockstep::testing
