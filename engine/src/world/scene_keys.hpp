// The keys of scene files. This is the only place for each key's type, limits, unit, default and meaning: the reader and the
// checks of a SceneDescription use these lists, and bindings/scene_keys.py generates scenes/schema.json and the table of
// docs/scene-format.md from them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>
#include <utility>

#include "base/config_values.hpp"
#include "flockstep/fields.hpp"
#include "flockstep/limits.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

enum class ValueKind : std::uint8_t {
  number,         //
  anything,       // not read
  version,        // the number kSceneVersion
  text,           //
  text_or_texts,  // one text, or an array of them
  flag,           // true or false; true by default
  integer,        //
  index,          // an integer >= 0
  choice,         // one of a few texts
  object,         // nested keys
  config,         // an object with the fields of a configuration; docs/configs.md lists them
};
template <>
struct EnumNames<ValueKind> {
  static constexpr std::array kNames{"number",  "anything", "version", "text",   "text_or_texts", "flag",
                                     "integer", "index",    "choice",  "object", "config"};
};

// Number of values that a key holds.
enum class ValueCount : std::uint8_t { one, list, by_name };
template <>
struct EnumNames<ValueCount> {
  static constexpr std::array kNames{"one", "list", "by_name"};
};

struct SceneKey {
  std::string_view name;
  FieldInfo info;                             // description of the value, as of a configuration's field
  ValueKind kind = ValueKind::number;         //
  std::size_t size = 0;                       // array length of a value; 0: not an array
  ValueCount count = ValueCount::one;         //
  std::size_t most = 0;                       // largest size of a list or a map; 0: no limit
  std::span<const SceneKey> keys = {};        // keys of an object
  std::span<const char* const> choices = {};  // names of a choice
  std::string (*usual)() = nullptr;           // default as JSON; null: no default
  bool is_required = false;                   // with `alternative`: required if another key of it is present
  std::uint8_t alternative = 0;               // only keys of one alternative may be present; 0: no alternative
};

inline constexpr int kSceneVersion = 1;

// Returns the default of a member of a struct, as JSON.
template <class Struct, class Value>
Struct struct_of(Value Struct::*);
template <auto kMember>
std::string default_of() {
  return config_values::written(decltype(struct_of(kMember))().*kMember, "").dump();
}

// Returns all keys as a JSON array of objects.
std::string scene_keys_as_json();

// Describes the allowed values: "a number in [1, 4]", "0 or a number in [0.1, 45]", or "numbers in [0, 1]" for an array.
std::string text_of_values(const SceneKey& key);

