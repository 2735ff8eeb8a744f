// The client against servers that err: gone, silent, of another version, or sending bytes that are no reply.
#include "server/scripted_server.hpp"

namespace flockstep {
namespace {

using namespace failures;

Failure connecting(const client::Options& options) {
  return failure([&] { Connection connection(options); });
}

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
    ScriptedServer server(welcomed([&](Peer& peer) {
      peer.next();
      peer.next();
      each.end(peer);
    }));
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
  return welcomed([bytes = std::move(bytes)](Peer& peer) {
    peer.next();
    peer.send(bytes);
  });
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

  ScriptedServer flags(welcomed([](Peer& peer) {
    const std::array<std::uint8_t, 2> values{0, 2};
    const std::size_t size = 2;
    peer.reply(peer.next().id, protocol::Time{}, [&](protocol::FrameWriter& writer) {
      writer.add("active", protocol::DType::kDtypeBool, std::as_bytes(std::span(values)), std::span(&size, 1));
    });
  }));
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

}  // namespace
}  // namespace flockstep
