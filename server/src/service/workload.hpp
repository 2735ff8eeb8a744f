// Workload: counts what may take long and is in progress. While there is something, the server's spare thread helps out.
#pragma once

#include <condition_variable>
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

}  // namespace flockstep::server
