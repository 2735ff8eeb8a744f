#include "render/renderer.hpp"

#include <algorithm>

#include "render/raycast_renderer.hpp"

namespace swiftlet::render {
namespace {

constexpr std::size_t kTilesPerJob = 64;  // a small image, or some rows of a large one

// Shots of one camera follow each other.
void raycast(std::span<const Shot> shots, Workers& workers) {
  while (!shots.empty()) {
    const std::size_t tiles = shots[0].lens->tiles.size();
    const auto other = std::find_if(shots.begin(), shots.end(), [&](const Shot& shot) { return shot.camera != shots[0].camera; });
    const auto count = static_cast<std::size_t>(other - shots.begin());
    const std::size_t jobs = (tiles + kTilesPerJob - 1) / kTilesPerJob;
    workers.run(count * jobs, [&](std::size_t job, Scratch& scratch) {
      const std::size_t first = job % jobs * kTilesPerJob;
      render_tiles(shots[job / jobs], first, std::min(first + kTilesPerJob, tiles), scratch.raycast);
    });
    shots = shots.subspan(count);
  }
}

}  // namespace

Renderer::Renderer(CameraBackend backend, std::span<const Shot> typical, Workers& workers) {
  (void)backend;
  (void)typical;
  (void)workers;
  report_ = "raycast: asked for";
}

void Renderer::start(std::span<const Shot>) {}

void Renderer::finish(std::span<const Shot> shots, Workers& workers) { raycast(shots, workers); }

}  // namespace swiftlet::render
