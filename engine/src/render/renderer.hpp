// Renderer: takes pictures by the backend that was chosen.
#pragma once

#include <memory>
#include <span>
#include <string>

#include "batch/workers.hpp"
#include "render/shot.hpp"
#include "swiftlet/config.hpp"

namespace swiftlet::render {

class Renderer {
 public:
  // Shots typical of the batch, whose frames may be written: an automatic choice times them.
  Renderer(CameraBackend backend, std::span<const Shot> typical, Workers& workers);

  // Which backend renders, and why.
  const std::string& report() const { return report_; }
  // What the user should know and has not been told; empty mostly. A GL that fails on the way is replaced.
  std::string take_warning() { return std::exchange(warning_, std::string()); }

  // Between the two, a backend that has a thread of its own renders already; the shots stay as they are.
  void start(std::span<const Shot> shots);
  void finish(std::span<const Shot> shots, Workers& workers);

 private:
  std::string report_;
  std::string warning_;
};

}  // namespace swiftlet::render
