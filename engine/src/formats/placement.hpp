// Places the points of a file in the world.
#pragma once

#include <Eigen/Geometry>

#include "flockstep/world.hpp"

namespace flockstep {

// Throws std::invalid_argument that names the invalid option.
void check_placement(const LoadOptions& options);

// Returns the transform from the file's coordinates to the world's: rotation, scale and translation. `usual` is the default up
// axis of the format, y or z.
Eigen::Affine3d placement(const LoadOptions& options, UpAxis usual);

// Returns whether the options change anything in a file with z up.
bool moves(const LoadOptions& options);

// Transforms a body by a rotation that maps axes to axes, a scale and a translation.
void place_body(BodyConfig& body, const Eigen::Affine3d& place, double scale);

// Transforms the description of a file with z up as the options say.
SceneDescription placed(SceneDescription description, const LoadOptions& options);

}  // namespace flockstep
