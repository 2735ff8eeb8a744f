// The parts that run the operations of the server: workload, executor, its end, and a load of clients.
#include "service/executor.hpp"

#include <sys/resource.h>

#include <deque>
#include <new>

#include "base/interrupt.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"
#include "server/operations.hpp"
#include "service/call.hpp"
#include "service/workload.hpp"

namespace flockstep::server {
namespace {

using namespace operating;

TEST(Workload, IsWaitedForUntilItsLastMark) {
  Workload workload;
  std::atomic<int> turns{0};
  std::thread spare([&] {
    while (workload.wait()) ++turns;
  });
  const auto is_idle = [&] {
    for (int i = 0; i < 200; ++i) {
      const int before = turns;
      std::this_thread::sleep_for(10ms);
      if (turns == before) return true;
    }
    return false;
  };
  const auto is_busy = [&] {
    for (const int before = turns; turns == before;) std::this_thread::yield();
  };
  EXPECT_TRUE(is_idle());
  {
    const Workload::Mark outer(workload);
    is_busy();
    try {
      const Workload::Mark inner(workload);
      throw std::runtime_error("of the operation");
    } catch (const std::runtime_error&) {
    }
    is_busy();
  }
  EXPECT_TRUE(is_idle());
  for (int i = 0; i < 100; ++i) {
    const Workload::Mark mark(workload);
    is_busy();
  }
  workload.end();
  spare.join();
}

TEST(Executor, RunsEachWaitingOperationByItself) {
  std::deque<std::function<void()>> posted;
  Executor executor([&](std::function<void()> work) { posted.push_back(std::move(work)); });
  std::vector<int> order;
  executor.run([&] {
    for (int i = 0; i < 3; ++i) executor.run([&, i] { order.push_back(i); });
    executor.run_later([&] { order.push_back(3); });
    EXPECT_FALSE(executor.try_run([] { return true; }));
    EXPECT_TRUE(order.empty());
  });
  for (int i = 0; i < 4; ++i) {
    EXPECT_EQ(std::ssize(order), i);
    ASSERT_EQ(posted.size(), 1U);
    const std::function<void()> next = std::move(posted.front());
    posted.pop_front();
    next();
  }
  EXPECT_EQ(order, (std::vector{0, 1, 2, 3}));
  EXPECT_TRUE(posted.empty());
  EXPECT_TRUE(executor.try_run([] { return true; }));

  executor.run_later([&] { order.push_back(4); });
  EXPECT_FALSE(executor.try_run([] { return true; }));
  ASSERT_EQ(posted.size(), 1U);
  executor.clear();
  posted.front()();
  EXPECT_EQ(order.size(), 4U);
}

TEST(Executor, RunsTheNextOperationAfterOneThatThrows) {
  std::deque<std::function<void()>> posted;
  Executor executor([&](std::function<void()> work) { posted.push_back(std::move(work)); });
  const auto fail = [] { throw std::bad_alloc(); };
  int runs = 0;
  EXPECT_THROW(executor.run([&] {
    executor.run_later(fail);
    executor.run_later([&] { ++runs; });
    fail();
  }),
               std::bad_alloc);
  ASSERT_EQ(posted.size(), 1U);
  EXPECT_THROW(posted[0](), std::bad_alloc);
  ASSERT_EQ(posted.size(), 2U);
  posted[1]();
  EXPECT_EQ(runs, 1);
  EXPECT_THROW(static_cast<void>(executor.try_run([&]() -> bool { throw std::bad_alloc(); })), std::bad_alloc);
  EXPECT_TRUE(executor.try_run([] { return true; }));
}

TEST(Call, MakesAnErrorOfAReplyThatIsTooLong) {
  Call call;
  call.request.id = 7;
  call.result<protocol::Error>().text = std::string(protocol::kMaxHeaderBytes<protocol::Reply>, 'x');
  call.finish();
  protocol::Reply reply;
  protocol::read_header(call.writer.header(), reply);
  EXPECT_EQ(reply.id, 7U);
  EXPECT_EQ(std::get<protocol::Error>(reply.result).code, protocol::Code::kResourceExhausted);
}

TEST(Server, StopsWhileOperationsRunAndWait) {
  for (int i = 0; i < 3; ++i) {
    Served served(rotors());
    GameModeController pilot(served.connect()), second(served.connect()), other(served.connect());
    const std::vector<float> hover(4 * kFleet, 0.0F);
    auto flight = pilot.fly(later, {.command = hover}, 1'000'000);
    auto next = second.fly(later, {.command = hover}, 1'000'000);
    ASSERT_TRUE(answers_pings(other));
    const auto begin = std::chrono::steady_clock::now();
    served.server.stop();
    EXPECT_LT(std::chrono::steady_clock::now() - begin, 5s);
    EXPECT_THROW(flight.get(), client::Error);
    EXPECT_THROW(next.get(), client::Error);
    EXPECT_THROW(other.ping(), client::Error);
  }
}

TEST(Server, ASecondStopWaitsForTheFirst) {
  Served served(rotors());
  GameModeController pilot(served.connect()), other(served.connect());
  const std::vector<float> hover(4 * kFleet, 0.0F);
  auto flight = pilot.fly(later, {.command = hover}, 1'000'000);
  ASSERT_TRUE(answers_pings(other));
  std::thread first([&] { served.server.stop(); });
  try {
    for (;;) other.ping();
  } catch (const client::Error&) {  // now the server stops
  }
  served.server.stop();
  EXPECT_FALSE(ServedBatch::is_served(served.batch));
  first.join();
}

TEST(Server, StopsAgainAfterAnInterrupt) {
  Served served(kinematic());
  std::atomic<int> phase{0};
  std::thread program([&] {
    const BatchLock lock(served.batch);
    phase = 1;
    while (phase == 1) std::this_thread::yield();
  });
  while (phase == 0) std::this_thread::yield();
  {
    const Interrupt interrupt([] { throw std::runtime_error("interrupted"); });
    EXPECT_THROW(served.server.stop(), std::runtime_error);
  }
  EXPECT_TRUE(ServedBatch::is_served(served.batch));
  phase = 2;
  served.server.stop();
  EXPECT_FALSE(ServedBatch::is_served(served.batch));
  program.join();
}

TEST(Server, AnswersAThousandClientsThatAskAtOnce) {
  constexpr rlim_t kFiles = 8192;
  rlimit before{};
  ASSERT_EQ(getrlimit(RLIMIT_NOFILE, &before), 0);
  rlimit files = before;
  files.rlim_cur = std::max(before.rlim_cur, std::min(before.rlim_max, kFiles));
  ASSERT_EQ(setrlimit(RLIMIT_NOFILE, &files), 0);
  const std::size_t count = files.rlim_cur >= kFiles ? 1000 : static_cast<std::size_t>(files.rlim_cur / 8);
  {
    Served served(kinematic());
    std::vector<Connection> connections;
    for (std::size_t i = 0; i < count; ++i) connections.push_back(served.connect());
    const auto all = operations();
    GameModeController other(connections.front());
    for (int round = 0; round < 3; ++round) {
      std::vector<Sent> sent;
      for (std::size_t i = 1; i < count; ++i)
        sent.push_back(all[(i + static_cast<std::size_t>(round)) % all.size()].second(connections[i]));
      EXPECT_TRUE(answers_pings(other));
      for (const Sent& result : sent) result();
    }
    EXPECT_EQ(served.server.num_clients(), static_cast<int>(count));
  }
  setrlimit(RLIMIT_NOFILE, &before);
}

// Threads of clients and of the program, which refused requests and the end of the server meet at any time.
TEST(Server, LosesNoReplyUnderLoad) {
  for (int round = 0; round < 3; ++round) {
    Served served(kinematic());
    std::atomic<bool> is_over{false};
    std::atomic<int> done{0};
    std::vector<std::thread> threads;
    for (std::size_t i = 0; i < 6; ++i) {
      threads.emplace_back([&, i] {
        const auto all = operations();
        try {
          const Connection connection = served.connect();
          DroneController missing(connection, 99);
          for (std::size_t turn = i; !is_over; ++turn) {
            const Sent first = all[turn % all.size()].second(connection),
                       second = all[(turn + i) % all.size()].second(connection);
            if (turn % 7 == 0) {
              EXPECT_THROW(missing.set_location({0, 0, 1}), client::Error);
            }
            second();
            first();
            ++done;
          }
        } catch (const client::Error& error) {
          EXPECT_NE(error.code(), client::ErrorCode::timeout) << error.what();
          EXPECT_TRUE(is_over) << error.what();
        }
      });
    }
    threads.emplace_back([&] {
      while (!is_over) {
        served.batch.sense();
        std::this_thread::sleep_for(100us);
      }
    });
    GameModeController other(served.connect());
    bool is_answered = true;
    while (is_answered && done < 300) is_answered = answers_pings(other);
    is_over = true;
    if (round > 0) served.server.stop();
    for (std::thread& thread : threads) thread.join();
    EXPECT_TRUE(is_answered);
  }
}

}  // namespace
}  // namespace flockstep::server
