// World: immutable geometry, materials and named markers, shared by any number of drones and batches.
#pragma once

#include <array>
#include <cstdint>
#include <filesystem>
#include <memory>
#include <mutex>
#include <optional>
#include <span>
#include <string>
#include <vector>

#include "flockstep/attachment.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

// Solids are full (a ray from outside stops at their surface); a room is the inside of a box, seen and hit from within. A plane
// (a rectangle) and a disc have no thickness and are seen and hit from both sides.
enum class PrimitiveKind : std::uint8_t { room, box, cylinder, sphere, capsule, plane, disc };
template <>
struct EnumNames<PrimitiveKind> {
  static constexpr std::array kNames{"room", "box", "cylinder", "sphere", "capsule", "plane", "disc"};
};

// What a thing is there for. Cameras, LiDARs and rays see what is visual; drones hit, planners go around and distances are to
// what is solid. A room is both.
enum class Visibility : std::uint8_t { full, visual, solid };
inline bool is_visible(Visibility visibility) { return visibility != Visibility::solid; }
inline bool is_solid(Visibility visibility) { return visibility != Visibility::visual; }

struct Primitive {
  PrimitiveKind kind = PrimitiveKind::box;
  Vec3 center = Vec3::Zero();                // m, world frame
  Quat rotation = Quat::Identity();          // local to world; identity for rooms and spheres
  Vec3 half_extents = Vec3::Constant(0.5F);  // m. box, room: half sizes; cylinder: (radius, radius, half height),
                                             // axis along local z, flat caps; sphere: (radius, radius, radius);
                                             // capsule: (radius, radius, half height, round caps included); plane: (half
                                             // sizes, 0) and disc: (radius, radius, 0), both normal to local z
  std::uint16_t material = 0;                // index into World::materials()
  Visibility visibility = Visibility::full;
};

// What a texture shows beyond its borders: itself again, itself mirrored, or its border.
enum class TextureWrap : std::uint8_t { repeat, mirror, clamp };
template <>
struct EnumNames<TextureWrap> {
  static constexpr std::array kNames{"repeat", "mirror", "clamp"};
};

// An image for surfaces.
struct Texture {
  std::string name;
  int width_px = 0, height_px = 0;  // 1 to 16384
  // Red, green, blue in sRGB and alpha, which only Material::alpha_cutoff asks for, row by row from the top: 4 width_px
  // height_px bytes.
  std::vector<std::uint8_t> rgba;
  std::array<TextureWrap, 2> wrap{TextureWrap::repeat, TextureWrap::repeat};  // across, down
};

// Its limits are those of the keys of a material in a scene file: docs/conventions.md, "Scene files".
struct Material {
  std::string name;
  std::array<float, 3> base_color{0.8F, 0.8F, 0.8F};  // linear RGB
  std::uint16_t semantic = 0;                         // class that cameras report; 0: the material's index plus 1
  // Index into World::textures(): its colours, as linear RGB, are multiplied by base_color. On triangles alone.
  std::optional<std::uint16_t> texture;
  // Linear RGB, shown in any light; on triangles it is multiplied by the texture and the colours of vertices.
  std::array<float, 3> emissive{};
  // Cameras see through triangles, and the sun shines through, where the alpha of the texture, from 0 to 1, is below this; 0:
  // nowhere. Rays of LiDARs and collisions hit whole triangles.
  float alpha_cutoff = 0.0F;
};

