// Runs the SIMD kernels on a chosen target, or a check on each.
#pragma once

#include <hwy/targets.h>

#include <cstdint>

#include "standard.hpp"

namespace flockstep::testing {

// Dispatches all SIMD kernels to one target during its lifetime.
class OnTarget {
 public:
  explicit OnTarget(std::int64_t target) { hwy::GetChosenTarget().Update(target); }
  ~OnTarget() { hwy::GetChosenTarget().Update(hwy::SupportedTargets()); }
  OnTarget(const OnTarget&) = delete;
  OnTarget& operator=(const OnTarget&) = delete;
};

// Runs a check on every SIMD target.
template <class Check>
void on_every_target(const Check& check) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    const OnTarget on(target);
    check();
  }
}

}  // namespace flockstep::testing
