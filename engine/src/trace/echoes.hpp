// Echoes: what LiDARs read from the surfaces that their beams hit, besides distances.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <vector>

#include "flockstep/pose.hpp"
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

// Beams of one sensor, and what they have hit.
struct BeamHits {
  static constexpr float kNoCosine = -1.0F;

  Vec3 origin;                    // m, world frame
  Mat3 rotation;                  // sensor to world
  const float *x, *y, *z;         // (count + kRayPadding,) unit directions, sensor frame
  const float* ranges;            // (count,) m
  const std::int32_t* elements;   // (count,) as in RayBundle; bodies have the numbers that their Bodies give them
  const std::int32_t* triangles;  // (count,) numbers in the meshes of bodies; for these only
  // (count,) of the angles between beams and normals, if they are needed. Only for solids, and kNoCosine for those not traced
  // directly. What is here for other hits means nothing.
  const float* cosines;
  std::size_t count;

  BeamHits part(std::size_t first, std::size_t beams) const {
    return {origin,         rotation,         x + first,         y + first,       z + first,
            ranges + first, elements + first, triangles + first, cosines + first, beams};
  }
};

// Beams that return less are lost: their ranges become negative.
struct LeastReturn {
  float cosine = 0.0F, intensity = 0.0F;
};

// The places of the readings of beams, in rows. Null: not needed.
struct EchoRows {
  float* ranges;
  std::uint16_t *semantic, *instance;
  float* intensity;
  std::size_t width, stride;  // beams of a row, and from row to row
  bool needs_cosines;         // for the intensity, or to lose beams
  LeastReturn least;

  // Beams side by side from this one on.
  EchoRows part(std::size_t beam, std::size_t beams) const {
    const auto from = [at = beam / width * stride + beam % width](auto* values) {
      return values == nullptr ? nullptr : values + at;
    };
    return {from(ranges), from(semantic), from(instance), from(intensity), beams, beams, needs_cosines, least};
  }
};

// Textures and colours of vertices do not count.
struct Echoes {
  explicit Echoes(const World& world);

  Echo operator[](std::int32_t element) const {
    const auto entry = static_cast<std::size_t>(element + 1);
    return {ids[entry], reflectance[entry]};
  }

  // Returns false if a beam's reading follows from its element, distance and cosine, or is that of a triangle.
  bool needs_closer_look(const BeamHits& hits, std::size_t beam, bool needs_cosines) const {
    const std::int32_t element = hits.elements[beam];
    return element >= num_elements || (needs_cosines && element >= 0 && element < first_triangle && hits.cosines[beam] < 0.0F);
  }

  std::int32_t first_triangle, num_elements;
  // By element + 1, since the first entry is that of a miss. At least 2 kRayPadding entries: small tables are read as a whole.
  std::vector<std::int32_t> ids;
  std::vector<float> reflectance;
  std::vector<float> normal_x, normal_y, normal_z;  // of the triangles; unit, or 0 if the corners lie on a line
};

// Writes a row of beams that have hit the same surface. cosines: (hits.count + kRayPadding,)
void write_echo(const Echo& echo, const float* cosines, const BeamHits& hits, const EchoRows& to);

// A LiDAR that reads more than distances.
struct EchoReader {
  // Arrays of all beams. Null: not needed.
  std::uint16_t *semantic = nullptr, *instance = nullptr;
  float* intensity = nullptr;

  // Writes the beams that need a closer look. drone: as in EchoTarget
  virtual void look_closer(std::size_t drone, const BeamHits& hits, const EchoRows& to) = 0;

 protected:
  ~EchoReader() = default;
};

// The reader of some beams, if more than distances are needed.
struct EchoTarget {
  EchoReader* reader = nullptr;  // null: nothing
  std::size_t drone = 0;
  std::size_t first = 0;  // place of the first beam in the reader's arrays
  bool needs_cosines = false;
  LeastReturn least{};

  EchoTarget from(std::size_t beam) const {
    return reader == nullptr ? EchoTarget() : EchoTarget{reader, drone, first + beam, needs_cosines, least};
  }
  // Writes rows of beams, their ranges included. echoes: of their scene
  void write(const Echoes& echoes, const BeamHits& hits, float* ranges, std::size_t width, std::size_t stride) const;
};

}  // namespace flockstep::trace
