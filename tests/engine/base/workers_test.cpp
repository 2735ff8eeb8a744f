#include "base/workers.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <thread>
#include <vector>

#include "base/interrupt.hpp"
#include "base/platform.hpp"

namespace flockstep {
namespace {

TEST(Workers, HaveTheRequestedNumber) {
  for (const int threads : {2, 8, 5, 8}) {
    Workers workers(threads);
    const auto count = static_cast<std::size_t>(threads);
    std::vector<std::atomic<int>> seen(count);
    std::atomic<int> inside{0};
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    workers.run(count, [&](std::size_t, std::size_t thread) {
      ++inside;
      ++seen.at(thread);
      while (inside < threads && std::chrono::steady_clock::now() < end) std::this_thread::yield();  // waits for all
    });
    for (const auto& times : seen) EXPECT_EQ(times, 1);
  }
}

TEST(Workers, AreAtMostFourPerProcessor) {
  EXPECT_EQ(thread_count(1), 1);
  EXPECT_EQ(thread_count(3), 3);
  EXPECT_EQ(thread_count(0), physical_cores());
  EXPECT_EQ(thread_count(1 << 20), 4 * logical_processors());
}

TEST(Workers, RethrowExceptionsAndStayUsable) {
  for (const int threads : {1, 3}) {
    Workers workers(threads);
    EXPECT_THROW(workers.run(100,
                             [](std::size_t i, std::size_t) {
                               if (i == 7) throw std::runtime_error("seven");
                             }),
                 std::runtime_error);
    std::atomic<int> calls{0};
    workers.run(100, [&](std::size_t, std::size_t) { ++calls; });
    EXPECT_EQ(calls, 100);
  }
}

TEST(Workers, AllCallsEndSoonOnceTheCallerIsInterrupted) {
  struct Stopped {};
  Workers workers(2);
  const Interrupt interrupt([] { throw Stopped(); });
  const auto begun = std::chrono::steady_clock::now();
  const auto poll_for_long = [&](std::size_t, std::size_t) {
    while (std::chrono::steady_clock::now() - begun < std::chrono::seconds(20)) Interrupt::poll();
  };
  EXPECT_THROW(workers.run(2, poll_for_long), Stopped);
  EXPECT_LT(std::chrono::steady_clock::now() - begun, std::chrono::seconds(10));
}

}  // namespace
}  // namespace flockstep
