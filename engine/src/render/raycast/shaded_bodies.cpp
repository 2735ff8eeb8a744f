#include "render/raycast/shaded_bodies.hpp"

#include <algorithm>

#include "flockstep/body.hpp"
#include "render/appearance.hpp"
#include "trace/bodies.hpp"

namespace flockstep::render {
namespace {

constexpr std::size_t kRamps = 16;  // ramps that are kept, unless a frame needs more

// Returns whether two lights give the same ramps.
bool give_same_ramps(const Light& a, const Light& b) {
  return a.sun_color == b.sun_color && a.sky_ambient == b.sky_ambient && a.ground_ambient == b.ground_ambient &&
         a.gamma == b.gamma;
}

}  // namespace

void ShadedBodies::begin(const VisibleBodies& bodies, const Shading& shading) {
  shading_ = &shading;
  bodies_ = bodies;
  ++frame_;
  if (bodies.shapes.count == 0) return;
  if (shaded_.size() < bodies.shapes.count) shaded_.resize(bodies.shapes.count);
  while (ramps_.size() < kRamps) ramps_.push_back(std::make_unique<Ramp>());
}

void ShadedBodies::shade(std::size_t number, Body& body) {
  const BodySurface& surface = bodies_.surfaces[number];
  body.shape = trace::make_shape(trace::posed_solid(bodies_.shapes, number));
  body.solid = shading_->make_solid(body.shape, {.color = surface.color,
                                                 .semantic = surface.semantic,
                                                 .instance = static_cast<std::uint16_t>(kFirstBodyInstance + number)});
  if (takes_ramp(body.solid)) body.solid.ramp = find_ramp(body.solid.surface);
  body.frame = frame_;
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
