// Interrupt: stops long work early, for example on Ctrl-C. The caller sets a check, and the work polls it.
#pragma once

#include <chrono>

namespace flockstep {

class Interrupt {
 public:
  using Check = void (*)();

  // While this object exists, poll() on this thread calls check from time to time. An exception from check ends the work.
  // Interrupts can be nested.
  explicit Interrupt(Check check) : before_(current()) { current() = {check, Clock::time_point()}; }
  ~Interrupt() { current() = before_; }
  Interrupt(const Interrupt&) = delete;
  Interrupt& operator=(const Interrupt&) = delete;

  // Call this in long loops every few microseconds; it reads the clock. It does nothing on threads without a check. On the
  // threads of Workers it stops their part of a call once the call has been cancelled.
  static void poll() {
    Polled& polled = current();
    if (polled.check == nullptr) return;
    const Clock::time_point now = Clock::now();
    if (polled.next == Clock::time_point()) polled.next = now + kPause;  // not set earlier: most calls are short and never poll
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
