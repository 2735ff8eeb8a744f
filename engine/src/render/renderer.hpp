// Renderer: renders images with the selected backend.
#pragma once

#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/workers.hpp"
#include "flockstep/config.hpp"
#include "render/gl/renderer.hpp"
#include "render/raycast/raycast_renderer.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

class Renderer {
 public:
  // gl_patience: see GlRenderer.
  Renderer(CameraBackend backend, const Workers& workers, std::chrono::milliseconds gl_patience = GlRenderer::kPatience);

  // The selected backend, and the reason.
  const std::string& report() const { return report_; }
  // Returns warnings that have not been reported to the user yet; usually empty. Raycast takes over if OpenGL is missing or
  // fails, and the warning says so.
  std::string take_warning() { return std::exchange(warning_, std::string()); }

  trace::EmbreeUse embree_use() const;  // by the raycast backend

  // Between start() and finish(), OpenGL already renders on its own thread; the requests must not change meanwhile.
  void start(std::span<const RenderRequest> requests);
  void finish(std::span<const RenderRequest> requests, Workers& workers);

 private:
  void raycast(std::span<const RenderRequest> requests, Workers& workers);
  void give_up_gl(const std::string& why);

  std::unique_ptr<GlRenderer> gl_;                                  // null if raycast renders
  std::vector<std::unique_ptr<RaycastScratch>> raycast_scratches_;  // one per thread
  std::vector<std::uint8_t> centres_;                               // see RenderRequest
  std::string report_;
  std::string warning_;
};

}  // namespace flockstep::render
