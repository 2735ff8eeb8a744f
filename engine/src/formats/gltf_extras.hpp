// What flockstep puts into the `extras` of a glTF file, under "flockstep": that of which glTF has no word. With it a saved world
// loads back equal; without it, the file is what any viewer shows of it.
#pragma once

#include <cstdint>
#include <nlohmann/json.hpp>
#include <optional>
#include <vector>

#include "base/json_document.hpp"
#include "flockstep/world.hpp"

namespace flockstep {

inline constexpr const char* kGltfExtras = "flockstep";

// Beside it in the extras of nodes, true or false: what the node and all below it are there for.
inline constexpr const char* kGltfVisual = "visual_only";
inline constexpr const char* kGltfSolid = "collision_only";

// Of a node with a mesh, one of the two:
struct GltfNodeExtras {
  // The primitive that the mesh is gltf_tessellation() of, in the node's frame with z up. Half extents are 1 (0 across a plane or
  // a disc), so that the node's scale is its size; only capsules, whose shape a scale changes, have their own.
  std::optional<Primitive> primitive;
  // The number that TriangleMesh::objects has for the mesh. Its primitives of glTF share vertices then, and all keep their uv.
  std::optional<std::uint16_t> object;
  // Of which of its primitives, and how many at a time, the triangles of the mesh come: first, number, next, number, ... Empty
  // where they come primitive by primitive.
  std::vector<std::uint32_t> order;
};

// Of the default scene.
struct GltfSceneExtras {
  Light light;
  Markers markers;  // radius and spawn box alone: the others are nodes
};

// `extras` is the field of that name of a node or a scene. Throw std::invalid_argument naming the field, what was expected and
// what came; what is not under kGltfExtras may be anything.
GltfNodeExtras read_gltf_node_extras(const json::JsonField& extras);
std::optional<GltfSceneExtras> read_gltf_scene_extras(const json::JsonField& extras);

nlohmann::ordered_json write_gltf_extras(const GltfNodeExtras& extras);
nlohmann::ordered_json write_gltf_extras(const GltfSceneExtras& extras);

// Of a primitive of such extras, which has about a thousand triangles at most. The reader compares, so it must not change: a
// primitive of older files would be taken for a mesh that somebody has edited.
TriangleMesh gltf_tessellation(const Primitive& primitive);

}  // namespace flockstep
