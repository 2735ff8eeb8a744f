// TapeMemory: the memory of a Tape, which knows a SIMD target. One per thread, kept from one use to the next.
#pragma once

#include <cstdint>
#include <vector>

#include "flockstep/aligned.hpp"

namespace flockstep {

template <class T>
struct TapeMemory {
  struct Operands {
    std::uint32_t a, b;
  };
  AlignedVector<T> partials, derivatives;
  std::vector<Operands> operands;
};

}  // namespace flockstep
