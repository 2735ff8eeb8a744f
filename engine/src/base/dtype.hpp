// Calls functions with the type of an array's values.
#pragma once

#include <cstdint>

#include "flockstep/buffer.hpp"

namespace flockstep {

// Calls f with a value of the C++ type of a DType, uint8_t for boolean: with_type(type, [&]<class T>(T) { ... }).
template <class F>
constexpr decltype(auto) with_type(DType type, const F& f) {
  switch (type) {
    case DType::boolean:
    case DType::uint8:
      return f(std::uint8_t());
    case DType::int32:
      return f(std::int32_t());
    case DType::int64:
      return f(std::int64_t());
    case DType::float32:
      return f(float());
    default:
      return f(double());
  }
}

}  // namespace flockstep
