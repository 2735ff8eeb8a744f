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
#include <string_view>
#include <vector>

#include "flockstep/attachment.hpp"
#include "flockstep/body.hpp"
#include "flockstep/export.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/light.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/visibility.hpp"

namespace flockstep {

// Solids are full: a ray from outside stops at their surface. A room is the inside of a box; rays and drones hit it from
// within. A plane (a rectangle) and a disc have no thickness; rays and drones hit them from both sides.
enum class PrimitiveKind : std::uint8_t { room, box, cylinder, sphere, capsule, plane, disc };
template <>
struct EnumNames<PrimitiveKind> {
  static constexpr std::array kNames{"room", "box", "cylinder", "sphere", "capsule", "plane", "disc"};
};

// A simple shape.
struct Primitive {
  PrimitiveKind kind = PrimitiveKind::box;   // the shape
  Vec3 center = Vec3::Zero();                // m, world frame
  Quat rotation = Quat::Identity();          // local to world; identity for rooms and spheres
  Vec3 half_extents = Vec3::Constant(0.5F);  // m. box, room: half sizes; cylinder: (radius, radius, half height),
                                             // axis along local z, flat caps; sphere: (radius, radius, radius);
                                             // capsule: (radius, radius, half height, round caps included); plane: (half
                                             // sizes, 0) and disc: (radius, radius, 0), both normal to local z
  std::uint16_t material = 0;                // index into World::materials()
  Visibility visibility = Visibility::full;  // its role
};

// Content of a texture beyond its borders: repeated, mirrored, or clamped to the border.
enum class TextureWrap : std::uint8_t { repeat, mirror, clamp };
template <>
struct EnumNames<TextureWrap> {
  static constexpr std::array kNames{"repeat", "mirror", "clamp"};
};

// An image for the surfaces of triangles.
struct Texture {
  std::string name;                 // name in the scene
  int width_px = 0, height_px = 0;  // 1 to 16384
  // sRGB red, green, blue, and alpha, row by row from the top: 4 width_px height_px bytes. Only Material::alpha_cutoff uses
  // alpha.
  std::vector<std::uint8_t> rgba;
  std::array<TextureWrap, 2> wrap{TextureWrap::repeat, TextureWrap::repeat};  // across, down
};

// The limits are those of a material's keys in a scene file: docs/reference/scene-format.md.
struct Material {
  std::string name;                                   // unique in a scene
  std::array<float, 3> base_color{0.8F, 0.8F, 0.8F};  // linear RGB
  std::uint16_t semantic = 0;                         // semantic id in camera images; 0: the material's index plus 1
  // Index into World::textures(). The texture's colours, as linear RGB, are multiplied by base_color. Triangles only.
  std::optional<std::uint16_t> texture;
  // Linear RGB, emitted independently of the lighting. On triangles it is multiplied by the texture and the vertex colours.
  std::array<float, 3> emissive{};
  // A triangle is transparent to cameras and sunlight wherever the texture's alpha, from 0 to 1, is below this; 0: nowhere.
  // LiDAR rays and collisions hit the whole triangle.
  float alpha_cutoff = 0.0F;
};

// Light and colours that can differ between copies of a world. They do not affect drones and rays.
struct Lighting {
  Light light;  // replaces the world's light
  // Factors of the base colours, linear RGB in [0, 10]; the products are limited to 1. One per material, one for all,
  // or empty.
  std::vector<std::array<float, 3>> tint;
};

// Triangles, with their materials and objects.
struct TriangleMesh {
  std::vector<Vec3> vertices;                          // m, world frame
  std::vector<std::array<std::int32_t, 3>> triangles;  // vertex indices, counter-clockwise seen from outside
  std::vector<std::uint16_t> materials;                // one per triangle, index into World::materials(); empty: all 0
  std::vector<std::uint16_t> objects;                  // one per triangle, number of its mesh in the scene; empty: all 0
  // One per vertex, texture coordinates: (0, 0) is the texture's upper left corner, (1, 1) its lower right one; empty: all (0,
  // 0).
  std::vector<std::array<float, 2>> uv;
  // One per vertex, linear RGB factor of base colour and emission; empty: all white.
  std::vector<std::array<float, 3>> colors;
  std::vector<Visibility> visibility;  // by object number; objects beyond the end are full

