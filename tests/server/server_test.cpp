// The server's threads: one runs handlers, and a spare one helps out while something may take long.
#include "flockstep/server.hpp"

#include <gtest/gtest.h>
#include <sys/resource.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <deque>
#include <functional>
#include <memory>
#include <new>
#include <optional>
#include <stdexcept>
#include <string>
#include <thread>
#include <utility>
#include <variant>
#include <vector>

#include "base/interrupt.hpp"
#include "batch_helpers.hpp"
#include "flockstep/batch.hpp"
#include "flockstep/batch_lock.hpp"
#include "flockstep/client.hpp"
#include "flockstep/served_batch.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"
#include "service/call.hpp"
#include "service/executor.hpp"
#include "service/workload.hpp"

namespace flockstep::server {
namespace {

using namespace std::chrono_literals;
using client::Connection;
using client::DroneController;
using client::GameModeController;
using client::later;

BatchConfig kinematic() {
  BatchConfig config = testing::lidar_batch(1, {.beams = 35, .max_range_m = 20});
  config.drones_per_env = 8;
  CameraConfig camera;
  camera.width_px = 32;
  camera.height_px = 24;
  camera.capture_mode = CaptureMode::on_demand;
  config.cameras = {camera};
  return config;
}

constexpr std::size_t kFleet = 64;

BatchConfig rotors() {
  BatchConfig config = testing::lidar_batch(kFleet);
  config.dynamics.motion = Motion::rotors;
  config.dynamics.control = Control::velocity;
  return config;
}

struct Served {
  explicit Served(const BatchConfig& config, int max_clients = 2000)
      : batch(config, Batch::Worlds{testing::closet()}, nullptr, DroneModel::quadrotor650()),
        server(batch, any_port(max_clients)) {}
  static ServerConfig any_port(int max_clients) {
    ServerConfig config;
    config.port = 0;
    config.max_clients = max_clients;
    return config;
  }
  Connection connect() const { return Connection({.address = server.address(), .timeout = 60s}); }
  void wait_for_clients(int count) const {
    for (int i = 0; i < 10000 && server.num_clients() != count; ++i) std::this_thread::sleep_for(1ms);
    EXPECT_EQ(server.num_clients(), count);
  }

