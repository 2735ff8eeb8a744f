// Flockstep's entries in the `extras` of a glTF file, under "flockstep": everything that glTF itself cannot express. With them
// a saved world loads back equal. Without them, the file contains what any viewer shows.
#pragma once

#include <cstdint>
#include <memory>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

inline constexpr const char* kGltfExtras = "flockstep";

// Other boolean keys in the extras of nodes. They apply to the node and its descendants.
inline constexpr const char* kGltfVisual = "visual_only";
inline constexpr const char* kGltfSolid = "collision_only";
inline constexpr const char* kGltfBody = "body";  // key of read_gltf_body()

// Extras of a node with a mesh: a primitive, a gate or an object.
struct GltfNodeExtras {
  // The mesh is the gltf_tessellation() of this primitive, in the node's frame with z up. Half extents are 1 (0 across a plane
  // or a disc), so that the node's scale is the primitive's size. Only capsules have their own half extents, because a scale
  // changes their shape.
  std::optional<Primitive> primitive;
  // The object's number in TriangleMesh::objects. The glTF primitives of such a mesh share vertices, and all keep their uv.
  std::optional<std::uint16_t> object;
  // The mesh is the frame of this gate, in the node's frame with z up. Position, material and visibility are those of the node.
  std::optional<Gate> gate;
  // The order of the mesh's triangles, as runs from its glTF primitives: primitive, count, primitive, count, ... Empty if they
  // are ordered primitive by primitive.
  std::vector<std::uint32_t> order;
};

// Extras of the default scene.
struct GltfSceneExtras {
  Light light;
  Markers markers;  // only radius and spawn box; other markers are nodes
  std::vector<BodyConfig> bodies;
};

// `extras` is the field of that name of a node or a scene. Everything outside kGltfExtras is
// ignored. Throw std::invalid_argument that names the field, the expected value and the actual one.
GltfNodeExtras read_gltf_node_extras(const json::JsonField& extras);
std::optional<GltfSceneExtras> read_gltf_scene_extras(const json::JsonField& extras);

// Reads the entry that makes a node and its descendants a body: an object of the fields of BodyConfig that the node does not
// define, in the axes of a scene file. Throws as the functions above.
std::shared_ptr<const BodyConfig> read_gltf_body(const json::JsonField& body);

nlohmann::ordered_json write_gltf_extras(const GltfNodeExtras& extras);
nlohmann::ordered_json write_gltf_extras(const GltfSceneExtras& extras);

// Returns the mesh of a primitive in extras, with at most about a thousand triangles. The reader compares meshes with this, so
// it must not change: otherwise primitives of older files would be treated as edited meshes.
TriangleMesh gltf_tessellation(const Primitive& primitive);

// Returns the mesh of a gate's frame, for viewers. The reader does not use it.
TriangleMesh gltf_tessellation(const Gate& gate);

}  // namespace flockstep
