// One target as a program of libFuzzer: FLOCKSTEP_FUZZ is its name.
#include <cstddef>
#include <cstdint>

#include "fuzz/targets.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  flockstep::fuzz::FLOCKSTEP_FUZZ({data, size});
  return 0;
}
