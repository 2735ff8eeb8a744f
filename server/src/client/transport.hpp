// Transport: sends and receives WebSocket messages over a socket, without blocking. advance() does all work; no thread of its
// own.
#pragma once

// clang-format off: Boost 1.74 uses std::exchange without its header
#include <utility>
#include <boost/asio/buffer.hpp>
#include <boost/beast/core/flat_buffer.hpp>
// clang-format on

#include <functional>
#include <memory>
#include <string>
#include <string_view>

#include "client/socket.hpp"
#include "flockstep/client.hpp"

namespace flockstep::client {

using Message = boost::beast::flat_buffer;

class Transport {
 public:
  // Called from advance().
  struct Events {
    std::function<void()> opened;
    std::function<void(Message&)> received;                     // may take the message, and leaves an empty one for the next
    std::function<void(ErrorCode, const std::string&)> failed;  // once; nothing else follows
  };

  virtual ~Transport() = default;
  // Begins the handshakes of TLS and WebSocket.
  virtual void open(Events events) = 0;
  // Begins to send a message of two parts, which must stay unchanged until `sent` is called, from advance(). One at a time.
  virtual void send(std::string_view header, std::string_view values, std::function<void()> sent) = 0;
  // Tells the server that the connection ends, if this is possible without waiting.
  virtual void close() = 0;
  // Does what is possible now. may_read: whether the socket may have bytes to read.
  virtual void advance(bool may_read) = 0;
  // Returns true if advance() can go on once the socket can be written.
  virtual bool wants_to_write() const = 0;
  virtual Socket& socket() = 0;
};

// Connects the socket; see Transport::open() for the rest. Throws Error.
std::unique_ptr<Transport> make_transport(const Options& options, Clock::time_point deadline);

}  // namespace flockstep::client
