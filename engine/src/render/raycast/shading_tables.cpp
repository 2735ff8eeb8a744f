// The tables of Shading: what is computed once for a world.
#include <algorithm>
#include <cmath>
#include <cstddef>
#include <cstdint>
#include <cstdlib>
#include <memory>
#include <span>
#include <vector>

#include "base/srgb.hpp"
#include "render/raycast/shading.hpp"

namespace flockstep::render {
namespace {

// Computes the same as the kernels' `linear` for one surface, converted to the levels that are written.
std::int32_t lit_color(const Shading::Tables& tables, const Surface& surface, float sunward, float upward) {
  const Light& light = tables.light;
  std::uint32_t color = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const float ambient = light.ground_ambient[c] + (light.sky_ambient[c] - light.ground_ambient[c]) * 0.5F * (1.0F + upward);
    const float reflected = surface.color[c] * (ambient + light.sun_color[c] * std::max(0.0F, sunward));
    const float root = std::sqrt(std::min(1.0F, reflected + surface.emissive[c]));
    const int level = tables.levels[static_cast<std::size_t>(std::lround(root * Shading::kLevels))];
    color |= static_cast<std::uint32_t>(level) << (8 * c);
  }
  return static_cast<std::int32_t>(color);
}

// Computes the same as the kernels' `sky`, without a sun disc.
std::int32_t sky_color(const Shading::Tables& tables, float up) {
  std::uint32_t color = 0;
  for (std::size_t c = 0; c < 3; ++c) {
    const float horizon = tables.light.horizon_color[c];
    const float value = horizon + (tables.light.zenith_color[c] - horizon) * up;
    const float root = std::sqrt(std::clamp(value, 0.0F, 1.0F));
    color |= static_cast<std::uint32_t>(tables.levels[static_cast<std::size_t>(std::lround(root * Shading::kLevels))]) << (8 * c);
  }
  return static_cast<std::int32_t>(color);
}

}  // namespace

bool is_fine(std::span<const std::int32_t> colors) {
  const auto skips = [](std::int32_t a, std::int32_t b) {
    for (int shift = 0; shift < 24; shift += 8) {
      if (std::abs(((a >> shift) & 0xFF) - ((b >> shift) & 0xFF)) > 1) return true;
    }
    return false;
  };
  return std::adjacent_find(colors.begin(), colors.end(), skips) == colors.end();
}

bool takes_ramp(const ShadedSolid& solid) {
  return solid.shape->kind == trace::ShapeKind::cylinder && solid.up[0] == 0.0F && solid.up[1] == 0.0F;
}

ShadedSolid Shading::make_solid(const trace::Shape& shape, const Surface& surface) const {
  ShadedSolid solid{.shape = &shape, .surface = surface, .sun = {}, .up = {}, .faces = {}};
  const auto& sun = tables_.light.sun_direction;
  const Vec3 to_sun(sun[0], sun[1], sun[2]);
  for (std::size_t axis = 0; axis < 3; ++axis) {
    const Vec3 outward = shape.to_local.row(static_cast<Eigen::Index>(axis)).transpose();
    solid.sun[axis] = outward.dot(to_sun);
    solid.up[axis] = outward.z();
    for (std::size_t shaded = 0; shaded < 2; ++shaded) {
      const float sunward = shaded != 0 ? 0.0F : outward.dot(to_sun);
      solid.faces[shaded][2 * axis] = lit_color(tables_, surface, -sunward, -outward.z());
      solid.faces[shaded][2 * axis + 1] = lit_color(tables_, surface, sunward, outward.z());
    }
  }
  return solid;
}

Shading::Images::Images(const World& world) : textures(world) {
  std::array<std::uint32_t, 256> roots;
  for (std::size_t i = 0; i < roots.size(); ++i) {
    roots[i] = static_cast<std::uint32_t>(std::lround(std::sqrt(srgb_to_linear()[i]) * static_cast<float>(kRoots)));
  }
  for (std::uint32_t& texel : textures.texels) {
    const auto root = [&](unsigned int shift) { return roots[texel >> shift & 0xFFU]; };
    texel = root(0) | root(8) << 10U | root(16) << 20U;
  }
  for (std::size_t i = 0; i < textures.offset.size(); ++i) sizes.push_back(textures.width[i] | textures.height[i] << 16);
  const TriangleMesh& mesh = world.triangles();
  const std::vector<float> densities = texels_per_square_metre(world);
  prints.reserve(densities.size());
  for (std::size_t i = 0; i < densities.size(); ++i) {
    const auto uv = [&](std::size_t k) { return mesh.uv[static_cast<std::size_t>(mesh.triangles[i][k])]; };
    const auto corner = [&](std::size_t k) -> Eigen::Vector3d {
      return mesh.vertices[static_cast<std::size_t>(mesh.triangles[i][k])].cast<double>();
    };
    const Eigen::Vector3d normal = (corner(1) - corner(0)).cross(corner(2) - corner(0)).normalized();
    const Vec3 scaled = (normal / std::sqrt(std::max(static_cast<double>(densities[i]), 1e-30))).cast<float>();
    prints.push_back({{uv(0), uv(1), uv(2)}, {scaled.x(), scaled.y(), scaled.z()}, mesh.materials[i]});
  }
}

