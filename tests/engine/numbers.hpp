// Constants that tests share.
#pragma once

#include <limits>

namespace flockstep::testing {

inline constexpr float kInfinity = std::numeric_limits<float>::infinity();  // range of a ray that hits nothing

}  // namespace flockstep::testing
