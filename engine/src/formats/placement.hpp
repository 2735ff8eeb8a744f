// Where a file's points come to in the world.
#pragma once

#include <Eigen/Geometry>

#include "flockstep/world.hpp"

namespace flockstep {

// Throws std::invalid_argument naming the option.
void check_placement(const LoadOptions& options);

// From the file's coordinates to the world's, by a rotation, a scale and a translation. usual: the format's own axis, y or z.
Eigen::Affine3d placement(const LoadOptions& options, UpAxis usual);

// Whether the options move anything of a file with z up.
bool moves(const LoadOptions& options);

// A description of a file with z up, as the options want it.
SceneDescription placed(SceneDescription description, const LoadOptions& options);

}  // namespace flockstep
