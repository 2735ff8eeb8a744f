#include "render/gl/bodies.hpp"

#include <cstddef>
#include <cstdint>

#include "flockstep/body.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"

namespace flockstep::render {
namespace {

RoundKind round_kind_of(PrimitiveKind kind) {
  switch (kind) {
    case PrimitiveKind::cylinder:
      return RoundKind::cylinder;
    case PrimitiveKind::sphere:
      return RoundKind::sphere;
    case PrimitiveKind::capsule:
      return RoundKind::capsule;
    default:
      return RoundKind::box;
  }
}

}  // namespace

void append_bodies(const VisibleBodies& bodies, const World& world, bool shadows,
                   const std::function<std::uint32_t(const std::shared_ptr<const World>&)>& model_of, GlBodies& out) {
  if (bodies.shapes.count == 0) return;
  const Eigen::Matrix3d to_sun = sun_rotation(world.light());
  for (std::size_t i = 0; i < bodies.shapes.count; ++i) {
    if (bodies.shapes.radius[i] < 0.0F) continue;  // the drone that carries the camera is hidden later; see TileCamera
    const BodySurface& appearance = bodies.surface(i);
    const Surface surface{.color = appearance.color, .semantic = appearance.semantic, .instance = bodies.instance(i)};
    if (const std::shared_ptr<const World>* const mesh = appearance.mesh) {
      const trace::PosedMesh posed = trace::posed_mesh(bodies.shapes, i);
      const Mat3 rotation = posed.to_local.transpose();
      out.meshes.push_back({model_of(*mesh), posed.position, rotation, posed.radius, pack_ids(surface),
                            shadows ? make_mesh_caster(posed.position, rotation, posed.radius, to_sun) : SunCaster{}});
      continue;
    }
    const Primitive solid = trace::posed_solid(bodies.shapes, i);
    const RoundKind kind = round_kind_of(solid.kind);
    out.solids.push_back({kind, make_round_shape(solid, surface, world.light()), make_round_bound(kind, solid),
                          shadows ? make_caster(solid, to_sun) : SunCaster{}});
  }
}

}  // namespace flockstep::render
