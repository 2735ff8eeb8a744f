// ShadedBodies: the bodies of one frame in the form that the shading kernels need.
#pragma once

#include <array>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <vector>

#include "flockstep/world.hpp"
#include "render/body_surface.hpp"
#include "render/raycast/shading.hpp"
#include "trace/shape.hpp"

namespace flockstep::render {

// Each thread needs its own. A body is computed when the first ray of the frame hits it.
class ShadedBodies {
 public:
  // Begins a frame. The arguments must outlive it. Allocates only if there are more bodies than ever before.
  void begin(const VisibleBodies& bodies, const Shading& shading);
  // Returns body `number`; the reference is valid until the next begin().
  const ShadedSolid& at(std::size_t number) {
    Body& body = shaded_[number];
    if (body.frame != frame_) shade(number, body);
    return body.solid;
  }

 private:
  struct Body {
    trace::Shape shape;
    ShadedSolid solid;
    std::uint64_t frame = 0;  // frame for which it was computed
  };
  // A ramp and what it depends on. Computing one takes longer than a body, and bodies share colours.
  struct Ramp {
    std::array<float, 3> color{};
    Light light;
    bool is_fine = false;
    std::uint64_t frame = 0;  // frame of the last use; 0: never
    Shading::Ramp entries{};
  };

  void shade(std::size_t number, Body& body);
  const std::int32_t* find_ramp(const Surface& surface);  // null if the ramp would be too coarse

  const Shading* shading_ = nullptr;
  VisibleBodies bodies_;
  std::uint64_t frame_ = 0;
  std::vector<Body> shaded_;  // by number
  std::vector<std::unique_ptr<Ramp>> ramps_;
};

}  // namespace flockstep::render