  // Returns the role of a triangle's object.
  Visibility visibility_of(std::size_t triangle) const {
    const std::size_t object = objects.empty() ? 0 : objects[triangle];
    return object < visibility.size() ? visibility[object] : Visibility::full;
  }
};

// Named places for tasks. Drones do not collide with them and LiDARs do not detect them. Cameras show them as spheres that cast
// no shadow and are visible only from outside, so a drone at its start looks out of the start marker.
struct Markers {
  float radius = 0.25F;           // m, drawn size
  std::optional<Vec3> start;      // m
  std::vector<Vec3> waypoints;    // m, in flight order
  std::optional<Vec3> goal;       // m
  std::optional<Aabb> spawn_box;  // m, region of random starts
};

// Semantic ids of the markers in camera images; those of materials are lower.
inline constexpr std::uint16_t kSemanticStart = 65533;
inline constexpr std::uint16_t kSemanticWaypoint = 65534;  // semantic id of waypoints
inline constexpr std::uint16_t kSemanticGoal = 65535;      // semantic id of the goal

// Shape of a gate's opening.
enum class GateShape : std::uint8_t { square, ring };
template <>
struct EnumNames<GateShape> {
  static constexpr std::array kNames{"square", "ring"};
};

// An opening to fly through, with a frame around it. Drones pass it along local x. Cameras, LiDARs, drones and queries find the
// frame among World::primitives(): four boxes, or kRingBars capsules in a circle.
struct Gate {
  GateShape shape = GateShape::square;       // shape of opening and frame
  Vec3 center = Vec3::Zero();                // m, world frame, middle of the opening
  Quat rotation = Quat::Identity();          // local to world; passed along local x, with local z up
  float size = 1.5F;                         // m, inside width of a square or inside diameter of a ring
  float bar = 0.1F;                          // m, thickness of the frame's bars
  std::uint16_t material = 0;                // the frame's, an index into World::materials()
  Visibility visibility = Visibility::full;  // role of the frame
};
inline constexpr std::size_t kRingBars = 16;  // capsules of a ring

// Content of a scene file in memory. Every World is built from a SceneDescription.
struct SceneDescription {
  std::string name = "unnamed";                                              // name of the world
  std::vector<Material> materials{Material{"default", {0.8F, 0.8F, 0.8F}}};  // 1 to 65532
  std::vector<Texture> textures;                                             // at most 65536
  std::vector<Primitive> primitives;                                         // simple shapes
  TriangleMesh mesh;                                                         // all triangle meshes of the scene, merged
  Markers markers;                                                           // start, waypoints, goal, spawn box
  Light light;                                                               // sun and sky
  std::vector<Gate> gates;                                                   // in the order of flight, at most 4096
  std::vector<BodyConfig> bodies;                                            // in every env of this world, at most 4096
};

// Folders from which a scene may read mesh files: the scene's folder and its subfolders, any folder, or none. in_folder keeps a
// scene from an untrusted source from reading other files.
enum class MeshFiles : std::uint8_t { in_folder, anywhere, none };

// Axis of a file that points up. of_format is y for glTF and z for all other formats. If y is up, a file's point (x, y, z)
// becomes (x, -z, y).
enum class UpAxis : std::uint8_t { of_format, y, z };

// Placement of a file's content in the world: points are turned upright, scaled, then moved.
struct LoadOptions {
  MeshFiles files = MeshFiles::in_folder;  // folders that may be read
  double scale = 1.0;                      // m per unit of the file, in [1e-6, 1e6]
  Vec3 origin = Vec3::Zero();              // m, position of the file's origin
  UpAxis up = UpAxis::of_format;           // axis that points up
};

class FLOCKSTEP_API World {
 public:
  // Reads a scene file (.json, described by scenes/schema.json), a glTF 2.0 file (.gltf, .glb) or a bare mesh (.obj, .ply).
  // Throws std::invalid_argument naming the file and the offending field.
  static std::shared_ptr<const World> load(const std::filesystem::path& path, const LoadOptions& options = {});
  // Reads a scene from JSON text. base_dir is the scene's folder; empty means the current folder.
  static std::shared_ptr<const World> from_json(const std::string& text, const std::filesystem::path& base_dir = {},
                                                MeshFiles files = MeshFiles::in_folder);
  // Suffixes of the files that load() reads: ".json", ".gltf", ".glb", ".obj", ".ply".
  static std::vector<std::string_view> suffixes();

  // Builds a world. Throws std::invalid_argument naming the field, the expected value and the actual one. ignored: see
  // ignored().
  //
  // The description is normalised. Primitives are sorted by kind, in the order of PrimitiveKind, and triangles by object; both
  // sorts are stable. Each object gets its own vertices, without unused ones, and each triangle a material and an object.
  // Quaternions and the sun's direction become unit. uv are present exactly if a material has a texture, vertex colours only if
  // one is not white, and visibility only up to the last object that is not full.
  explicit World(SceneDescription description, std::vector<std::string> ignored = {});
  // Makes a copy of a world in another light. It shares geometry, bodies, textures and all acceleration structures with the
  // original, and keeps the original alive. Throws std::invalid_argument if the lighting is not valid.
  World(std::shared_ptr<const World> world, const Lighting& lighting);
  World(const World&) = delete;
  World& operator=(const World&) = delete;

