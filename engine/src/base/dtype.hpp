// Calls functions with the type of an array's values.
#pragma once

#include <cstdint>

#include "flockstep/buffer.hpp"

namespace flockstep {

// Returns f<T>(), a lambda [&]<class T>(). Booleans are bytes.
template <class F>
decltype(auto) with_type(DType type, const F& f) {
  switch (type) {
    case DType::int32:
      return f.template operator()<std::int32_t>();
    case DType::int64:
      return f.template operator()<std::int64_t>();
    case DType::float32:
      return f.template operator()<float>();
    case DType::float64:
      return f.template operator()<double>();
    default:
      return f.template operator()<std::uint8_t>();
  }
}

}  // namespace flockstep
