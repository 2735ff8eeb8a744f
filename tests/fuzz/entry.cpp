// Entry point of a libFuzzer program for a single target, FLOCKSTEP_FUZZ.
#include <cstddef>
#include <cstdint>

#include "fuzz/targets.hpp"

extern "C" int LLVMFuzzerTestOneInput(const std::uint8_t* data, std::size_t size) {
  flockstep::fuzz::FLOCKSTEP_FUZZ({data, size});
  return 0;
}
