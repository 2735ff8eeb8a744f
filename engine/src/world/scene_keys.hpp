// The keys of scene files, as structs with fields(). This is the only place for each key's type, limits, unit, default and
// meaning: the reader (formats/scene_values.hpp) and the checks of a SceneDescription use these structs, and
// bindings/scene_keys.py generates scenes/schema.json and the tables of docs/reference/scene-format.md from them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <optional>
#include <string>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/limits.hpp"
#include "flockstep/world.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

inline constexpr int kSceneVersion = 1;

// Returns all keys as a JSON array of objects.
std::string scene_keys_as_json();

// Calls f(field) for each key of an object.
template <class Object, class F>
constexpr void for_each_key(const F& f) {
  kFields<Object>.apply([&](const auto&... fields) { (f(fields), ...); });
}

namespace keys {

inline constexpr Limits kCoordinates = within(kMaxCoordinate);
inline constexpr Limits kSizes = between(kMinSize, kMaxCoordinate);
inline constexpr Limits kLengths = between(2.0 * kMinSize, 2.0 * kMaxCoordinate);  // half of a length is a size
inline constexpr Limits kCorners = within(kMaxCorner);
inline constexpr Limits kShares = between(0.0, 1.0);
inline constexpr Limits kSemantics = between(1, kSemanticStart - 1);

// The type of a member tells what its key holds. A plain value keeps the default that its struct gives it if the key is left out,
// and a std::optional has none. Exactly one alternative of an object is given: only its keys may be present, and those of them
// that are required are.
template <class Value, bool kIsRequired, int kAlternative = 0>
struct Key {
  std::optional<Value> value;
};
template <class Value>
using Required = Key<Value, true>;
template <int kNumber, class Value, bool kIsRequired = true>
using Alternative = Key<Value, kIsRequired, kNumber>;
template <class Value, std::size_t kMost = 0, bool kAreNamed = false>
struct List {};  // an array of at most kMost values (0: any number), or an object with a value by each name; read one by one
template <class Value, std::size_t kMost>
using ByName = List<Value, kMost, true>;
struct Version {};
struct Unread {};  // not read
struct Text {      // with its place, for messages
  std::optional<json::JsonField> field;
};
struct TextOrTexts : Text {};  // one text, or an array of them
template <std::size_t kSize>
using Numbers = std::array<double, kSize>;  // rounded to float32 once, after all arithmetic
struct Index {                              // an integer >= 0
  std::int32_t value = -1;                  // -1: it is none
};

constexpr FieldInfo metres(const char* about, const Limits& limits) { return {.about = about, .unit = "m", .limits = limits}; }

struct Object {};  // base of what a scene file describes by keys

struct Texture : Object {
  Alternative<1, Text> file;
  Alternative<2, Text> png_base64;
  std::array<TextureWrap, 2> wrap = flockstep::Texture().wrap;

  static constexpr auto fields() {
    using C = Texture;
    return field_list(
        field("file", &C::file, {.about = "Path of a PNG or JPEG file, relative to the scene."}),
        field("png_base64", &C::png_base64, {.about = "The bytes of such a file, in base64."}),
        field("wrap", &C::wrap, {.about = "How the image continues beyond its edges, horizontally and vertically."}));
  }
};

struct Material : Object {
  Required<std::array<float, 3>> base_color;
  std::optional<std::uint16_t> semantic;
  Text texture;
  std::array<float, 3> emissive = flockstep::Material().emissive;
  float alpha_cutoff = flockstep::Material().alpha_cutoff;

