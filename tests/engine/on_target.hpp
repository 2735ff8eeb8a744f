// Runs the SIMD kernels on a chosen target.
#pragma once

#include <hwy/targets.h>

#include <cstdint>

namespace flockstep::testing {

// Dispatches all SIMD kernels to one target during its lifetime.
class OnTarget {
 public:
  explicit OnTarget(std::int64_t target) { hwy::GetChosenTarget().Update(target); }
  ~OnTarget() { hwy::GetChosenTarget().Update(hwy::SupportedTargets()); }
  OnTarget(const OnTarget&) = delete;
  OnTarget& operator=(const OnTarget&) = delete;
};

}  // namespace flockstep::testing
