// BeamTargets: the world, bodies and drones around a LiDAR, and the surfaces that its beams hit.
#pragma once

#include <Eigen/Core>

#include "flockstep/pose.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"
#include "trace/scene.hpp"
#include "trace/tracer.hpp"

namespace flockstep::sensors {

struct BeamTargets {
  // Numbers bodies and drones after the elements of the world.
  BeamTargets(const trace::Scene& scene_in, const render::VisibleBodies& bodies_in, const trace::Bodies& drones_in);

  // Returns colour and ids of a hit, which is no miss. Textures and colours of vertices do not count.
  render::Surface surface(const trace::RayHit& hit) const;
  // Returns the cosine of the angle between a beam and the surface's normal at its hit. direction: unit. World frame.
  double incidence(const trace::RayHit& hit, const Eigen::Vector3d& point, const Eigen::Vector3d& direction) const;

  const trace::Scene& scene;
  render::VisibleBodies bodies;
  trace::Bodies drones;

 private:
  bool is_of_world(const trace::RayHit& hit) const { return hit.element < bodies.shapes.first_element; }
  bool is_drone(const trace::RayHit& hit) const { return hit.element >= drones.first_element; }
};

}  // namespace flockstep::sensors
