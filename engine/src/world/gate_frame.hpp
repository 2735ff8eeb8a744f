// Frames of gates, as primitives.
#pragma once

#include <vector>

#include "flockstep/world.hpp"

namespace flockstep {

// Appends the bars of a gate's frame. The whole opening stays free: a square of side Gate::size, or a circle of that diameter.
void append_frame(const Gate& gate, std::vector<Primitive>& bars);

// Returns the primitives of a canonical description and the frames of its gates, sorted by kind. Returns nothing if there are no
// gates.
std::vector<Primitive> with_frames(const SceneDescription& description);

}  // namespace flockstep