// Sun and sky, as cameras see them. Colours are linear RGB; limits are those of the keys of the light in a scene file. A surface
// of unit normal n and base colour c shows c * (sun_color * max(0, n . sun_direction) + lerp(ground_ambient, sky_ambient, (1 +
// n.z) / 2)), and the sky in unit direction d lerp(horizon_color, zenith_color, max(0, d.z)); what a surface emits is added; a
// value v is written as 255 * min(v, 1)^(1 / gamma), rounded. The sun stands in the sky where sun_radius_deg or sun_glow is not
// 0: with q = |d - sun_direction|^2 and r = 2 sin(sun_radius_deg / 2), the sky there is lerp(sky, s, max(disc, sun_glow / (1 +
// 100 q))), where disc = clamp((r^2 - q) / (0.19 r^2), 0, 1), of which the outer tenth of the radius is the soft border, and s =
// sun_color over its largest channel.
struct Light {
  std::array<float, 3> sun_direction{0.4F, 0.3F, 0.8660254F};  // towards the sun; any length but 0, a World's is unit
  std::array<float, 3> sun_color{0.45F, 0.43F, 0.4F};
  std::array<float, 3> sky_ambient{0.6F, 0.62F, 0.65F};
  std::array<float, 3> ground_ambient{0.48F, 0.47F, 0.46F};
  std::array<float, 3> zenith_color{0.16F, 0.36F, 0.72F};
  std::array<float, 3> horizon_color{0.68F, 0.78F, 0.88F};
  float gamma = 2.2F;
  float sun_radius_deg = 0.0F;  // of its disc in the sky; 0: no disc
  float sun_glow = 0.0F;        // the sun's share of the sky's colour beside it; it has halved 5.7 degrees away
};

// Light and colours that a copy of a world may change. Drones and rays do not notice them.
struct Lighting {
  Light light;
  // By which base colours are multiplied, linear RGB in [0, 10], and then at most 1: one for each material, or none.
  std::vector<std::array<float, 3>> tint;
};

struct TriangleMesh {
  std::vector<Vec3> vertices;                          // m, world frame
  std::vector<std::array<std::int32_t, 3>> triangles;  // vertex indices, counter-clockwise seen from outside
  std::vector<std::uint16_t> materials;                // one per triangle, index into World::materials(); none: all 0
  std::vector<std::uint16_t> objects;                  // one per triangle, which mesh of the scene it is of; none: all 0
  // One per vertex, where in a texture: (0, 0) its upper left corner, (1, 1) its lower right one; none: all (0, 0).
  std::vector<std::array<float, 2>> uv;
  // One per vertex, linear RGB, by which base colour and emission are multiplied; none: all white.
  std::vector<std::array<float, 3>> colors;
  std::vector<Visibility> visibility;  // by the number of the object; those that are not listed are full

  Visibility visibility_of(std::size_t triangle) const {
    const std::size_t object = objects.empty() ? 0 : objects[triangle];
    return object < visibility.size() ? visibility[object] : Visibility::full;
  }
};

// Named places. A task reads them; nothing collides with them and no LiDAR sees them. Cameras see them as spheres, from outside
// only (a drone at its start looks out of the start's), that cast no shadow.
struct Markers {
  float radius = 0.25F;           // m, drawn size
  std::optional<Vec3> start;      // m
  std::vector<Vec3> waypoints;    // m, in the order of flight
  std::optional<Vec3> goal;       // m
  std::optional<Aabb> spawn_box;  // m; where a task may start drones at random
};

// What cameras report as semantic id of the markers; materials have lower ones.
inline constexpr std::uint16_t kSemanticStart = 65533;
inline constexpr std::uint16_t kSemanticWaypoint = 65534;
inline constexpr std::uint16_t kSemanticGoal = 65535;

// What a scene file says, in memory: the one input a World is built from.
struct SceneDescription {
  std::string name = "unnamed";
  std::vector<Material> materials{Material{"default", {0.8F, 0.8F, 0.8F}}};  // 1 to 65532
  std::vector<Texture> textures;                                             // at most 65536
  std::vector<Primitive> primitives;
  TriangleMesh mesh;  // all triangle meshes of the scene, merged
  Markers markers;
  Light light;
};

// Where the mesh files that a scene names may lie: in the scene's folder and those below it, so that a scene of a stranger reads
// nothing else, or anywhere.
enum class MeshFiles : std::uint8_t { in_folder, anywhere };

// Which axis of a file points up: y for glTF and z for all others, or the one that is given. The other two follow: what a file
// with y up has at (x, y, z) comes to (x, -z, y).
enum class UpAxis : std::uint8_t { of_format, y, z };

// How a world lies in its file: points are turned upright, scaled, then moved.
struct LoadOptions {
  MeshFiles files = MeshFiles::in_folder;
  double scale = 1.0;          // m per unit of the file, in [1e-6, 1e6]
  Vec3 origin = Vec3::Zero();  // m, where the file's origin comes to
  UpAxis up = UpAxis::of_format;
};

