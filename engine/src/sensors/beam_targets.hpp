// BeamTargets: the world, bodies and drones around a LiDAR, and what its beams read from those that trace::Echoes do not list.
#pragma once

#include <cstddef>
#include <cstdint>

#include "render/appearance.hpp"
#include "trace/bodies.hpp"
#include "trace/echoes.hpp"
#include "trace/ray_block.hpp"
#include "trace/scene.hpp"

namespace flockstep::sensors {

struct BeamTargets {
  BeamTargets(const trace::Scene& scene_in, const render::VisibleBodies& bodies_in, const trace::Bodies& drones_in)
      : bodies(bodies_in), drones(drones_in) {
    put_into(scene_in);
  }

  // Puts the bodies and drones into another world. Numbers them after its elements.
  void put_into(const trace::Scene& other) {
    scene = &other;
    bodies.shapes.first_element = other.first_triangle() + static_cast<std::int32_t>(other.num_triangles());
    drones.first_element = bodies.shapes.first_element + static_cast<std::int32_t>(bodies.shapes.count);
  }

  // Reads the beams that need a closer look.
  void read(const trace::BeamHits& hits, const trace::EchoRows& to) const;

  const trace::Scene* scene;
  render::VisibleBodies bodies;
  trace::Bodies drones;

 private:
  bool is_of_world(std::int32_t element) const { return element < bodies.shapes.first_element; }
  bool is_drone(std::int32_t element) const { return element >= drones.first_element; }
  trace::Echo echo(std::int32_t element, std::int32_t triangle) const;
  // Writes the cosines of the angles between beams and the normals of what they have hit, unless that is a triangle of the world.
  void write_cosines(std::int32_t element, std::int32_t triangle, const trace::BeamHits& hits, trace::RayFloats& cosines) const;
};

}  // namespace flockstep::sensors
