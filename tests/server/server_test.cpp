// The server's threads: one runs handlers, and a spare one helps out while something may take long.
#include "flockstep/server.hpp"

#include "server/operations.hpp"

namespace flockstep::server {
namespace {

using namespace operating;

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
  batch.camera(0).set({.width_px = 64});
  ServedBatch::run_moves_with(batch, {});
  ASSERT_TRUE(was_called);
}

TEST(Server, ReadsAPublishedFrameInTheSizeThatItHas) {
  Served served(filming());
  const Connection connection = served.connect();
  GameModeController other(served.connect());
  served.batch.sense();
  ask_for_published_frames(served, connection, other);
  served.batch.camera(0).set({.width_px = 8, .height_px = 6});
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
  served.batch.camera(0).set_capture_mode(CaptureMode::on_demand);
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

}  // namespace
}  // namespace flockstep::server
