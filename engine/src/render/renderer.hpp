// Renderer: takes pictures by the backend that was chosen.
#pragma once

#include <chrono>
#include <memory>
#include <span>
#include <string>
#include <utility>
#include <vector>

#include "base/workers.hpp"
#include "flockstep/config.hpp"
#include "render/gl_renderer.hpp"
#include "render/raycast_renderer.hpp"
#include "render/render_request.hpp"

namespace flockstep::render {

class Renderer {
 public:
  // Requests typical of the batch, whose frames may be written: an automatic choice times them. The worlds of all requests
  // outlive the renderer. gl_patience: see GlRenderer.
  Renderer(CameraBackend backend, std::span<const RenderRequest> typical, Workers& workers,
           std::chrono::milliseconds gl_patience = GlRenderer::kPatience);

  // Which backend renders, and why.
  const std::string& report() const { return report_; }
  // What the user should know and has not been told; empty mostly. OpenGL that is missing or fails is replaced by raycast.
  std::string take_warning() { return std::exchange(warning_, std::string()); }

  // Between the two OpenGL renders already, on a thread of its own; the requests stay as they are.
  void start(std::span<const RenderRequest> requests);
  void finish(std::span<const RenderRequest> requests, Workers& workers);

 private:
  void raycast(std::span<const RenderRequest> requests, Workers& workers);
  void choose(std::span<const RenderRequest> typical, Workers& workers);
  void give_up_gl(const std::string& why);

  std::unique_ptr<GlRenderer> gl_;                                  // null: raycast renders
  std::vector<std::unique_ptr<RaycastScratch>> raycast_scratches_;  // of each thread
  std::string report_;
  std::string warning_;
};

}  // namespace flockstep::render
