// Every primitive as triangles, for pictures, exports and triangle-only tools.
#pragma once

#include "flockstep/world.hpp"

namespace flockstep {

// The scene's primitives in order, then its triangle meshes. Vertices lie on the surfaces; no point of a triangle is farther than
// chord_error_m from them. Triangles are counter-clockwise seen from free space: outside a solid, inside a room.
// objects are numbered as World::mesh() says; all_objects, if given, becomes the same numbers whether or not they fit 16 bits.
// Throws std::invalid_argument unless chord_error_m is at least 1e-6.
TriangleMesh tessellate(const SceneDescription& description, float chord_error_m,
                        std::vector<std::int32_t>* all_objects = nullptr);

}  // namespace flockstep
