// The keys of scene files. This is the only place for each key's type, limits, unit, default and meaning: the reader and the
// checks of a SceneDescription use these lists, and bindings/scene_keys.py generates scenes/schema.json and the table of
// docs/conventions.md from them.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <span>
#include <string>
#include <string_view>
#include <tuple>
#include <type_traits>

#include "flockstep/fields.hpp"
#include "flockstep/limits.hpp"
#include "flockstep/pose.hpp"
#include "flockstep/world.hpp"
#include "world/scene_description.hpp"

namespace flockstep {

enum class ValueKind : std::uint8_t {
  anything,       // not read
  version,        // the number kSceneVersion
  text,           //
  text_or_texts,  // one text, or an array of them
  flag,           // true or false; true by default
  number,         //
  integer,        //
  index,          // an integer >= 0
  direction,      // numbers, not all 0
  choice,         // one of a few texts
  object,         // nested keys
  config,         // an object with the fields of a configuration; docs/configs.md lists them
};
template <>
struct EnumNames<ValueKind> {
  static constexpr std::array kNames{"anything", "version", "text",      "text_or_texts", "flag",   "number",
                                     "integer",  "index",   "direction", "choice",        "object", "config"};
};

// Number of values that a key holds.
enum class ValueCount : std::uint8_t { one, list, by_name };
template <>
struct EnumNames<ValueCount> {
  static constexpr std::array kNames{"one", "list", "by_name"};
};

struct SceneKey {
  std::string_view name;
  std::string_view meaning;  // a sentence
  ValueKind kind = ValueKind::number;
  Limits limits;                         // limits of each number
  bool or_zero = false;                  // 0 is allowed in addition to the limits
  std::size_t size = 0;                  // array length of a value; 0: not an array
  ValueCount count = ValueCount::one;    //
  std::size_t most = 0;                  // largest size of a list or a map; 0: no limit
  std::string_view unit;                 //
  std::string (*usual)() = nullptr;      // default as JSON; null: no default
  bool is_required = false;              // with `alternative`: required if another key of it is present
  std::uint8_t alternative = 0;          // only keys of one alternative may be present; 0: no alternative
  std::span<const SceneKey> keys;        // keys of an object
  std::span<const char* const> choices;  // names of a choice
};

inline constexpr int kSceneVersion = 1;

// Formats values for SceneKey::usual.
std::string as_json(const std::string& text);
std::string as_json(float value);
std::string as_json(const std::array<float, 3>& values);
std::string as_json(const std::array<TextureWrap, 2>& wrap);
std::string as_json(GateShape shape);

// Returns all keys as a JSON array of objects.
std::string scene_keys_as_json();

// Describes the allowed values: "a number in [1, 4]", "0 or a number in [0.1, 45]", or "numbers in [0, 1]" for an array.
std::string text_of_values(const SceneKey& key);

// Returns true if the float32 can be the rounded value of an allowed number.
constexpr bool allows(const SceneKey& key, float value) {
  const Limits& limits = key.limits;
  return (value >= static_cast<float>(limits.least) && value <= static_cast<float>(limits.greatest)) ||
         (key.or_zero && value == 0.0F);
}

namespace keys {

constexpr SceneKey list_of(std::string_view name, std::string_view meaning, std::span<const SceneKey> keys,
                           std::size_t most = 0) {
  return {.name = name, .meaning = meaning, .kind = ValueKind::object, .count = ValueCount::list, .most = most, .keys = keys};
}

// Returns the key of a light's field.
template <auto kMember>
constexpr SceneKey light_key() {
  SceneKey key;
  const auto take = [&]<class Value>(const FieldPointer<Light, Value>& field) {
    if constexpr (std::is_same_v<Value Light::*, decltype(kMember)>) {
      if (field.member != kMember) return;
      key = {.name = field.name,
             .meaning = field.info.about,
             .limits = field.info.limits,
             .size = std::is_same_v<Value, float> ? 0U : 3U,
             .unit = field.info.unit,
             .usual = [] { return as_json(Light().*kMember); }};
    }
  };
  std::apply([&](const auto&... fields) { (take(fields), ...); }, kFields<Light>);
  return key;
}

inline constexpr Limits kCoordinates = within(kMaxCoordinate);
inline constexpr Limits kSizes = between(kMinSize, kMaxCoordinate);
inline constexpr Limits kLengths = between(2.0 * kMinSize, 2.0 * kMaxCoordinate);  // half of a length is a size
inline constexpr Limits kCorners = within(kMaxCorner);
inline constexpr Limits kShares = between(0.0, 1.0);

// Keys of several objects
inline constexpr SceneKey kCenter{
    .name = "center", .meaning = "x, y, z.", .limits = kCoordinates, .size = 3, .unit = "m", .is_required = true};
inline constexpr SceneKey kRadius{.name = "radius", .meaning = "The radius.", .limits = kSizes, .unit = "m", .is_required = true};
inline constexpr SceneKey kHeight{.name = "height",
                                  .meaning = "Length along local z. A capsule's includes its caps: at least twice the radius.",
                                  .limits = kLengths,
                                  .unit = "m",
                                  .is_required = true};
inline constexpr SceneKey kRotation{
    .name = "quat_wxyz",
    .meaning = "Rotation (w, x, y, z) from local to world, of norm 1 within 1e-3; the identity if left out.",
    .limits = kCoordinates,
    .size = 4};
inline constexpr SceneKey kMaterial{.name = "material",
                                    .meaning =
                                        "A name listed in materials. If omitted, the material \"default\", which is "
                                        "light grey unless the scene defines it.",
                                    .kind = ValueKind::text};
inline constexpr SceneKey kVisible{
    .name = "visible", .meaning = "True if cameras, LiDARs and rays see it.", .kind = ValueKind::flag};
inline constexpr SceneKey kSolid{
    .name = "solid",
    .meaning = "True if drones hit it and planners go around it. At least one of visible and solid is true.",
    .kind = ValueKind::flag};
inline constexpr SceneKey kMin{
    .name = "min", .meaning = "Least corner.", .limits = kCorners, .size = 3, .unit = "m", .is_required = true};
inline constexpr SceneKey kMax{
    .name = "max", .meaning = "Greatest corner, above min.", .limits = kCorners, .size = 3, .unit = "m", .is_required = true};

// Textures
inline constexpr SceneKey kTextureFile{.name = "file",
                                       .meaning = "Path of a PNG or JPEG file, relative to the scene.",
                                       .kind = ValueKind::text,
                                       .is_required = true,
                                       .alternative = 1};
inline constexpr SceneKey kTextureBytes{.name = "png_base64",
                                        .meaning = "The bytes of such a file, in base64.",
                                        .kind = ValueKind::text,
                                        .is_required = true,
                                        .alternative = 2};
inline constexpr SceneKey kWrap{.name = "wrap",
                                .meaning =
                                    "How the image continues beyond its edges, horizontally and vertically: "
                                    "repeated, mirrored, or clamped to the edge.",
                                .kind = ValueKind::choice,
                                .size = 2,
                                .usual = [] { return as_json(Texture().wrap); },
                                .choices = EnumNames<TextureWrap>::kNames};
inline constexpr std::array kTextureKeys{kTextureFile, kTextureBytes, kWrap};

// Materials
inline constexpr SceneKey kBaseColor{
    .name = "base_color", .meaning = "Linear red, green, blue.", .limits = kShares, .size = 3, .is_required = true};
inline constexpr SceneKey kSemantic{.name = "semantic",
                                    .meaning =
                                        "Class that cameras report. Default: the material's position in materials, "
                                        "counted from 1.",
                                    .kind = ValueKind::integer,
                                    .limits = between(1, kSemanticStart - 1)};
inline constexpr SceneKey kTexture{.name = "texture",
                                   .meaning =
                                       "A name listed in textures. Its colours are multiplied by base_color; only triangles "
                                       "show it.",
                                   .kind = ValueKind::text};
inline constexpr SceneKey kEmissive{.name = "emissive",
                                    .meaning =
                                        "Linear red, green, blue, shown in any light and added to the lit colour. On triangles "
                                        "it is multiplied by texture and colors.",
                                    .limits = Light::kBrightness,
                                    .size = 3,
                                    .usual = [] { return as_json(Material().emissive); }};
inline constexpr SceneKey kAlphaCutoff{.name = "alpha_cutoff",
                                       .meaning =
                                           "Cameras see through triangles, and the sun shines through, if the texture's "
                                           "alpha, from 0 to 1, is below this.",
                                       .limits = kShares,
                                       .usual = [] { return as_json(Material().alpha_cutoff); }};
inline constexpr std::array kMaterialKeys{kBaseColor, kSemantic, kTexture, kEmissive, kAlphaCutoff};

// Solids
inline constexpr std::array kRoomKeys{kMin, kMax, kMaterial};

inline constexpr SceneKey kPillarCenter{
    .name = "center", .meaning = "x, y.", .limits = kCoordinates, .size = 2, .unit = "m", .is_required = true};
inline constexpr SceneKey kPillarEnds{
    .name = "z", .meaning = "Low and high end; those of the room if left out.", .limits = kCoordinates, .size = 2, .unit = "m"};
inline constexpr std::array kPillarKeys{kPillarCenter, kRadius, kPillarEnds, kMaterial, kVisible, kSolid};

inline constexpr std::array kRoundKeys{kCenter, kRadius, kHeight, kRotation, kMaterial, kVisible, kSolid};

inline constexpr SceneKey kBoxSize{.name = "size",
                                   .meaning = "Full lengths along local x, y, z.",
                                   .limits = kLengths,
                                   .size = 3,
                                   .unit = "m",
                                   .is_required = true};
inline constexpr std::array kBoxKeys{kCenter, kBoxSize, kRotation, kMaterial, kVisible, kSolid};

inline constexpr std::array kSphereKeys{kCenter, kRadius, kMaterial, kVisible, kSolid};

inline constexpr SceneKey kPlaneSize{
    .name = "size", .meaning = "Full lengths along local x, y.", .limits = kLengths, .size = 2, .unit = "m", .is_required = true};
inline constexpr std::array kPlaneKeys{kCenter, kPlaneSize, kRotation, kMaterial, kVisible, kSolid};

inline constexpr std::array kDiscKeys{kCenter, kRadius, kRotation, kMaterial, kVisible, kSolid};

// Gates
inline constexpr SceneKey kGateShape{.name = "shape",
                                     .meaning = "Shape of the opening and the frame.",
                                     .kind = ValueKind::choice,
                                     .usual = [] { return as_json(Gate().shape); },
                                     .choices = EnumNames<GateShape>::kNames};
inline constexpr SceneKey kGateSize{.name = "size",
                                    .meaning = "Inside width of a square, inside diameter of a ring.",
                                    .limits = kLengths,
                                    .unit = "m",
                                    .usual = [] { return as_json(Gate().size); }};
inline constexpr SceneKey kGateBar{
    .name = "bar", .meaning = "Thickness of the frame's bars.", .limits = kLengths, .unit = "m", .usual = [] {
      return as_json(Gate().bar);
    }};
inline constexpr std::array kGateKeys{kGateShape, kCenter, kRotation, kGateSize, kGateBar, kMaterial, kVisible, kSolid};

// Meshes
inline constexpr SceneKey kMeshFile{.name = "file",
                                    .meaning =
                                        "Path of an OBJ or PLY file, relative to the scene. If material is omitted, an "
                                        "OBJ file uses the materials of its MTL files, except those that the scene also "
                                        "defines. Its vt become uv.",
                                    .kind = ValueKind::text,
                                    .is_required = true,
                                    .alternative = 1};
inline constexpr SceneKey kVertices{.name = "vertices",
                                    .meaning = "x, y, z of each vertex.",
                                    .limits = kCoordinates,
                                    .size = 3,
                                    .count = ValueCount::list,
                                    .unit = "m",
                                    .is_required = true,
                                    .alternative = 2};
inline constexpr SceneKey kTriangles{.name = "triangles",
                                     .meaning =
                                         "Vertex indices from 0, counter-clockwise seen from outside. Triangles without "
                                         "an area are refused.",
                                     .kind = ValueKind::index,
                                     .size = 3,
                                     .count = ValueCount::list,
                                     .is_required = true,
                                     .alternative = 2};
inline constexpr SceneKey kUv{.name = "uv",
                              .meaning =
                                  "One per vertex, a place in the texture: [0, 0] is its upper left corner, [1, 1] its "
                                  "lower right one.",
                              .limits = kCoordinates,
                              .size = 2,
                              .count = ValueCount::list,
                              .alternative = 2};
inline constexpr SceneKey kColors{.name = "colors",
                                  .meaning =
                                      "One per vertex, linear red, green, blue: base_color and emissive are multiplied by "
                                      "them. White if left out.",
                                  .limits = kShares,
                                  .size = 3,
                                  .count = ValueCount::list,
                                  .alternative = 2};
inline constexpr SceneKey kPosition{.name = "position",
                                    .meaning = "Position of the mesh's origin. Default: the world's origin.",
                                    .limits = kCoordinates,
                                    .size = 3,
                                    .unit = "m"};
inline constexpr SceneKey kScale{.name = "scale",
                                 .meaning = "Factor of all coordinates of the mesh, before rotation and position.",
                                 .limits = kSizes,
                                 .usual = [] { return std::string("1"); }};
inline constexpr SceneKey kMeshMaterial{.name = "material",
                                        .meaning = "One name for all triangles, or an array with a name for each.",
                                        .kind = ValueKind::text_or_texts};
inline constexpr std::array kMeshKeys{kMeshFile, kVertices, kTriangles,    kUv,      kColors, kPosition,
                                      kRotation, kScale,    kMeshMaterial, kVisible, kSolid};

// Markers
inline constexpr SceneKey kMarkerRadius{
    .name = "radius", .meaning = "Radius at which markers are drawn.", .limits = kSizes, .unit = "m", .usual = [] {
      return as_json(Markers().radius);
    }};
inline constexpr SceneKey kStart{.name = "start", .meaning = "x, y, z.", .limits = kCoordinates, .size = 3, .unit = "m"};
inline constexpr SceneKey kWaypoints{.name = "waypoints",
                                     .meaning = "x, y, z of each, in the order of flight.",
                                     .limits = kCoordinates,
                                     .size = 3,
                                     .count = ValueCount::list,
                                     .unit = "m"};
inline constexpr SceneKey kGoal{.name = "goal", .meaning = "x, y, z.", .limits = kCoordinates, .size = 3, .unit = "m"};
inline constexpr SceneKey kLow{
    .name = "min", .meaning = "Least corner.", .limits = kCoordinates, .size = 3, .unit = "m", .is_required = true};
inline constexpr SceneKey kHigh{.name = "max",
                                .meaning = "Greatest corner, at least min.",
                                .limits = kCoordinates,
                                .size = 3,
                                .unit = "m",
                                .is_required = true};
inline constexpr std::array kSpawnBoxKeys{kLow, kHigh};
inline constexpr SceneKey kSpawnBox{.name = "spawn_box",
                                    .meaning = "The box in which a task may start drones at random.",
                                    .kind = ValueKind::object,
                                    .keys = kSpawnBoxKeys};
inline constexpr std::array kMarkerKeys{kMarkerRadius, kStart, kWaypoints, kGoal, kSpawnBox};

// The light
constexpr SceneKey light_key_or_zero(SceneKey key, double least) {
  key.limits.least = least;
  key.or_zero = true;
  return key;
}
constexpr SceneKey direction_key(SceneKey key) {
  key.kind = ValueKind::direction;
  return key;
}
inline constexpr SceneKey kSunDirection = direction_key(light_key<&Light::sun_direction>());
inline constexpr SceneKey kSunColor = light_key<&Light::sun_color>();
inline constexpr SceneKey kSkyAmbient = light_key<&Light::sky_ambient>();
inline constexpr SceneKey kGroundAmbient = light_key<&Light::ground_ambient>();
inline constexpr SceneKey kZenithColor = light_key<&Light::zenith_color>();
inline constexpr SceneKey kHorizonColor = light_key<&Light::horizon_color>();
inline constexpr SceneKey kGamma = light_key<&Light::gamma>();
// The least radius is resolvable by float32 directions.
inline constexpr SceneKey kSunRadius = light_key_or_zero(light_key<&Light::sun_radius_deg>(), 0.1);
inline constexpr SceneKey kSunGlow = light_key<&Light::sun_glow>();
inline constexpr SceneKey kFogVisibility = light_key_or_zero(light_key<&Light::fog_visibility_m>(), 0.1);
inline constexpr std::array kLightKeys{kSunDirection, kSunColor, kSkyAmbient, kGroundAmbient, kZenithColor,
                                       kHorizonColor, kGamma,    kSunRadius,  kSunGlow,       kFogVisibility};

// The scene
inline constexpr SceneKey kVersion{
    .name = "flockstep_scene", .meaning = "Version of the format.", .kind = ValueKind::version, .is_required = true};
inline constexpr SceneKey kSchema{
    .name = "$schema", .meaning = "Address of the schema, for editors.", .kind = ValueKind::anything};
inline constexpr SceneKey kName{
    .name = "name", .meaning = "Shown in messages and pictures.", .kind = ValueKind::text, .usual = [] {
      return as_json(SceneDescription().name);
    }};
inline constexpr SceneKey kTextures{.name = "textures",
                                    .meaning = "Images by name. They colour triangles.",
                                    .kind = ValueKind::object,
                                    .count = ValueCount::by_name,
                                    .most = kMaxTextures,
                                    .keys = kTextureKeys};
inline constexpr SceneKey kMaterials{.name = "materials",
                                     .meaning = "Materials by name.",
                                     .kind = ValueKind::object,
                                     .count = ValueCount::by_name,
                                     .most = kMaxMaterials,
                                     .keys = kMaterialKeys};
inline constexpr SceneKey kRoom{.name = "room",
                                .meaning = "The inside of a box: floor, walls and ceiling, hit from within.",
                                .kind = ValueKind::object,
                                .keys = kRoomKeys};
inline constexpr SceneKey kPillars =
    list_of("pillars", "Upright cylinders from the floor of the room to its ceiling, or from z[0] to z[1].", kPillarKeys);
inline constexpr SceneKey kCylinders = list_of("cylinders", "Cylinders with flat caps; the axis is local z.", kRoundKeys);
inline constexpr SceneKey kBoxes = list_of("boxes", "Boxes.", kBoxKeys);
inline constexpr SceneKey kSpheres = list_of("spheres", "Spheres.", kSphereKeys);
inline constexpr SceneKey kCapsules =
    list_of("capsules", "Cylinders with round caps at both ends; the axis is local z.", kRoundKeys);
inline constexpr SceneKey kPlanes =
    list_of("planes", "Rectangles of no thickness, normal to local z, seen and hit from both sides.", kPlaneKeys);
inline constexpr SceneKey kDiscs =
    list_of("discs", "Discs of no thickness, normal to local z, seen and hit from both sides.", kDiscKeys);
inline constexpr SceneKey kGates = list_of("gates",
                                           "Openings with a frame, in the order of flight. Drones pass a gate along its local x; "
                                           "local z is up. The frame is four boxes or a ring of 16 capsules.",
                                           kGateKeys, kMaxGates);
inline constexpr SceneKey kMeshes = list_of("meshes",
                                            "Triangles from an OBJ or PLY file, or given here; scaled, then rotated, then moved. "
                                            "Each mesh is one object to cameras.",
                                            kMeshKeys, kMaxObjects);
inline constexpr SceneKey kBodies{.name = "bodies",
                                  .meaning = "Solids that move, with the fields of BodyConfig. Every env in this world has them.",
                                  .kind = ValueKind::config,
                                  .count = ValueCount::list,
                                  .most = kMaxBodies};
inline constexpr SceneKey kMarkers{.name = "markers",
                                   .meaning = "Named places. Nothing collides with them and no LiDAR sees them.",
                                   .kind = ValueKind::object,
                                   .keys = kMarkerKeys};
inline constexpr SceneKey kLight{
    .name = "light", .meaning = "Sun and sky, as cameras see them.", .kind = ValueKind::object, .keys = kLightKeys};
inline constexpr std::array kSceneKeys{kVersion, kSchema,    kName,   kTextures, kMaterials, kRoom,
                                       kPillars, kCylinders, kBoxes,  kSpheres,  kCapsules,  kPlanes,
                                       kDiscs,   kGates,     kMeshes, kBodies,   kMarkers,   kLight};

}  // namespace keys

// Members of a Light and their keys.
struct LightColor {
  const SceneKey& key;
  std::array<float, 3> Light::* member;
};
inline constexpr std::array<LightColor, 5> kLightColors{{{keys::kSunColor, &Light::sun_color},
                                                         {keys::kSkyAmbient, &Light::sky_ambient},
                                                         {keys::kGroundAmbient, &Light::ground_ambient},
                                                         {keys::kZenithColor, &Light::zenith_color},
                                                         {keys::kHorizonColor, &Light::horizon_color}}};
struct LightNumber {
  const SceneKey& key;
  float Light::* member;
};
inline constexpr std::array<LightNumber, 4> kLightNumbers{{{keys::kGamma, &Light::gamma},
                                                           {keys::kSunRadius, &Light::sun_radius_deg},
                                                           {keys::kSunGlow, &Light::sun_glow},
                                                           {keys::kFogVisibility, &Light::fog_visibility_m}}};

}  // namespace flockstep
