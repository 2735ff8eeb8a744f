// How messages say where the world ends.
#pragma once

#include <string>

#include "flockstep/limits.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

// in_world("finite coordinates") is "finite coordinates within +-1e+06 m".
inline std::string in_world(const char* what) { return std::string(what) + ' ' + within(kMaxCoordinate).text() + " m"; }

}  // namespace flockstep
