// ForestSurfaces: the textures, colours and light of generated forests. They have their own random numbers, so they never change
// the shape of a forest.
#pragma once

#include <cstdint>
#include <string>
#include <vector>

#include "flockstep/world_builder.hpp"
#include "generators/noise.hpp"
#include "planning/draws.hpp"

namespace flockstep {

class ForestSurfaces {
 public:
  // Adds the materials to the builder.
  ForestSurfaces(WorldBuilder& builder, std::uint64_t seed);

  // A tree's materials and the colours that multiply them.
  struct Tree {
    std::uint16_t bark = 0, crown = 0;
    Color bark_tint{}, crown_tint{};
  };
  Tree conifer();
  Tree broadleaf();

  // Each colours the vertices that were added to a part after its last call: crowns are darker below and inside, trunks below
  // the crown, rocks at the ground.
  static void color_trunk(MeshPart& part, const Tree& tree);
  // share: 0 for the lowest tier of branches, towards 1 for the highest.
  static void color_tier(MeshPart& part, const Tree& tree, double share);
  // These two also lay the texture around the ball, which add_ball() projects from above.
  static void color_crown(MeshPart& part, const Tree& tree, const Vec3d& center, const Vec3d& half);
  void color_rock(MeshPart& part, const Vec3d& center, const Vec3d& half);

  // Returns the mesh that WorldBuilder::heightfield() would add, with brown litter under the trees.
  struct Shade {
    Vec2d at;
    double reach;  // m
  };
  static MeshPart ground(const Heightfield& field, const std::vector<Shade>& trees);

  static Light light();

  std::uint16_t ground_material() const { return ground_; }
  std::uint16_t rock_material() const { return rock_; }

 private:
  // How cells of a texture look: `columns` by `rows` of them, each a spot of its own brightness with a dark rim.
  struct Cells {
    int columns, rows;
    Color dark, bright;
  };
  std::uint16_t texture_of_cells(WorldBuilder& builder, const std::string& name, const Cells& cells) const;
  std::uint16_t ground_texture(WorldBuilder& builder) const;
  std::uint16_t bark_texture(WorldBuilder& builder) const;
  std::uint16_t birch_texture(WorldBuilder& builder) const;
  std::uint16_t rock_texture(WorldBuilder& builder) const;
  Color between(const Color& a, const Color& b) { return mixed(a, b, draws_.uniform(0.0, 1.0)); }

  std::uint64_t seed_;
  Draws draws_;
  std::uint16_t ground_ = 0, bark_ = 0, needles_ = 0, leaves_ = 0, rock_ = 0, birch_ = 0;
};

}  // namespace flockstep