  const std::string& name() const { return description_.name; }                   // for messages and pictures
  std::span<const Material> materials() const { return description_.materials; }  // by the indices that objects have
  std::span<const Texture> textures() const { return shape().textures; }          // by the indices that materials have
  std::uint16_t semantic(std::size_t material) const;  // semantic id of a material in camera images, in [1, 65532]
  // All primitives, sorted by kind. The bars of the gates follow the other primitives of their kind.
  std::span<const Primitive> primitives() const { return original_ ? original_->own_primitives() : own_primitives(); }
  std::span<const Gate> gates() const { return shape().gates; }  // in the order of flight
  // Bodies that every env in this world begins an episode with. They are no part of the geometry: queries do not find them.
  std::span<const BodyConfig> bodies() const { return shape().bodies; }
  const TriangleMesh& triangles() const { return shape().mesh; }   // all meshes, sorted by object
  const Markers& markers() const { return description_.markers; }  // places for tasks
  const Light& light() const { return description_.light; }        // sun and sky
  const Aabb& bounds() const { return bounds_; }                   // m, of all geometry; without bodies
  // Where drones begin: at the start marker, or at the centre of the bounds if there is none.
  Vec3 drone_start() const { return markers().start.value_or((bounds_.min + bounds_.max) / 2.0F); }

  // The world whose geometry this one shares; null if it has its own.
  const World* original() const { return original_.get(); }

  // Content of the loaded file that flockstep does not read, in words ("2 animations").
  std::span<const std::string> ignored() const { return ignored_; }

  std::string to_json() const;  // text of a scene file, with triangle meshes inline
  // Binary form for other processes of the same version. It is much quicker than JSON for triangles and textures, and larger for
  // textures, which it does not compress. from_bytes() throws std::invalid_argument if the bytes are damaged.
  std::string to_bytes() const;
  static std::shared_ptr<const World> from_bytes(std::string_view bytes);  // an equal world
  std::string to_glb() const;  // bytes of a binary glTF file (.glb), for files that contain worlds
  // Returns the equal world of such bytes, which must not name other files. Throws std::invalid_argument naming the cause;
  // messages name `source`.
  static std::shared_ptr<const World> from_glb(const std::string& bytes, const std::string& source);
  // Writes a scene file (.json) or a glTF 2.0 file (.glb, .gltf) that load() reads back as an equal world. The file is written
  // completely or not at all. Throws std::invalid_argument naming the file and the cause.
  void save(const std::filesystem::path& path) const;

  // Returns all geometry as triangles. Round primitives are tessellated so that no chord is farther than chord_error_m (m) from
  // the surface. Primitive i becomes object i, and object k of triangles() becomes object primitives().size() + k: the cameras'
  // instance ids minus 1. If these numbers do not fit 16 bits, `objects` stays empty; all_objects, if given, always receives
  // them. uv of geometry without a texture is (0, 0).
  TriangleMesh mesh(float chord_error_m = 1e-3F, std::vector<std::int32_t>* all_objects = nullptr) const;

  // Returns the same world with these markers and no others. It keeps gates and bodies.
  std::shared_ptr<const World> with_markers(Markers markers) const;

  // Returns the same world with these bodies and no others. Throws std::invalid_argument that names the body.
  std::shared_ptr<const World> with_bodies(std::vector<BodyConfig> bodies) const;

  // Hash of the whole content except the name; every byte of the canonical content counts. Worlds of equal hash give the same
  // simulation and images. Computed on first use, thread-safe.
  std::uint64_t content_hash() const;

  // Cache for the stages that trace, collide and render; see prepared/prepared_world.hpp.
  const Attachment& attachment() const { return attachment_; }

 private:
  const SceneDescription& shape() const { return original_ ? original_->description_ : description_; }
  std::span<const Primitive> own_primitives() const { return framed_.empty() ? description_.primitives : framed_; }
  // Returns the complete description, built in `copy` if this world shares the geometry of another.
  const SceneDescription& description(SceneDescription& copy) const;

  SceneDescription description_;   // without textures, primitives, triangles, gates and bodies if original_ has them
  std::vector<Primitive> framed_;  // the primitives and the frames of the gates; empty without gates
  std::shared_ptr<const World> original_;
  std::vector<std::string> ignored_;
  Aabb bounds_;
  mutable std::once_flag hashed_;
  mutable std::uint64_t content_hash_ = 0;
  Attachment attachment_;  // last member: its data may refer to the others and must be destroyed first
};

}  // namespace flockstep