namespace keys {

constexpr SceneKey number(std::string_view name, const char* about, const Limits& limits, const char* unit = "") {
  return {.name = name, .info = {.about = about, .unit = unit, .limits = limits}};
}
constexpr SceneKey numbers(std::size_t size, std::string_view name, const char* about, const Limits& limits,
                           const char* unit = "") {
  SceneKey key = number(name, about, limits, unit);
  key.size = size;
  return key;
}
constexpr SceneKey value(ValueKind kind, std::string_view name, const char* about, const Limits& limits = {}) {
  SceneKey key = number(name, about, limits);
  key.kind = kind;
  return key;
}
constexpr SceneKey choice(std::string_view name, const char* about, std::span<const char* const> choices, std::size_t size = 0) {
  SceneKey key = value(ValueKind::choice, name, about);
  key.choices = choices;
  key.size = size;
  return key;
}
constexpr SceneKey object(std::string_view name, const char* about, std::span<const SceneKey> keys) {
  SceneKey key = value(ValueKind::object, name, about);
  key.keys = keys;
  return key;
}
constexpr SceneKey list_of(SceneKey key, std::size_t most = 0) {
  key.count = ValueCount::list;
  key.most = most;
  return key;
}
constexpr SceneKey by_name(SceneKey key, std::size_t most) {
  key.count = ValueCount::by_name;
  key.most = most;
  return key;
}
constexpr SceneKey required(SceneKey key) {
  key.is_required = true;
  return key;
}
constexpr SceneKey alternative(std::uint8_t number, SceneKey key) {
  key.alternative = number;
  return key;
}
template <auto kMember>
constexpr SceneKey usually(SceneKey key) {
  key.usual = &default_of<kMember>;
  return key;
}

inline constexpr Limits kCoordinates = within(kMaxCoordinate);
inline constexpr Limits kSizes = between(kMinSize, kMaxCoordinate);
inline constexpr Limits kLengths = between(2.0 * kMinSize, 2.0 * kMaxCoordinate);  // half of a length is a size
inline constexpr Limits kCorners = within(kMaxCorner);
inline constexpr Limits kShares = between(0.0, 1.0);

// Keys of several objects
inline constexpr SceneKey kCenter = required(numbers(3, "center", "x, y, z.", kCoordinates, "m"));
inline constexpr SceneKey kRadius = required(number("radius", "The radius.", kSizes, "m"));
inline constexpr SceneKey kHeight =
    required(number("height", "Length along local z. A capsule's includes its caps: at least twice the radius.", kLengths, "m"));
inline constexpr SceneKey kRotation = numbers(
    4, "quat_wxyz", "Rotation (w, x, y, z) from local to world, of norm 1 within 1e-3; the identity if left out.", kCoordinates);
inline constexpr SceneKey kMaterial =
    value(ValueKind::text, "material",
          "A name listed in materials. If omitted, the material \"default\", which is light grey unless the scene defines it.");
inline constexpr SceneKey kVisible = value(ValueKind::flag, "visible", "True if cameras, LiDARs and rays see it.");
inline constexpr SceneKey kSolid = value(
    ValueKind::flag, "solid", "True if drones hit it and planners go around it. At least one of visible and solid is true.");
inline constexpr SceneKey kMin = required(numbers(3, "min", "Least corner.", kCorners, "m"));
inline constexpr SceneKey kMax = required(numbers(3, "max", "Greatest corner, above min.", kCorners, "m"));

// Textures
inline constexpr SceneKey kTextureFile =
    alternative(1, required(value(ValueKind::text, "file", "Path of a PNG or JPEG file, relative to the scene.")));
inline constexpr SceneKey kTextureBytes =
    alternative(2, required(value(ValueKind::text, "png_base64", "The bytes of such a file, in base64.")));
inline constexpr SceneKey kWrap = usually<&Texture::wrap>(choice(
    "wrap", "How the image continues beyond its edges, horizontally and vertically: repeated, mirrored, or clamped to the edge.",
    EnumNames<TextureWrap>::kNames, 2));
inline constexpr std::array kTextureKeys{kTextureFile, kTextureBytes, kWrap};

// Materials
inline constexpr SceneKey kBaseColor = required(numbers(3, "base_color", "Linear red, green, blue.", kShares));
inline constexpr SceneKey kSemantic = value(
    ValueKind::integer, "semantic", "Class that cameras report. Default: the material's position in materials, counted from 1.",
    between(1, kSemanticStart - 1));
inline constexpr SceneKey kTexture = value(
    ValueKind::text, "texture", "A name listed in textures. Its colours are multiplied by base_color; only triangles show it.");
inline constexpr SceneKey kEmissive = usually<&Material::emissive>(
    numbers(3, "emissive",
            "Linear red, green, blue, shown in any light and added to the lit colour. On triangles it is multiplied by "
            "texture and colors.",
            Light::kBrightness));
inline constexpr SceneKey kAlphaCutoff = usually<&Material::alpha_cutoff>(number(
    "alpha_cutoff",
    "Cameras see through triangles, and the sun shines through, if the texture's alpha, from 0 to 1, is below this.", kShares));
inline constexpr std::array kMaterialKeys{kBaseColor, kSemantic, kTexture, kEmissive, kAlphaCutoff};

// Solids
inline constexpr std::array kRoomKeys{kMin, kMax, kMaterial};

inline constexpr SceneKey kPillarCenter = required(numbers(2, "center", "x, y.", kCoordinates, "m"));
inline constexpr SceneKey kPillarEnds = numbers(2, "z", "Low and high end; those of the room if left out.", kCoordinates, "m");
inline constexpr std::array kPillarKeys{kPillarCenter, kRadius, kPillarEnds, kMaterial, kVisible, kSolid};

inline constexpr std::array kRoundKeys{kCenter, kRadius, kHeight, kRotation, kMaterial, kVisible, kSolid};

inline constexpr SceneKey kBoxSize = required(numbers(3, "size", "Full lengths along local x, y, z.", kLengths, "m"));
inline constexpr std::array kBoxKeys{kCenter, kBoxSize, kRotation, kMaterial, kVisible, kSolid};

inline constexpr std::array kSphereKeys{kCenter, kRadius, kMaterial, kVisible, kSolid};

inline constexpr SceneKey kPlaneSize = required(numbers(2, "size", "Full lengths along local x, y.", kLengths, "m"));
inline constexpr std::array kPlaneKeys{kCenter, kPlaneSize, kRotation, kMaterial, kVisible, kSolid};

inline constexpr std::array kDiscKeys{kCenter, kRadius, kRotation, kMaterial, kVisible, kSolid};

// Gates
inline constexpr SceneKey kGateShape =
    usually<&Gate::shape>(choice("shape", "Shape of the opening and the frame.", EnumNames<GateShape>::kNames));
inline constexpr SceneKey kGateSize =
    usually<&Gate::size>(number("size", "Inside width of a square, inside diameter of a ring.", kLengths, "m"));
inline constexpr SceneKey kGateBar = usually<&Gate::bar>(number("bar", "Thickness of the frame's bars.", kLengths, "m"));
inline constexpr std::array kGateKeys{kGateShape, kCenter, kRotation, kGateSize, kGateBar, kMaterial, kVisible, kSolid};

// Meshes
inline constexpr SceneKey kMeshFile = alternative(
    1,
    required(value(ValueKind::text, "file",
                   "Path of an OBJ or PLY file, relative to the scene. If material is omitted, an OBJ file uses the materials of "
                   "its MTL files, except those that the scene also defines. Its vt become uv.")));
inline constexpr SceneKey kVertices =
    alternative(2, required(list_of(numbers(3, "vertices", "x, y, z of each vertex.", kCoordinates, "m"))));
constexpr SceneKey index_triples(std::string_view name, const char* about) {
  SceneKey key = value(ValueKind::index, name, about);
  key.size = 3;
  return list_of(key);
}
inline constexpr SceneKey kTriangles = alternative(
    2, required(index_triples(
           "triangles", "Vertex indices from 0, counter-clockwise seen from outside. Triangles without an area are refused.")));
inline constexpr SceneKey kUv = alternative(
    2, list_of(numbers(2, "uv",
                       "One per vertex, a place in the texture: [0, 0] is its upper left corner, [1, 1] its lower right one.",
                       kCoordinates)));
inline constexpr SceneKey kColors = alternative(
    2,
    list_of(numbers(3, "colors",
                    "One per vertex, linear red, green, blue: base_color and emissive are multiplied by them. White if left out.",
                    kShares)));
inline constexpr SceneKey kPosition =
    numbers(3, "position", "Position of the mesh's origin. Default: the world's origin.", kCoordinates, "m");
inline constexpr SceneKey kScale = [] {
  SceneKey key = number("scale", "Factor of all coordinates of the mesh, before rotation and position.", kSizes);
  key.usual = [] { return std::string("1"); };
  return key;
}();
inline constexpr SceneKey kMeshMaterial =
    value(ValueKind::text_or_texts, "material", "One name for all triangles, or an array with a name for each.");
inline constexpr std::array kMeshKeys{kMeshFile, kVertices, kTriangles,    kUv,      kColors, kPosition,
                                      kRotation, kScale,    kMeshMaterial, kVisible, kSolid};

// Markers
inline constexpr SceneKey kMarkerRadius =
    usually<&Markers::radius>(number("radius", "Radius at which markers are drawn.", kSizes, "m"));
inline constexpr SceneKey kStart = numbers(3, "start", "x, y, z.", kCoordinates, "m");
inline constexpr SceneKey kWaypoints =
    list_of(numbers(3, "waypoints", "x, y, z of each, in the order of flight.", kCoordinates, "m"));
inline constexpr SceneKey kGoal = numbers(3, "goal", "x, y, z.", kCoordinates, "m");
inline constexpr SceneKey kLow = required(numbers(3, "min", "Least corner.", kCoordinates, "m"));
inline constexpr SceneKey kHigh = required(numbers(3, "max", "Greatest corner, at least min.", kCoordinates, "m"));
inline constexpr std::array kSpawnBoxKeys{kLow, kHigh};
inline constexpr SceneKey kSpawnBox = object("spawn_box", "The box in which a task may start drones at random.", kSpawnBoxKeys);
inline constexpr std::array kMarkerKeys{kMarkerRadius, kStart, kWaypoints, kGoal, kSpawnBox};

// The light: the fields of Light
template <std::size_t kIndex>
constexpr SceneKey light_key() {
  constexpr auto kField = std::get<kIndex>(kFields<Light>);
  return {.name = kField.name,
          .info = kField.info,
          .size = std::is_same_v<decltype(kField.member), float Light::*> ? 0U : 3U,
          .usual = &default_of<kField.member>};
}
inline constexpr auto kLightKeys = []<std::size_t... kIndex>(std::index_sequence<kIndex...>) {
  return std::array{light_key<kIndex>()...};
}(std::make_index_sequence<std::tuple_size_v<decltype(Light::fields())>>());

// The scene
inline constexpr SceneKey kVersion = required(value(ValueKind::version, "flockstep_scene", "Version of the format."));
inline constexpr SceneKey kSchema = value(ValueKind::anything, "$schema", "Address of the schema, for editors.");
inline constexpr SceneKey kName =
    usually<&SceneDescription::name>(value(ValueKind::text, "name", "Shown in messages and pictures."));
inline constexpr SceneKey kTextures =
    by_name(object("textures", "Images by name. They colour triangles.", kTextureKeys), kMaxTextures);
inline constexpr SceneKey kMaterials = by_name(object("materials", "Materials by name.", kMaterialKeys), kMaxMaterials);
inline constexpr SceneKey kRoom = object("room", "The inside of a box: floor, walls and ceiling, hit from within.", kRoomKeys);
inline constexpr SceneKey kPillars =
    list_of(object("pillars", "Upright cylinders from the floor of the room to its ceiling, or from z[0] to z[1].", kPillarKeys));
inline constexpr SceneKey kCylinders = list_of(object("cylinders", "Cylinders with flat caps; the axis is local z.", kRoundKeys));
inline constexpr SceneKey kBoxes = list_of(object("boxes", "Boxes.", kBoxKeys));
inline constexpr SceneKey kSpheres = list_of(object("spheres", "Spheres.", kSphereKeys));
inline constexpr SceneKey kCapsules =
    list_of(object("capsules", "Cylinders with round caps at both ends; the axis is local z.", kRoundKeys));
inline constexpr SceneKey kPlanes =
    list_of(object("planes", "Rectangles of no thickness, normal to local z, seen and hit from both sides.", kPlaneKeys));
inline constexpr SceneKey kDiscs =
    list_of(object("discs", "Discs of no thickness, normal to local z, seen and hit from both sides.", kDiscKeys));
inline constexpr SceneKey kGates = list_of(
    object(
        "gates",
        "Openings with a frame, in the order of flight. Drones pass a gate along its local x; local z is up. The frame is four "
        "boxes or a ring of 16 capsules.",
        kGateKeys),
    kMaxGates);
inline constexpr SceneKey kMeshes = list_of(
    object(
        "meshes",
        "Triangles from an OBJ or PLY file, or given here; scaled, then rotated, then moved. Each mesh is one object to cameras.",
        kMeshKeys),
    kMaxObjects);
inline constexpr SceneKey kBodies = list_of(
    value(ValueKind::config, "bodies", "Solids that move, with the fields of BodyConfig. Every env in this world has them."),
    kMaxBodies);
inline constexpr SceneKey kMarkers =
    object("markers", "Named places. Nothing collides with them and no LiDAR sees them.", kMarkerKeys);
inline constexpr SceneKey kLight = object("light", "Sun and sky, as cameras see them.", kLightKeys);
inline constexpr std::array kSceneKeys{kVersion, kSchema,    kName,   kTextures, kMaterials, kRoom,
                                       kPillars, kCylinders, kBoxes,  kSpheres,  kCapsules,  kPlanes,
                                       kDiscs,   kGates,     kMeshes, kBodies,   kMarkers,   kLight};

}  // namespace keys

}  // namespace flockstep