  Batch batch;
  Server server;
};

// Some pings take longer than a request on its way to the server.
bool answers_pings(GameModeController& client) {
  for (int i = 0; i < 50; ++i) {
    if (!client.ping(later).get_for(5s)) return false;
  }
  return true;
}

// An operation that is sent and whose result is fetched later.
using Sent = std::function<void()>;
using Operation = std::function<Sent(const Connection&)>;

template <class Begin>
Operation operation(Begin begin) {
  return [begin](const Connection& connection) {
    const auto future = std::make_shared<decltype(begin(connection))>(begin(connection));
    return [future] { future->get(); };
  };
}

std::vector<std::pair<std::string, Operation>> operations() {
  const auto drone = [](const Connection& to) { return DroneController(to, 3); };
  return {
      {"SetLocation", operation([=](const Connection& to) { return drone(to).set_location(later, {1, 1, 0.75F}, true); })},
      {"GetLidarData", operation([=](const Connection& to) { return drone(to).get_lidar_data(later); })},
      {"GetCameraData", operation([=](const Connection& to) { return drone(to).get_camera_data(later); })},
      {"GetLocation", operation([=](const Connection& to) { return drone(to).get_location(later); })},
      {"GetArrays", operation([=](const Connection& to) { return GameModeController(to).get_array(later, "position"); })},
      {"SetPoses", operation([](const Connection& to) { return GameModeController(to).set_poses(later, {}, true); })},
      {"Sense", operation([](const Connection& to) { return GameModeController(to).sense(later); })},
      {"Step", operation([](const Connection& to) { return GameModeController(to).step(later); })},
      {"Snapshot", operation([](const Connection& to) { return GameModeController(to).snapshot(later); })},
      {"SetLidarConfig",
       operation([=](const Connection& to) { return drone(to).set_lidar_config(later, R"({"hfov_deg": 90})"); })},
  };
}

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

TEST(Server, ListsTenThousandDrones) {
  BatchConfig config;
  config.num_envs = 10'000;
  Served served(config);
  EXPECT_EQ(GameModeController(served.connect()).get_drones().size(), 10'000U);
}

TEST(Server, AnswersPingsWhileAnOperationWaitsForTheProgram) {
  Served served(kinematic());
  const Connection first = served.connect(), second = served.connect();
  GameModeController other(served.connect());
  for (const auto& [name, begin] : operations()) {
    SCOPED_TRACE(name);
    std::vector<Sent> sent;
    {
      const BatchLock lock(served.batch);
      sent.push_back(begin(first));
      ASSERT_TRUE(answers_pings(other));
      sent.push_back(begin(second));
      ASSERT_TRUE(answers_pings(other));
    }
    for (const Sent& result : sent) result();
    EXPECT_TRUE(answers_pings(other));
  }
}

TEST(Server, FreesADroneThatALastRequestClaims) {
  Served served(kinematic());
  GameModeController other(served.connect());
  std::optional<Connection> gone = served.connect();
  {
    const BatchLock lock(served.batch);
    static_cast<void>(GameModeController(*gone).spawn_drone(later, {.claim = true}));  // runs, and waits for the lock
    ASSERT_TRUE(answers_pings(other));
    gone.reset();
  }
  served.wait_for_clients(1);
  const std::vector<client::Drone> drones = other.get_drones();
  EXPECT_EQ(drones.size(), 9U);
  for (const client::Drone& drone : drones) EXPECT_EQ(drone.owner, 0U);
}

TEST(Server, DropsWaitingRequestsOfAClientThatIsGone) {
  Served served(kinematic(), 3);
  GameModeController first(served.connect()), other(served.connect());
  std::optional<Connection> gone = served.connect();
  {
    const BatchLock lock(served.batch);
    auto sensed = first.sense(later);  // waits for the lock, and the next request for this one
    ASSERT_TRUE(answers_pings(other));
    static_cast<void>(GameModeController(*gone).spawn_drone(later));
    ASSERT_TRUE(answers_pings(other));
    gone.reset();
    ASSERT_TRUE(answers_pings(other));
    try {  // the request still has its place
      static_cast<void>(served.connect());
      ADD_FAILURE() << "a fourth client";
    } catch (const client::Error& error) {
      EXPECT_EQ(error.code(), client::ErrorCode::resource_exhausted);
    }
  }
  other.sense();
  EXPECT_EQ(other.get_drones().size(), 8U);
  served.wait_for_clients(2);
  EXPECT_TRUE(served.connect().is_open());
}

TEST(Server, SendsNoErrorOfAStreamThatHasEnded) {
  Served served(kinematic());
  const Connection connection = served.connect();
  GameModeController first(served.connect()), client(connection), other(served.connect());
  {
    const BatchLock lock(served.batch);
    auto sensed = first.sense(later);  // waits for the lock, and the value for this one
    ASSERT_TRUE(answers_pings(other));
    {
      const auto stream = DroneController(connection, 3).stream_lidar(1000);
      client.ping();
      ASSERT_TRUE(answers_pings(other));  // by then a value is being made
    }
    client.ping();
    served.batch.remove(std::array<std::int64_t, 1>{3});  // the value fails
  }
  client.sense();
  client.ping();
  EXPECT_TRUE(connection.is_open());
}

TEST(Server, LimitsTheStreamsWhoseValuesAreBeingMade) {
  Served served(kinematic());
  const Connection connection = served.connect();
  GameModeController first(served.connect()), client(connection), other(served.connect());
  DroneController drone(connection, 3);
  const auto is_refused = [&] {
    auto stream = drone.stream_lidar(1000);
    client.ping();
    try {
      static_cast<void>(stream.next(0ns));
    } catch (const client::Error& error) {
      EXPECT_EQ(error.code(), client::ErrorCode::resource_exhausted);
      return true;
    }
    return false;
  };
  {
    const BatchLock lock(served.batch);
    auto sensed = first.sense(later);  // waits for the lock, and all values for this one
    ASSERT_TRUE(answers_pings(other));
    int turns = 0;
    while (!is_refused()) ASSERT_LT(++turns, 2000);
    EXPECT_GE(turns, 64);
  }
  client.sense();  // comes after all values
  EXPECT_FALSE(is_refused());
}

TEST(Server, AnswersPingsWhileATickOrALockstepWaits) {
  Served served(kinematic());
  GameModeController clock(served.connect()), member(served.connect()), other(served.connect());
  clock.set_clock(1000);
  for (int i = 0; i < 3; ++i) {
    const BatchLock lock(served.batch);
    std::this_thread::sleep_for(5ms);
    ASSERT_TRUE(answers_pings(other));
  }
  clock.set_clock(0);
  clock.join_lockstep();
  member.join_lockstep();
  auto first = clock.step(later);
  std::optional<client::Future<client::Time>> second;
  {
    const BatchLock lock(served.batch);
    second.emplace(member.step(later));
    ASSERT_TRUE(answers_pings(other));
  }
  EXPECT_EQ(first.get().step, second->get().step);
}

BatchConfig filming() {
  BatchConfig config = kinematic();
  config.cameras[0].capture_mode = CaptureMode::every_step;
  return config;
}

// Lets a client ask for a frame while the batch is locked, so that the server publishes frames before the next long calls.
void ask_for_published_frames(Served& served, const Connection& connection, GameModeController& other) {
  std::optional<client::Future<client::CameraData>> frame;
  {
    const BatchLock lock(served.batch);
    frame.emplace(DroneController(connection, 7).get_camera_data(later));
    ASSERT_TRUE(answers_pings(other));
  }
  frame->get();
}

// Calls a function during a long call of the program, after the server has published what clients read.
void during_a_call(Batch& batch, const std::function<void()>& function) {
  bool was_called = false;
  ServedBatch::run_moves_with(batch, [&](const std::function<void()>& move) {
    function();
    was_called = true;
    move();
  });
  batch.set_camera(0, {.width_px = 64});
  ServedBatch::run_moves_with(batch, {});
  ASSERT_TRUE(was_called);
}

TEST(Server, ReadsAPublishedFrameInTheSizeThatItHas) {
  Served served(filming());
  const Connection connection = served.connect();
  GameModeController other(served.connect());
  served.batch.sense();
  ask_for_published_frames(served, connection, other);
  served.batch.set_camera(0, {.width_px = 8, .height_px = 6});
  served.batch.sense();
  during_a_call(served.batch, [&] {
    const client::CameraData frame = DroneController(connection, 7).get_camera_data({.format = client::ImageFormat::png});
    EXPECT_EQ(frame.width_px, 8);
    EXPECT_EQ(frame.height_px, 6);
  });
}

TEST(Server, PublishesNoFramesOfACameraThatTheProgramSetsOnDemand) {
  Served served(filming());
  const Connection connection = served.connect();
  GameModeController other(served.connect());
  served.batch.sense();
  ask_for_published_frames(served, connection, other);
  served.batch.set_capture_mode(0, CaptureMode::on_demand);
  std::optional<client::Future<client::CameraData>> frame;
  during_a_call(served.batch, [&] {
    frame.emplace(DroneController(connection, 7).get_camera_data(later));
    ASSERT_TRUE(answers_pings(other));
    EXPECT_FALSE(frame->is_ready());
  });
  EXPECT_EQ(frame->get().width_px, 64);
}

TEST(Server, TakesNoFrameForAChange) {
  Served served(kinematic());
  DroneController drone(served.connect(), 3);
  auto stream = drone.stream_camera(1000, {}, true);
  ASSERT_TRUE(stream.next(10s));
  for (int i = 0; i < 10; ++i) drone.get_camera_data();
  EXPECT_FALSE(stream.next(50ms));
  drone.set_location({1, 1, 0.75F}, true);
  EXPECT_TRUE(stream.next(10s));
}

TEST(Server, StreamsImagesWhileItsClockTakesAllItsTime) {
  Served served(filming());
  GameModeController clock(served.connect());
  clock.set_clock(10000);
  const Connection watcher = served.connect();
  std::vector<client::Stream<client::CameraData>> streams;
  for (std::int64_t drone = 0; drone < 8; ++drone) streams.push_back(DroneController(watcher, drone).stream_camera(200));
  for (int i = 0; i < 20; ++i) {
    for (auto& stream : streams) ASSERT_TRUE(stream.next(10s));
  }
  EXPECT_GT(clock.get_fps().fps, 0.0);
}

TEST(Server, AnswersPingsDuringALongOperationAndAfterItsFailure) {
  Served served(rotors());
  GameModeController pilot(served.connect()), second(served.connect()), other(served.connect());
  const std::vector<float> hover(4 * kFleet, 0.0F);
  for (int i = 0; i < 100; ++i) EXPECT_THROW(pilot.fly({.command = hover}, 2'000'000), client::Error);
  auto flight = pilot.fly(later, {.command = hover}, 100'000);
  ASSERT_TRUE(answers_pings(other));  // by then the flight has begun
  auto next = second.fly(later, {.command = hover}, 1);
  ASSERT_TRUE(answers_pings(other));
  EXPECT_FALSE(flight.is_ready());
  EXPECT_FALSE(next.is_ready());
  next.get();
  EXPECT_TRUE(flight.is_ready());
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
