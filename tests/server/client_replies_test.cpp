// Replies in any order, late, large or with changed bytes, and requests that are not sent.
#include "server/scripted_server.hpp"

namespace flockstep {
namespace {

using namespace failures;

TEST(ClientFaults, LateRepliesAndTimeouts) {
  std::atomic<bool> may_answer{false};
  ScriptedServer server(welcomed([&](Peer& peer) {
    const std::uint64_t first = peer.next().id, second = peer.next().id;
    while (!may_answer) std::this_thread::sleep_for(1ms);
    peer.reply(first, protocol::Vector3{.x = 1});
    peer.reply(second, protocol::Vector3{.x = 2});
    peer.reply(peer.next().id, protocol::Done{});
  }));
  DroneController drone(Connection({.address = server.address(), .timeout = 50ms}), 0);
  auto kept = drone.get_location(later);
  EXPECT_FALSE(kept.is_ready());
  EXPECT_EQ(kept.get_for(1ms), std::nullopt);
  const Failure late = failure([&] { drone.get_location(); });  // which discards its reply
  EXPECT_EQ(late.code, ErrorCode::timeout);
  EXPECT_TRUE(contains(late.text, "did not reply within 50 ms")) << late.text;
  EXPECT_EQ(failure([&] { kept.get(); }).code, ErrorCode::timeout);
  may_answer = true;
  EXPECT_EQ(kept.get_for(5s), (client::Vector3{1, 0, 0}));
  EXPECT_TRUE(drone.ping(later).get_for(5s));
  EXPECT_EQ(failure([&] { kept.get(); }).code, ErrorCode::failed_precondition);  // taken before
}

TEST(ClientFaults, FuturesInAnyOrder) {
  ScriptedServer server(welcomed([](Peer& peer) {
    for (int i = 0; i < 100; ++i) peer.reply(peer.next().id, protocol::Vector3{.x = static_cast<float>(i)});
  }));
  DroneController drone(Connection({.address = server.address()}), 0);
  std::vector<client::Future<client::Vector3>> futures;
  for (int i = 0; i < 100; ++i) futures.push_back(drone.get_location(later));
  for (int i = 99; i >= 0; --i) EXPECT_EQ(futures[static_cast<std::size_t>(i)].get()[0], static_cast<float>(i));
}

TEST(ClientFaults, ThreadsShareAConnection) {
  constexpr int kThreads = 4, kCalls = 300;
  ScriptedServer server(welcomed([](Peer& peer) {
    for (;;) {
      const protocol::Request request = peer.next();
      peer.reply(request.id,
                 protocol::Vector3{.x = static_cast<float>(std::get<protocol::GetLocation>(request.operation).drone)});
    }
  }));
  const Connection connection({.address = server.address()});
  std::vector<std::thread> threads;
  std::atomic<int> right{0};
  for (int t = 0; t < kThreads; ++t) {
    threads.emplace_back([&, t] {
      for (int i = 0; i < kCalls; ++i) {
        const int drone = t * kCalls + i;
        right += DroneController(connection, drone).get_location()[0] == static_cast<float>(drone) ? 1 : 0;
      }
    });
  }
  for (std::thread& thread : threads) thread.join();
  EXPECT_EQ(right, kThreads * kCalls);
}

TEST(ClientFaults, LargeMessagesBothWaysAtOnce) {
  const std::vector<std::uint8_t> large(std::size_t{24} << 20, 7);
  ScriptedServer server(welcomed([&](Peer& peer) {
    const std::uint64_t get = peer.next().id;
    peer.reply(get, protocol::Done{}, [&](auto& writer) {
      writer.add("snapshot", std::span<const std::uint8_t>(large), {large.size()});
    });  // which reads nothing in the meantime
    const std::uint64_t set = peer.next().id;
    EXPECT_GT(peer.bytes().size(), large.size());
    peer.reply(set, protocol::Done{});
  }));
  GameModeController simulation(Connection({.address = server.address()}));
  auto snapshot = simulation.snapshot(later);
  simulation.restore(large);
  EXPECT_EQ(snapshot.get(), large);
}

// ------------------------------------------------------------------------------------------------------------------- streams

TEST(ClientFaults, StreamsGiveTheNewestValueAndEnd) {
  std::uint64_t unsubscribed = 0;
  ScriptedServer server(welcomed([&](Peer& peer) {
    const protocol::Request request = peer.next();
    EXPECT_EQ(std::get<protocol::Subscribe>(request.operation).rate_hz, 50.0);
    for (int i = 1; i <= 20; ++i) peer.reply(request.id, protocol::Fps{.fps = static_cast<double>(i)});
    peer.reply(peer.next().id, protocol::Done{});  // Ping
    const protocol::Request end = peer.next();
    unsubscribed = std::get<protocol::Unsubscribe>(end.operation).stream;
    peer.reply(request.id, protocol::Fps{.fps = 21.0});  // was on its way
    peer.reply(end.id, protocol::Done{});
    peer.reply(peer.next().id, protocol::Done{});  // Ping
    const std::uint64_t other = peer.next().id;
    peer.reply(other, protocol::Fps{.fps = 1.0});
    peer.reply(other, protocol::Error{.code = protocol::Code::kNotFound, .text = "the drone is gone"});
    const std::uint64_t refused = peer.next().id;
    peer.reply(refused, protocol::Error{.code = protocol::Code::kInvalidArgument, .text = "rate_hz: bad"});
    peer.reply(peer.next().id, protocol::Done{});  // Ping
    peer.reply(other, protocol::Fps{.fps = 2.0});  // of a stream that has ended
  }));
  Connection connection({.address = server.address()});
  GameModeController simulation(connection);
  {
    auto stream = simulation.stream_fps(50.0);
    simulation.ping();  // whose reply comes after them
    EXPECT_EQ(stream.next(0ms).value().fps, 20.0);
    EXPECT_FALSE(stream.next(10ms));
  }
  simulation.ping();
  EXPECT_EQ(unsubscribed, 2U);
  auto other = simulation.stream_fps(50.0);
  EXPECT_EQ(failure([&] {
              while (other.next(5s)) {
              }
            }).text,
            "the drone is gone");
  auto refused = simulation.stream_fps(-1.0);
  EXPECT_EQ(failure([&] { refused.next(5s); }).text, "rate_hz: bad");
  simulation.ping();
  EXPECT_EQ(failure([&] { simulation.ping(); }).code, ErrorCode::bad_reply);
}

// ------------------------------------------------------------------------------------------------------------------ requests

TEST(ClientFaults, BadArgumentsAreNotSent) {
  std::atomic<int> requests{0};
  ScriptedServer server(welcomed([&](Peer& peer) {
    for (;;) {
      const std::uint64_t id = peer.next().id;
      ++requests;
      peer.reply(id, protocol::Done{});
    }
  }));
  Connection connection({.address = server.address()});
  GameModeController simulation(connection);
  DroneController drone(connection, 0);
  constexpr float inf = kInfinity;
  const std::vector<std::function<void()>> calls{
      [&] { drone.set_location({kNan, 0, 0}); },
      [&] { drone.set_rotation(client::Quaternion{1, 0, inf, 0}); },
      [&] { drone.set_rotation(client::Angles{.pitch_deg = kNan}); },
      [&] { drone.set_location_and_rotation({0, 0, inf}, client::Angles{}); },
      [&] { drone.stream_lidar(std::numeric_limits<double>::infinity()); },
      [&] { simulation.spawn_drone({.location = client::Vector3{kNan, 0, 0}}); },
      [&] { simulation.set_clock(std::numeric_limits<double>::quiet_NaN()); },
      [&] { simulation.get_point_cloud(kNan); },
      [&] { simulation.fly({.command = std::vector<float>(5)}); },
      [&] { simulation.set_poses({.position = std::vector<float>(4)}); },
      [&] { simulation.set_poses({.mask = std::vector<std::uint8_t>{2}}); },
      [&] { simulation.spawn_bodies("{}", {.velocity = std::vector<float>(4)}); },
      [&] { simulation.set_body_poses({.position = std::vector<float>(4)}); },
      [&] { simulation.set_body_velocities({.angular_velocity = std::vector<float>(6)}); },
      [&] { simulation.remove_bodies(std::vector<std::uint8_t>{1}); },
      [&] { simulation.step_envs({.shape = {2}, .bytes = std::vector<std::byte>(7)}); }};
  for (std::size_t i = 0; i < calls.size(); ++i) {
    const Failure refused = failure(calls[i]);
    EXPECT_EQ(refused.code, ErrorCode::invalid_argument) << i << ": " << refused.text;
    EXPECT_TRUE(contains(refused.text, ": expected ")) << refused.text;
  }
  simulation.ping();
  EXPECT_EQ(requests, 1);
}

// ------------------------------------------------------------------------------------------------------------- changed bytes

// Changes some bytes: overwrites, cuts, inserts or repeats them.
std::string changed(std::string bytes, std::mt19937& random) {
  const auto below = [&](std::size_t limit) { return std::uniform_int_distribution<std::size_t>(0, limit - 1)(random); };
  for (std::size_t n = 1 + below(3); n > 0 && !bytes.empty(); --n) {
    const std::size_t at = below(bytes.size());
    switch (below(5)) {
      case 0:
        bytes[at] = static_cast<char>(below(256));
        break;
      case 1:
        bytes[at] = static_cast<char>(static_cast<unsigned char>(bytes[at]) ^ (1U << below(8)));
        break;
      case 2:
        bytes.resize(at);
        break;
      case 3:
        bytes.insert(at, 1 + below(8), static_cast<char>(below(256)));
        break;
      default:
        bytes.insert(at, bytes.substr(below(bytes.size()), 1 + below(16)));
    }
  }
  return bytes;
}

// Every operation, each of which reads its reply in its own way.
const std::vector<std::function<void(Connection&)>>& operations() {
  static const std::vector<std::string> kNames{"position"};
  static const std::vector<std::function<void(Connection&)>> kOperations{
      [](Connection& c) { DroneController(c, 0).get_lidar_data(); },
      [](Connection& c) { DroneController(c, 0).set_location({1, 2, 3}); },
      [](Connection& c) { DroneController(c, 0).get_rotation(); },
      [](Connection& c) { DroneController(c, 0).get_camera_data(); },
      [](Connection& c) { DroneController(c, 0).get_camera_config(); },
      [](Connection& c) { DroneController(c, 0).get_lidar_config(); },
      [](Connection& c) { GameModeController(c).get_drones(); },
      [](Connection& c) { GameModeController(c).get_worlds(); },
      [](Connection& c) { GameModeController(c).get_light(); },
      [](Connection& c) { GameModeController(c).get_mesh(); },
      [](Connection& c) { GameModeController(c).get_point_cloud(0.1F); },
      [](Connection& c) { GameModeController(c).get_boxes(); },
      [](Connection& c) { GameModeController(c).get_task(); },
      [](Connection& c) { GameModeController(c).get_arrays(kNames); },
      [](Connection& c) { GameModeController(c).snapshot(); }};
  return kOperations;
}

// A right reply to any of them.
std::string right_reply(const protocol::Request& request) {
  const std::uint64_t id = request.id;
  const auto floats = [](const char* name, std::size_t rows) {
    return [name, rows](protocol::FrameWriter& writer) {
      const std::vector<float> values(3 * rows, 1.0F);
      writer.add(name, std::span<const float>(values), {rows, 3});
    };
  };
  const auto integers = [](protocol::FrameWriter& writer, const char* name) {
    const std::vector<std::int32_t> values{0, 1};
    writer.add(name, std::span<const std::int32_t>(values), {2});
  };
  const auto is = [&]<class Operation>(Operation) { return std::holds_alternative<Operation>(request.operation); };
  if (is(protocol::GetLidarData{})) return Peer::message(id, scan(), add_scan);
  if (is(protocol::SetLocation{})) return Peer::message(id, impact());
  if (is(protocol::GetRotation{})) {
    return Peer::message(
        id, protocol::Rotation{.quaternion = protocol::Quaternion{.w = 1}, .angles = protocol::Angles{.yaw_deg = 3}});
  }
  if (is(protocol::GetCameraData{})) {
    return Peer::message(id, protocol::CameraData{.step = 1, .width_px = 4, .height_px = 3}, [](auto& writer) {
      const std::vector<std::uint8_t> image(36, 9);
      writer.add("image", std::span<const std::uint8_t>(image), {3, 4, 3});
    });
  }
  if (is(protocol::GetCameraConfig{})) return Peer::message(id, protocol::Config{.config_json = R"({"width_px": 4})"});
  if (is(protocol::GetLidarConfig{})) return Peer::message(id, protocol::Config{.config_json = R"({"beams": 35})"});
  if (is(protocol::GetDrones{}))
    return Peer::message(id, protocol::Drones{.drones = {{.drone = 0}, {.drone = 1, .env = 1, .owner = 7}}});
  if (is(protocol::GetWorlds{})) {
    return Peer::message(id, protocol::Worlds{.worlds = {{.name = "office",
                                                          .min = protocol::Vector3{.x = -1},
                                                          .max = protocol::Vector3{.x = 1},
                                                          .goal = protocol::Vector3{}}}});
  }
  if (is(protocol::GetLight{})) return Peer::message(id, protocol::Config{.config_json = R"({"gamma": 2})"});
  if (is(protocol::GetMesh{})) {
    return Peer::message(id, protocol::Done{}, [&](auto& writer) {
      floats("vertices", 3)(writer);
      const std::vector<std::int32_t> triangles{0, 1, 2, 2, 1, 0};
      writer.add("triangles", std::span<const std::int32_t>(triangles), {2, 3});
      integers(writer, "objects");
    });
  }
  if (is(protocol::GetPointCloud{})) {
    return Peer::message(id, protocol::Done{}, [&](auto& writer) {
      floats("points", 2)(writer);
      floats("normals", 2)(writer);
      const std::vector<std::uint16_t> semantic{3, 4};
      writer.add("semantic", std::span<const std::uint16_t>(semantic), {2});
      integers(writer, "objects");
    });
  }
  if (is(protocol::GetBoxes{})) {
    return Peer::message(id, protocol::Done{}, [&](auto& writer) {
      floats("min", 2)(writer);
      floats("max", 2)(writer);
      integers(writer, "materials");
    });
  }
  if (is(protocol::GetTask{})) {
    protocol::Field field{.name = "action", .dtype = protocol::DType::kDtypeFloat32, .shape = {3}, .low = {-1}, .high = {1}};
    return Peer::message(id, protocol::Task{.action = field, .observation = {field}, .reward_terms = {"closer"}, .num_rows = 4});
  }
  if (is(protocol::GetArrays{})) return Peer::message(id, protocol::Time{.step = 3, .time_s = 0.3}, floats("position", 4));
  return Peer::message(id, protocol::Done{}, [](auto& writer) {
    const std::vector<std::uint8_t> bytes{1, 2, 3};
    writer.add("snapshot", std::span<const std::uint8_t>(bytes), {3});
  });
}

TEST(ClientFaults, RightRepliesAreAccepted) {
  ScriptedServer server(welcomed([](Peer& peer) {
    for (;;) peer.send(right_reply(peer.next()));
  }));
  Connection connection({.address = server.address()});
  for (const auto& operation : operations()) operation(connection);
}

// Changed replies are accepted or refused with an error; the next operation works, or the connection is closed.
TEST(ClientFaults, ChangedRepliesNeverCrash) {
  const int trials = static_cast<int>(times_tried(2000));
  std::atomic<unsigned> seed{1 + 1000000 * part_tried()};
  ScriptedServer server(welcomed([&](Peer& peer) {
    std::mt19937 random(seed);
    for (;;) {
      const protocol::Request request = peer.next();
      const std::string reply = right_reply(request);
      if (std::holds_alternative<protocol::Ping>(request.operation)) {
        peer.send(reply);
      } else if (random() % 4 == 0) {  // below WebSocket
        peer.send_raw(changed(
            std::string("\x82\x7e", 2) + static_cast<char>(reply.size() >> 8) + static_cast<char>(reply.size()) + reply, random));
        peer.socket().shutdown(boost::asio::socket_base::shutdown_send);
      } else {
        peer.send(changed(reply, random));
      }
    }
  }));
  int accepted = 0, refused = 0;
  std::optional<Connection> connection;
  for (int i = 0; i < trials; ++i) {
    if (!connection || !connection->is_open()) {
      ++seed;
      connection.reset();
      connection.emplace(client::Options{.address = server.address()});
    }
    const Failure result = failure([&] { operations()[static_cast<std::size_t>(i) % operations().size()](*connection); });
    ASSERT_NE(result.code, ErrorCode::timeout) << i;
    ++(result.code == ErrorCode() ? accepted : refused);
    if (connection->is_open() && result.code != ErrorCode()) {
      const Failure next = failure([&] { GameModeController(*connection).ping(); });
      ASSERT_TRUE(!connection->is_open() || next.code == ErrorCode()) << i << ": " << next.text;
    }
  }
  EXPECT_GT(accepted, trials / 50);
  EXPECT_GT(refused, trials / 2);
}

}  // namespace
}  // namespace flockstep
