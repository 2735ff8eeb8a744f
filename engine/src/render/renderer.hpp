// Renderer: takes pictures with the backend that was chosen.
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
  // typical: requests like the batch's, which an automatic choice times; their frames may be written. The worlds of all requests
  // must outlive the renderer. gl_patience: see GlRenderer.
  Renderer(CameraBackend backend, std::span<const RenderRequest> typical, Workers& workers,
           std::chrono::milliseconds gl_patience = GlRenderer::kPatience);

  // Which backend renders, and why.
  const std::string& report() const { return report_; }
  // What the user should know and has not been told yet; mostly empty. Raycast renders where OpenGL is missing or fails, and this
  // says so.
  std::string take_warning() { return std::exchange(warning_, std::string()); }

  trace::EmbreeUse embree_use() const;  // by raycast

  // Between the two OpenGL renders already, on a thread of its own; the requests must not change meanwhile.
  void start(std::span<const RenderRequest> requests);
  void finish(std::span<const RenderRequest> requests, Workers& workers);

 private:
  void raycast(std::span<const RenderRequest> requests, Workers& workers);
  void choose(std::span<const RenderRequest> typical, Workers& workers);
  void give_up_gl(const std::string& why);

  std::unique_ptr<GlRenderer> gl_;                                  // null: raycast renders
  std::vector<std::unique_ptr<RaycastScratch>> raycast_scratches_;  // one for each thread
  std::string report_;
  std::string warning_;
};

}  // namespace flockstep::render
