// GlWorker: the thread that owns the OpenGL context. It receives tasks and returns images.
#pragma once

#include <chrono>
#include <cstddef>
#include <cstdint>
#include <memory>
#include <string>
#include <thread>
#include <vector>

#include "render/gl/atlas.hpp"
#include "render/gl/model.hpp"
#include "render/gl/painter.hpp"

namespace flockstep::render {

// Tiles that are drawn and read back together.
struct GlRound {
  AtlasSize size;  // has room for at least `count` tiles
  GlPass pass;     // what it writes is read back
  std::size_t first_camera = 0;
  int count = 0;
};

struct GlTask {
  std::vector<GlModel> models;  // added first
  GlScene scene;
  std::vector<GlRound> rounds;
};

// The thread accesses only its task and its own data, so it can be abandoned if a driver never answers.
class GlWorker {
 public:
  // patience: see GlRenderer. Throws GlUnavailable.
  explicit GlWorker(std::chrono::milliseconds patience);
  ~GlWorker();  // abandons unfinished work
  GlWorker(const GlWorker&) = delete;
  GlWorker& operator=(const GlWorker&) = delete;

  const std::string& description() const;
  int max_side() const;  // px, limit for an atlas
  bool is_software() const;

  GlTask& task();  // may be changed until start(), and again after the last round has been released
  void start();
  // Returns the pixels of the task's next round. Throws GlUnavailable if the round failed or did not arrive in time.
  const AtlasPixels& wait();
  void release();  // releases the pixels of the last wait()

 private:
  struct Shared;
  struct Device;
  static void run(Shared& s);

  std::shared_ptr<Shared> shared_;
  std::thread thread_;
};

}  // namespace flockstep::render
