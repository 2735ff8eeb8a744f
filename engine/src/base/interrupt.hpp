// Interrupt: how long work is stopped half-way, such as by Ctrl-C. Whoever calls the work says what to look at; the work polls.
#pragma once

#include <chrono>

namespace flockstep {

class Interrupt {
 public:
  using Check = void (*)();

  // While this lives, poll() on this thread calls check now and then. What check throws ends the work. They nest.
  explicit Interrupt(Check check) : before_(current()) { current() = {check, Clock::time_point()}; }
  ~Interrupt() { current() = before_; }
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  // For loops that may take long, once every some microseconds: it reads the clock. On other threads than the caller's it does
  // nothing, but on those of Workers it ends the call once the caller's has ended.
  static void poll() {
    Polled& polled = current();
    if (polled.check == nullptr) return;
    const Clock::time_point now = Clock::now();
    if (polled.next == Clock::time_point()) polled.next = now + kPause;  // not before: calls that never poll are many and short
    if (now < polled.next) return;
    polled.check();
    polled.next = Clock::now() + kPause;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kPause{50};

  struct Polled {
    Check check = nullptr;
    Clock::time_point next;
  };
  static Polled& current() {
    thread_local Polled polled;
    return polled;
  }

  Polled before_;
};

}  // namespace flockstep
