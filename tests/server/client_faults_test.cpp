// The client against servers that err: gone, silent, of another version, or sending bytes that are no reply.
#include <gtest/gtest.h>

#include <algorithm>
#include <array>
#include <atomic>
#include <chrono>
#include <cstdint>
#include <functional>
#include <limits>
#include <random>
#include <span>
#include <string>
#include <thread>
#include <vector>

#include "flockstep/client.hpp"
#include "scripted_server.hpp"
#include "tried.hpp"

namespace flockstep {
namespace {

using namespace std::chrono_literals;
using client::Connection;
using client::DroneController;
using client::ErrorCode;
using client::GameModeController;
using client::later;
using testing::Peer;
using testing::ScriptedServer;

struct Failure {
  ErrorCode code = {};
  std::string text = "no error";
};

// Returns the error of a call.
template <class Call>
Failure failure(const Call& call) {
  try {
    call();
  } catch (const client::Error& error) {
    return {.code = error.code(), .text = error.what()};
  }
  return {};
}

Failure connecting(const client::Options& options) {
  return failure([&] { Connection connection(options); });
}

bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

protocol::Impact impact() {
  return {.hit = true,
          .fraction = 0.5F,
          .location = protocol::Vector3{.x = 1, .y = 2, .z = 3},
          .rotation = protocol::Quaternion{.w = 1},
          .point = protocol::Vector3{.x = 4},
          .normal = protocol::Vector3{.z = 1}};
}

const std::vector<float> kRanges{1.0F, std::numeric_limits<float>::infinity()};
const std::vector<float> kDirections{1, 0, 0, 0, 1, 0};

void add_scan(protocol::FrameWriter& writer) {
  writer.add("ranges", std::span<const float>(kRanges), {1, 2});
  writer.add("directions", std::span<const float>(kDirections), {1, 2, 3});
}
protocol::LidarData scan() { return {.origin = protocol::Vector3{.x = 1}, .rotation = protocol::Quaternion{.w = 1}}; }

// ---------------------------------------------------------------------------------------------------------------- connecting

TEST(ClientFaults, NobodyListens) {
  std::string address;
  {
    address = ScriptedServer([](Peer&) {}).address();
  }
  const Failure tcp = connecting({.address = address});
  EXPECT_EQ(tcp.code, ErrorCode::unavailable);
  EXPECT_EQ(tcp.text, "no server at " + address + ": start one with `python -m flockstep serve RECIPE`");
  const Failure unix_socket = connecting({.address = "unix:/nowhere/socket"});
  EXPECT_EQ(unix_socket.code, ErrorCode::unavailable);
  EXPECT_EQ(unix_socket.text, "no server at unix:/nowhere/socket: start one with `python -m flockstep serve RECIPE`");
  EXPECT_EQ(connecting({.address = "nowhere.invalid:41451"}).code, ErrorCode::unavailable);
}

TEST(ClientFaults, BadOptionsAreRefused) {
  for (const char* const address : {"", "127.0.0.1", "127.0.0.1:", ":41451", "127.0.0.1:0", "127.0.0.1:65536", "127.0.0.1:-1",
                                    "127.0.0.1:41451x", "::1:41451", "unix:"}) {
    const Failure refused = connecting({.address = address});
    EXPECT_EQ(refused.code, ErrorCode::invalid_argument) << address;
    EXPECT_TRUE(contains(refused.text, "address: expected HOST:PORT, [HOST]:PORT or unix:PATH, got \"")) << refused.text;
  }
  EXPECT_EQ(connecting({.address = "unix:" + std::string(200, 'x')}).code, ErrorCode::invalid_argument);
  EXPECT_EQ(connecting({.timeout = 0ms}).text, "timeout: expected a time above 0, got 0 ms");
  EXPECT_EQ(connecting({.ca_file = "ca.pem"}).text, "ca_file: expected none without tls, got \"ca.pem\"");
  EXPECT_EQ(connecting({.address = "unix:/x", .tls = true}).text, "tls: expected false for a Unix socket, got true");
  EXPECT_TRUE(contains(connecting({.tls = true, .ca_file = "/nowhere.pem"}).text, "ca_file: expected a PEM file"));
}

TEST(ClientFaults, AServerOfAnotherKind) {
  ScriptedServer web([](Peer& peer) {
    std::array<char, 4096> request{};
    peer.socket().read_some(boost::asio::buffer(request));
    peer.send_raw("HTTP/1.1 404 Not Found\r\nContent-Length: 0\r\n\r\n");
  });
  const Failure no_websocket = connecting({.address = web.address()});
  EXPECT_EQ(no_websocket.code, ErrorCode::bad_reply);
  EXPECT_TRUE(contains(no_websocket.text, "no flockstep server at " + web.address())) << no_websocket.text;

  ScriptedServer mail([](Peer& peer) {
    peer.send_raw("220 mail.example.org ESMTP\r\n");
    std::array<char, 4096> request{};
    peer.socket().read_some(boost::asio::buffer(request));  // to close with unread bytes would reset the connection
  });
  EXPECT_EQ(connecting({.address = mail.address()}).code, ErrorCode::bad_reply);

  ScriptedServer closes([](Peer& peer) {
    std::array<char, 4096> request{};
    peer.socket().read_some(boost::asio::buffer(request));
  });
  const Failure closed = connecting({.address = closes.address()});
  EXPECT_EQ(closed.code, ErrorCode::unavailable);
  EXPECT_TRUE(contains(closed.text, "If the server has a certificate, set Options::tls")) << closed.text;
  EXPECT_TRUE(contains(connecting({.address = closes.address(), .tls = true}).text, "TLS failed"));

  ScriptedServer chats([](Peer& peer) {  // a WebSocket, but none of ours
    peer.accept();
    peer.next();
    peer.send("hello");
    peer.wait_for_end();
  });
  EXPECT_EQ(connecting({.address = chats.address()}).code, ErrorCode::bad_reply);
}

TEST(ClientFaults, SilentServersTimeOut) {
  const auto silent = [](Peer& peer) {
    std::array<char, 4096> request{};
    while (peer.socket().read_some(boost::asio::buffer(request)) > 0) {
    }
  };
  const auto silent_after_the_handshake = [](Peer& peer) {
    peer.accept();
    peer.wait_for_end();
  };
  const auto check = [](const ScriptedServer::Script& script, bool tls) {
    ScriptedServer server(script);
    const auto begin = std::chrono::steady_clock::now();
    const Failure late = connecting({.address = server.address(), .timeout = 60ms, .tls = tls});
    const auto took = std::chrono::steady_clock::now() - begin;
    EXPECT_EQ(late.code, ErrorCode::timeout) << late.text;
    EXPECT_GE(took, 60ms);
    EXPECT_LT(took, 5s);
  };
  check(silent, false);
  check(silent, true);
  check(silent_after_the_handshake, false);
}

TEST(ClientFaults, AnotherVersion) {
  ScriptedServer newer([](Peer& peer) {
    peer.accept();
    peer.reply(peer.next().id, protocol::Welcome{.protocol = 3, .version = "9.8.7"});
    peer.wait_for_end();
  });
  const Failure mismatch = connecting({.address = newer.address()});
  EXPECT_EQ(mismatch.code, ErrorCode::failed_precondition);
  EXPECT_EQ(mismatch.text,
            "protocol: expected version 2, which this client has, got 3 of the server (flockstep 9.8.7); "
            "install the same version on both sides");
}

TEST(ClientFaults, TheServerSaysWhyItRefuses) {
  ScriptedServer server([](Peer& peer) {
    peer.accept();
    const protocol::Request hello = peer.next();
    EXPECT_EQ(std::get<protocol::Hello>(hello.operation).token, "secret");
    EXPECT_EQ(std::get<protocol::Hello>(hello.operation).protocol, protocol::kVersion);
    peer.reply(hello.id, protocol::Error{.code = protocol::Code::kUnauthenticated, .text = "token: wrong"});
  });
  const Failure refused = connecting({.address = server.address(), .token = "secret"});
  EXPECT_EQ(refused.code, ErrorCode::unauthenticated);
  EXPECT_EQ(refused.text, "token: wrong");
}

// ------------------------------------------------------------------------------------------------------------------- replies

TEST(ClientFaults, AServerThatEndsInTheMiddle) {
  struct Case {
    std::function<void(Peer&)> end;
    std::string text;
  };
  const std::vector<Case> cases{
      {[](Peer& peer) { peer.socket().close(); }, " is gone"},
      {[](Peer& peer) {
         const std::string half = Peer::message(2, impact());
         peer.send_raw(std::string("\x82", 1) + static_cast<char>(half.size()) + half.substr(0, 10));
         peer.socket().close();
       },
       " is gone"},
      {[](Peer& peer) { peer.stream().close({boost::beast::websocket::close_code::going_away, "the server stops"}); },
       " closed the connection: the server stops"},
      {[](Peer& peer) { peer.reply(0, protocol::Error{.code = protocol::Code::kInternal, .text = "out of order"}); },
       "out of order"}};
  for (const Case& each : cases) {
    ScriptedServer server([&](Peer& peer) {
      peer.welcome();
      peer.next();
      peer.next();
      each.end(peer);
      peer.wait_for_end();
    });
    Connection connection({.address = server.address()});
    DroneController drone(connection, 0);
    auto first = drone.set_location(later, {1, 2, 3});
    auto second = drone.get_location(later);
    const Failure of_first = failure([&] { first.get(); });
    EXPECT_TRUE(contains(of_first.text, each.text)) << of_first.text;
    EXPECT_EQ(failure([&] { second.get(); }).text, of_first.text);
    EXPECT_EQ(failure([&] { drone.ping(); }).text, of_first.text);
    EXPECT_FALSE(connection.is_open());
  }
}

// Serves one operation with these bytes for the request with id 2.
ScriptedServer::Script answering(std::string bytes) {
  return [bytes = std::move(bytes)](Peer& peer) {
    peer.welcome();
    peer.next();
    peer.send(bytes);
    peer.wait_for_end();
  };
}

Failure scan_of(const ScriptedServer& server) {
  return failure([&] { DroneController(Connection({.address = server.address(), .timeout = 5s}), 0).get_lidar_data(); });
}

TEST(ClientFaults, TruncatedReplies) {
  const std::string whole = Peer::message(2, scan(), add_scan);
  EXPECT_EQ(scan_of(ScriptedServer(answering(whole))).text, "no error");
  for (std::size_t size = 0; size < whole.size(); ++size) {
    EXPECT_EQ(scan_of(ScriptedServer(answering(whole.substr(0, size)))).code, ErrorCode::bad_reply) << size;
  }
  EXPECT_EQ(scan_of(ScriptedServer(answering(whole + 'x'))).code, ErrorCode::bad_reply);
}

TEST(ClientFaults, RepliesThatNobodyAskedFor) {
  EXPECT_EQ(scan_of(ScriptedServer(answering(Peer::message(3, scan(), add_scan)))).text,
            "the server does not speak this client's protocol: a reply to request 3, which was not sent");
  EXPECT_EQ(scan_of(ScriptedServer(answering(Peer::message(1, protocol::Done{})))).code, ErrorCode::bad_reply);
}

TEST(ClientFaults, RepliesOfAnotherForm) {
  const std::vector<float> more(6, 1.0F);
  const auto ranges = [](protocol::FrameWriter& writer) { writer.add("ranges", std::span<const float>(kRanges), {1, 2}); };
  const std::vector<std::string> replies{
      Peer::message(2, impact()),
      Peer::message(2, scan()),
      Peer::message(2, protocol::Done{}),
      Peer::message(2, protocol::LidarData{.origin = protocol::Vector3{}}, add_scan),
      Peer::message(2, scan(), [](auto& writer) { writer.add("ranges", std::span<const float>(kRanges), {2}); }),
      Peer::message(2, scan(),
                    [](auto& writer) {
                      const std::vector<double> wide(2);
                      writer.add("ranges", std::span<const double>(wide), {1, 2});
                    }),
      Peer::message(2, scan(), [&](auto& writer) {
        ranges(writer);
        writer.add("directions", std::span<const float>(more), {2, 1, 3});
      })};
  for (std::size_t i = 0; i < replies.size(); ++i) {
    EXPECT_EQ(scan_of(ScriptedServer(answering(replies[i]))).code, ErrorCode::bad_reply) << i;
  }
  EXPECT_EQ(scan_of(ScriptedServer(answering(Peer::message(2, scan(), ranges)))).text, "no error");

  ScriptedServer flags([](Peer& peer) {
    peer.welcome();
    const std::array<std::uint8_t, 2> values{0, 2};
    const std::size_t size = 2;
    peer.reply(peer.next().id, protocol::Time{}, [&](protocol::FrameWriter& writer) {
      writer.add("active", protocol::DType::kDtypeBool, std::as_bytes(std::span(values)), std::span(&size, 1));
    });
    peer.wait_for_end();
  });
  Connection connection({.address = flags.address()});
  EXPECT_EQ(failure([&] { GameModeController(connection).get_array("active"); }).code, ErrorCode::bad_reply);
  EXPECT_TRUE(connection.is_open());
}

TEST(ClientFaults, ARepliesLimit) {
  ScriptedServer server(answering(Peer::message(2, scan(), add_scan)));
  const Failure refused =
      failure([&] { DroneController(Connection({.address = server.address(), .max_message_bytes = 64}), 0).get_lidar_data(); });
  EXPECT_EQ(refused.code, ErrorCode::resource_exhausted);
  EXPECT_TRUE(contains(refused.text, "max_message_bytes")) << refused.text;
}

TEST(ClientFaults, LateRepliesAndTimeouts) {
  std::atomic<bool> may_answer{false};
  ScriptedServer server([&](Peer& peer) {
    peer.welcome();
    const std::uint64_t first = peer.next().id, second = peer.next().id;
    while (!may_answer) std::this_thread::sleep_for(1ms);
    peer.reply(first, protocol::Vector3{.x = 1});
    peer.reply(second, protocol::Vector3{.x = 2});
    peer.reply(peer.next().id, protocol::Done{});
    peer.wait_for_end();
  });
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
  ScriptedServer server([](Peer& peer) {
    peer.welcome();
    for (int i = 0; i < 100; ++i) peer.reply(peer.next().id, protocol::Vector3{.x = static_cast<float>(i)});
    peer.wait_for_end();
  });
  DroneController drone(Connection({.address = server.address()}), 0);
  std::vector<client::Future<client::Vector3>> futures;
  for (int i = 0; i < 100; ++i) futures.push_back(drone.get_location(later));
  for (int i = 99; i >= 0; --i) EXPECT_EQ(futures[static_cast<std::size_t>(i)].get()[0], static_cast<float>(i));
}

TEST(ClientFaults, ThreadsShareAConnection) {
  constexpr int kThreads = 4, kCalls = 300;
  ScriptedServer server([](Peer& peer) {
    peer.welcome();
    for (;;) {
      const protocol::Request request = peer.next();
      peer.reply(request.id,
                 protocol::Vector3{.x = static_cast<float>(std::get<protocol::GetLocation>(request.operation).drone)});
    }
  });
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
  ScriptedServer server([&](Peer& peer) {
    peer.welcome();
    const std::uint64_t get = peer.next().id;
    peer.reply(get, protocol::Done{}, [&](auto& writer) {
      writer.add("snapshot", std::span<const std::uint8_t>(large), {large.size()});
    });  // which reads nothing in the meantime
    const std::uint64_t set = peer.next().id;
    EXPECT_GT(peer.bytes().size(), large.size());
    peer.reply(set, protocol::Done{});
    peer.wait_for_end();
  });
  GameModeController simulation(Connection({.address = server.address()}));
  auto snapshot = simulation.snapshot(later);
  simulation.restore(large);
  EXPECT_EQ(snapshot.get(), large);
}

// ------------------------------------------------------------------------------------------------------------------- streams

TEST(ClientFaults, StreamsGiveTheNewestValueAndEnd) {
  std::uint64_t unsubscribed = 0;
  ScriptedServer server([&](Peer& peer) {
    peer.welcome();
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
    peer.wait_for_end();
  });
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
  ScriptedServer server([&](Peer& peer) {
    peer.welcome();
    for (;;) {
      const std::uint64_t id = peer.next().id;
      ++requests;
      peer.reply(id, protocol::Done{});
    }
  });
  Connection connection({.address = server.address()});
  GameModeController simulation(connection);
  DroneController drone(connection, 0);
  const float nan = std::numeric_limits<float>::quiet_NaN(), inf = std::numeric_limits<float>::infinity();
  const std::vector<std::function<void()>> calls{
      [&] { drone.set_location({nan, 0, 0}); },
      [&] { drone.set_rotation(client::Quaternion{1, 0, inf, 0}); },
      [&] { drone.set_rotation(client::Angles{.pitch_deg = nan}); },
      [&] { drone.set_location_and_rotation({0, 0, inf}, client::Angles{}); },
      [&] { drone.stream_lidar(std::numeric_limits<double>::infinity()); },
      [&] { simulation.spawn_drone({.location = client::Vector3{nan, 0, 0}}); },
      [&] { simulation.set_clock(std::numeric_limits<double>::quiet_NaN()); },
      [&] { simulation.get_point_cloud(nan); },
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
  ScriptedServer server([](Peer& peer) {
    peer.welcome();
    for (;;) peer.send(right_reply(peer.next()));
  });
  Connection connection({.address = server.address()});
  for (const auto& operation : operations()) operation(connection);
}

// Changed replies are accepted or refused with an error; the next operation works, or the connection is closed.
TEST(ClientFaults, ChangedRepliesNeverCrash) {
  const int trials = static_cast<int>(testing::times_tried(2000));
  std::atomic<unsigned> seed{1 + 1000000 * testing::part_tried()};
  ScriptedServer server([&](Peer& peer) {
    std::mt19937 random(seed);
    peer.welcome();
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
  });
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
