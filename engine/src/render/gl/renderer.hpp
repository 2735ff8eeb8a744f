// GlRenderer: pictures by OpenGL 4.5 through EGL, with no screen: all requests of one kind of camera as tiles of an atlas.
#pragma once

#include <chrono>
#include <memory>
#include <span>
#include <string>

#include "base/workers.hpp"
#include "render/gl/egl_context.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

// A thread of its own owns the context. Not thread-safe: one caller at a time. Worlds are copied to the device when they are
// first seen, and known by their address from then on: they outlive the renderer. In a forked child start() and finish() throw
// GlUnavailable, and nothing is done on destruction.
//
// The environment variable FLOCKSTEP_EGL says which devices may be used; see EglDevices.
class GlRenderer {
 public:
  // Drivers compile shaders at the first picture: those with shadows take Mesa 25 six seconds of a processor, of which a busy
  // machine gives it a part.
  static constexpr std::chrono::milliseconds kPatience{120'000};

  // patience: how long the device may give no sign of life while it draws. Throws GlUnavailable.
  explicit GlRenderer(std::chrono::milliseconds patience = kPatience);
  ~GlRenderer();
  GlRenderer(const GlRenderer&) = delete;
  GlRenderer& operator=(const GlRenderer&) = delete;

  std::string description() const;  // of the device, such as "llvmpipe (LLVM 15.0.6, 256 bits), OpenGL 4.5"

  // Begins to render; the requests, and what they point to, stay as they are until finish().
  void start(std::span<const RenderRequest> requests);
  // Writes all frames as they arrive. Throws GlUnavailable if the device failed or did not answer in time; the frames are then
  // undefined, and the renderer is of no more use.
  void finish(Workers& workers);

 private:
  struct Impl;
  Impl& impl();  // throws GlUnavailable in a forked child

  std::unique_ptr<Impl> impl_;
};

}  // namespace flockstep::render
