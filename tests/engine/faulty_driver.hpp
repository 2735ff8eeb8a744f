// FaultyDriver: replaces the OpenGL driver during its lifetime with one that fails or hangs.
#pragma once

#include <epoxy/gl.h>

#include <condition_variable>

#include "standard.hpp"

namespace flockstep::testing {

// libepoxy calls OpenGL through function pointers. This class replaces the pointer of glGetError(), which the renderer calls
// once after reading a round of images. Only one may exist at a time, and it affects every context in the process.
class FaultyDriver {
 public:
  enum class Fault { error, hang };

  // The first `good_rounds` rounds succeed.
  explicit FaultyDriver(Fault fault, int good_rounds = 0) {
    const std::lock_guard lock(shared().mutex);
    shared().fault = fault;
    shared().good_rounds = good_rounds;
    shared().over = false;
    true_function_ = std::exchange(epoxy_glGetError, &get_error);
  }
  // Releases the threads that hang and waits for them to end.
  ~FaultyDriver() {
    std::unique_lock lock(shared().mutex);
    epoxy_glGetError = true_function_;
    shared().over = true;
    shared().changed.notify_all();
    shared().changed.wait(lock, [] { return shared().threads_that_hung == 0; });
  }
  FaultyDriver(const FaultyDriver&) = delete;
  FaultyDriver& operator=(const FaultyDriver&) = delete;

 private:
  struct Shared {
    std::mutex mutex;
    std::condition_variable changed;
    Fault fault = Fault::error;
    int good_rounds = 0;
    bool over = true;
    int threads_that_hung = 0;
  };
  static Shared& shared() {
    static Shared one;
    return one;
  }

  // Exists as long as the thread that owns it.
  struct HungThread {
    HungThread() { ++shared().threads_that_hung; }
    ~HungThread() {
      const std::lock_guard lock(shared().mutex);
      --shared().threads_that_hung;
      shared().changed.notify_all();
    }
  };

  static GLenum get_error() {
    std::unique_lock lock(shared().mutex);
    if (shared().good_rounds-- > 0) return GL_NO_ERROR;
    if (shared().fault == Fault::error) return GL_OUT_OF_MEMORY;
    static thread_local HungThread this_thread;
    shared().changed.wait(lock, [] { return shared().over; });
    return GL_NO_ERROR;
  }

  GLenum (*true_function_)();
};

}  // namespace flockstep::testing
