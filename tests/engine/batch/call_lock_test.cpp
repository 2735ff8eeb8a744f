// Batches that threads share.
#include "batch/call_lock.hpp"

#include <chrono>

#include "base/interrupt.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/served_batch.hpp"

namespace flockstep {
namespace {

using namespace testing;
using namespace std::chrono_literals;

// Returns the message of the std::runtime_error that the call throws.
template <class Call>
std::string error_of(const Call& call) {
  return refusal<std::runtime_error>(call);
}

constexpr int kFlockSize = 8;
const std::vector<float> kFlockPositions(3 * kFlockSize, 1.0F);

// Eight drones that share an env, so that every move() changes the same clock.
std::unique_ptr<Batch> flock() {
  BatchConfig config = lidar_batch(1);
  config.drones_per_env = kFlockSize;
  return std::make_unique<Batch>(config, Batch::Worlds{closet()});
}

DroneMask only(std::vector<std::uint8_t>& flags, std::size_t drone) {
  flags.assign(kFlockSize, 0);
  flags[drone] = 1;
  return DroneMask(flags);
}

// Holds the lock of a batch on another thread until it is destroyed.
class Holder {
 public:
  explicit Holder(const Batch& batch)
      : thread_([this, &batch] {
          const BatchLock lock(batch);
          holds_ = true;
          while (!ends_) std::this_thread::sleep_for(1ms);
        }) {
    while (!holds_) std::this_thread::yield();
  }
  ~Holder() { end(); }
  void end() {
    ends_ = true;
    if (thread_.joinable()) thread_.join();
  }