  static constexpr auto fields() {
    using C = Material;
    return field_list(
        field("base_color", &C::base_color, {.about = "Linear red, green, blue.", .limits = kShares}),
        field("semantic", &C::semantic,
              {.about = "Class that cameras report. Default: the material's number in materials, from 1.", .limits = kSemantics}),
        field("texture", &C::texture, {.about = "A name in textures, whose colours base_color multiplies, on triangles only."}),
        field("emissive", &C::emissive,
              {.about = "Linear RGB added to the lit colour. On triangles it is multiplied by texture and colors.",
               .limits = Light::kBrightness}),
        field("alpha_cutoff", &C::alpha_cutoff,
              {.about = "Cameras and sunlight pass triangles where the texture's alpha is below this.", .limits = kShares}));
  }
};

// Members of several objects. An object lists those that it has, and its own.
struct Solid : Object {
  Required<Numbers<3>> center;
  Required<double> radius;
  Required<double> height;
  std::optional<Numbers<4>> quat_wxyz;
  Text material;
  bool visible = true;
  bool solid = true;
};
inline constexpr auto kCenter = field("center", &Solid::center, metres("x, y, z.", kCoordinates));
inline constexpr auto kRadius = field("radius", &Solid::radius, metres("The radius.", kSizes));
inline constexpr auto kHeight =
    field("height", &Solid::height,
          metres("Length along local z. A capsule's includes its caps: at least twice the radius.", kLengths));
inline constexpr auto kRotation =
    field("quat_wxyz", &Solid::quat_wxyz,
          {.about = "Rotation (w, x, y, z) from local to world, of norm 1 within 1e-3. Default: the identity.",
           .limits = kCoordinates});
inline constexpr auto kMaterial =
    field("material", &Solid::material,
          {.about = "A name in materials. Default: \"default\", light grey unless the scene defines it."});
inline constexpr auto kVisible = field("visible", &Solid::visible, {.about = "True if cameras, LiDARs and rays see it."});
inline constexpr auto kSolid = field("solid", &Solid::solid, {.about = "True if drones hit it and planners avoid it."});

struct Room : Solid {
  Required<Numbers<3>> min, max;

  static constexpr auto fields() {
    return field_list(field("min", &Room::min, metres("Least corner.", kCorners)),
                      field("max", &Room::max, metres("Greatest corner, above min.", kCorners)), kMaterial);
  }
};

struct Pillar : Solid {
  Required<Numbers<2>> xy;
  std::optional<Numbers<2>> z;

  static constexpr auto fields() {
    return field_list(field("center", &Pillar::xy, metres("x, y.", kCoordinates)), kRadius,
                      field("z", &Pillar::z, metres("Low and high end. Default: those of the room.", kCoordinates)), kMaterial,
                      kVisible, kSolid);
  }
};

struct Cylinder : Solid {
  static constexpr auto fields() { return field_list(kCenter, kRadius, kHeight, kRotation, kMaterial, kVisible, kSolid); }
};

struct Capsule : Cylinder {};

struct Box : Solid {
  Required<Numbers<3>> size;

  static constexpr auto fields() {
    return field_list(kCenter, field("size", &Box::size, metres("Full lengths along local x, y, z.", kLengths)), kRotation,
                      kMaterial, kVisible, kSolid);
  }
};

struct Sphere : Solid {
  static constexpr auto fields() { return field_list(kCenter, kRadius, kMaterial, kVisible, kSolid); }
};

struct Plane : Solid {
  Required<Numbers<2>> size;

  static constexpr auto fields() {
    return field_list(kCenter, field("size", &Plane::size, metres("Full lengths along local x, y.", kLengths)), kRotation,
                      kMaterial, kVisible, kSolid);
  }
};

struct Disc : Solid {
  static constexpr auto fields() { return field_list(kCenter, kRadius, kRotation, kMaterial, kVisible, kSolid); }
};

struct Gate : Solid {
  GateShape shape = flockstep::Gate().shape;
  float size = flockstep::Gate().size;
  float bar = flockstep::Gate().bar;

  static constexpr auto fields() {
    using C = Gate;
    return field_list(field("shape", &C::shape, {.about = "Shape of the opening and the frame."}), kCenter, kRotation,
                      field("size", &C::size, metres("Inside width of a square, inside diameter of a ring.", kLengths)),
                      field("bar", &C::bar, metres("Thickness of the frame's bars.", kLengths)), kMaterial, kVisible, kSolid);
  }
};

struct Mesh : Solid {
  Alternative<1, Text> file;
  Alternative<2, std::vector<Numbers<3>>> vertices;
  Alternative<2, std::vector<std::array<Index, 3>>> triangles;
  Alternative<2, std::vector<std::array<float, 2>>, false> uv;
  Alternative<2, std::vector<std::array<float, 3>>, false> colors;
  std::optional<Numbers<3>> position;
  float scale = 1.0F;
  TextOrTexts materials;

