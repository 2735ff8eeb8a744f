// GlWorker: the thread that owns the OpenGL context, and the handing over of work to it and of pictures from it.
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
#include "render/gl/sun_grid.hpp"

namespace flockstep::render {

// Tiles that are drawn and read back at once.
struct GlRound {
  AtlasSize size;  // with room for at least `count` tiles
  GlPass pass;     // its traits say what is read back
  std::size_t first_camera = 0;
  int count = 0;
};

// A grid of the sun for a model.
struct GlModelGrid {
  std::uint32_t model;
  GlSunGrid grid;
};

struct GlTask {
  std::vector<GlModel> models;     // to be added first
  std::vector<GlModelGrid> grids;  // then
  std::vector<TileCamera> cameras;
  std::vector<GlRound> rounds;
};

// The thread touches nothing but its task and what it owns itself, so it can be left behind when a driver never answers.
class GlWorker {
 public:
  // patience: see GlRenderer. Throws GlUnavailable.
  explicit GlWorker(std::chrono::milliseconds patience);
  ~GlWorker();  // leaves what is under way unfinished
  GlWorker(const GlWorker&) = delete;
  GlWorker& operator=(const GlWorker&) = delete;

  const std::string& description() const;
  int max_side() const;  // px, of an atlas
  bool is_software() const;

  GlTask& task();  // may be changed until start(), and again after the last round was released
  void start();
  // The pictures of the task's next round. Throws GlUnavailable where it failed or did not come in time.
  const Pixels& wait();
  void release();  // they are no longer needed

 private:
  struct Shared;
  struct Device;
  static void run(Shared& s);

  std::shared_ptr<Shared> shared_;
  std::thread thread_;
};

}  // namespace flockstep::render
