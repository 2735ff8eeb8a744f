// Workload: counts what may take long and is in progress. While there is something, the server's spare thread helps out.
#pragma once

#include <algorithm>
#include <chrono>
#include <condition_variable>
#include <deque>
#include <mutex>

namespace flockstep::server {

class Workload {
 public:
  // Exists while its thread does something that may take long.
  class Mark {
   public:
    explicit Mark(Workload& workload) : workload_(workload) { workload_.add(1); }
    ~Mark() { workload_.add(-1); }
    Mark(const Mark&) = delete;
    Mark& operator=(const Mark&) = delete;

   private:
    Workload& workload_;
  };

  // Waits until there is a mark. Returns false after end().
  bool wait() {
    std::unique_lock lock(mutex_);
    changed_.wait(lock, [this] { return marks_ > 0 || is_over_; });
    return !is_over_;
  }
  void end() {
    const std::scoped_lock lock(mutex_);
    is_over_ = true;
    changed_.notify_all();
  }

 private:
  void add(int marks) {
    const std::scoped_lock lock(mutex_);
    if (marks_ == 0) changed_.notify_all();
    marks_ += marks;
  }

  std::mutex mutex_;
  std::condition_variable changed_;
  int marks_ = 0;
  bool is_over_ = false;
};

// RateMeter: how fast the simulation steps, over the last seconds of wall time.
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