  static constexpr auto fields() {
    using C = Mesh;
    return field_list(
        field("file", &C::file,
              {.about = "Path of an OBJ or PLY file, relative to the scene. Without a material, an OBJ file uses its MTL "
                        "materials, unless the scene defines the same names. Its vt become uv."}),
        field("vertices", &C::vertices, metres("x, y, z of each vertex.", kCoordinates)),
        field("triangles", &C::triangles,
              {.about = "Vertex indices from 0, counter-clockwise seen from outside, each with an area."}),
        field("uv", &C::uv, {.about = "Place in the texture, one per vertex.", .limits = kCoordinates}),
        field("colors", &C::colors,
              {.about = "Linear RGB, one per vertex, that base_color and emissive are multiplied by. Default: white.",
               .limits = kShares}),
        field("position", &C::position, metres("Position of the mesh's origin. Default: the world's origin.", kCoordinates)),
        kRotation,
        field("scale", &C::scale, {.about = "Factor of all coordinates, before rotation and position.", .limits = kSizes}),
        field("material", &C::materials, {.about = "One name for all triangles, or one for each."}), kVisible, kSolid);
  }
};

struct SpawnBox : Object {
  Required<Numbers<3>> min, max;

  static constexpr auto fields() {
    using C = SpawnBox;
    return field_list(field("min", &C::min, metres("Least corner.", kCoordinates)),
                      field("max", &C::max, metres("Greatest corner, at least min.", kCoordinates)));
  }
};

struct Markers : Object {
  float radius = flockstep::Markers().radius;
  std::optional<Numbers<3>> start;
  std::vector<Numbers<3>> waypoints;
  std::optional<Numbers<3>> goal;
  std::optional<SpawnBox> spawn_box;

  static constexpr auto fields() {
    using C = Markers;
    return field_list(field("radius", &C::radius, metres("Radius at which markers are drawn.", kSizes)),
                      field("start", &C::start, metres("x, y, z.", kCoordinates)),
                      field("waypoints", &C::waypoints, metres("x, y, z of each, in the order of flight.", kCoordinates)),
                      field("goal", &C::goal, metres("x, y, z.", kCoordinates)),
                      field("spawn_box", &C::spawn_box, {.about = "Box in which a task may start drones at random."}));
  }
};

inline constexpr const char* kVersionName = "flockstep_scene";

struct Scene {
  Required<Version> version;
  Unread schema;
  std::string name = SceneDescription().name;
  ByName<Texture, kMaxTextures> textures;
  ByName<Material, kMaxMaterials> materials;
  std::optional<Room> room;
  List<Pillar> pillars;
  List<Cylinder> cylinders;
  List<Box> boxes;
  List<Sphere> spheres;
  List<Capsule> capsules;
  List<Plane> planes;
  List<Disc> discs;
  List<Gate, kMaxGates> gates;
  List<Mesh, kMaxObjects> meshes;
  List<BodyConfig, kMaxBodies> bodies;
  std::optional<Markers> markers;
  std::optional<Light> light;

  // The reader keeps to this order.
  static constexpr auto fields() {
    using C = Scene;
    return field_list(
        field(kVersionName, &C::version, {.about = "Version of the format."}),
        field("$schema", &C::schema, {.about = "Address of the schema, for editors."}),
        field("name", &C::name, {.about = "Shown in messages and pictures."}),
        field("textures", &C::textures, {.about = "Images by name. They colour triangles."}),
        field("materials", &C::materials, {.about = "Materials by name."}),
        field("room", &C::room, {.about = "Floor, walls and ceiling of a box, hit from inside."}),
        field("pillars", &C::pillars, {.about = "Upright cylinders from floor to ceiling, or from z[0] to z[1]."}),
        field("cylinders", &C::cylinders, {.about = "Cylinders with flat caps. The axis is local z."}),
        field("boxes", &C::boxes, {.about = "Boxes."}), field("spheres", &C::spheres, {.about = "Spheres."}),
        field("capsules", &C::capsules, {.about = "Cylinders with round caps at both ends. The axis is local z."}),
        field("planes", &C::planes, {.about = "Rectangles without thickness, normal to local z, seen and hit from both sides."}),
        field("discs", &C::discs, {.about = "Discs without thickness, normal to local z, seen and hit from both sides."}),
        field(
            "gates", &C::gates,
            {.about = "Openings with a frame, in the order of flight. Drones pass along local x, and local z is up. The frame is "
                      "four boxes or a ring of 16 capsules."}),
        field(
            "meshes", &C::meshes,
            {.about =
                 "Triangles from an OBJ or PLY file, or given here. They are scaled, then rotated, then moved. Each mesh is one "
                 "object to cameras."}),
        field("bodies", &C::bodies, {.about = "Solids that move, in every env of this world."}),
        field("markers", &C::markers, {.about = "Named places. Nothing collides with them and no LiDAR sees them."}),
        field("light", &C::light, {.about = "Sun and sky, as cameras see them."}));
  }
};

}  // namespace keys

}  // namespace flockstep
