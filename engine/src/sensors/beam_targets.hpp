// BeamTargets: the world, bodies and drones around a LiDAR, and what its beams read from the surfaces that they hit.
#pragma once

#include <cstddef>
#include <cstdint>
#include <span>

#include "flockstep/pose.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"
#include "trace/echoes.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

// The traced beams of one drone, or some side by side. Spans of what is not needed are empty.
struct Scan {
  std::span<float> ranges;
  std::span<std::int32_t> elements, triangles;  // as in trace::HitRows
  std::span<float> intensity;                   // cosines as in trace::HitRows, until they are read
  std::span<std::uint16_t> semantic, instance;
  std::span<float> edges;  // ranges of the rays at the edges of the beams

  // True if a beam needs the closer look of BeamTargets::read().
  bool is_unread(std::size_t beam, const trace::Echoes& echoes) const {
    return elements[beam] >= echoes.num_elements || (elements[beam] >= 0 && !intensity.empty() && intensity[beam] < 0.0F);
  }
  void clear_outputs(std::size_t beam) const {
    if (!intensity.empty()) intensity[beam] = 0.0F;
    if (!semantic.empty()) semantic[beam] = 0;
    if (!instance.empty()) instance[beam] = 0;
  }
  // A part of the beams, without their hits, to be written.
  Scan outputs(std::size_t first, std::size_t count) const {
    const auto part = [&](const auto& all) { return all.empty() ? all : all.subspan(first, count); };
    return {.ranges = part(ranges), .intensity = part(intensity), .semantic = part(semantic), .instance = part(instance)};
  }
};

// Beams that return less are lost: their ranges become negative.
struct LeastReturn {
  float cosine = 0.0F, intensity = 0.0F;
};

// Directions of beams side by side, and where they have hit.
struct BeamRun {
  Vec3 origin;             // m, world frame
  Mat3 rotation;           // body to world
  const float *x, *y, *z;  // (count + trace::kRayPadding,) directions, body frame
  const float* ranges;     // (count,) m
  std::size_t count;       // at most trace::kMaxRays

  BeamRun part(std::size_t first, std::size_t beams) const {
    return {origin, rotation, x + first, y + first, z + first, ranges + first, beams};
  }
};

// Writes the cosines of the beams that have hit triangles of the world.
void write_triangle_cosines(const trace::Echoes& echoes, const BeamRun& run, const std::int32_t* elements, float* cosines);

// Reads all beams but those that need a closer look, of which it reads nothing. Returns true if there are some.
bool read_world(const trace::Echoes& echoes, const LeastReturn& least, const Scan& scan);

struct BeamTargets {
  // Numbers bodies and drones after the elements of the world.
  BeamTargets(const trace::Scene& scene_in, const render::VisibleBodies& bodies_in, const trace::Bodies& drones_in);

  // Reads beams that have hit the same thing. outputs: Scan::outputs() of them
  void read(std::int32_t element, std::int32_t triangle, const BeamRun& run, const LeastReturn& least, const Scan& outputs) const;

  const trace::Scene& scene;
  render::VisibleBodies bodies;
  trace::Bodies drones;

 private:
  bool is_of_world(std::int32_t element) const { return element < bodies.shapes.first_element; }
  bool is_drone(std::int32_t element) const { return element >= drones.first_element; }
  trace::Echo echo(std::int32_t element, std::int32_t triangle) const;
  // Writes the cosines of the angles between beams and the normals of what they have hit, unless that is a triangle of the world.
  void write_cosines(std::int32_t element, std::int32_t triangle, const BeamRun& run, trace::RayFloats& cosines) const;
};

}  // namespace flockstep::sensors
