// Converts all primitives to triangles, for pictures, exports and triangle-only tools.
#pragma once

#include <vector>

#include "flockstep/world_builder.hpp"

namespace flockstep {

// Returns the triangles of the primitives in order, then those of the meshes. Vertices lie on the surfaces, and no point of a
// triangle is farther than chord_error_m from its surface. Triangles are counter-clockwise seen from free space: from outside a
// solid, from inside a room.
// Objects are numbered as in World::mesh(). If all_objects is given, it receives the same numbers, even if they exceed 16 bits.
// Throws std::invalid_argument unless chord_error_m is at least 1e-6.
TriangleMesh tessellate(const SceneDescription& description, float chord_error_m,
                        std::vector<std::int32_t>* all_objects = nullptr);

// Returns two triangles for each cell of a valid heightfield.
MeshPart grid_of(const Heightfield& field);

// Appends the bars of a gate's frame. The whole opening stays free: a square of side Gate::size, or a circle of that diameter.
void append_frame(const Gate& gate, std::vector<Primitive>& bars);

// Returns the primitives of a canonical description and the frames of its gates, sorted by kind. Returns nothing if there are no
// gates.
std::vector<Primitive> with_frames(const SceneDescription& description);

}  // namespace flockstep
