// Number of trials of randomised tests. The suite runs some thousand; ./dev try multiplies them by FLOCKSTEP_TRY.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>

namespace flockstep::testing {

// Returns count times FLOCKSTEP_TRY, or count if it is not set.
inline long times_tried(long count) {
  const char* const factor = std::getenv("FLOCKSTEP_TRY");
  return factor == nullptr ? count : count * std::max(1L, std::atol(factor));
}

// Returns the index of the part to try, FLOCKSTEP_TRY_PART, which defaults to 0. Parts have different seeds, so their counts
// add up.
inline unsigned part_tried() {
  const char* const part = std::getenv("FLOCKSTEP_TRY_PART");
  return part == nullptr ? 0U : static_cast<unsigned>(std::max(0L, std::atol(part)));
}

// Records the number of trials in the test report, where bench/tried.py reads it.
inline void tried(const std::string& what, long count) {
  ::testing::Test::RecordProperty("tried_" + what, std::to_string(count));
}

}  // namespace flockstep::testing
