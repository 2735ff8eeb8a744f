// Describes coordinates and their limit in messages.
#pragma once

#include <sstream>
#include <string>

#include "flockstep/limits.hpp"
#include "flockstep/pose.hpp"

namespace flockstep {

// For example, in_world("finite coordinates") returns "finite coordinates within +-1e+06 m".
inline std::string in_world(const char* what) { return std::string(what) + ' ' + within(kMaxCoordinate).text() + " m"; }

// Returns "(1, 2, 3)".
template <class Vector>
std::string coordinates(const Vector& v) {
  std::ostringstream out;
  out << '(' << v.x() << ", " << v.y() << ", " << v.z() << ')';
  return out.str();
}

}  // namespace flockstep
