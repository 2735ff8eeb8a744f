// Echoes: what a LiDAR reads from the elements of a world, besides their distance.
#pragma once

#include <array>
#include <cstdint>
#include <vector>

#include "flockstep/world.hpp"

namespace flockstep::trace {

// A surface as beams read it, before angle and distance count.
struct Echo {
  std::int32_t ids;   // semantic id in the lower half of the bits, instance id in the upper one
  float reflectance;  // mean of the colour
};

inline Echo echo_of(const std::array<float, 3>& color, std::uint16_t semantic, std::uint16_t instance) {
  return {static_cast<std::int32_t>(std::uint32_t{instance} << 16 | semantic), (color[0] + color[1] + color[2]) / 3.0F};
}

// Textures and colours of vertices do not count.
struct Echoes {
  explicit Echoes(const World& world);

  Echo operator[](std::int32_t element) const {
    const auto entry = static_cast<std::size_t>(element + 1);
    return {ids[entry], reflectance[entry]};
  }

  std::int32_t first_triangle, num_elements;
  // By element + 1, since the first entry is that of a miss. At least 2 kRayPadding entries: small tables are read as a whole.
  std::vector<std::int32_t> ids;
  std::vector<float> reflectance;
  std::vector<float> normal_x, normal_y, normal_z;  // of the triangles; unit, or 0 if the corners lie on a line
};

}  // namespace flockstep::trace
