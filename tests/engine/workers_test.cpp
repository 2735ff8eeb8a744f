#include "base/workers.hpp"

#include <gtest/gtest.h>

#include <atomic>
#include <chrono>
#include <cstddef>
#include <stdexcept>
#include <thread>
#include <vector>

namespace flockstep {
namespace {

TEST(Workers, AreAsManyAsWereAskedFor) {
  for (const int threads : {2, 8, 5, 8}) {
    Workers workers(threads);
    const auto count = static_cast<std::size_t>(threads);
    std::vector<std::atomic<int>> seen(count);
    std::atomic<int> inside{0};
    const auto end = std::chrono::steady_clock::now() + std::chrono::seconds(30);
    workers.run(count, [&](std::size_t, std::size_t thread) {
      ++inside;
      ++seen.at(thread);
      while (inside < threads && std::chrono::steady_clock::now() < end) std::this_thread::yield();  // for all to come
    });
    for (const auto& times : seen) EXPECT_EQ(times, 1);
  }
}

TEST(Workers, PassOnWhatACallThrowsAndCanBeUsedAfterwards) {
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

}  // namespace
}  // namespace flockstep
