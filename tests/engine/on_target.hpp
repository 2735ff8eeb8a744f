// Running the SIMD kernels by one target after the other.
#pragma once

#include <hwy/targets.h>

#include <cstdint>

namespace flockstep::testing {

// Lets all that is dispatched be run by one SIMD target, until this goes.
class OnTarget {
 public:
  explicit OnTarget(std::int64_t target) { hwy::GetChosenTarget().Update(target); }
  ~OnTarget() { hwy::GetChosenTarget().Update(hwy::SupportedTargets()); }
  OnTarget(const OnTarget&) = delete;
  OnTarget& operator=(const OnTarget&) = delete;
};

}  // namespace flockstep::testing
