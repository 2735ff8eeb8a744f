#include "render/gl/worker.hpp"

#include <algorithm>
#include <array>
#include <chrono>
#include <condition_variable>
#include <cstdint>
#include <exception>
#include <mutex>
#include <span>
#include <string>
#include <system_error>
#include <thread>
#include <utility>

#include "base/platform.hpp"
#include "render/gl/egl_context.hpp"
#include "render/gl/renderer.hpp"

namespace flockstep::render {
namespace {

using std::chrono::milliseconds;

constexpr milliseconds kStartPatience{30'000};  // until the context exists

// Mesa terminates the process if it gets no memory. Before it draws anything, it takes 0.6 GiB of address space on two
// processors, and about 70 MB more for a thread on each further processor, up to 32.
double address_space_wanted() {
  constexpr double kGibibyte = 1024.0 * 1024.0 * 1024.0;
  return kGibibyte * (1.0 + 0.125 * std::min(logical_processors(), 32));
}

constexpr std::size_t kNumReadbacks = 2;  // one is drawn and read while the caller holds the other

// Keeps atlases, since their sizes recur from step to step. If there are too many, the least recently used one is dropped.
class Atlases {
 public:
  const GlAtlas& get(const AtlasSize& size, const Attachments& attachments) {
    const auto found = std::find_if(atlases_.begin(), atlases_.end(), [&](const auto& atlas) {
      return atlas->size() == size && atlas->attachments() == attachments;
    });
    if (found != atlases_.end()) {
      std::rotate(found, found + 1, atlases_.end());
    } else {
      if (atlases_.size() == kMax) atlases_.erase(atlases_.begin());
      atlases_.push_back(std::make_unique<GlAtlas>(size, attachments));
    }
    return *atlases_.back();
  }

 private:
  static constexpr std::size_t kMax = 16;
  std::vector<std::unique_ptr<GlAtlas>> atlases_;  // the most recently used one is last
};

}  // namespace

struct GlWorker::Shared {
  const EglDevices devices;
  const milliseconds patience;  // limit once the worker is ready
  std::mutex mutex;
  std::condition_variable changed;
  // Protected by the mutex:
  bool ready = false;
  bool stop = false;
  bool ended = false;               // the thread has released all its OpenGL objects
  std::string error;                // reason why it ended; the worker is then unusable
  std::uint64_t signs_of_life = 0;  // incremented whenever the device makes progress
  std::uint64_t started = 0;        // number of tasks started
  std::size_t published = 0;        // rounds of the current task that have been read back
  std::size_t released = 0;         // published rounds that the caller has released
  std::array<AtlasPixels, kNumReadbacks> pixels;
  // Written before `ready` is set:
  std::string description;
  int max_side = 0;
  bool is_software = false;
  // Owned by the caller until it is started, then by the thread until all rounds are published:
  GlTask task;

  Shared(EglDevices allowed, milliseconds at_work) : devices(allowed), patience(at_work) {}

  // Waits until the condition holds. Returns false if the device makes no progress for too long.
  template <class Condition>
  bool wait(std::unique_lock<std::mutex>& lock, const Condition& condition) {
    while (!condition()) {
      const std::uint64_t signs = signs_of_life;
      changed.wait_for(lock, ready ? patience : kStartPatience, [&] { return condition() || signs_of_life != signs; });
      if (signs_of_life == signs && !condition()) return false;
    }
    return true;
  }

  // Changes what the mutex protects.
  template <class F>
  void change(const F& f) {
    const std::lock_guard lock(mutex);
    f();
    changed.notify_all();
  }

