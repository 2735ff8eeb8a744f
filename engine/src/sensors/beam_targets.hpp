// BeamTargets: the world, bodies and drones around a LiDAR, and the surfaces that its beams hit.
#pragma once

#include <cstddef>

#include "flockstep/pose.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

// Neighbouring beams of a LiDAR that have hit the same thing.
struct BeamRun {
  Vec3 origin;             // m, world frame
  Mat3 rotation;           // body to world
  const float *x, *y, *z;  // (count + trace::kRayPadding,) directions, body frame
  const float* ranges;     // (count,) m
  std::size_t count;       // at most trace::kMaxRays
};

struct BeamTargets {
  // Numbers bodies and drones after the elements of the world.
  BeamTargets(const trace::Scene& scene_in, const render::VisibleBodies& bodies_in, const trace::Bodies& drones_in);

  // Returns colour and ids of a hit, which is no miss. Textures and colours of vertices do not count.
  render::Surface surface(const trace::RayHit& hit) const;
  // Writes the cosines of the angles between beams and the normals of the surface where they have hit it.
  void write_cosines(const trace::RayHit& hit, const BeamRun& run, trace::RayFloats& cosines) const;

  const trace::Scene& scene;
  render::VisibleBodies bodies;
  trace::Bodies drones;

 private:
  bool is_of_world(const trace::RayHit& hit) const { return hit.element < bodies.shapes.first_element; }
  bool is_drone(const trace::RayHit& hit) const { return hit.element >= drones.first_element; }
};

}  // namespace flockstep::sensors
