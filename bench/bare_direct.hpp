// Interface of the bare direct loop in bare_direct-inl.hpp.
#pragma once

#include <cstddef>

namespace bench {

enum class Kind { box, cylinder, sphere };  // a room is a box

struct Shape {
  Kind kind;
  bool turned;        // set if to_local is not the identity
  float center[3];    // m
  float half[3];      // m
  float bounds[3];    // m, half sizes of the bounding box
  float to_local[9];  // row-major
};

struct Sensors {
  std::size_t count;
  const float* position;   // (count, 3) m
  const float* rotation;   // (count, 3, 3) rotation from sensor to world
  std::size_t beams;       // beams per sensor
  const float *x, *y, *z;  // (beams,) plus up to 15 for padding, unit vectors in the sensor frame
  float range;             // m
  std::size_t stride;      // ranges per sensor, at least beams + 15
};

}  // namespace bench