  void fail(const std::string& why) {
    change([&] {
      if (error.empty()) error = why;
    });
  }
};

GlWorker::GlWorker(milliseconds patience) : shared_(std::make_shared<Shared>(egl_devices(), patience)) {
  if (address_space_left() < address_space_wanted()) {
    throw GlUnavailable("the limit on address space is too low (ulimit -v): OpenGL needs " +
                        std::to_string(static_cast<int>(address_space_wanted() / 1e6)) + " MB more");
  }
  try {
    thread_ = std::thread([shared = shared_] {
      run(*shared);
      shared->change([&] { shared->ended = true; });
    });
  } catch (const std::system_error& error) {
    throw GlUnavailable(std::string("no thread can be started for OpenGL: ") + error.what());
  }
  std::string error;
  {
    std::unique_lock lock(shared_->mutex);
    shared_->wait(lock, [&] { return shared_->ready || !shared_->error.empty(); });
    if (shared_->ready) return;
    error = shared_->error;
    shared_->stop = true;
  }
  if (error.empty()) {
    thread_.detach();
    throw GlUnavailable("the OpenGL driver does not answer");
  }
  thread_.join();
  throw GlUnavailable(error);
}

GlWorker::~GlWorker() {
  if (!thread_.joinable()) return;
  std::unique_lock lock(shared_->mutex);
  shared_->stop = true;
  shared_->changed.notify_all();
  const bool answers = shared_->wait(lock, [&] { return shared_->ended; });
  lock.unlock();
  if (answers) {
    thread_.join();
  } else {
    thread_.detach();
  }
}

const std::string& GlWorker::description() const { return shared_->description; }
int GlWorker::max_side() const { return shared_->max_side; }
bool GlWorker::is_software() const { return shared_->is_software; }
GlTask& GlWorker::task() { return shared_->task; }

void GlWorker::start() {
  shared_->change([&] {
    if (!shared_->error.empty()) throw GlUnavailable(shared_->error);
    ++shared_->started;
    shared_->published = 0;
    shared_->released = 0;
  });
}

const AtlasPixels& GlWorker::wait() {
  std::unique_lock lock(shared_->mutex);
  const std::size_t round = shared_->released;
  shared_->wait(lock, [&] { return shared_->published > round || !shared_->error.empty(); });
  if (shared_->published > round) return shared_->pixels[round % kNumReadbacks];
  if (!shared_->error.empty()) throw GlUnavailable(shared_->error);
  shared_->error = "the OpenGL driver did not answer within " + std::to_string(shared_->patience.count()) + " ms";
  shared_->stop = true;
  shared_->changed.notify_all();
  thread_.detach();
  throw GlUnavailable(shared_->error);
}

void GlWorker::release() {
  shared_->change([&] { ++shared_->released; });
}

// The OpenGL objects of the thread, and the work it does with them.
struct GlWorker::Device {
  Shared& s;
  const EglContext context;
  GlPainter painter;
  Atlases atlases;
  std::array<GlReadback, kNumReadbacks> readbacks;

  explicit Device(Shared& shared)
      : s(shared), context(s.devices), readbacks{GlReadback(context.is_software()), GlReadback(context.is_software())} {
    GLint side = 0;
    std::array<GLint, 2> viewport{};
    glGetIntegerv(GL_MAX_TEXTURE_SIZE, &side);
    glGetIntegerv(GL_MAX_VIEWPORT_DIMS, viewport.data());
    s.change([&] {
      s.description = context.description();
      s.max_side = std::min({side, viewport[0], viewport[1]});
      s.is_software = context.is_software();
      s.ready = true;
    });
  }

  void work() {
    std::uint64_t done = 0;
    while (true) {
      {
        std::unique_lock lock(s.mutex);
        s.changed.wait(lock, [&] { return s.stop || s.started > done; });
        if (s.stop) return;
        done = s.started;
      }
      for (const GlModel& model : s.task.models) {
        painter.add(model);
        s.change([&] { ++s.signs_of_life; });
      }
      const std::size_t count = s.task.rounds.size();
      for (std::size_t round = 0; round < count; ++round) {
        {
          std::unique_lock lock(s.mutex);
          s.changed.wait(lock, [&] { return s.stop || s.released + kNumReadbacks > round; });
          if (s.stop) return;
        }
        draw(s.task.rounds[round], readbacks[round % kNumReadbacks]);
        // A GPU copies the previous round while it draws this one. A software device has already copied this one.
        if (s.is_software) {
          publish(round);
        } else if (round > 0) {
          publish(round - 1);
        }
      }
      if (!s.is_software && count > 0) publish(count - 1);
    }
  }

  void draw(const GlRound& round, GlReadback& readback) {
    const GlScene& scene = s.task.scene;
    const auto cameras = std::span(scene.cameras).subspan(round.first_camera, static_cast<std::size_t>(round.count));
    const GlAtlas& atlas = atlases.get(round.size, round.pass.writes);
    if (const int side = round.pass.samples; side == 1) {
      painter.paint(atlas, scene, cameras, round.pass);
    } else {  // only colours use several samples
      const AtlasSize large{round.size.width * side, round.size.height * side, round.size.tiles};
      const GlAtlas& samples = atlases.get(large, {.color = true});
      GlPass pass = round.pass;
      pass.writes = {.color = true};
      painter.paint(samples, scene, cameras, pass);
      pass.writes = round.pass.writes;
      pass.writes.color = false;
      pass.samples = 1;
      if (pass.writes != Attachments{}) painter.paint(atlas, scene, cameras, pass);
      painter.resolve(samples, atlas, side, round.count);
    }
    readback.start(atlas, round.count);
  }

  void publish(std::size_t round) {
    GlReadback& readback = readbacks[round % kNumReadbacks];
    readback.finish();
    s.change([&] {
      s.pixels[round % kNumReadbacks] = readback.pixels();
      s.published = round + 1;
      ++s.signs_of_life;
    });
  }
};

void GlWorker::run(Shared& s) {
  try {
    Device device(s);
    try {
      device.work();
    } catch (const std::exception& error) {
      s.fail(error.what());
      // The caller may still be reading the previous round, so its memory is kept until the worker is stopped.
      std::unique_lock lock(s.mutex);
      s.changed.wait(lock, [&] { return s.stop; });
    }
  } catch (const std::exception& error) {
    s.fail(error.what());
  }
}

}  // namespace flockstep::render
