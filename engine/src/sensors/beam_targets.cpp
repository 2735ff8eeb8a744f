#include "sensors/beam_targets.hpp"

#include <cmath>
#include <cstddef>
#include <cstdint>

#include "flockstep/body.hpp"
#include "flockstep/world.hpp"
#include "world/surface_normal.hpp"

namespace flockstep::sensors {
namespace {

using Vec3d = Eigen::Vector3d;

std::size_t number_of(const trace::RayHit& hit, const trace::Bodies& among) {
  return static_cast<std::size_t>(hit.element - among.first_element);
}

const Material& material_of(const World& world, std::size_t triangle) {
  return world.materials()[world.triangles().materials[triangle]];
}

}  // namespace

BeamTargets::BeamTargets(const trace::Scene& scene_in, const render::VisibleBodies& bodies_in, const trace::Bodies& drones_in)
    : scene(scene_in), bodies(bodies_in), drones(drones_in) {
  bodies.shapes.first_element = scene.first_triangle() + static_cast<std::int32_t>(scene.num_triangles());
  drones.first_element = bodies.shapes.first_element + static_cast<std::int32_t>(bodies.shapes.count);
}

render::Surface BeamTargets::surface(const trace::RayHit& hit) const {
  if (is_of_world(hit)) {
    const World& world = scene.world();
    const auto element = static_cast<std::size_t>(hit.element), num_primitives = world.primitives().size();
    const bool is_primitive = element < num_primitives;
    const std::size_t triangle = element - num_primitives;  // for triangles
    const std::uint16_t material =
        is_primitive ? world.primitives()[element].material : world.triangles().materials[triangle];
    const std::size_t object = is_primitive ? element : num_primitives + world.triangles().objects[triangle];
    return {.color = world.materials()[material].base_color,
            .semantic = world.semantic(material),
            .instance = static_cast<std::uint16_t>(1 + object)};
  }
  if (is_drone(hit)) {
    return {.color = render::kHullColor,
            .semantic = kSemanticDrone,
            .instance = static_cast<std::uint16_t>(kFirstDroneInstance + number_of(hit, drones))};
  }
  const std::size_t number = number_of(hit, bodies.shapes);
  const render::BodySurface& body = bodies.surface(number);
  return {.color = body.mesh == nullptr ? body.color : material_of(**body.mesh, static_cast<std::size_t>(hit.triangle)).base_color,
          .semantic = body.semantic,
          .instance = bodies.instance(number)};
}

double BeamTargets::incidence(const trace::RayHit& hit, const Vec3d& point, const Vec3d& direction) const {
  if (is_of_world(hit)) {
    const World& world = scene.world();
    const auto element = static_cast<std::size_t>(hit.element), num_primitives = world.primitives().size();
    const Vec3d normal = element < num_primitives ? surface_normal(world.primitives()[element], point)
                                                  : triangle_normal(world.triangles(), element - num_primitives);
    return std::abs(normal.dot(direction));
  }
  if (is_drone(hit)) {
    const std::size_t number = number_of(hit, drones);
    const float* const q = drones.quat_wxyz + 4 * number;
    const Eigen::Matrix3d to_local = Quat(q[0], q[1], q[2], q[3]).cast<double>().toRotationMatrix().transpose();
    const Vec3d local = to_local * (point - Vec3::Map(drones.position + 3 * number).cast<double>());
    return std::abs(drones.common_hull->normal_at(local.cast<float>()).cast<double>().dot(to_local * direction));
  }
  const std::size_t number = number_of(hit, bodies.shapes);
  if (bodies.shapes.mesh(number) == nullptr) {
    return std::abs(surface_normal(trace::posed_solid(bodies.shapes, number), point).dot(direction));
  }
  const trace::PosedMesh mesh = trace::posed_mesh(bodies.shapes, number);
  const Vec3d normal = triangle_normal(mesh.scene->world().triangles(), static_cast<std::size_t>(hit.triangle));
  return std::abs(normal.dot(mesh.to_local.cast<double>() * direction));
}

}  // namespace flockstep::sensors
