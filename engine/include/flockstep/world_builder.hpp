// WorldBuilder: builds a world in code.
#pragma once

#include <array>
#include <cstdint>
#include <functional>
#include <memory>
#include <span>
#include <string>
#include <vector>

#include "flockstep/export.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

// Triangles of one object. uv and colors have one entry per vertex, or are empty.
struct MeshPart {
  std::vector<Vec3> vertices;                          // m, world frame
  std::vector<std::array<std::int32_t, 3>> triangles;  // counter-clockwise seen from outside
  std::vector<std::array<float, 2>> uv;                // as in TriangleMesh
  std::vector<std::array<float, 3>> colors;            // as in TriangleMesh
};

// Heights over a grid of points. Point (column, row) is at corner + cell_m * (column, row).
struct Heightfield {
  Eigen::Vector2f corner = Eigen::Vector2f::Zero();  // m, world frame
  float cell_m = 1.0F;                               // m, spacing of the points
  int columns = 0, rows = 0;                         // points, at least 2 each
  std::vector<float> heights;                        // (rows, columns), m, world frame
  float texture_m = 4.0F;                            // m, size of one repetition of the texture
};

class FLOCKSTEP_API WorldBuilder {
 public:
  // Returns the colour of a texture at (s, t) in [0, 1): linear RGB in [0, 1].
  using ColorAt = std::function<std::array<float, 3>(float s, float t)>;

  explicit WorldBuilder(std::string name = "unnamed");  // name: of the world

  // Each adds an item and returns its number. Names of materials must be unique.
  std::uint16_t texture(Texture texture);
  std::uint16_t texture(const std::string& name, int width_px, int height_px, const ColorAt& color);
  std::uint16_t material(Material material);  // see texture()

  // Lengths are in m. material: a number that material() returned.
  void room(const Vec3& min, const Vec3& max, std::uint16_t material);
  // A box, turned about its centre.
  void box(const Vec3& center, const Vec3& size, std::uint16_t material, const Quat& rotation = Quat::Identity(),
           Visibility visibility = Visibility::full);
  // A cylinder along its local z axis, turned about its centre.
  void cylinder(const Vec3& center, float radius, float height, std::uint16_t material, const Quat& rotation = Quat::Identity(),
                Visibility visibility = Visibility::full);
  // A capsule along its local z axis; height includes the round caps.
  void capsule(const Vec3& center, float radius, float height, std::uint16_t material, const Quat& rotation = Quat::Identity(),
               Visibility visibility = Visibility::full);
  // A sphere.
  void sphere(const Vec3& center, float radius, std::uint16_t material, Visibility visibility = Visibility::full);
  // A rectangle normal to its local z axis, without thickness.
  void plane(const Vec3& center, const Eigen::Vector2f& size, std::uint16_t material, const Quat& rotation = Quat::Identity(),
             Visibility visibility = Visibility::full);
  // A disc normal to its local z axis, without thickness.
  void disc(const Vec3& center, float radius, std::uint16_t material, const Quat& rotation = Quat::Identity(),
            Visibility visibility = Visibility::full);
  // Adds a gate after the gates so far.
  void gate(const Gate& gate) { scene_.gates.push_back(gate); }
  // Adds a body after the bodies so far.
  void body(const BodyConfig& body) { scene_.bodies.push_back(body); }
  // Adds a mesh as a separate object.
  void mesh(const MeshPart& part, std::uint16_t material, Visibility visibility = Visibility::full);
  // Adds ground over a grid of heights as a separate object.
  void heightfield(const Heightfield& field, std::uint16_t material, Visibility visibility = Visibility::full);

  void light(const Light& light) { scene_.light = light; }                         // replaces sun and sky
  void start(const Vec3& place) { scene_.markers.start = place; }                  // m, world frame
  void waypoint(const Vec3& place) { scene_.markers.waypoints.push_back(place); }  // m, world frame; after the waypoints so far
  void goal(const Vec3& place) { scene_.markers.goal = place; }                    // m, world frame
  void spawn_box(const Aabb& box) { scene_.markers.spawn_box = box; }              // m, region of random starts

  // Returns the world built so far. Throws std::invalid_argument under the same conditions as World.
  std::shared_ptr<const World> build() const;

 private:
  void add(PrimitiveKind kind, const Vec3& center, const Vec3& half, std::uint16_t material, const Quat& rotation,
           Visibility visibility);

  SceneDescription scene_;
  std::uint16_t objects_ = 0;  // number of meshes so far
};

}  // namespace flockstep