Shading::Shading(const World& world, const trace::Scene& scene, const Shading* original)
    : world_(world), tables_(world.light()), room_(shading_room(world)) {
  const Appearance appearance(world);
  for (std::size_t i = 0; i < tables_.levels.size(); ++i) {
    const double value = std::pow(static_cast<double>(i) / kLevels, 2.0);
    tables_.levels[i] =
        static_cast<std::int32_t>(std::lround(255.0 * std::pow(value, 1.0 / static_cast<double>(tables_.light.gamma))));
  }
  for (const Surface& material : appearance.materials) make_ramp(material, tables_.ramps.emplace_back());
  for (std::size_t i = 0; i < appearance.primitives.size(); ++i) {
    const trace::Shape& shape = scene.shape(i);
    ShadedSolid& solid = tables_.solids.emplace_back(make_solid(shape, appearance.primitives[i]));
    if (takes_ramp(solid)) {
      const auto& ramp = tables_.ramps[world.primitives()[i].material];
      if (is_fine(ramp)) solid.ramp = ramp.data();
    }
  }
  for (std::size_t i = 0; i < appearance.markers.size(); ++i) {
    tables_.markers.push_back(make_solid(scene.markers()[i].shape, appearance.markers[i].surface));
  }
  tables_.first_triangle = static_cast<std::int32_t>(world.primitives().size());
  tables_.first_marker = tables_.first_triangle + static_cast<std::int32_t>(world.triangles().triangles.size());
  tables_.images = original != nullptr ? original->tables_.images : std::make_shared<const Images>(world);
  add_mesh(appearance, tables_);
  light_triangles(false);
  if (!tables_.sun_disc.shows) {
    for (int i = 0; i <= kSky; ++i) tables_.sky.push_back(sky_color(tables_, static_cast<float>(i) / kSky));
    if (!is_fine(tables_.sky)) tables_.sky.clear();
  }
}

// Sets everything that concerns triangles, except their colours. The images and the light of the tables are set.
void Shading::add_mesh(const Appearance& appearance, Tables& tables) const {
  tables.triangle_material = world_.triangles().materials;
  tables.triangle_object = world_.triangles().objects;
  for (const Surface& material : appearance.materials) {
    Paint& paint = tables.paints.emplace_back();
    for (std::size_t c = 0; c < 3; ++c) {
      tables.color[c].push_back(material.color[c]);
      tables.emissive[c].push_back(material.emissive[c]);
      const Light& light = tables.light;
      const float brightest = std::max(light.sky_ambient[c], light.ground_ambient[c]) + light.sun_color[c];
      const float most = static_cast<float>(Shading::kRoots);
      paint.unit[c] = (material.color[c] * brightest + material.emissive[c]) / (most * most);
    }
    tables.emits |= material.emits();
    tables.semantic.push_back(material.semantic);
    if (material.texture < 0) continue;
    const Textures& textures = tables.images->textures;
    const auto texture = static_cast<std::size_t>(material.texture);
    paint.texture = material.texture;
    paint.wrap_across = textures.wrap_across[texture];
    paint.wrap_down = textures.wrap_down[texture];
    paint.first_level = textures.first_level[texture];
    paint.last_level = textures.num_levels[texture] - 1;
  }
  tables.vertices = world_.triangles().vertices;
  tables.triangles = world_.triangles().triangles;
  tables.colors = world_.triangles().colors;
  tables.first_object = appearance.first_object;
  tables.lit = std::make_unique_for_overwrite<std::int32_t[]>(4 * tables.triangles.size());
}

Shading::Tables Shading::tables_of_body(const Shading& world) const {
  Tables tables(world.light());
  tables.sun_disc = SunDisc(Light());  // it is in the sky, which a mesh does not show
  tables.levels = world.tables_.levels;
  tables.images = tables_.images;
  tables.first_marker = static_cast<std::int32_t>(world_.triangles().triangles.size());
  add_mesh(Appearance(world_), tables);
  return tables;
}

}  // namespace flockstep::render
