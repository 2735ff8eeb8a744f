// Runs a check on every SIMD target.
#pragma once

#include "on_target.hpp"
#include "standard.hpp"

namespace flockstep::testing {

template <class Check>
void on_every_target(const Check& check) {
  for (const std::int64_t target : hwy::SupportedAndGeneratedTargets()) {
    SCOPED_TRACE(hwy::TargetName(target));
    const OnTarget on(target);
    check();
  }
}

}  // namespace flockstep::testing