 private:
  std::atomic<bool> holds_{false}, ends_{false};
  std::thread thread_;
};

TEST(CallLock, RefusesASecondThreadUnlessTheBatchIsShared) {
  const auto batch = flock();
  EXPECT_FALSE(ServedBatch::is_served(*batch));
  Holder holder(*batch);
  const std::string in_use = "this Batch is in use by another thread: one call at a time";
  for (const std::string& message :
       {error_of([&] { batch->sense(); }), error_of([&] { batch->seed(std::vector<std::uint64_t>{1}); }),
        error_of([&] { const BatchLock lock(*batch); }), error_of([&] { const ServedBatch served(*batch); })}) {
    EXPECT_EQ(message, in_use);
  }
  EXPECT_FALSE(BatchLock::try_lock(*batch).has_value());
  holder.end();
  batch->sense();
  EXPECT_TRUE(BatchLock::try_lock(*batch).has_value());
}

TEST(CallLock, EveryCallOfEveryThreadIsMadeAndNoneIsTorn) {
  const auto batch = flock();
  ServedBatch served(*batch);
  EXPECT_TRUE(ServedBatch::is_served(*batch));
  constexpr int kCalls = 300;
  std::atomic<int> torn{0};
  const auto use = [&](std::size_t drone) {
    std::vector<std::uint8_t> flags;
    for (int call = 0; call < kCalls; ++call) {
      const float x = 0.5F + 0.001F * static_cast<float>(call);
      const std::vector<float> positions(3 * kFlockSize, x);
      batch->move(positions, {}, only(flags, drone));
      batch->sense(only(flags, drone));
      const BatchLock lock(*batch);  // three numbers that a call of another thread would change together
      const std::int64_t before = batch->state().tick[0];
      batch->set_pose(std::vector<float>(3 * kFlockSize, x), {});
      const std::vector<float>& now = batch->state().position;
      torn += std::any_of(now.begin(), now.end(), [&](float value) { return value != x; });
      torn += batch->state().tick[0] != before;
    }
  };
  std::vector<std::thread> threads;
  for (std::size_t drone = 0; drone < 3; ++drone) threads.emplace_back(use, drone);
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(torn, 0);
  EXPECT_EQ(batch->state().tick[0], 3 * kCalls * batch->config().clock.substeps());
}

TEST(CallLock, AThreadThatCallsInALoopLetsAnotherOneIn) {
  const auto batch = flock();
  ServedBatch served(*batch);
  std::atomic<bool> stop{false};
  std::atomic<int> looped{0};
  std::thread loop([&] {
    while (!stop) {
      const BatchLock lock(*batch);
      std::this_thread::sleep_for(200us);
      ++looped;
    }
  });
  while (looped == 0) std::this_thread::yield();
  constexpr int kCalls = 50;
  const int before = looped;
  for (int call = 0; call < kCalls; ++call) batch->set_pose(kFlockPositions, {});
  const int meanwhile = looped - before;
  stop = true;
  loop.join();
  EXPECT_LE(meanwhile, 4 * kCalls);  // a lock without a queue lets the loop take it hundreds of times for each call
}

TEST(CallLock, WaitingThreadsGetItInTheOrderOfTheirCalls) {
  const auto batch = flock();
  ServedBatch served(*batch);
  Holder holder(*batch);
  std::vector<int> order;
  std::vector<std::thread> threads;
  for (int i = 0; i < 4; ++i) {
    threads.emplace_back([&, i] {
      const BatchLock lock(*batch);
      order.push_back(i);
    });
    std::this_thread::sleep_for(20ms);
  }
  EXPECT_FALSE(BatchLock::try_lock(*batch).has_value());
  holder.end();
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(order, (std::vector{0, 1, 2, 3}));
}

TEST(CallLock, AnnouncesOutermostCallsThatMayTakeLong) {
  const auto batch = flock();
  int count = 0;
  ServedBatch served(*batch, [&] {
    ++count;
    batch->sense();  // a call within the call does not announce itself
    EXPECT_TRUE(BatchLock::try_lock(*batch).has_value());
    std::thread([&] { EXPECT_FALSE(BatchLock::try_lock(*batch).has_value()); }).join();
  });
  const std::vector<std::int64_t> one{1};
  const std::string snapshot = batch->snapshot();
  batch->set_pose(kFlockPositions, {});
  batch->seed(std::vector<std::uint64_t>{7});
  batch->remove(one);
  EXPECT_EQ(count, 0);
  batch->move(kFlockPositions, {});
  batch->sense();
  batch->spawn(one, {}, {}, {});
  batch->restore(snapshot);
  EXPECT_EQ(count, 4);
  {
    const BatchLock lock(*batch);
    batch->sense();
  }
  EXPECT_EQ(count, 4);
  served.end();
  batch->sense();
  EXPECT_EQ(count, 4);
}

TEST(CallLock, AnExceptionOfTheAnnouncementEndsTheCallAndReleasesTheBatch) {
  const auto batch = flock();
  ServedBatch served(*batch, [] { throw std::runtime_error("not now"); });
  const std::int64_t tick = batch->state().tick[0];
  EXPECT_EQ(error_of([&] { batch->move(kFlockPositions, {}); }), "not now");
  EXPECT_EQ(batch->state().tick[0], tick);
  std::thread([&] { EXPECT_TRUE(BatchLock::try_lock(*batch).has_value()); }).join();
}

TEST(CallLock, ANestedOrMovedLockIsReleasedOnce) {
  const auto batch = flock();
  ServedBatch served(*batch);
  const auto is_free = [&] {
    bool free = false;
    std::thread([&] { free = BatchLock::try_lock(*batch).has_value(); }).join();
    return free;
  };
  std::optional<BatchLock> outer(std::in_place, *batch);
  {
    const BatchLock inner(*batch);
    EXPECT_TRUE(BatchLock::try_lock(*batch).has_value());
  }
  EXPECT_FALSE(is_free());
  std::optional<BatchLock> moved(std::move(*outer));
  outer.reset();
  EXPECT_FALSE(is_free());
  moved.reset();
  EXPECT_TRUE(is_free());
}

TEST(CallLock, AnInterruptEndsAWaitAndTheOthersGoOn) {
  const auto batch = flock();
  ServedBatch served(*batch);
  Holder holder(*batch);
  std::string message;
  std::thread first([&] {
    const Interrupt interrupt([] { throw std::runtime_error("interrupted"); });
    message = error_of([&] { batch->sense(); });
  });
  std::this_thread::sleep_for(10ms);
  bool sensed = false;
  std::thread second([&] {
    batch->sense();
    sensed = true;
  });
  first.join();
  EXPECT_EQ(message, "interrupted");
  holder.end();
  second.join();
  EXPECT_TRUE(sensed);
}

TEST(CallLock, ThreadsThatWaitAtTheEndOfTheSharingStillGetTheirTurns) {
  const auto batch = flock();
  ServedBatch served(*batch);
  std::atomic<int> done{0};
  std::vector<std::thread> threads;
  {
    const BatchLock lock(*batch);
    for (int i = 0; i < 3; ++i) {
      threads.emplace_back([&] {
        const BatchLock own(*batch);
        ++done;
      });
    }
    std::this_thread::sleep_for(50ms);
    served.end();
    EXPECT_EQ(done, 0);
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(done, 3);
}

}  // namespace
}  // namespace flockstep
