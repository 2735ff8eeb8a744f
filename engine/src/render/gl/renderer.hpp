// GlRenderer: off-screen rendering with OpenGL 4.5 through EGL. All requests of one kind of camera become tiles of an atlas.
#pragma once

#include <chrono>
#include <memory>
#include <span>
#include <string>

#include "base/workers.hpp"
#include "render/gl/egl_context.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

// The context belongs to a separate thread. Not thread-safe: only one caller at a time. The geometry of each world is copied to
// the device on first use and then identified by the address of the world that has it (World::original()), so this world must
// live as long as the renderer. Shadows and fog are not drawn: Batch refuses them. In a forked child, all members but the
// destructor throw GlUnavailable, and the destructor does nothing.
//
// The environment variable FLOCKSTEP_EGL selects the devices that may be used; see EglDevices.
class GlRenderer {
 public:
  // Drivers compile shaders at the first image.
  static constexpr std::chrono::milliseconds kPatience{120'000};

  // patience: longest time without progress while the device draws. Throws GlUnavailable.
  explicit GlRenderer(std::chrono::milliseconds patience = kPatience);
  ~GlRenderer();
  GlRenderer(const GlRenderer&) = delete;
  GlRenderer& operator=(const GlRenderer&) = delete;

  std::string description() const;  // name of the device, such as "llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5"

  // Starts rendering. The requests and the objects they point to must not change until finish().
  void start(std::span<const RenderRequest> requests);
  // Writes all frames as they arrive. Throws GlUnavailable if the device fails or does not answer in time. The frames are
  // then undefined, and the renderer must not be used again.
  void finish(Workers& workers);

 private:
  struct Impl;
  Impl& impl();  // throws GlUnavailable in a forked child

  std::unique_ptr<Impl> impl_;
};

}  // namespace flockstep::render
