// Describes the coordinate limit of the world in messages.
#pragma once

#include <string>

#include "flockstep/limits.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

// For example, in_world("finite coordinates") returns "finite coordinates within +-1e+06 m".
inline std::string in_world(const char* what) { return std::string(what) + ' ' + within(kMaxCoordinate).text() + " m"; }

}  // namespace flockstep
