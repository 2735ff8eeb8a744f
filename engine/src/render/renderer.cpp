#include "render/renderer.hpp"

#include <algorithm>
#include <chrono>
#include <limits>
#include <sstream>

namespace flockstep::render {
namespace {

constexpr std::size_t kTilesPerJob = 64;  // a small image, or some rows of a large one
constexpr int kTimedRuns = 3;             // per backend; the fastest one counts
constexpr double kEnoughS = 1.0;          // s, total time after which no further run is timed

// Renders once to warm up, then returns the frames per second of the fastest timed run.
template <class Render>
double frames_per_second(std::size_t frames, const Render& render) {
  render();
  double least = std::numeric_limits<double>::infinity(), spent = 0.0;
  for (int run = 0; run < kTimedRuns && spent < kEnoughS; ++run) {
    const auto start = std::chrono::steady_clock::now();
    render();
    const double seconds = std::chrono::duration<double>(std::chrono::steady_clock::now() - start).count();
    least = std::min(least, seconds);
    spent += seconds;
  }
  return static_cast<double>(frames) / least;
}

}  // namespace

Renderer::Renderer(CameraBackend backend, std::span<const RenderRequest> typical, Workers& workers,
                   std::chrono::milliseconds gl_patience)
    : report_("raycast: as requested") {
  for (int i = 0; i < workers.num_threads(); ++i) raycast_scratches_.push_back(std::make_unique<RaycastScratch>());
  if (backend == CameraBackend::raycast) return;
  try {
    gl_ = std::make_unique<GlRenderer>(gl_patience);
  } catch (const GlUnavailable& error) {
    give_up_gl(error.what());
    return;
  }
  report_ = "gl: as requested, on " + gl_->description();
  if (backend == CameraBackend::automatic) choose(typical, workers);
}

void Renderer::choose(std::span<const RenderRequest> typical, Workers& workers) {
  const std::string device = gl_->description();
  const double of_raycast = frames_per_second(typical.size(), [&] { raycast(typical, workers); });
  const double of_gl = frames_per_second(typical.size(), [&] {
    start(typical);
    finish(typical, workers);
  });
  if (!gl_) return;  // gl failed, and the report says so
  std::ostringstream report;
  report.precision(3);
  report << (of_gl > of_raycast ? "gl" : "raycast") << ": the faster on " << typical.size() << " frames of this batch: raycast "
         << of_raycast << " frames/s, gl " << of_gl << " frames/s on " << device;
  report_ = report.str();
  if (of_gl <= of_raycast) gl_.reset();
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

void Renderer::forget_worlds() {
  if (!gl_) return;
  try {
    gl_->forget_worlds();
  } catch (const GlUnavailable& error) {
    give_up_gl(error.what());
  }
}

// Requests of one camera are adjacent and have the same tiles.
void Renderer::raycast(std::span<const RenderRequest> requests, Workers& workers) {
  while (!requests.empty()) {
    const std::size_t tiles = requests[0].pinhole->tiles.size();
    const auto other = std::find_if(requests.begin(), requests.end(),
                                    [&](const RenderRequest& request) { return request.camera != requests[0].camera; });
    const auto count = static_cast<std::size_t>(other - requests.begin());
    const std::size_t jobs = (tiles + kTilesPerJob - 1) / kTilesPerJob;
    workers.run(count * jobs, [&](std::size_t job, std::size_t thread) {
      const std::size_t first = job % jobs * kTilesPerJob;
      render_tiles(requests[job / jobs], first, std::min(first + kTilesPerJob, tiles), *raycast_scratches_[thread]);
    });
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
