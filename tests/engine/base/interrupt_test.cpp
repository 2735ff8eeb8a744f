#include "base/interrupt.hpp"

#include <chrono>

#include "base/platform.hpp"
#include "base/workers.hpp"
#include "batch_helpers.hpp"
#include "flockstep/generators.hpp"
#include "flockstep/planning.hpp"
#include "flockstep/raycast.hpp"
#include "formats/mesh_files.hpp"
#include "formats/scene_json.hpp"

namespace flockstep {
namespace {

using namespace testing;

struct Stopped {};

// Acts like Ctrl-C at the first poll.
struct Stop {
  Interrupt interrupt{[] { throw Stopped(); }};
  Stop() {
    Interrupt::poll();
    std::this_thread::sleep_for(std::chrono::milliseconds(60));  // longer than the interval between checks
  }
};

int polls = 0;

TEST(Interrupt, ChecksPeriodically) {
  polls = 0;
  {
    const Interrupt outer([] { ++polls; });
    const auto begin = std::chrono::steady_clock::now();
    const auto elapsed = [begin] { return std::chrono::steady_clock::now() - begin; };
    while (polls < 4 && elapsed() < std::chrono::minutes(1)) Interrupt::poll();
    EXPECT_EQ(polls, 4);
    EXPECT_GE(elapsed(), 4 * std::chrono::milliseconds(50));
    {
      const Interrupt inner([] { throw Stopped(); });
      Interrupt::poll();
      std::this_thread::sleep_for(std::chrono::milliseconds(60));
      EXPECT_THROW(Interrupt::poll(), Stopped);
      std::thread([] { Interrupt::poll(); }).join();
    }
    Interrupt::poll();
  }
  const int before = polls;
  std::this_thread::sleep_for(std::chrono::milliseconds(60));
  Interrupt::poll();
  EXPECT_EQ(polls, before);
}

TEST(Interrupt, EndsLoading) {
  std::string spheres;
  for (int i = 0; i < 2000; ++i) spheres += (i == 0 ? "" : ",") + std::string(R"({"center": [0, 0, 0], "radius": 1})");
  const std::string scene = R"({"flockstep_scene": 1, "spheres": [)" + spheres + "]}";
  std::string obj = "v 0 0 0\nv 1 0 0\nv 0 1 0\n";
  for (int i = 0; i < 20'000; ++i) obj += "f 1 2 3\n";
  EXPECT_EQ(parse_scene(scene, "x", {}).primitives.size(), 2000U);
  EXPECT_EQ(parse_obj(obj, "x").mesh.triangles.size(), 20'000U);
  const Stop stop;
  EXPECT_THROW(parse_scene(scene, "x", {}), Stopped);
  EXPECT_THROW(parse_obj(obj, "x"), Stopped);
}

TEST(Interrupt, EndsPreparationAndTheWorldStaysUsable) {
  TriangleMesh mesh;
  for (int i = 0; i < 400; ++i) {
    for (int j = 0; j < 400; ++j) {
      const auto first = static_cast<std::int32_t>(mesh.vertices.size());
      const auto x = static_cast<float>(i), y = static_cast<float>(j);
      for (const Vec3& corner : {Vec3(x, y, 0), Vec3(x + 1, y, 0), Vec3(x, y + 1, 1)}) mesh.vertices.push_back(corner);
      mesh.triangles.push_back({first, first + 1, first + 2});
    }
  }
  const auto world = make_world({}, {}, mesh);
  const std::vector<float> origin{0.25F, 0.25F, 5}, down{0, 0, -1};
  {
    const Stop stop;
    EXPECT_THROW(raycast(*world, origin, down, 10), Stopped);
    EXPECT_THROW(closet()->mesh(1e-5F), Stopped);
  }
  EXPECT_EQ(raycast(*world, origin, down, 10).primitive[0], 0);
}

TEST(Interrupt, EndsTheWorkOfABatch) {
  for (const int threads : {1, 3}) {
    BatchConfig config = lidar_batch(64, {.channels = 32, .beams = 64});
    config.num_threads = threads;
    config.block_size = 1;
    config.episode.max_episode_steps = 100;
    Batch batch(config, {closet()}, make_task(NavigationConfig{}));
    batch.reset(std::vector<std::uint64_t>(64, 7));
    const std::string before = batch.snapshot();
    const std::vector<std::int64_t> actions(64, 1);
    {
      const Stop stop;
      EXPECT_THROW(batch.step(actions), Stopped);
      EXPECT_THROW(batch.sense(), Stopped);
    }
    // Some envs have been stepped and others not, so the batch is unusable until it is reset or restored as a whole.
    for (const std::string& message : {message_of([&] { batch.step(actions); }), message_of([&] { batch.snapshot(); }),
                                       message_of([&] { batch.reset({}, std::vector<std::uint8_t>(64, 0)); }),
                                       message_of([&] { batch.spawn(std::vector<std::int64_t>{3}, {}, {}, {}); })}) {
      EXPECT_TRUE(names(message, "interrupted"));
    }
    batch.restore(before);
    batch.step(actions);
    const std::string after = batch.snapshot();
    {
      const Stop stop;
      EXPECT_THROW(batch.reset({}), Stopped);
      EXPECT_THROW(batch.step(actions), std::runtime_error);
    }
    batch.reset(std::vector<std::uint64_t>(64, 7));
    batch.step(actions);
    EXPECT_EQ(batch.snapshot(), after);
  }
}

TEST(Interrupt, EndsPlanning) {
  const auto world = playground("train-1");
  const auto goals = std::vector<Vec3>{*world->markers().goal};
  EXPECT_TRUE(plan(*world, DroneModel::quadrotor650(), *world->markers().start, goals, 0.2F));
  const Stop stop;
  EXPECT_THROW(plan(*world, DroneModel::quadrotor650(), *world->markers().start, goals, 0.2F), Stopped);
  EXPECT_THROW(flockstep::playground({.seed = 1}), Stopped);
}

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
