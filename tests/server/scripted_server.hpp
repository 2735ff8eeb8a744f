// ScriptedServer: a WebSocket server that answers as a test tells it, right or wrong; its replies, and failures of a client.
#pragma once

// clang-format off: Boost 1.74 uses std::exchange without its header
#include <chrono>
#include <random>

#include <boost/asio.hpp>
#include <boost/beast/core.hpp>
#include <boost/beast/websocket.hpp>
// clang-format on

#include "flockstep/client.hpp"
#include "protocol/frame.hpp"
#include "protocol/messages.hpp"
#include "random.hpp"
#include "standard.hpp"

namespace flockstep::testing {

// A client's connection, as the script sees it. Calls throw when the client has gone.
class Peer {
 public:
  using Socket = boost::asio::ip::tcp::socket;
  using WebSocket = boost::beast::websocket::stream<Socket>;

  explicit Peer(Socket given) : stream_(std::move(given)) { socket().set_option(boost::asio::ip::tcp::no_delay(true)); }
  WebSocket& stream() { return stream_; }
  Socket& socket() { return stream_.next_layer(); }

  // Does the handshake of WebSocket.
  void accept() {
    stream_.accept();
    stream_.binary(true);
    stream_.read_message_max(0);
  }
  // Does the handshake and answers Hello.
  void welcome() {
    accept();
    const protocol::Request hello = next();
    reply(hello.id, protocol::Welcome{.protocol = protocol::kVersion, .version = "0.1.0", .client = 1, .num_envs = 4});
  }
  // Waits for the next request.
  protocol::Request next() {
    boost::beast::flat_buffer buffer;
    stream_.read(buffer);
    bytes_.assign(static_cast<const char*>(buffer.data().data()), buffer.size());
    protocol::Request request;
    protocol::read_header(bytes_, request);
    return request;
  }
  const std::string& bytes() const { return bytes_; }  // of the last request

  template <class Result>
  static std::string message(std::uint64_t id, Result result, const std::function<void(protocol::FrameWriter&)>& add = {}) {
    protocol::FrameWriter writer;
    if (add) add(writer);
    protocol::Reply reply;
    reply.id = id;
    reply.result = std::move(result);
    writer.finish(reply);
    return writer.header() + writer.values();
  }
  template <class Result>
  void reply(std::uint64_t id, Result result, const std::function<void(protocol::FrameWriter&)>& add = {}) {
    send(message(id, std::move(result), add));
  }
  void send(std::string_view message) { stream_.write(boost::asio::buffer(message)); }
  // Bytes below WebSocket.
  void send_raw(std::string_view bytes) { boost::asio::write(socket(), boost::asio::buffer(bytes)); }
  // Waits until the client has gone.
  void wait_for_end() {
    try {
      for (;;) next();
    } catch (const std::exception&) {
    }
  }

 private:
  WebSocket stream_;
  std::string bytes_;
};

// Runs the script for each connection, one after the other, in a thread.
class ScriptedServer {
 public:
  using Script = std::function<void(Peer&)>;

  explicit ScriptedServer(Script script) : script_(std::move(script)) {
    acceptor_.non_blocking(false);
    thread_ = std::thread([this] { serve(); });
  }
  ~ScriptedServer() {
    is_stopped_ = true;
    {
      const std::scoped_lock lock(mutex_);
      if (current_ != nullptr) ::shutdown(current_->socket().native_handle(), SHUT_RDWR);
    }
    boost::system::error_code ignored;
    boost::asio::ip::tcp::socket(context_).connect(acceptor_.local_endpoint(), ignored);  // ends accept()
    thread_.join();
  }
  ScriptedServer(const ScriptedServer&) = delete;
  ScriptedServer& operator=(const ScriptedServer&) = delete;

  std::string address() const { return "127.0.0.1:" + std::to_string(acceptor_.local_endpoint().port()); }

 private:
  void serve() {
    while (!is_stopped_) {
      Peer peer(acceptor_.accept());
      {
        const std::scoped_lock lock(mutex_);
        if (is_stopped_) return;
        current_ = &peer;
      }
      try {
        script_(peer);
      } catch (const std::exception&) {  // the client has gone, as many tests want
      }
      const std::scoped_lock lock(mutex_);
      current_ = nullptr;
    }
  }

  const Script script_;
  boost::asio::io_context context_;
  boost::asio::ip::tcp::acceptor acceptor_{context_, {boost::asio::ip::address_v4::loopback(), 0}};
  std::atomic<bool> is_stopped_{false};
  std::mutex mutex_;
  Peer* current_ = nullptr;
  std::thread thread_;
};

}  // namespace flockstep::testing

namespace flockstep::failures {

using namespace std::chrono_literals;
using client::Connection;
using client::DroneController;
using client::ErrorCode;
using client::GameModeController;
using client::later;
using namespace testing;

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

// A script that answers Hello first, and in the end waits until the client has gone.
template <class Script>
ScriptedServer::Script welcomed(Script script) {
  return [script = std::move(script)](Peer& peer) {
    peer.welcome();
    script(peer);
    peer.wait_for_end();
  };
}

inline bool contains(const std::string& text, const std::string& part) { return text.find(part) != std::string::npos; }

inline protocol::Impact impact() {
  return {.hit = true,
          .fraction = 0.5F,
          .location = protocol::Vector3{.x = 1, .y = 2, .z = 3},
          .rotation = protocol::Quaternion{.w = 1},
          .point = protocol::Vector3{.x = 4},
          .normal = protocol::Vector3{.z = 1}};
}

inline const std::vector<float> kRanges{1.0F, std::numeric_limits<float>::infinity()};
inline const std::vector<float> kDirections{1, 0, 0, 0, 1, 0};

inline void add_scan(protocol::FrameWriter& writer) {
  writer.add("ranges", std::span<const float>(kRanges), {1, 2});
  writer.add("directions", std::span<const float>(kDirections), {1, 2, 3});
}
inline protocol::LidarData scan() { return {.origin = protocol::Vector3{.x = 1}, .rotation = protocol::Quaternion{.w = 1}}; }

}  // namespace flockstep::failures
