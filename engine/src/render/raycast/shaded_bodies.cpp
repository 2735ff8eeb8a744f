#include "render/raycast/shaded_bodies.hpp"

#include <algorithm>

#include "flockstep/body.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"

namespace flockstep::render {
namespace {

constexpr std::size_t kRamps = 16;   // ramps that are kept, unless a frame needs more
constexpr std::size_t kMeshes = 16;  // the same for meshes

// Returns whether two lights give the same ramps.
bool give_same_ramps(const Light& a, const Light& b) {
  return a.sun_color == b.sun_color && a.sky_ambient == b.sky_ambient && a.ground_ambient == b.ground_ambient &&
         a.gamma == b.gamma;
}

}  // namespace

void ShadedBodies::begin(const VisibleBodies& bodies, const VisibleBodies& drones, const Shading& shading) {
  shading_ = &shading;
  bodies_ = bodies;
  drones_ = drones;
  ++frame_;
  if (bodies.shapes.count == 0) return;
  if (shaded_.size() < bodies.shapes.count) shaded_.resize(bodies.shapes.count);
  while (ramps_.size() < kRamps) ramps_.push_back(std::make_unique<Ramp>());
}

void ShadedBodies::shade(std::size_t number, Body& body) {
  const BodySurface& surface = bodies_.surface(number);
  body.shape = trace::make_shape(trace::posed_solid(bodies_.shapes, number));
  body.solid = shading_->make_solid(body.shape,
                                    {.color = surface.color, .semantic = surface.semantic, .instance = bodies_.instance(number)});
  if (takes_ramp(body.solid)) body.solid.ramp = find_ramp(body.solid.surface);
  body.frame = frame_;
}

ShadedBodies::Mesh ShadedBodies::mesh_at(std::size_t number) {
  const VisibleBodies& set = of(number);
  const std::size_t among = number_among(number);
  const BodySurface& surface = set.surface(among);
  const trace::PosedMesh posed = trace::posed_mesh(set.shapes, among);
  // The best is one that already has this rotation, then one whose rotation is not needed in this frame.
  const auto rank = [&](const KeptMesh& kept) {
    if (!kept.shaded->fits(surface, shading_->light())) return 0;
    return !kept.shaded->is_turned(posed.to_local) ? 2 : kept.frame != frame_ ? 1 : 0;
  };
  auto found =
      std::max_element(meshes_.begin(), meshes_.end(), [&](const KeptMesh& a, const KeptMesh& b) { return rank(a) < rank(b); });
  if (found == meshes_.end() || rank(*found) == 0) {
    found =
        std::min_element(meshes_.begin(), meshes_.end(), [](const KeptMesh& a, const KeptMesh& b) { return a.frame < b.frame; });
    if (meshes_.size() < kMeshes || found->frame == frame_) found = meshes_.emplace(meshes_.end());
    found->shaded = std::make_unique<ShadedMesh>(surface, *shading_);
  }
  found->shaded->turn(posed.to_local);
  found->frame = frame_;
  return {found->shaded.get(), posed, {.semantic = surface.semantic, .instance = set.instance(among)}};
}

void ShadedBodies::light(const Mesh& mesh, std::int32_t element, const trace::RayBundle& rays, const trace::HitDetails& details,
                         bool shadows) {
  triangles_.clear();
  for (std::size_t i = 0; i < rays.count; ++i) {
    if (rays.element[i] == element) triangles_.push_back(details.triangle[i]);
  }
  mesh.shaded->light(triangles_, shadows);
}

const std::int32_t* ShadedBodies::find_ramp(const Surface& surface) {
  const auto fits = [&](const std::unique_ptr<Ramp>& ramp) {
    return ramp->frame != 0 && ramp->color == surface.color && give_same_ramps(ramp->light, shading_->light());
  };
  auto found = std::find_if(ramps_.begin(), ramps_.end(), fits);
  if (found == ramps_.end()) {
    found = std::min_element(ramps_.begin(), ramps_.end(), [](const auto& a, const auto& b) { return a->frame < b->frame; });
    // A ramp that this frame uses cannot be replaced.
    if ((*found)->frame == frame_) found = ramps_.insert(ramps_.end(), std::make_unique<Ramp>());
    Ramp& ramp = **found;
    ramp.color = surface.color;
    ramp.light = shading_->light();
    shading_->make_ramp(surface, ramp.entries);
    ramp.is_fine = is_fine(ramp.entries);
  }
  (*found)->frame = frame_;
  return (*found)->is_fine ? (*found)->entries.data() : nullptr;
}

}  // namespace flockstep::render
