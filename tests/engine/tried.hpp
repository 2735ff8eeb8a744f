// How often a promise is tried. The suite tries it some thousand times; ./dev try, by FLOCKSTEP_TRY, so many times as often.
#pragma once

#include <gtest/gtest.h>

#include <algorithm>
#include <cstdlib>
#include <string>

namespace flockstep::testing {

// count, or FLOCKSTEP_TRY times as many.
inline long times_tried(long count) {
  const char* const factor = std::getenv("FLOCKSTEP_TRY");
  return factor == nullptr ? count : count * std::max(1L, std::atol(factor));
}

// The part that is tried, from 0; FLOCKSTEP_TRY_PART. Each has seeds of its own, so that the counts of several add up.
inline unsigned part_tried() {
  const char* const part = std::getenv("FLOCKSTEP_TRY_PART");
  return part == nullptr ? 0U : static_cast<unsigned>(std::max(0L, std::atol(part)));
}

// Notes in the test's report how often it has tried: bench/tried.py reads it there.
inline void tried(const std::string& what, long count) {
  ::testing::Test::RecordProperty("tried_" + what, std::to_string(count));
}

}  // namespace flockstep::testing
