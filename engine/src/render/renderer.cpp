#include "render/renderer.hpp"

#include <algorithm>

namespace flockstep::render {
namespace {

constexpr std::size_t kTilesPerJob = 64;  // a small image, or some rows of a large one

}  // namespace

Renderer::Renderer(CameraBackend backend, const Workers& workers, std::chrono::milliseconds gl_patience)
    : report_(backend == CameraBackend::automatic ? "raycast: the choice of auto" : "raycast: as requested") {
  for (int i = 0; i < workers.num_threads(); ++i) raycast_scratches_.push_back(std::make_unique<RaycastScratch>());
  if (backend != CameraBackend::gl) return;
  try {
    gl_ = std::make_unique<GlRenderer>(gl_patience);
    report_ = "gl: as requested, on " + gl_->description();
  } catch (const GlUnavailable& error) {
    give_up_gl(error.what());
  }
}

void Renderer::give_up_gl(const std::string& why) {
  gl_.reset();
  report_ = "raycast: gl is not available (" + why + ")";
  warning_ = "cameras: gl is not available; raycast renders instead: " + why;
}

trace::EmbreeUse Renderer::embree_use() const {
  trace::EmbreeUse use;
  for (const auto& scratch : raycast_scratches_) use += scratch->tracer.embree_use();
  return use;
}

// Requests of one camera are adjacent and have the same tiles.
void Renderer::raycast(std::span<const RenderRequest> requests, Workers& workers) {
  while (!requests.empty()) {
    const std::size_t tiles = requests[0].optics->tiles.size();
    const auto other = std::find_if(requests.begin(), requests.end(),
                                    [&](const RenderRequest& request) { return request.camera != requests[0].camera; });
    const auto count = static_cast<std::size_t>(other - requests.begin());
    const std::size_t jobs = (tiles + kTilesPerJob - 1) / kTilesPerJob;
    const std::size_t colors = 3 * tiles * TilePixels::kCount;
    const auto& camera = *requests[0].camera;
    const bool adaptive =
        camera.adaptive_samples && camera.samples_per_pixel > 1 && camera.outputs.any_color() && !camera.takes_time();
    if (adaptive && centres_.size() < count * colors) centres_.resize(count * colors);
    const auto for_all_tiles = [&](const auto& render) {
      workers.run(count * jobs, [&](std::size_t job, std::size_t thread) {
        RenderRequest request = requests[job / jobs];
        if (adaptive) request.centres = centres_.data() + job / jobs * colors;
        const std::size_t first = job % jobs * kTilesPerJob;
        render(request, first, std::min(first + kTilesPerJob, tiles), *raycast_scratches_[thread]);
      });
    };
    for_all_tiles(render_tiles);
    if (adaptive) for_all_tiles(refine_tiles);
    requests = requests.subspan(count);
  }
}

void Renderer::start(std::span<const RenderRequest> requests) {
  if (!gl_) return;
  try {
    gl_->start(requests);
  } catch (const GlUnavailable& error) {
    give_up_gl(error.what());
  }
}

void Renderer::finish(std::span<const RenderRequest> requests, Workers& workers) {
  if (gl_) {
    try {
      gl_->finish(workers);
      return;
    } catch (const GlUnavailable& error) {
      give_up_gl(error.what());
    }
  }
  raycast(requests, workers);
}

}  // namespace flockstep::render