class FLOCKSTEP_API World {
 public:
  // Reads a scene file (.json as scenes/schema.json describes), a glTF 2.0 file (.gltf, .glb) or a bare mesh (.obj, .ply).
  // Throws std::invalid_argument naming the file and the offending field.
  static std::shared_ptr<const World> load(const std::filesystem::path& path, const LoadOptions& options = {});
  // The same from JSON text; base_dir is the scene's folder, the current one if empty.
  static std::shared_ptr<const World> from_json(const std::string& text, const std::filesystem::path& base_dir = {},
                                                MeshFiles files = MeshFiles::in_folder);
  // The suffixes of files that load() reads: ".json", ".gltf", ".glb", ".obj", ".ply".
  static std::vector<std::string_view> suffixes();

  // Throws std::invalid_argument naming the field, what was expected and what came. Puts the description in order: primitives by
  // kind (rooms first, as PrimitiveKind lists them) and otherwise as given, triangles by object and otherwise as given, each
  // object with vertices of its own and none unused, a material and an object for each triangle, quaternions and the sun's
  // direction unit; uv where a material has a texture, and not elsewhere; colours of vertices where one is not white;
  // visibility up to the last object that is not full.
  // ignored: what ignored() returns.
  explicit World(SceneDescription description, std::vector<std::string> ignored = {});
  // The same world in another light. It shares geometry, textures, and all that is built for rays and collisions with the one
  // that is given, and keeps that one alive. Throws std::invalid_argument likewise.
  World(std::shared_ptr<const World> world, const Lighting& lighting);
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  const std::string& name() const { return description_.name; }
  std::span<const Material> materials() const { return description_.materials; }
  std::span<const Texture> textures() const { return shape().textures; }
  std::uint16_t semantic(std::size_t material) const;  // the class that cameras report of a material, in [1, 65532]
  std::span<const Primitive> primitives() const { return shape().primitives; }
  const TriangleMesh& triangles() const { return shape().mesh; }
  const Markers& markers() const { return description_.markers; }
  const Light& light() const { return description_.light; }
  const Aabb& bounds() const { return bounds_; }  // m, of all geometry

  // The world whose geometry this one shares; null where it has its own.
  const World* original() const { return original_.get(); }

  // What the file that this world was loaded from has and flockstep does not read, in words ("2 animations").
  std::span<const std::string> ignored() const { return ignored_; }

  std::string to_json() const;  // a scene file's text; triangle meshes are written inline
  // Writes a scene file (.json) or a glTF 2.0 file (.glb, .gltf), from which load() makes an equal world; whole or not at all.
  // Throws std::invalid_argument naming the file and the cause.
  void save(const std::filesystem::path& path) const;

  // Everything as triangles; round primitives are tessellated so that no chord is farther than chord_error_m from the surface.
  // Primitive i becomes object i, and object k of triangles() becomes primitives().size() + k: the instance ids of cameras
  // less 1. Where these numbers do not fit 16 bits, objects is left empty; all_objects, if given, has them in any case. uv of
  // what is not textured is (0, 0).
  TriangleMesh mesh(float chord_error_m = 1e-3F, std::vector<std::int32_t>* all_objects = nullptr) const;

  // The same world with these markers and no others.
  std::shared_ptr<const World> with_markers(Markers markers) const;

  // Of all that the world is made of but its name: worlds of equal hash are the same to whatever is simulated or drawn in them.
  // Every byte of the canonical content counts. Computed on first need, thread-safe.
  std::uint64_t content_hash() const;

  // What the stages that trace, collide and render keep of this world; see prepared/prepared_world.hpp.
  const Attachment& attachment() const { return attachment_; }

 private:
  const SceneDescription& shape() const { return original_ ? original_->description_ : description_; }
  // The description of the whole world; made in `copy` where this one shares the geometry of another.
  const SceneDescription& description(SceneDescription& copy) const;

  SceneDescription description_;  // without textures, primitives and triangles where the original has them
  std::shared_ptr<const World> original_;
  std::vector<std::string> ignored_;
  Aabb bounds_;
  mutable std::once_flag hashed_;
  mutable std::uint64_t content_hash_ = 0;
  Attachment attachment_;  // the last member: what it keeps may refer to the others, and goes before them
};

}  // namespace flockstep
