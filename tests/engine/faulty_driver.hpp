// FaultyDriver: an OpenGL driver that fails or hangs, put in the place of the true one while it lives.
#pragma once

#include <epoxy/gl.h>

#include <condition_variable>
#include <mutex>
#include <utility>

namespace flockstep::testing {

// libepoxy calls OpenGL through pointers that are variables: this one replaces glGetError(), which the renderer asks once after
// it has read a round of pictures. One at a time, and every context in the process gets its answers.
class FaultyDriver {
 public:
  enum class Fault { error, hang };

  // The first `good_rounds` rounds are answered as if all was well.
  explicit FaultyDriver(Fault fault, int good_rounds = 0) {
    const std::lock_guard lock(shared().mutex);
    shared().fault = fault;
    shared().good_rounds = good_rounds;
    shared().over = false;
    true_function_ = std::exchange(epoxy_glGetError, &get_error);
  }
  // Lets threads that hang go on, and waits for their end.
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

  // Lives as long as the thread that has it.
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
