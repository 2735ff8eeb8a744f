// RateMeter: how fast the simulation steps, over the last seconds of wall time.
#pragma once

#include <algorithm>
#include <chrono>
#include <deque>
#include <mutex>

namespace flockstep::server {

class RateMeter {
 public:
  struct Rates {
    double fps = 0.0;               // steps per second
    double real_time_factor = 0.0;  // simulated time over wall time
  };

  // Counts steps and the time that they simulated.
  void add(double steps, double simulated_s) {
    const std::scoped_lock lock(mutex_);
    const auto now = Clock::now();
    if (samples_.empty() || now - samples_.back().begin > kSample) samples_.push_back({.begin = now});
    samples_.back().steps += steps;
    samples_.back().simulated_s += simulated_s;
    forget(now);
  }
  Rates rates() {
    const std::scoped_lock lock(mutex_);
    const auto now = Clock::now();
    forget(now);
    if (samples_.empty()) return {};
    const double elapsed_s = std::max(std::chrono::duration<double>(now - samples_.front().begin).count(), 1e-3);
    Rates sum;
    for (const Sample& sample : samples_) {
      sum.fps += sample.steps / elapsed_s;
      sum.real_time_factor += sample.simulated_s / elapsed_s;
    }
    return sum;
  }

 private:
  using Clock = std::chrono::steady_clock;
  static constexpr std::chrono::milliseconds kSample{100}, kWindow{2000};
  struct Sample {
    Clock::time_point begin;
    double steps = 0.0;
    double simulated_s = 0.0;
  };
  void forget(Clock::time_point now) {
    while (!samples_.empty() && now - samples_.front().begin > kWindow) samples_.pop_front();
  }

  std::mutex mutex_;
  std::deque<Sample> samples_;
};

}  // namespace flockstep::server
